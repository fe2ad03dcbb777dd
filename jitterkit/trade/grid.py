"""Measure settings one by one: milliseconds a frame, and their effect on the separation.

Reach for :func:`measure_grid`.  The error of a setting has two parts, both as shares of the least error that
a frame allows (the Cramer-Rao bound at the most exact settings): its bias, which is what is wrong with the
separation of frames without noise; and the scatter that it adds, which is how far the separations of frames
with noise are from those that the most exact settings find in the same frames, the bias apart.
"""

from __future__ import annotations

import math
from collections.abc import Hashable, Iterator, Sequence
from dataclasses import dataclass, replace
from importlib.util import find_spec
from typing import Any, NamedTuple

import jax
import numpy as np

from jitterkit.batch import FrameProcessor
from jitterkit.errors import JitterkitError
from jitterkit.frames import Frame
from jitterkit.instruments import Instrument
from jitterkit.loci import LOCI
from jitterkit.trade.methods import Fitting
from jitterkit.trade.scenes import TradeScene
from jitterkit.trade.settings import ABERRATIONS, PRESETS, Settings, own_pad, preset

GRID: dict[str, tuple[Any, ...]] = {
    "pad": (0, 8, 16, 32, 64, 96, 128),
    "samples": (1, 3, 5, 7, 9, 11, 13, 16),
    "binning": (8, 4, 2, 1),
    "aberrations": ABERRATIONS,
    "tolerance": (1.0, 0.1, 1e-2, 1e-4, 1e-5, 1e-6),
    "region": (32, 48, 64, 96),
    "bits": (32,),
    "nodes": (4, 6, 8, 12, 24, 48),
    "jitter": ("seen",),
    "method": ("score", "mtf", "sampling"),
}
"""From the fastest to the most exact; values of ``balanced`` are measured as such, and the joint fit by
itself."""

_ALIKE = ("score", "joint")
"""Methods that ask for frames of one direction."""


_BREAKDOWNS = (JitterkitError, ArithmeticError, ValueError, np.linalg.LinAlgError)
"""Errors that end one row and not the grid."""


@dataclass(frozen=True)
class Point:
    """Hold settings with their cost and their errors.

    Attributes
    ----------
    name : str
    settings : Settings or None
        None of another package.
    seconds : float
        Of a frame, its share of the look at the optics included.
    bias : float
        Rms over the frames of what is wrong with the separation without noise, arcsec.
    scatter : float
        Rms over the frames of what the settings change beside, in frames with noise, arcsec.
    sigma : float
        Rms of the errors of the separation that the fits state, arcsec.
    bound : float
        The least that there can be, arcsec: what ``exact`` states; of the joint fit, what an exact joint fit
        does.
    message : str
        Why there are no numbers, if there are none.
    """

    name: str
    settings: Settings | None
    seconds: float = math.nan
    bias: float = math.nan
    scatter: float = math.nan
    sigma: float = math.nan
    bound: float = math.nan
    message: str = ""

    @property
    def error(self) -> float:
        """Return the bias and added scatter together, in squares, as a share of the bound."""
        return math.hypot(self.bias, self.scatter) / self.bound


class Reference(NamedTuple):
    """Separations with which those of other settings are compared.

    Attributes
    ----------
    noisy : (n,) array
        Separations of the frames with noise, arcsec.
    biases : (n,) array
        What is wrong with those of the same frames without.
    bound : float
        Rms of the errors stated.
    """

    noisy: np.ndarray
    biases: np.ndarray
    bound: float


def measure_grid(instrument: Instrument, scene: TradeScene, *, locus: str = "mvn") -> Iterator[Point]:
    """Measure the presets, and every value of every setting with the others as they are in ``balanced``.

    Parameters
    ----------
    instrument : Instrument
    scene : TradeScene
    locus : str
        To fit; or ``auto``.

    Yields
    ------
    point : Point
        The most exact one first: it, or the first that can be had, is what the others are compared with; the
        joint fit with the most exact joint fit.
    """
    named = {name: preset(name, instrument) for name in ("exact", "balanced", "fast")}
    seen = {_resolved(settings, instrument) for settings in named.values()}
    for setting, values in GRID.items():
        for value in values:
            settings = replace(PRESETS["balanced"], **{setting: value})
            known = _resolved(settings, instrument) in seen
            if not known and can_be_had(setting, value, instrument, locus):
                seen.add(_resolved(settings, instrument))
                named[f"{setting} {value}"] = settings
    reference: Reference | None = None
    for name, settings in named.items():
        point, found = measure(name, settings, instrument, scene, locus, reference)
        reference = reference or found
        yield point
    exact, balanced = (replace(named[name], method="joint") for name in ("exact", "balanced"))
    joint, reference = measure("method joint", exact, instrument, scene, locus)
    if reference is not None:
        joint, _ = measure("method joint", balanced, instrument, scene, locus, reference)
    yield joint


