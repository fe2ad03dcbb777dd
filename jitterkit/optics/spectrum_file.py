"""Curves over wavelength from CSV files, and a spectrum as few wavelengths that are worth as much.

Reach for :func:`read_spectrum`; :func:`read_curve` reads any other curve (a filter, a quantum
efficiency) in the same format.  A measured spectrum may have hundreds of rows; an image needs some ten
wavelengths.  The nodes and weights of the Gauss quadrature that belongs to *this* spectrum integrate
every polynomial of degree ``2 n - 1`` in wavelength exactly against it
(:meth:`~jitterkit.optics.spectrum.Spectrum.sampled`).
"""

from __future__ import annotations

import csv
import re
from pathlib import Path

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode, reading_code
from jitterkit.optics.spectrum import Spectrum


def read_spectrum(path: str | Path, samples: int = 13) -> Spectrum:
    """Read a spectrum from a CSV table.

    Parameters
    ----------
    path : str or Path
        Two columns, wavelength [nm] ascending and photons per nm in any unit, separated by commas;
        a first line of words and lines that begin with ``#`` are skipped.  The first, and a comment of two
        columns right above the numbers, must not name other units.
    samples : int
        Wavelengths to model with.

    Returns
    -------
    spectrum : Spectrum

    Raises
    ------
    ConfigurationError
        If the file is not such a table; the message names the line.
    """
    wavelengths, photons = read_curve(path, "photons")
    try:
        return band_from_table(wavelengths, photons, samples)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{path}: {error}") from None


def read_curve(path: str | Path, values: str) -> tuple[np.ndarray, np.ndarray]:
    """Read a curve over wavelength from a CSV table.

    Parameters
    ----------
    path : str or Path
        Two columns, wavelength [nm] and value, as in :func:`read_spectrum`.
    values : str
        What the second column holds, for the complaint: its names must not say energy of ``photons``, nor per
        cent, densities or responsivities of a ``share``.

    Returns
    -------
    wavelengths, values : (m,) arrays
        As they stand in the file, in whatever order.

    Raises
    ------
    ConfigurationError
        If the file is not such a table, or its names say other units; the message names the line.
    """
    try:
        wavelengths, read = np.array(_rows(Path(path), values), dtype=float).reshape(-1, 2).T
    except (OSError, UnicodeDecodeError) as error:
        problem = f"{path}: cannot be read ({error}); give a CSV of wavelength_nm, {values}."
        raise ConfigurationError(reading_code(error), problem) from None
    return wavelengths, read


def band_from_table(wavelengths: np.ndarray, photons: np.ndarray, samples: int = 13) -> Spectrum:
    """Return the Gauss quadrature of a tabulated spectrum.

    Parameters
    ----------
    wavelengths : (m,) array
        nm, ascending.
    photons : (m,) array
        Photons per nm, in any unit; straight lines between the rows, nothing outside.
    samples : int
        Number of nodes.

    Returns
    -------
    spectrum : Spectrum
        A table of two equal rows gives :func:`~jitterkit.optics.spectrum.flat_band`.

    Raises
    ------
    ConfigurationError
        If there are fewer than two rows, they are out of order or negative, or no light is in them.
    """
    if len(wavelengths) < 2 or samples < 1:
        code = ErrorCode.TOO_FEW if len(wavelengths) < 2 else ErrorCode.OUT_OF_RANGE
        problem = f"A spectrum of {len(wavelengths)} rows cannot be modelled with {samples} samples"
        raise ConfigurationError(code, f"{problem}; give 2 rows and 1 sample at least.")
    if not (np.all(np.isfinite(photons)) and np.all(photons >= 0) and np.any(photons > 0)):
        problem = "A spectrum's photons must not be negative, nor all zero"
        found = f"and they reach from {np.min(photons):g} to {np.max(photons):g}; correct the table"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, {found}.")
    in_place = wavelengths > np.append(0.0, wavelengths[:-1])
    if not in_place.all():
        problem = "A spectrum's wavelengths must be positive and ascend, in nm"
        found = f"and {wavelengths[~in_place][0]:g} is out of place; sort the table"
        raise ConfigurationError(ErrorCode.MALFORMED, f"{problem}, {found}.")
    at, weight = _fine(wavelengths, photons, samples + 1)
    return Spectrum(tuple(at), tuple(weight)).sampled(samples)


