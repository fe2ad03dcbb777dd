"""Classify the pattern of the smear over the field: tracking, optics or rotation.

A pointing error smears every star alike.  Optics smear along or across the line to the axis, the more the
farther out: coma and astigmatism.  A field that rotates about a guide star draws arcs about it, so
tangential streaks about a point that need not be the frame's centre.  In the moments' complex
ellipticity ``e = (Sxx - Syy) + 2i Sxy`` all three are polynomials of the position ``z = x + iy``:

    tracking   e = c
    optics     e = a z²           a > 0 radial, a < 0 tangential
    rotation   e = a (z - z0)²    a < 0: arcs about z0

The lengths of the streaks grow with the distance, their squares with its square.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from scipy.optimize import least_squares

from jitterkit.conventions import axis_angle

_LEAST = 8
"""Smallest number of stars that is classified."""

_BETTER = 12.0
"""Chi-squared that a further term must explain: 3.5 sigma; a scatter that is noise explains less."""

_IRREGULAR = 45.0
"""Chi-squared that a smooth field must explain beyond one direction: 1e-5 by chance, of ten terms."""

_NOTABLE = 0.1
"""Share of the smear's power above which a part is named."""


@dataclass(frozen=True)
class FieldPattern:
    """Hold the class of the stars' elongation over a field.

    Attributes
    ----------
    kind : str
        ``smear`` (one direction everywhere), ``radial`` or ``tangential`` (optics), ``rotation`` (arcs about
        a point off the centre), ``mixed`` (smear and a pattern), ``round``, ``irregular`` (long, but
        neither), ``sharp`` (as the reference is), or ``undetermined``.
    sentence : str
        The class with its numbers.
    angle, angle_err : float
        Of the common direction [deg].
    smear_share, pattern_share : float
        Of the stars' squared ellipticity, beyond noise: explained by one direction everywhere, and by
        a radial or tangential pattern alone.
    chi2 : dict of str to float
        Of each model: ``round``, ``smear``, ``pattern``, ``both``, ``rotation``; noise and the scatter
        that no model explains count as errors.
    dof : int
        Numbers that went in, two a star.
    centre : (float, float) or None
        Of the rotation, ``(x, y)`` in pixels from the frame's centre.
    """

    kind: str
    sentence: str
    angle: float
    angle_err: float
    smear_share: float
    pattern_share: float
    chi2: dict[str, float]
    dof: int
    centre: tuple[float, float] | None = None


class _Fit(NamedTuple):
    """Hold a linear model of the ellipticities: its terms, their covariance and its chi-squared."""

    terms: np.ndarray
    covariance: np.ndarray
    chi2: float


def classify_field(
    x: np.ndarray,
    y: np.ndarray,
    moments: np.ndarray,
    covariance: np.ndarray,
    *,
    shared: np.ndarray | None = None,
    direction: tuple[float, float] | None = None,
) -> FieldPattern:
    """Distinguish tracking from optics.

    Parameters
    ----------
    x, y : (n,) array
        Positions of the stars from the frame's centre, pixels.
    moments : (n, 3) array
        ``(Sxx, Sxy, Syy)`` of each star, those of a sharp star taken off where they are known.
    covariance : (n, 3, 3) array
        Of each star's moments.
    shared : (3, 3) array, optional
        Covariance of what was taken off all of them.
    direction : (float, float), optional
        Axis and error [deg] of the common smear, where it has been measured better than here; not used
        where a pattern is mixed with it.

    Returns
    -------
    pattern : FieldPattern

    Notes
    -----
    *Assumes* that the optical axis meets the frame's centre, and stars all over the frame.  *Fails when* a
    smear comes from optics that are out of line: astigmatism that is the same everywhere looks like
    tracking, in one frame.
    """
    if len(x) < _LEAST:
        stars = "1 isolated star is" if len(x) == 1 else f"{len(x)} isolated stars are"
        sentence = f"undetermined: {stars} too few to see a pattern; {_LEAST} are needed."
        unknown = (*(direction or (np.nan, np.nan)), np.nan, np.nan)
        return FieldPattern("undetermined", sentence, *unknown, {}, 2 * len(x))
    project = np.array([[1.0, 0.0, -1.0], [0.0, 2.0, 0.0]])
    e, noise = moments @ project.T, project @ covariance @ project.T
    offset = np.zeros((2, 2)) if shared is None else project @ shared @ project.T
    reach = float(np.sqrt(np.mean(np.square(x) + np.square(y))))
    z = (x + 1j * y) / reach
    weight, flexible = _weights(e, noise, z)
    one, zero = np.ones(z.shape), np.zeros(z.shape)
    constant = np.stack([np.stack([one, zero], -1), np.stack([zero, one], -1)], axis=1)
    square = np.stack([(z**2).real, (z**2).imag], axis=1)[..., None]
    both = np.concatenate([constant, square], axis=2)
    designs = {"round": both[:, :, :0], "smear": constant, "pattern": square, "both": both}
    fits = {name: _fit(e, weight, design) for name, design in designs.items()}
    chi2 = {name: fit.chi2 for name, fit in fits.items()}
    size, middle, chi2["rotation"] = _rotation(e, weight, z, fits["both"])
    power = max(chi2["round"] - flexible, 1e-12)
    smear, pattern = (float(np.clip((chi2["round"] - chi2[n]) / power, 0, 1)) for n in ("smear", "pattern"))
    shares, mixed = (smear, pattern), fits["both"]
    steady, steadiness = mixed.terms[:2], mixed.covariance[:2, :2] + offset
    found = {
        "smear": steady @ np.linalg.solve(steadiness, steady) > _BETTER and shares[0] > _NOTABLE,
        "pattern": chi2["smear"] - chi2["both"] > _BETTER and shares[1] > _NOTABLE,
        "rotation": chi2["both"] - chi2["rotation"] > _BETTER and size < 0,
        "other": chi2["smear"] - flexible > _IRREGULAR,
    }
    centre = (middle.real * reach, middle.imag * reach) if found["rotation"] else None
    if found["smear"] and found["pattern"]:  # one direction alone is pulled by the pattern
        direction = _direction(steady, steadiness)
    elif direction is None:
        direction = _direction(fits["smear"].terms, fits["smear"].covariance + offset)
    way = "radial" if mixed.terms[2] > 0 else "tangential"
    kind, text = _worded(found, direction, shares, way, centre)
    return FieldPattern(kind, text + ".", *direction, smear, pattern, chi2, 2 * len(x), centre)


