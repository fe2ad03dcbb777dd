"""From electrons to the numbers of a file, in the order in which nature does it.

Photons arrive by the flat and dark current joins them; all are counted (Poisson); cosmic rays hit; the
well clips; the read-out couples neighbours, is not linear, adds noise; the converter divides by the
gain, adds the bias, rounds and clips.
"""

from __future__ import annotations

import numpy as np

from jitterkit.detectors.characteristics import Characteristics
from jitterkit.detectors.cosmic_rays import cosmic_rays
from jitterkit.detectors.coupling import couple
from jitterkit.detectors.knowledge import ASSUMED
from jitterkit.detectors.linearity import measured
from jitterkit.detectors.maps import piece
from jitterkit.errors import ConfigurationError, ErrorCode

_NAME = "the expected image"


def read_out(
    detector: Characteristics,
    expected: np.ndarray,
    rng: np.random.Generator | None,
    exposure: float | None,
    origin: tuple[int, int],
) -> np.ndarray:
    """Read an expected image out; see :meth:`Detector.expose`."""
    _refuse_without_exposure(detector, rng, exposure)
    expected = np.maximum(np.asarray(expected, dtype=float), 0.0)
    return _digitised(
        detector,
        _amplified(detector, _collected(detector, expected, rng, exposure, origin), rng, origin),
        origin,
    )


def _refuse_without_exposure(
    detector: Characteristics, rng: np.random.Generator | None, exposure: float | None
) -> None:
    needs = {"dark_current": True, "cosmic_rays": rng is not None}
    for name, needed in needs.items():
        value = getattr(detector, name)
        if exposure is None and needed and value is not None and np.any(value):
            raise ConfigurationError(
                ErrorCode.MISSING_VALUE, f"{name} needs the exposure of the frame; give exposure, in s."
            )


def _collected(detector, expected, rng, exposure, origin) -> np.ndarray:
    """What the wells hold, e-."""
    if detector.flat is not None:
        expected = expected * piece("flat", detector.flat, _NAME, origin, expected.shape)
    if detector.dark_current is not None:
        dark = piece("dark_current", detector.dark_current, _NAME, origin, expected.shape)
        expected = expected + dark * (exposure or 0.0)
    charge = expected if rng is None else rng.poisson(expected).astype(float)
    if rng is not None and detector.cosmic_rays:
        charge = charge + cosmic_rays(charge.shape, detector.cosmic_rays, exposure, rng)
    return charge if detector.full_well is None else np.minimum(charge, detector.full_well)


def _amplified(detector, charge, rng, origin) -> np.ndarray:
    """What reaches the converter, e-."""
    if detector.coupling:
        charge = couple(charge, detector.coupling)
    if detector.nonlinearity is not None:
        charge = measured(charge, detector.nonlinearity, detector.full_well)
    if rng is None or detector.read_noise is None:
        return charge
    noise = piece("read_noise", detector.read_noise, _NAME, origin, charge.shape)
    return charge + rng.normal(0.0, noise, charge.shape) if np.any(noise) else charge


def _digitised(detector, level, origin) -> np.ndarray:
    """What the file holds, ADU."""
    bias = 0.0 if detector.bias is None else piece("bias", detector.bias, _NAME, origin, level.shape)
    rounded = np.rint(bias + level / (detector.gain or ASSUMED["gain"]))
    if detector.bits is None:
        holds = np.abs(rounded).max(initial=0.0) <= np.iinfo(np.int32).max
        return rounded.astype(np.int32 if holds else np.int64)
    return np.clip(rounded, 0, detector.largest).astype(np.uint16 if detector.bits <= 16 else np.uint32)