def _fine(wavelengths: np.ndarray, photons: np.ndarray, points: int) -> tuple[np.ndarray, np.ndarray]:
    """A fine quadrature: each interval's is exact for its straight line times degree ``2 points - 2``."""
    nodes, weights = np.polynomial.legendre.leggauss(points)
    half, middle = np.diff(wavelengths)[:, None] / 2, (wavelengths[1:] + wavelengths[:-1])[:, None] / 2
    at = (middle + half * nodes).ravel()
    weight = (half * weights).ravel() * np.interp(at, wavelengths, photons)
    lit = weight > 0
    return at[lit], weight[lit]


def _rows(path: Path, values: str) -> list[tuple[float, float]]:
    rows: list[tuple[float, float]] = []
    names: list[str] = []
    said: list[str] = []  # the last comment above the numbers, which names columns where it has as many cells
    with path.open(newline="", encoding="utf-8-sig") as handle:
        for number, cells in enumerate(csv.reader(handle), start=1):
            if not cells or cells[0].lstrip().startswith("#"):
                said = said if rows or not cells else [cells[0].lstrip(" #"), *cells[1:]]
                continue
            try:
                wavelength, value = map(float, cells)
            except ValueError:
                if not names and not rows:
                    names = cells
                    continue
                problem = f"{path}: line {number} is {','.join(cells)!r}; give wavelength_nm, {values}."
                raise ConfigurationError(ErrorCode.MALFORMED, problem) from None
            rows.append((wavelength, value))
    for columns in (names, said if len(said) == 2 and _WAVELENGTH.search(said[0]) else []):
        if columns:
            _refuse_other_units(path, columns, values)
    return rows


_WAVELENGTH = re.compile(r"wave|^lam|λ|^wl|freq|energy", re.I)
"""A comment's first word where it names columns, and is no prose."""

_NO_NANOMETRES = re.compile(
    r"[\s_(\[/](angstroms?|aa?|å|[uµμ]m|microns?|[mc]?m|[kmgt]hz|ev)\W*$|freq|wave-?number|energy|1/cm|cm\W?-1",
    re.I,
)
_NO_PHOTONS = re.compile(
    r"erg|joule|watt|(?<![a-z])w(?![a-z])|jy|flam|f_?lambda|fnu|energy|(?<![a-z])mag(s|nitude\w*)?(?![a-z])"
    r"|(?<!photon.)(?<!photons.)(?<!photon)(flux|power|irradiance|(?<!ir)radiance)"
    r"(?!.*(photon|electron|count|(?<![a-z])ph(?![a-z])))",
    re.I,
)

_NO_SHARE = re.compile(
    r"%(?!\W*/ ?100)|per-?cent|(?<![a-z])(pct|od|db|m?a ?/ ?w)(?![a-z\d])|optical[\W_]?density|absorbance"
    r"|absorptance|(?<![-\d])absorption|responsiv|reflectance|^\W*(reflection|extinction)",
    re.I,
)


def _refuse_other_units(path: Path, names: list[str], values: str) -> None:
    """Raise ConfigurationError if the names of the columns say another unit, or another quantity."""
    if found := _NO_NANOMETRES.search(names[0]):
        wrong, wanted = found[0], "wavelengths in nm"
    elif values == "photons" and (found := _NO_PHOTONS.search(" ".join(names[1:]))):
        wrong, wanted = found[0], "photons per nm: of a power per nm, multiply it by the wavelength"
    elif values == "share" and (found := _NO_SHARE.search(" ".join(names[1:]))):
        wrong, wanted = found[0], "the share of the photons that passes or is detected, 0 to 1"
    else:
        return
    problem = f"{path}: the names {','.join(names)!r} say {wrong.strip(' _([/])')!r}"
    raise ConfigurationError(ErrorCode.UNKNOWN_UNIT, f"{problem}; give {wanted}.")