def _fit(e: np.ndarray, weight: np.ndarray, design: np.ndarray) -> _Fit:
    """Return the weighted least squares of (n, 2) ellipticities."""
    normal = np.einsum("nik,nij,njl->kl", design, weight, design)
    covariance = np.linalg.inv(normal)
    terms = covariance @ np.einsum("nik,nij,nj->k", design, weight, e)
    residual = e - design @ terms
    return _Fit(terms, covariance, float(np.einsum("ni,nij,nj->", residual, weight, residual)))


def _weights(e: np.ndarray, noise: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, float]:
    """Inverse of noise plus the scatter about a smooth field, (n, 2, 2), and the chi-squared about it.

    The smooth field is the general quadratic in z and its conjugate: it holds every model as a
    special case, and what it leaves is no model's fault.
    """
    x, y = z.real, z.imag
    powers = np.stack([np.ones(z.shape), x, y, x * x, x * y, y * y], axis=1)
    if len(z) < 2 * powers.shape[1]:
        powers = powers[:, :1]
    design = np.einsum("nk,ij->nijk", powers, np.eye(2)).reshape(len(z), 2, -1)
    scatter = 0.0
    for _ in range(10):
        weight = np.linalg.inv(noise + scatter * np.eye(2))
        fit = _fit(e, weight, design)
        dof = design.shape[0] * 2 - design.shape[2]
        excess = fit.chi2 / dof
        if excess <= 1 and scatter == 0:
            break
        spread = np.trace(np.linalg.inv(weight), axis1=1, axis2=2) / 2
        scatter = max(scatter + (excess - 1) * float(1 / np.mean(1 / spread)), 0.0)
    return weight, fit.chi2


def _rotation(e: np.ndarray, weight: np.ndarray, z: np.ndarray, start: _Fit) -> tuple[float, complex, float]:
    """Fit arcs ``e = a (z - z0)²`` with real a, from where tracking plus a pattern left it.

    Return a, the centre z0 in units of the field, and chi-squared.
    """
    root = np.linalg.cholesky(weight)
    size = start.terms[2] if start.terms[2] != 0 else -1e-6
    first = np.sqrt(complex(start.terms[0], start.terms[1]) / size)

    def residual(p):
        arcs = p[0] * (z - complex(p[1], p[2])) ** 2
        return np.einsum("nij,ni->nj", root, e - np.stack([arcs.real, arcs.imag], axis=1)).ravel()

    trials = [least_squares(residual, [size, s * first.real, s * first.imag], max_nfev=50) for s in (1, -1)]
    best = min(trials, key=lambda trial: trial.cost)
    return float(best.x[0]), complex(best.x[1], best.x[2]), 2 * float(best.cost)


def _worded(found, direction, shares, way: str, centre) -> tuple[str, str]:
    """Return the kind and its sentence, from what was found."""
    angle, angle_err = direction
    if found["rotation"]:
        return "rotation", (
            f"rotation: the stars draw arcs about x {centre[0]:+.0f}, y {centre[1]:+.0f} pixels from the "
            "frame's centre; the field turned during the exposure"
        )
    if found["smear"] and found["pattern"]:
        return "mixed", (
            f"mixed: one direction ({angle:.1f} ± {angle_err:.1f}°) explains {shares[0]:.0%} of the stars' "
            f"elongation, a {way} pattern {shares[1]:.0%}; tracking and optics both"
        )
    if found["smear"]:
        return "smear", (
            f"smear: one direction ({angle:.1f} ± {angle_err:.1f}°) everywhere explains {shares[0]:.0%} of "
            f"the stars' elongation; a radial or tangential pattern explains {shares[1]:.0%}"
        )
    if found["pattern"]:
        cause = "the optics" if way == "radial" else "the optics, or a field that turned"
        return way, (
            f"{way}: a pattern about the frame's centre explains {shares[1]:.0%} of the stars' elongation, "
            f"one direction everywhere {shares[0]:.0%}; {cause}"
        )
    if found["other"]:
        return "irregular", (
            f"irregular: the stars are long, but one direction explains {shares[0]:.0%} of it and a radial "
            f"or tangential pattern {shares[1]:.0%}"
        )
    return "round", "round: no direction is common to the stars, and none points to the centre"


def _direction(e: np.ndarray, covariance: np.ndarray) -> tuple[float, float]:
    """Return the axis of a constant ellipticity and its error, degrees."""
    size = max(float(np.hypot(*e)), 1e-300)
    across = np.array([-e[1], e[0]]) / size
    error = np.degrees(np.sqrt(across @ covariance @ across) / size / 2)
    return axis_angle(np.degrees(np.arctan2(e[1], e[0])) / 2), min(float(error), 90 / np.sqrt(3))
