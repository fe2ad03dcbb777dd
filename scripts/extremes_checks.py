"""What ``scripts/extremes`` holds each extreme to: finite derivatives, limits from elsewhere, honest fits."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import equinox as eqx
import jax
import numpy as np

from jitterkit.batch import Processor
from jitterkit.conventions import ARCSEC
from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError
from jitterkit.forward import Parameters, expected_image, image_and_jacobian, to_vector
from jitterkit.instruments import Instrument
from jitterkit.instruments.pupils import plain
from jitterkit.likelihood import Data, deviance, normal_equations
from jitterkit.loci import Locus, Stable
from jitterkit.optics import lines
from jitterkit.optics.otf import OTF
from jitterkit.scene import Binary, Scene
from jitterkit.simulate import simulate_frame

__all__ = [
    "SCALE",
    "STATE",
    "Check",
    "binary",
    "direct_star",
    "finite",
    "fitted",
    "image_of",
    "near",
    "recovered",
    "refused",
    "shifted",
    "telescope",
]

SCALE, SIDE = 0.375, 48
STATE = np.array([20.0, -10.0])
PULL = 4.0


class Check(NamedTuple):
    """What came out of one look at an extreme, and whether it is as it must be."""

    came: str
    good: bool


def telescope(
    shape=(SIDE, SIDE), scale=SCALE, spectrum=None, samples=128, noll=(5, 7), **detector
) -> Instrument:
    """A plain telescope with two aberrations; its detector counts electrons unless told otherwise."""
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
    return Check(f"all finite, gradients by two ways differ by {off:.0e}", whole and off < 1e-5)


_slope = eqx.filter_jit(eqx.filter_grad(deviance))


def near(what: str, found, expected, tolerance: float, scale: float | None = None) -> Check:
    """How far an array is from what it must be, in units of its largest value."""
    size = float(np.max(np.abs(expected))) if scale is None else scale
    off = float(np.max(np.abs(np.asarray(found) - np.asarray(expected)))) / size
    return Check(f"{what}: off by {off:.1e}", off <= tolerance)


def shifted(scene: Binary, otf: OTF, offsets: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Sum of unblurred images at offsets (n, 2) [arcsec] of the pointing: what a blur is by definition."""

    def add(total, step):
        (x, y), weight = step
        moved = eqx.tree_at(lambda s: (s.x, s.y), scene, (scene.x + x, scene.y + y))
        return total + weight * expected_image(Parameters(moved, Stable.of(), otf.state), otf), None

    start = np.zeros(otf.grid.shape)
    return np.asarray(jax.lax.scan(add, start, (np.asarray(offsets), np.asarray(weights)))[0])


def direct_star(instrument: Instrument, state, x: float, y: float, flux: float, order: int = 5) -> np.ndarray:
    """One star by Fraunhofer's integral: every ray of the pupil summed at Gauss' nodes in every pixel."""
    pupil, (ny, nx), scale = instrument.pupil, instrument.shape, instrument.plate_scale
    nodes, shares = np.polynomial.legendre.leggauss(order)
    metres = pupil.pitch * (np.arange(len(pupil.opd)) - (len(pupil.opd) - 1) / 2)
    rows, columns = (
        ((np.arange(n) - (n - 1) / 2)[:, None] * scale + scale / 2 * nodes).ravel() for n in (ny, nx)
    )
    opd = np.asarray(pupil.opd) + np.tensordot(state, np.asarray(pupil.basis), 1)
    light, image = np.sum(np.asarray(pupil.transmission) ** 2), 0.0
    for wavelength, weight in zip(instrument.spectrum.wavelengths, instrument.spectrum.weights, strict=True):
        wave = 2 * np.pi / (wavelength * 1e-9)
        field = np.asarray(pupil.transmission) * np.exp(1j * wave * 1e-9 * opd)
        up = np.exp(-1j * wave * ARCSEC * np.outer(rows - y, metres))
        across = np.exp(-1j * wave * ARCSEC * np.outer(metres, columns - x))
        area = (wave * pupil.pitch * scale * ARCSEC / (2 * np.pi)) ** 2 / light
        image = image + flux * weight * area * np.abs(up @ field @ across) ** 2
    share = np.tile(shares / 2, max(ny, nx))
    weighted = share[: ny * order, None] * image * share[: nx * order]
    return weighted.reshape(ny, order, nx, order).sum(axis=(1, 3))


def recovered(result, truth: float) -> Check:
    """A fit that gives the separation within four of its errors."""
    if not result.status.usable:
        return Check(f"{result.status.name}: {result.message}", False)
    pull = (float(result.parameters.scene.separation) - truth) / result.error("separation")
    error = result.error("separation")
    return Check(f"fitted ({result.locus}) to ±{error:.2g}″, pull {pull:+.1f}", abs(pull) < PULL)


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
    result = Processor(instrument, locus=by).process(frame).result
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
