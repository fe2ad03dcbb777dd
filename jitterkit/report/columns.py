"""Declare the columns of tables: name, unit, meaning and format.

Every table is made by :func:`bind` or :func:`bind_rows`, of a :class:`Column` for each column.  ``COLUMNS``
are those of a results table, which other tables take by :func:`named`; :func:`unit_of` knows the unit of
every parameter, size and setting.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from astropy.table import QTable
from astropy.units import Unit

_ASCII = str.maketrans(
    {"²": "2", "³": "3", "µ": "u", "±": "+/-", "°": " deg", "″": '"', "′": "'", "√": "sqrt "}
)
"""Signs of messages as a FITS table can hold them."""


@dataclass(frozen=True)
class Column:
    """Describe one column.

    Attributes
    ----------
    name : str
    description : str
    unit : str
        As astropy reads it; empty for a pure number or text.
    kind : type
        ``float``, ``int``, ``bool`` or ``str``.
    format : str
        Of a printed cell; empty for all digits.  Files have all digits.
    """

    name: str
    description: str = ""
    unit: str = ""
    kind: type = float
    format: str = ""

    @property
    def blank(self) -> Any:
        """Return the value of an unknown cell: NaN, 0 or an empty text."""
        return math.nan if self.kind is float else self.kind()


def measured(name: str, description: str, unit: str = "", format: str = "") -> list[Column]:
    """Return the columns of a quantity and of its standard error."""
    error = Column(f"{name}_err", f"standard error of {name}", unit, format=format)
    return [Column(name, description, unit, format=format), error]


def bind(
    columns: Iterable[tuple[Column, Any]], meta: Mapping[str, Any] | None = None, *, format: str = ""
) -> QTable:
    """Make a table of columns and their values.

    Parameters
    ----------
    columns : iterable of (Column, sequence)
        Values in the column's unit.
    meta : mapping, optional
    format : str
        Of numbers whose column has no format.

    Returns
    -------
    table : QTable
    """
    table = QTable(meta=dict(meta or {}))
    for column, values in columns:
        if column.name == "message":
            values = [message.translate(_ASCII) for message in values]
        cells: Any = np.asarray(values, dtype=column.kind)
        table.add_column(cells << Unit(column.unit) if column.unit else cells, name=column.name, copy=False)
        info = table[column.name].info
        info.description = column.description or None
        info.format = column.format or (format if column.kind is float else "") or None
    return table


def bind_rows(
    columns: Sequence[Column], rows: Iterable[Sequence], meta: Mapping[str, Any] | None = None, **options: Any
) -> QTable:
    """Make a table of rows, which may be none, as :func:`bind` does of columns."""
    cells = list(zip(*rows, strict=True)) or [()] * len(columns)
    return bind(zip(columns, cells, strict=True), meta, **options)


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
    *measured("separation", "angular distance from A, the brighter star, to B", "arcsec"),
    Column("separation_crlb", "Cramer-Rao bound of separation from this frame alone, 1 sigma", "arcsec"),
    Column(
        "separation_spread", "weighted rms of separation over the candidates: does not average out", "arcsec"
    ),
    Column(
        "separation_model_err",
        "part of separation_err by errors of the model: alike in all frames, does not average out",
        "arcsec",
    ),
    Column(
        "separation_scale_err",
        "error of separation by that of the plate scale, not part of separation_err: does not average out",
        "arcsec",
    ),
    Column("va_factor", "velocity aberration: separation seen from the barycentre over that seen here"),
    Column("orbit_change", "growth of separation by orbital motion since the reference epoch", "arcsec"),
    Column(
        "separation_corrected",
        "separation times va_factor, less orbit_change; as far as these are known, empty if neither is",
        "arcsec",
    ),
    *measured("theta", "direction from A to B, counter-clockwise from +x", "deg"),
    *measured("pa", "position angle from A to B on the sky, north through east", "deg"),
    *measured("x", "the brightest star or the midpoint of the pair, from the frame's centre", "arcsec"),
    *measured("y", "the brightest star or the midpoint of the pair, from the frame's centre", "arcsec"),
    Column("x_pixel", "the brightest star or the midpoint of the pair in the original frame, from 0", "pix"),
    Column("y_pixel", "the brightest star or the midpoint of the pair in the original frame, from 0", "pix"),
    *measured(
        "flux",
        "electrons per frame from the brightest star or the pair, inside the frame or not",
        "electron",
    ),
    *measured("contrast", "flux of A over flux of B"),
    *measured("spectral_index_a", "slope of the spectrum of A, or of the star, over the instrument's"),
    *measured("spectral_index_b", "slope of the spectrum of B over the instrument's"),
    *measured("wavelength_shift", "by which all wavelengths are longer than the instrument's", "nm"),
    *measured("plate_scale_shift", "plate scale over the one stated, less one"),
    *measured("sxx", "second moment of the pointing", "arcsec2"),
    *measured("sxy", "second moment of the pointing", "arcsec2"),
    *measured("syy", "second moment of the pointing", "arcsec2"),
    Column("jitter_major", "1 sigma of the pointing along its major axis", "arcsec"),
    Column("jitter_minor", "1 sigma of the pointing along its minor axis", "arcsec"),
    Column("jitter_angle", "major axis, counter-clockwise from +x, 0 to 180", "deg"),
    Column("jitter_length", "full length of a linear smear, peak to peak of an oscillation", "arcsec"),
    *measured("shape", "excess kurtosis of the blur: normal 0, linear -1.2, oscillation -1.5"),
    *measured("background", "electrons per pixel, at the centre of the frame", "electron"),
    *measured("background_x", "gradient of the background along x, per pixel", "electron / arcsec"),
    *measured("background_y", "gradient of the background along y, per pixel", "electron / arcsec"),
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

SHIFTS = ("wavelength_shift", "plate_scale_shift")
"""Columns that are parameters of the optics too, as :mod:`jitterkit.optics.otf` has them."""

_NAMES = frozenset(column.name for column in COLUMNS)

_SIZES = {
    "arcsec": "length length1 length2 sigma_major sigma_minor semi_major semi_minor amplitude_x amplitude_y "
    "partial_x partial_y",
    "deg": "angle angle1 angle2 phase sigma_angle smear_direction",
    "electron": "read_noise full_well",
    "electron/adu": "gain",
    "arcsec/s": "velocity_x velocity_y",
}
"""Parameters, sizes and settings that are no column of a results table, by their unit."""

_UNITS = {column.name: column.unit for column in COLUMNS} | {
    name: unit for unit, names in _SIZES.items() for name in names.split()
}


def named(*names: str) -> list[Column]:
    """Return columns of a results table by name."""
    return [next(column for column in COLUMNS if column.name == name) for name in names]


def aberration_column(name: str) -> str:
    """Return the column of an aberration: its own name, unless a column of another meaning has that already.

    >>> aberration_column("noll4"), aberration_column("flux"), aberration_column("wavelength_shift")
    ('noll4', 'aberration_flux', 'wavelength_shift')
    """
    taken = {name, f"{name}_err"} & _NAMES and name not in SHIFTS
    return f"aberration_{name}" if taken else name


def aberration_columns(name: str) -> list[Column]:
    """Return both columns of an aberration."""
    unit = "" if name.startswith("transmission_") else "nm"
    return measured(name, "coefficient of the aberration", unit)


def unit_of(name: str) -> str:
    """Return the unit of a column, parameter, size or setting, as astropy reads it; empty for a pure number.

    >>> unit_of("noll4"), unit_of("mvn_xx"), unit_of("skewed_xxy"), unit_of("contrast")
    ('nm', 'arcsec2', 'arcsec3', '')
    """
    if name in _UNITS:
        return _UNITS[name]
    if name.startswith("noll"):
        return "nm"
    if name.startswith("path"):
        return "arcsec"
    if name.endswith(("_xxx", "_xxy", "_xyy", "_yyy")):
        return "arcsec3"
    return "arcsec2" if name.endswith(("_xx", "_xy", "_yy", "_c", "_s")) else ""
