"""What ``scripts/extremes`` holds each extreme to: finite derivatives, limits from elsewhere, honest fits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import numpy as np

from jitterkit.batch import FrameProcessor
from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError
from jitterkit.forward import Parameters, expected_image, image_and_jacobian, to_vector
from jitterkit.instruments import Instrument
from jitterkit.instruments.pupils import plain
from jitterkit.likelihood import Data, deviance, normal_equations
from jitterkit.loci import Locus, Stable, locus_name
from jitterkit.optics import lines
from jitterkit.optics.otf import OTF
from jitterkit.scene import Binary, Scene
from jitterkit.simulate import simulate_frame

__all__ = [
    "SCALE",
    "STATE",
    "Check",
    "binary",
    "finite",
    "fitted",
    "image_of",
    "near",
    "recovered",
    "refused",
    "telescope",
    "worst",
]

SCALE, SIDE = 0.375, 48
STATE = np.array([20.0, -10.0])
PULL = 4.0


class Check(NamedTuple):
    """What came out of one look at an extreme, whether it is as it must be, and how far off it was."""

    came: str
    good: bool
    off: float = 0.0


def worst(checks: Iterable[Check]) -> Check:
    """Of several alike the one that is furthest off; one that is not good is further off than any that is."""
    return max(checks, key=lambda check: (not check.good, check.off))


def telescope(
    shape=(SIDE, SIDE), scale=SCALE, spectrum=None, samples=128, noll=(5, 7), **detector
) -> Instrument:
    """A plain telescope with two aberrations; its detector counts electrons unless given otherwise."""
    ideal = {"gain": 1.0, "read_noise": 0.0, "bias": 0.0}
    pupil = partial(plain, 0.125, 0.04, struts=3, strut_width=0.004, noll=noll, samples=samples)
    return Instrument(
        "plain",
        scale,
        shape,
        Detector(**(ideal | detector)),
        lines(550.0, 620.0) if spectrum is None else spectrum,
        pupil,
        exposure=0.1,
        flux=1e6,
    )


def binary(**changes) -> Binary:
    """A pair 4 arcsec wide of a million photons, but for the changes."""
    values = {"separation": 4.0, "theta": 33.0, "x": 0.4, "y": -0.6, "flux": 1e6, "contrast": 3.37}
    return Binary(**(values | changes))


def image_of(scene: Scene, locus: Locus, otf: OTF) -> np.ndarray:
    """Expected image at the state of the optics."""
    return np.asarray(expected_image(Parameters(scene, locus, otf.state), otf))


def finite(scene: Scene, locus: Locus, otf: OTF) -> Check:
    """Image, all its derivatives, and the deviance's by two ways: finite, and the two alike."""
    here = Parameters(scene, locus, otf.state)
    every = tuple(range(to_vector(here)[0].size))
    image, jacobian = image_and_jacobian(here, otf, every)
    data = Data(np.rint(np.abs(np.asarray(image)) * 1.1) + 1.0, 4.0)
    score = np.asarray(normal_equations(here, otf, data, every).score)
    slope = np.asarray(to_vector(_slope(here, otf, data))[0])
    arrays = (image, jacobian, score, slope)
    whole = all(np.all(np.isfinite(array)) for array in arrays)
    # rounding is that of the sizes of all pixels, and of what cancels where a derivative vanishes
    sizes = np.abs(np.asarray(jacobian)).sum(axis=(1, 2)) + np.abs(slope)
    off = float(np.max(np.abs(slope + 2 * score) / (sizes + 1e-6 * sizes.max())))
    good = whole and off < np.cbrt(np.finfo(score.dtype).eps)  # what a difference quotient could tell
    return Check(f"all finite, gradients by two ways differ by {off:.0e}", bool(good), off)


_slope = eqx.filter_jit(eqx.filter_grad(deviance))


def near(what: str, found, expected, tolerance: float, scale: float | None = None) -> Check:
    """How far an array is from what it must be, in units of its largest value."""
    size = float(np.max(np.abs(expected))) if scale is None else scale
    off = float(np.max(np.abs(np.asarray(found) - np.asarray(expected)))) / size
    return Check(f"{what}: off by {off:.1e}", off <= tolerance, off)


def recovered(result, truth: float) -> Check:
    """A fit that gives the separation within four of its errors."""
    if not result.status.usable:
        return Check(f"{result.status.name}: {result.message}", False)
    error = result.error("separation")
    pull = (float(result.parameters.scene.separation) - truth) / error
    came = f"fitted ({locus_name(result.parameters.locus)}) to ±{error:.2g}″, pull {pull:+.1f}"
    return Check(came, abs(pull) < PULL, abs(pull))


def fitted(
    instrument: Instrument,
    scene: Binary,
    locus: Locus | None = None,
    *,
    by: str = "mvn",
    ends: Iterable[str] = (),
    seed: int = 1,
    mask: np.ndarray | None = None,
    readout: bool = False,
    **options,
) -> Check:
    """Simulate and process a frame: the truth within its errors, or one of the named ends with a sentence."""
    frame = simulate_frame(
        instrument,
        scene,
        Stable.of() if locus is None else locus,
        rng=np.random.default_rng(seed),
        detector=readout,
        **options,
    ).raw
    frame = frame if mask is None else replace(frame, mask=mask)
    result = FrameProcessor(instrument, locus=by).process(frame).result
    if result.status.usable and not isinstance(result.parameters.scene, Binary):
        return Check("one star is seen", "NO_PAIR" in ends)
    if result.status.name in ends:
        return Check(f"{result.status.name}: “{result.message}”", bool(result.message))
    return (
        recovered(result, float(scene.separation))
        if result.status.usable or not ends
        else Check(f"{result.status.name}: “{result.message}”", False)
    )


def refused(action, words: str) -> Check:
    """What cannot be done is refused, in a sentence that says why."""
    try:
        action()
    except ConfigurationError as error:
        return Check(f"refused: “{error}”", words in str(error))
    return Check("not refused", False)
