"""Follow-up observations that separate the causes of a width.

Reach for :func:`further_data`: a list of observations from the cheapest to the dearest, each with the Fisher
information that it adds, and for :func:`cheapest`, which chooses.  A further frame has a scene and a jitter
of its own; it shares aberrations, diffusion and seeing.
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
class Observation:
    """Hold an observation that may be added to the frame.

    Attributes
    ----------
    words : str
    extra : Information
        What it adds about the causes and about the other parameters that all frames share.
    """

    words: str
    extra: Information

    def __add__(self, other: Observation) -> Observation:
        """Combine two observations."""
        return Observation(f"{self.words}, and {other.words}", self.extra + other.extra)


@dataclass(frozen=True)
class FollowUp:
    """Hold the sizes of possible follow-up observations.

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


def further_data(causes: Causes, follow_up: FollowUp | None = None) -> list[Observation]:
    """List observations that might separate the causes, the cheapest first.

    Parameters
    ----------
    causes : Causes
    follow_up : FollowUp, optional

    Returns
    -------
    sets : list of Observation
        More light under the same motion (in short frames: it does not saturate); more frames; a laboratory's
        diffusion; telemetry, of the frame and of more frames; a frame at rest, and one without air; a pair
        refocused both ways; the band in halves; a redder filter.  Observations that the setting does not
        allow are excluded.

    Notes
    -----
    *Assumes* the same light in every frame (each half of the band has half of it), and wavefront errors in nm
    and a diffusion that do not change with the wavelength; charge from deeper in a detector diffuses less
    far.  A refocused pair that determines defocus determines its square as well.
    """
    follow_up = FollowUp() if follow_up is None else follow_up
    setting, locus = causes.setting, causes.locus
    moves = axis_variances(np.asarray(locus.moments()))[0] > 0
    sets = [Observation(f"{_LIGHT:g} times the light under the same motion", causes.frame.times(_LIGHT - 1))]
    if moves:
        others = [(one, setting.frame(one)) for one in _other_jitters(locus, follow_up.frames)]
        more = _sum(information.about(setting.shared) for _, information in others)
        sets.append(Observation(f"{follow_up.frames} more frames, each with a jitter of its own", more))
    words = f"diffusion measured to {follow_up.diffusion:g} pixel"
    sets.append(Observation(words, _diffusion(causes, follow_up)))
    if moves:
        both = (information + _telemetry(one, follow_up.telemetry) for one, information in others)
        trusted = _sum(information.about(setting.shared) for information in both)
        known = _telemetry(locus, follow_up.telemetry)
        words = f"telemetry of the jitter to {100 * follow_up.telemetry:g} %"
        sets.append(Observation(words, known))
        sets.append(Observation(f"{words}, in {follow_up.frames} more frames too", known + trusted))
    if locus.names:
        sets.append(Observation("a frame at rest", _shared(setting, Stable.of())))
    if setting.seeing is not None:
        bench = replace(setting, seeing=None)
        sets.append(Observation("a frame at rest without air", _shared(bench, Stable.of())))
    return sets + _refocused(causes, follow_up.diversity) + _recoloured(causes)


def cheapest(causes: Causes, sets: Sequence[Observation], target: float = 0.1) -> Observation | None:
    """Return the first observation, or else pair of observations, that brings every cause below a target.

    Parameters
    ----------
    causes : Causes
    sets : sequence of Observation
        The cheapest first.
    target : float
        Largest error, as :meth:`Causes.shares` has it.
    """
    pairs = sorted(itertools.combinations(range(len(sets)), 2), key=sum)
    every = itertools.chain(sets, (sets[i] + sets[j] for i, j in pairs))
    return next((one for one in every if np.all(causes.shares(causes.errors(one.extra)) <= target)), None)


def _shared(setting: Setting, locus: Locus) -> Information:
    """Return what a frame tells about the parameters that all frames share."""
    return setting.frame(locus).about(setting.shared)


def _sum(parts) -> Information:
    first, *others = parts
    return sum(others, start=first)


