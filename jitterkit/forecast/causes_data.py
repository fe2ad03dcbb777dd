"""What further data would tell the causes of a width apart.

Reach for :func:`further_data`: a list of data sets from the cheapest to the dearest, each with the Fisher
information that it adds, and for :func:`cheapest`, which chooses.  A further frame has a scene and a jitter
of its own; aberrations, diffusion and seeing it shares.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, replace

import jax.numpy as jnp
import numpy as np

from jitterkit.errors import positive
from jitterkit.forecast.causes import Causes
from jitterkit.forecast.causes_frame import JITTER, SQUARE, Setting
from jitterkit.forecast.causes_information import Information
from jitterkit.loci import Locus, Stable, Streak, axis_variances, moments_on_axis
from jitterkit.optics import OpticalSystem, Spectrum, grid_for

_LIGHT = 4.0
"""Times the light of one frame: as many photons as four frames, but one motion."""

_REDDER = 1.4
"""Times the wavelength of another filter: 585 nm becomes 820 nm."""

_SIZES = (0.5, 1.5)
"""Range of the further frames' jitter, in sizes of the frame's own."""


@dataclass(frozen=True)
class DataSet:
    """Data beside the frame.

    Attributes
    ----------
    words : str
    extra : Information
        What they tell about the causes and about what every frame shares.
    """

    words: str
    extra: Information

    def __add__(self, other: DataSet) -> DataSet:
        """Both together."""
        return DataSet(f"{self.words}, and {other.words}", self.extra + other.extra)


@dataclass(frozen=True)
class Offer:
    """Sizes of what may be measured beside the frame.

    Attributes
    ----------
    frames : int
        Further frames, their jitter turned by equal steps and half to one and a half times as large.
    telemetry : float
        Error of each second moment of the jitter that telemetry has, as a share of the variance along it.
    diffusion : float
        Error of sigma that a dark spot, an edge or a flat field leaves, pixels.
    diversity : float
        Defocus, nm of noll4, on both sides of the frame's.

    Raises
    ------
    ConfigurationError
        If one is not positive.
    """

    frames: int = 8
    telemetry: float = 0.05
    diffusion: float = 0.05
    diversity: float = 100.0

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            positive(name, value)


def further_data(causes: Causes, offer: Offer | None = None) -> list[DataSet]:
    """Data that might tell the causes apart, the cheapest first.

    Parameters
    ----------
    causes : Causes
    offer : Offer, optional

    Returns
    -------
    sets : list of DataSet
        More light under the same motion (in short frames: it does not saturate); more frames; a laboratory's
        diffusion; telemetry, of the frame and of more frames; a frame at rest, and one without air; a pair
        refocused both ways; the band in halves; a redder filter.  What the setting does not allow is left
        out.

    Notes
    -----
    *Assumes* the same light in every frame (each half of the band has half of it), and wavefront errors in nm
    and a diffusion that do not change with the wavelength; charge from deeper in a detector wanders less far.
    A refocused pair that tells defocus tells its square as well.
    """
    offer = Offer() if offer is None else offer
    setting, locus = causes.setting, causes.locus
    moves = axis_variances(np.asarray(locus.moments()))[0] > 0
    sets = [DataSet(f"{_LIGHT:g} times the light under the same motion", causes.frame.times(_LIGHT - 1))]
    if moves:
        others = [(one, setting.frame(one)) for one in _other_jitters(locus, offer.frames)]
        more = _sum(_shared(told, setting) for _, told in others)
        trusted = [_shared(told + _telemetry(one, offer.telemetry), setting) for one, told in others]
        sets.append(DataSet(f"{offer.frames} more frames, each with a jitter of its own", more))
    sets.append(DataSet(f"diffusion measured to {offer.diffusion:g} pixel", _diffusion(causes, offer)))
    if moves:
        known = _telemetry(locus, offer.telemetry)
        words = f"telemetry of the jitter to {100 * offer.telemetry:g} %"
        sets.append(DataSet(words, known))
        sets.append(DataSet(f"{words}, in {offer.frames} more frames too", known + _sum(trusted)))
    if locus.names:
        sets.append(DataSet("a frame at rest", _shared(setting.frame(Stable.of()), setting)))
    if setting.seeing is not None:
        bench = replace(setting, seeing=None)
        sets.append(DataSet("a frame at rest without air", _shared(bench.frame(Stable.of()), bench)))
    return sets + _refocused(causes, offer.diversity) + _recoloured(causes)


def cheapest(causes: Causes, sets: Sequence[DataSet], target: float = 0.1) -> DataSet | None:
    """The first of some data sets, or else of their pairs, that brings every cause below a target.

    Parameters
    ----------
    causes : Causes
    sets : sequence of DataSet
        The cheapest first.
    target : float
        Largest error, as :meth:`Causes.shares` has it.
    """
    pairs = sorted(itertools.combinations(range(len(sets)), 2), key=sum)
    every = itertools.chain(sets, (sets[i] + sets[j] for i, j in pairs))
    return next((one for one in every if np.all(causes.shares(causes.errors(one.extra)) <= target)), None)


def _shared(told: Information, setting: Setting) -> Information:
    return told.about(setting.shared)


def _sum(parts) -> Information:
    first, *others = parts
    return sum(others, start=first)


def _other_jitters(locus: Locus, count: int) -> list[Locus]:
    """The jitter turned by equal steps through 180 degrees, and of other sizes."""
    jitters = []
    for k, size in enumerate(np.linspace(*_SIZES, count)):
        turned = size**2 * moments_on_axis(locus.moments(), -180.0 * k / count)
        straight = isinstance(locus, Streak)
        rest = locus.coords[3:]
        jitters.append(locus.near(turned) if straight else locus.at(jnp.concatenate([turned, rest])))
    return jitters


def _telemetry(locus: Locus, share: float) -> Information:
    names = JITTER[:2] if isinstance(locus, Streak) else JITTER
    along, _, _ = axis_variances(np.asarray(locus.moments()))
    return Information.prior(dict.fromkeys(names, share * along))


def _diffusion(causes: Causes, offer: Offer) -> Information:
    """A prior on the variance, from the error of sigma."""
    error, sigma = offer.diffusion * causes.plate_scale, causes.setting.diffusion**0.5
    return Information.prior({"diffusion": (sigma + error) ** 2 - sigma**2})


def _refocused(causes: Causes, offset: float) -> list[DataSet]:
    """A frame on each side of the focus, known how far."""
    setting = causes.setting
    names = setting.optics.nominal.names
    if "noll4" not in names:
        return []
    step = offset * np.array([name == "noll4" for name in names[: len(setting.aberrations)]])
    moved = [
        replace(setting, aberrations=tuple(np.array(setting.aberrations) + sign * step), square=False)
        for sign in (-1, 1)
    ]
    extra = _sum(_shared(one.frame(causes.locus), one) for one in moved)
    if setting.square:
        error = float(extra.about(("noll4",)).errors[0])
        others = [name for name in extra.names if name != "noll4"]
        extra = extra.about(others) + Information.prior({SQUARE: error**2})
    return [DataSet(f"2 frames refocused by ±{offset:g} nm", extra)]


def _recoloured(causes: Causes) -> list[DataSet]:
    """The two halves of the band, and another band, where the optics know their colours."""
    setting, optics = causes.setting, causes.setting.optics
    if not isinstance(optics, OpticalSystem):
        return []
    spectrum = optics.spectrum
    redder = Spectrum(tuple(_REDDER * w for w in spectrum.wavelengths), spectrum.weights)
    sets = []
    halves = _halves(spectrum)
    if halves:
        parts = [
            _shared(_in_light(setting, half, share).frame(causes.locus), setting) for half, share in halves
        ]
        sets.append(DataSet("2 frames through the halves of the band", _sum(parts)))
    other = _in_light(setting, redder, 1.0)
    words = f"a frame at {_REDDER:g} times the wavelength"
    return [*sets, DataSet(words, _shared(other.frame(causes.locus), other))]


def _halves(spectrum: Spectrum) -> list[tuple[Spectrum, float]]:
    """Both halves of a band and their shares of its light; a node in the middle counts half in both."""
    wavelengths, weights = np.array(spectrum.wavelengths), np.array(spectrum.weights)
    if len(wavelengths) < 2:
        return []
    middle = (wavelengths.min() + wavelengths.max()) / 2
    blue = np.where(np.isclose(wavelengths, middle), 0.5, wavelengths < middle)
    halves = [(weights * part, wavelengths) for part in (blue, 1 - blue)]
    return [(Spectrum(tuple(w[p > 0]), tuple(p[p > 0])), float(p.sum())) for p, w in halves]


def _in_light(setting: Setting, spectrum: Spectrum, share: float) -> Setting:
    """The setting in other light, and a share of it."""
    optics = setting.optics
    assert isinstance(optics, OpticalSystem)
    old = optics.grid
    grid = grid_for(optics.pupil, spectrum, old.shape, old.plate_scale, old.pad)
    scene = setting.scene.brightened(share)
    ratio = setting.ratio * _mean(spectrum) / _mean(optics.spectrum)
    return replace(setting, optics=replace(optics, spectrum=spectrum, grid=grid), scene=scene, ratio=ratio)


def _mean(spectrum: Spectrum) -> float:
    return float(np.dot(spectrum.wavelengths, spectrum.weights))
