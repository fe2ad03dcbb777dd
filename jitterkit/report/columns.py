"""The columns of a results table: name, unit and meaning, said once."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

__all__ = ["COLUMNS", "Column", "aberration_column", "aberration_columns"]


@dataclass(frozen=True)
class Column:
    """One column.

    Attributes
    ----------
    name : str
    description : str
    unit : str
        As astropy reads it; empty for a pure number or text.
    kind : type
        ``float``, ``int`` or ``str``.
    """

    name: str
    description: str
    unit: str = ""
    kind: type = float

    @property
    def blank(self) -> Any:
        """What stands where nothing is known: NaN, 0 or an empty text."""
        return math.nan if self.kind is float else self.kind()


def _measured(name: str, description: str, unit: str = "") -> list[Column]:
    return [Column(name, description, unit), Column(f"{name}_err", f"standard error of {name}", unit)]


COLUMNS: tuple[Column, ...] = (
    Column("file", "name of the file", kind=str),
    Column("frame", "place of the frame in its file, from 0", kind=int),
    Column("time", "time of the exposure, ISO 8601, UTC", kind=str),
    Column("exposure", "exposure time", "s"),
    Column("status", "how the frame ended: ok, or why its numbers are not to be used", kind=str),
    Column("reason", "code of what is wrong with a frame that is not ok; empty for one that is", kind=str),
    Column("message", "the status in a sentence", kind=str),
    Column("flags", "sum of the remarks whose values the table's metadata explains", kind=int),
    Column("scene", "scene that was fitted, star, binary or stars: what it does not have is empty", kind=str),
    Column("locus", "jitter locus that was fitted", kind=str),
    Column(
        "locus_weight", "weight of that locus among the candidates, 0 to 1; below 0.95 the frame is undecided"
    ),
    *_measured("separation", "angular distance from A, the brighter star, to B", "arcsec"),
    Column("separation_crlb", "Cramer-Rao bound of separation from this frame alone, 1 sigma", "arcsec"),
    Column(
        "separation_spread", "weighted rms of separation over the candidates: does not average out", "arcsec"
    ),
    Column(
        "separation_model_err",
        "part of separation_err by errors of the model: alike in all frames, does not average out",
        "arcsec",
    ),
    *_measured("theta", "direction from A to B, counter-clockwise from +x", "deg"),
    *_measured("pa", "position angle from A to B on the sky, north through east", "deg"),
    *_measured("x", "the brightest star or the midpoint of the pair, from the frame's centre", "arcsec"),
    *_measured("y", "the brightest star or the midpoint of the pair, from the frame's centre", "arcsec"),
    Column("x_pixel", "the brightest star or the midpoint of the pair in the original frame, from 0", "pix"),
    Column("y_pixel", "the brightest star or the midpoint of the pair in the original frame, from 0", "pix"),
    *_measured(
        "flux",
        "electrons per frame from the brightest star or the pair, inside the frame or not",
        "electron",
    ),
    *_measured("contrast", "flux of A over flux of B"),
    *_measured("spectral_index_a", "slope of the spectrum of A, or of the star, over the instrument's"),
    *_measured("spectral_index_b", "slope of the spectrum of B over the instrument's"),
    *_measured("wavelength_shift", "mean wavelength less the instrument's", "nm"),
    *_measured("sxx", "second moment of the pointing", "arcsec2"),
    *_measured("sxy", "second moment of the pointing", "arcsec2"),
    *_measured("syy", "second moment of the pointing", "arcsec2"),
    Column("jitter_major", "1 sigma of the pointing along its major axis", "arcsec"),
    Column("jitter_minor", "1 sigma of the pointing along its minor axis", "arcsec"),
    Column("jitter_angle", "major axis, counter-clockwise from +x, 0 to 180", "deg"),
    Column("jitter_length", "full length of a linear smear, peak to peak of an oscillation", "arcsec"),
    *_measured("shape", "excess kurtosis of the blur: normal 0, linear -1.2, oscillation -1.5"),
    *_measured("background", "electrons per pixel", "electron"),
    Column("chi2_dof", "Pearson's chi-squared per degree of freedom"),
    Column("model_error", "error of the model that was allowed for, as a share of the light, 0 for none"),
    Column("dof", "degrees of freedom: pixels used less parameters; 0 of a frame without a fit", kind=int),
    Column(
        "candidates",
        "loci compared, best first, as JSON; objective is deviance and priors, evidence a logarithm",
        kind=str,
    ),
    Column("stars", "all stars of a frame that shows more than a pair, as JSON; see stars.ecsv", kind=str),
    Column("further_limit", "light from which a further star would have been found", "electron"),
    Column("iterations", "steps of the fit", kind=int),
    Column("seconds", "time the frame took", "s"),
    Column("digest", "identifies the raw pixels of the frame", kind=str),
    Column("path", "the file as it was given", kind=str),
)
"""In the order of the table; the aberrations, whose names the telescope gives, follow ``shape_err``."""

_NAMES = frozenset(column.name for column in COLUMNS)


def aberration_column(name: str) -> str:
    """Column of an aberration: its own name, unless a column has that already.

    >>> aberration_column("noll4"), aberration_column("flux")
    ('noll4', 'aberration_flux')
    """
    return f"aberration_{name}" if {name, f"{name}_err"} & _NAMES else name


def aberration_columns(name: str) -> list[Column]:
    """Both columns of an aberration."""
    return _measured(name, "coefficient of the aberration", "nm")