def _other_jitters(locus: Locus, count: int) -> list[Locus]:
    """Return the jitter turned by equal steps through 180 degrees, and of other sizes."""
    sizes = enumerate(np.linspace(*_SIZES, count))
    turned = [size**2 * moments_on_axis(locus.moments(), -180.0 * k / count) for k, size in sizes]
    if isinstance(locus, Streak):
        return [locus.near(moments) for moments in turned]
    return [locus.at(jnp.concatenate([moments, locus.coords[3:]])) for moments in turned]


def _telemetry(locus: Locus, share: float) -> Information:
    names = JITTER[:2] if isinstance(locus, Streak) else JITTER
    along, _, _ = axis_variances(np.asarray(locus.moments()))
    return Information.prior(dict.fromkeys(names, share * along))


def _diffusion(causes: Causes, follow_up: FollowUp) -> Information:
    """Return a prior on the variance, from the error of sigma."""
    error, sigma = follow_up.diffusion * causes.plate_scale, causes.setting.diffusion**0.5
    return Information.prior({"diffusion": (sigma + error) ** 2 - sigma**2})


def _refocused(causes: Causes, offset: float) -> list[Observation]:
    """Return the observation of a frame on each side of the focus, by a known defocus."""
    setting = causes.setting
    names = setting.optics.nominal.names
    if "noll4" not in names:
        return []
    step = offset * np.array([name == "noll4" for name in names[: len(setting.aberrations)]])
    moved = [
        replace(setting, aberrations=tuple(np.array(setting.aberrations) + sign * step), square=False)
        for sign in (-1, 1)
    ]
    extra = _sum(_shared(one, causes.locus) for one in moved)
    if setting.square:
        error = float(extra.about(("noll4",)).errors[0])
        others = [name for name in extra.names if name != "noll4"]
        extra = extra.about(others) + Information.prior({SQUARE: error**2})
    return [Observation(f"2 frames refocused by ±{offset:g} nm", extra)]


def _recoloured(causes: Causes) -> list[Observation]:
    """Return the observations in the halves of the band, and in another band, if the optics have colours."""
    setting, optics = causes.setting, causes.setting.optics
    if not isinstance(optics, OpticalSystem):
        return []
    spectrum = optics.spectrum
    redder = Spectrum(tuple(_REDDER * w for w in spectrum.wavelengths), spectrum.weights)
    sets = []
    if halves := _halves(spectrum):
        parts = (_shared(_in_light(setting, half, share), causes.locus) for half, share in halves)
        sets.append(Observation("2 frames through the halves of the band", _sum(parts)))
    words = f"a frame at {_REDDER:g} times the wavelength"
    return [*sets, Observation(words, _shared(_in_light(setting, redder, 1.0), causes.locus))]


def _halves(spectrum: Spectrum) -> list[tuple[Spectrum, float]]:
    """Return both halves of a band, with their shares of its light; a node in the middle is split."""
    wavelengths, weights = np.array(spectrum.wavelengths), np.array(spectrum.weights)
    if len(wavelengths) < 2:
        return []
    middle = (wavelengths.min() + wavelengths.max()) / 2
    blue = np.where(np.isclose(wavelengths, middle), 0.5, wavelengths < middle)
    halves = [(weights * part, wavelengths) for part in (blue, 1 - blue)]
    return [(Spectrum(tuple(w[p > 0]), tuple(p[p > 0])), float(p.sum())) for p, w in halves]


def _in_light(setting: Setting, spectrum: Spectrum, share: float) -> Setting:
    """Return the setting in a share of other light."""
    optics = setting.optics
    assert isinstance(optics, OpticalSystem)
    old = optics.grid
    grid = grid_for(optics.pupil, spectrum, old.shape, old.plate_scale, old.pad)
    scene = setting.scene.brightened(share)
    ratio = setting.ratio * spectrum.mean / optics.spectrum.mean
    return replace(setting, optics=replace(optics, spectrum=spectrum, grid=grid), scene=scene, ratio=ratio)
