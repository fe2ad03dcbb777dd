"""From electrons to the numbers of a file, in the order in which nature does it.

Photons arrive by the flat and dark current joins them; all are counted (Poisson); cosmic rays hit; charge
repels charge; the well clips; the read-out couples neighbours, is not linear, adds noise; the converter
divides by the gain, adds the bias, rounds and clips.  :meth:`jitterkit.detectors.Detector.expose` does all of
it.

:func:`cosmic_rays` draws straight tracks of charge at a given rate.  Nothing here finds or removes them: a
filter of the image that does also eats the tails of a jittered star.  :mod:`jitterkit.refit.outliers`
finds them in what a fit leaves over.
"""

from __future__ import annotations

import numpy as np

from jitterkit.detectors.knowledge import ASSUMED, piece
from jitterkit.detectors.response import BORDER, broaden, couple, measured
from jitterkit.errors import ConfigurationError, ErrorCode

DEPTH = 1.0
"""Depth of the layer that collects charge, pixels: a few um in a thinned sensor whose pixels are as wide."""

CHARGE = 200.0
"""Charge along a track, e- per pixel: 80 e-/um of a fast particle in silicon, in pixels of 2.4 um."""

_MOST = 9e18
"""Electrons: numpy draws 64-bit integers."""

_STEP = 0.1
"""Pixels between the points in which a track is deposited."""


def cosmic_rays(shape: tuple[int, int], rate: float, exposure: float, rng: np.random.Generator) -> np.ndarray:
    """Draw the charge that cosmic rays leave.

    Parameters
    ----------
    shape : (int, int)
        ``(ny, nx)``.
    rate : float
        Hits per pixel and second.
    exposure : float
        s.
    rng : numpy.random.Generator

    Returns
    -------
    charge : (ny, nx) array
        e-.

    Notes
    -----
    Particles come evenly from a hemisphere, so through a surface as the cosine from its normal: cos² is
    uniform, a path of length ``l`` is longer than the depth by more than a factor ``k`` in ``1/k²`` of all
    cases, and ``2 CHARGE DEPTH`` is deposited on average.  *Assumes* one charge per length (no
    straggling) and that all enter through the frame.  *Fails* where the energy of single hits matters:
    depth and charge per pixel are those of a small thinned pixel.
    """
    ny, nx = shape
    charge = np.zeros(shape)
    hits = rng.poisson(rate * exposure * ny * nx)
    start = rng.uniform(-0.5, 0.5, (hits, 2)) * shape + (np.array(shape) - 1) / 2
    cosine = np.sqrt(1 - rng.random(hits))  # never zero
    azimuth = rng.uniform(0.0, 2 * np.pi, hits)
    along = DEPTH * np.sqrt(1 - cosine**2) / cosine
    for (y0, x0), cos, length, phi in zip(start, cosine, along, azimuth, strict=True):
        seen = min(length, float(sum(shape)))
        points = max(1, int(np.ceil(seen / _STEP)))
        t = (np.arange(points) + 0.5) / points * seen
        y = np.rint(y0 + t * np.sin(phi)).astype(int)
        x = np.rint(x0 + t * np.cos(phi)).astype(int)
        inside = (y >= 0) & (y < ny) & (x >= 0) & (x < nx)  # what passes the frame's edge is lost
        share = CHARGE * DEPTH / cos * (seen / length if length else 1.0) / points
        np.add.at(charge, (y[inside], x[inside]), share)
    return charge


_NAME = "the expected image"


def collected(detector, expected, rng, exposure, origin) -> np.ndarray:
    """Return what the wells hold, e-."""
    if detector.flat is not None:
        expected = expected * piece("flat", detector.flat, _NAME, origin, expected.shape)
    if detector.dark_current is not None:
        dark = piece("dark_current", detector.dark_current, _NAME, origin, expected.shape)
        expected = expected + dark * (exposure or 0.0)
    if rng is not None and expected.max(initial=0.0) > _MOST:
        problem = f"{expected.max():g} electrons are expected in a pixel, of which no noise can be drawn"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; give less light.")
    charge = expected if rng is None else rng.poisson(expected).astype(float)
    if rng is not None and detector.cosmic_rays:
        charge = charge + cosmic_rays(charge.shape, detector.cosmic_rays, exposure, rng)
    well = np.inf if detector.full_well is None else detector.full_well
    held = np.minimum(charge, well)
    if not detector.brighter_fatter:
        return held
    if held.max(initial=0.0) * detector.brighter_fatter >= BORDER:
        problem = f"brighter_fatter = {detector.brighter_fatter:g} is too large for a pixel of"
        remedy = "give a smaller one, or a full_well"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem} {held.max():g} e-; {remedy}.")
    return np.where(held < well, np.minimum(broaden(held, detector.brighter_fatter), well), well)


def amplified(detector, charge, rng, origin) -> np.ndarray:
    """Return what reaches the converter, e-."""
    if detector.coupling:
        charge = couple(charge, detector.coupling)
    if detector.nonlinearity is not None:
        charge = measured(charge, detector.nonlinearity, detector.full_well)
    if rng is None or detector.read_noise is None:
        return charge
    noise = piece("read_noise", detector.read_noise, _NAME, origin, charge.shape)
    return charge + rng.normal(0.0, noise, charge.shape) if np.any(noise) else charge


def digitised(detector, level, origin) -> np.ndarray:
    """Return what the file holds, ADU."""
    bias = 0.0 if detector.bias is None else piece("bias", detector.bias, _NAME, origin, level.shape)
    rounded = np.rint(bias + level / (detector.gain or ASSUMED["gain"]))
    if detector.bits is None:
        holds = np.abs(rounded).max(initial=0.0) <= np.iinfo(np.int32).max
        return rounded.astype(np.int32 if holds else np.int64)
    return np.clip(rounded, 0, detector.largest).astype(np.uint16 if detector.bits <= 16 else np.uint32)