def can_be_had(setting: str, value: Any, instrument: Instrument, locus: str = "mvn") -> bool:
    """Return whether frames of an instrument with a jitter can be modelled and fitted so."""
    if setting == "samples":
        spectrum = instrument.spectrum
        return spectrum is not None and len(spectrum.sampled(value).wavelengths) == value
    if setting in ("binning", "aberrations"):
        return instrument.pupil is not None
    if setting == "nodes":
        return locus in LOCI and value < LOCI[locus].nodes
    if setting == "jitter":
        return locus == "auto"
    return value != "sampling" or find_spec("blackjax") is not None


def _resolved(settings: Settings, instrument: Instrument) -> tuple[Hashable, ...]:
    """Return what settings come to for an instrument: equal where they are the same."""
    ny, nx = instrument.shape
    side, spectrum = settings.region or max(ny, nx), instrument.spectrum
    if spectrum is not None and settings.samples is not None:
        spectrum = spectrum.sampled(settings.samples)
    pad = own_pad(instrument) if settings.pad is None else settings.pad
    others = (settings.binning, settings.aberrations, settings.tolerance, settings.bits, settings.nodes)
    return (pad, spectrum, min(ny, side), min(nx, side), *others, settings.jitter, settings.method)


def measure(
    name: str,
    settings: Settings,
    instrument: Instrument,
    scene: TradeScene,
    locus: str = "mvn",
    reference: Reference | None = None,
) -> tuple[Point, Reference | None]:
    """Fit the frames of a scene with some settings.

    Parameters
    ----------
    name : str
    settings : Settings
    instrument : Instrument
    scene : TradeScene
    locus : str
    reference : Reference, optional
        By default these settings themselves.

    Returns
    -------
    point : Point
        With a message instead of numbers where the settings do not do.
    found : Reference or None
        For others to be compared with; None of settings that do not do.
    """
    try:
        fitting = _fitting(settings, instrument, scene, locus)
        biases, sigmas = _without_noise(fitting, scene)
        if settings.bits == 64:
            noisy, seconds = fitting.timed(scene.noisy)
        else:
            jax.clear_caches()  # programs of the one precision do not take the other's numbers
            with jax.enable_x64(False):
                noisy, seconds = _fitting(settings, instrument, scene, locus).timed(scene.noisy)
    except _BREAKDOWNS as error:
        return Point(name, settings, message=str(error)), None
    found = Reference(noisy[:, 0], biases[: len(noisy)], _rms(sigmas))
    beside = reference or found
    scatter = _rms((found.noisy - found.biases) - (beside.noisy - beside.biases))
    return Point(name, settings, seconds, _rms(biases), scatter, found.bound, beside.bound), found


def _fitting(settings: Settings, instrument: Instrument, scene: TradeScene, locus: str) -> Fitting:
    processor = settings.applied(FrameProcessor(instrument, scene="binary", locus=locus))
    if settings.aberrations == "expanded" or settings.method == "joint":
        return Fitting(processor, method=settings.method)
    return Fitting.anchored(processor, scene.reference, method=settings.method)


def _without_noise(fitting: Fitting, scene: TradeScene) -> tuple[np.ndarray, np.ndarray]:
    """Return what is wrong with the separations (n,) of frames without noise, and the errors stated, arcsec.

    Turned ones are left out where a method asks for frames that share their direction.
    """
    calibrate, every = fitting.processor.calibrate, zip(scene.plain, scene.images, strict=True)
    frames = [without_noise(calibrate(raw), image) for raw, image in every]
    found = fitting.separations(frames[: len(scene.noisy)] if fitting.method in _ALIKE else frames)
    truths = [float(truth.binary.separation) for truth in scene.truths]
    return found[:, 0] - truths[: len(found)], found[:, 1]


def without_noise(frame: Frame, image: np.ndarray) -> Frame:
    """Return a frame with its expected electrons, neither rounded nor cut off at a ceiling."""
    (x0, y0), (ny, nx) = frame.origin, frame.shape
    return replace(frame, electrons=image[y0 : y0 + ny, x0 : x0 + nx])


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def front(points: Sequence[Point]) -> list[Point]:
    """Return the points that no other of this package beats in time and error, from the fastest on."""
    ours = (point for point in points if point.settings is not None)
    sound = sorted((p for p in ours if math.isfinite(p.error)), key=lambda p: (p.seconds, p.error))
    best, least = [], math.inf
    for point in sound:
        if point.error < least:
            best.append(point)
            least = point.error
    return best
