"""Choose the scene of a frame: one star, a pair, or several stars.

0. Where three bright peaks or more are far apart, stars are searched for; if they describe the frame beyond
   doubt, or nothing else does, they are the answer.
1. Where the brightest peaks are two, far apart, a pair is searched for; one that describes the frame, wider
   than blur and resolution, with a companion beyond doubt, is the answer.
2. Otherwise one star with a normal blur is fitted.  It is the answer if it describes the frame, nothing
   stands out of its residual, and its blur is not that of two stars: a long one.
3. Otherwise one star is fitted with the best of the loci, two with a normal blur, both also without jitter,
   and they are weighed by their evidence.  Two stars closer than the resolution and a straight blur are
   nearly the same image.

The priors are proper, since they do not cancel between scenes.  A star has a companion within an e-fold of
separation by a chance of :data:`COMPANIONS`, its difference in magnitude is uniform, its direction too.
Jitter has a size, uniform in its logarithm, or is too small to be seen, with the same chance.  Places and
fluxes have the same priors in both scenes.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import log_ndtr

from jitterkit.forward import Parameters, expected_image
from jitterkit.kernel_estimate import significance
from jitterkit.likelihood import Data
from jitterkit.locate import (
    Residual,
    Start,
    bright_stars,
    find_pairs,
    locate_binary,
    locate_star,
    locate_stars,
    polished,
    resolution,
)
from jitterkit.loci import Mvn, axis_variances, covariance_on_axis, principal_axes
from jitterkit.optics import Anchor, AnchoredOptics, OpticalSystem, Optics
from jitterkit.refit.choose import DETECTED, fit_best_locus, fit_locus
from jitterkit.refit.evidence import log_volume, minor_variance
from jitterkit.refit.fit import FitOptions
from jitterkit.refit.priors import Priors
from jitterkit.refit.result import FitResult, Status
from jitterkit.refit.weigh import weight_of_evidence
from jitterkit.scene import Binary, Scene, Star, Stars

__all__ = ["DECIDED", "SCENES", "SceneChoice", "choose_scene"]

SCENES = (Star.name, Binary.name, Stars.name)
"""Names of the scenes that can be searched for."""

_OF_PAIRS = set(Binary.own) - set(Star.own)
"""Parameters that one star has not."""

COMPANIONS = 0.05
"""Share of stars that have a companion, an e-fold of separation: 44 % of stars like the sun, over a normal
law of 2.28 decades of period (Duchene & Kraus, Annu. Rev. Astron. Astrophys. 51, 269, 2013)."""

_FAINTEST = 1000.0
"""Largest contrast that is searched for."""

DECIDED = 3.0
"""Logarithm of the odds, 20 to 1, from which a pair is one; by less in its favour a frame does not decide."""

_WIDE, _FAR_OUT, _CLEAR = 1.0, 6.0, 8.0
"""Of a pair beyond doubt: its separation in resolutions, and in 1 sigma of its blur (a star that vibrates is
fitted by two with 4.4 at most); its faint star's flux in errors."""

_SHINING = 4.0
"""Errors of its flux that each of several stars must shine by."""

_APART, _BRIGHT = 1.5, 100.0
"""Separation, in resolutions, and contrast of two peaks that an image shows without a fit."""

_STANDS_OUT = 25.0
"""Chi-squared of a companion from which the residual of a star is looked into."""

_SIZED = 3.0
"""Standard errors of the total variance from which a jitter has a size, as its evidence takes for granted."""

_LONG = 3.0
"""Standard errors by which a blur is longer than wide, from which it may be that of two stars."""

_STRAIGHT, _THIN = 4.0, 1e-3
"""Standard errors of the minor variance within which a blur may have no width, and its share of the major: a
fit with a straight locus has no error there."""

_STREAKS = ("linear", "shm")
"""Loci that are weighed for a straight blur whether its shape is seen or not: two stars have another."""

_SURELY = 200.0
"""Chi-squared of its moments from which no frame is fitted without jitter: odds of e^100."""

_ALIKE = 9.0
"""Deviance by which a pair may fit worse than one star, and look like it."""


@dataclass(frozen=True)
class SceneChoice:
    """What scene a frame shows.

    Attributes
    ----------
    start : Start
        Of the scene that is more probable, fitted briefly.
    log_odds : float
        Logarithm of the odds of a pair against one star, priors included; infinite where only one of them
        was worth a fit.
    readings : str
        Both, in words, where both were fitted.
    alike : bool
        Whether the odds are below 20 to 1; or a pair without jitter, closer than the resolution, fits the
        frame as well as one star, so that only what is probable beforehand tells them apart.
    fit : FitResult or None
        Of one star with the best of the loci, by the options that were given, if it was made and is chosen.
    """

    start: Start
    log_odds: float
    readings: str = ""
    alike: bool = False
    fit: FitResult | None = None

    @property
    def undecided(self) -> bool:
        """Whether a pair is the more probable, but not by enough."""
        return 0 < self.log_odds < DECIDED

    @property
    def doubt(self) -> str:
        """That a pair may look the same as the star that was chosen, in a sentence; or nothing."""
        return f"It shows {self.readings}: both look alike." if self.alike and self.log_odds < 0 else ""

    @property
    def scene(self) -> str:
        """Name of the scene, one of :data:`SCENES`."""
        return self.start.parameters.scene.name


def choose_scene(
    data: Data, optics: Optics, options: FitOptions | None = None, *, rough: bool = False
) -> SceneChoice | None:
    """Find the simplest scene that a frame supports, and starting values for all of its parameters.

    Parameters
    ----------
    data : Data
    optics : Optics
    options : FitOptions, optional
        Of the fit to come.  Whoever holds, or has a prior on, what only a pair has gets a pair; priors on
        anything else do not enter.
    rough : bool
        As for :func:`~jitterkit.locate.locate_binary`.

    Returns
    -------
    choice : SceneChoice or None
        None if no star rises above the noise.
    """
    options = options or FitOptions()
    frame = _Frame(data, optics, replace(options, priors=Priors()), rough)
    if _OF_PAIRS & {*options.hold, *options.priors.terms}:  # who knows them knows that there is a pair
        pair = frame.pair()
        return None if pair is None else SceneChoice(pair, math.inf)
    several = frame.stars() if frame.looks_like_several() else None
    if several is not None and frame.beyond_doubt(several):
        return SceneChoice(several, math.inf)
    pair = frame.pair() if frame.looks_like_a_pair() else None
    if pair is not None and frame.beyond_doubt(pair):
        return SceneChoice(pair, math.inf)
    star = locate_star(data, optics, frame.options.hold, rough=rough)
    if star is None:
        return None
    if several is not None and several.describes(data):
        return frame.best_of(star, pair, several)
    pairs = list(frame.pairs_instead(star, pair))
    if not pairs:
        return SceneChoice(star, -math.inf)
    return frame.weighed(star, pairs)


@dataclass(frozen=True)
class _Reading:
    """One way to read a frame."""

    start: Start
    fit: FitResult
    evidence: float


@dataclass(frozen=True)
class _Frame:
    """A frame whose scene is asked for."""

    data: Data
    optics: Optics
    options: FitOptions
    rough: bool

    @property
    def fineness(self) -> float:
        """Resolution of the optics, arcsec."""
        return resolution(self.optics.nominal)

    @property
    def width(self) -> float:
        """Of the frame, arcsec, along its longer side."""
        grid = self.optics.nominal.grid
        return grid.plate_scale * max(grid.shape)

    def pair(self) -> Start | None:
        return locate_binary(self.data, self.optics, self.options.hold, rough=self.rough)

    def looks_like_a_pair(self) -> bool:
        """Whether two bright peaks stand apart."""
        found = find_pairs(self.data, self.optics.nominal, most=1)
        scene = found[0].scene if found else None
        return (
            scene is not None
            and float(scene.separation) > _APART * self.fineness
            and float(scene.contrast) < _BRIGHT
        )

    def looks_like_several(self) -> bool:
        """Whether more than two bright peaks stand apart."""
        found = bright_stars(self.data, self.optics.nominal)
        return found is not None and len(found.x) > 2

    def stars(self) -> Start | None:
        """Three stars or more, if they stay so many when everything is fitted."""
        found = locate_stars(self.data, self.optics, self.options.hold, rough=self.rough)
        return found if found is not None and len(found.parameters.scene.sources()[0]) > 2 else None

    def beyond_doubt(self, start: Start) -> bool:
        """Whether stars describe the frame, and no blur of one star could."""
        scene = start.parameters.scene
        major, _, _ = principal_axes(start.parameters.locus.moments())
        x, y, _ = (np.asarray(part) for part in scene.sources())
        apart = np.hypot(x - x[:, None], y - y[:, None])[np.triu_indices(len(x), 1)]
        return bool(
            apart.min() > max(_WIDE * self.fineness, _FAR_OUT * major)
            and _is_clear(start)
            and start.describes(self.data)
        )

    def best_of(self, star: Start, pair: Start | None, several: Start) -> SceneChoice:
        """The simplest that describes the frame: two or more stars do where nothing else does."""
        if star.describes(self.data):
            return SceneChoice(star, -math.inf)
        simpler = pair is not None and pair.describes(self.data)
        return SceneChoice(pair if simpler and pair is not None else several, math.inf)

    def pairs_instead(self, star: Start, pair: Start | None) -> Iterator[Start]:
        """Pairs that a frame may show in place of a star; ``pair`` has been searched for."""
        hold, parameters = self.options.hold, star.parameters
        image = np.asarray(expected_image(parameters, star.otf))
        other, gain = Residual(self.data, image, star.otf, parameters.locus).star()
        if gain > _STANDS_OUT:
            scene = _with_companion(parameters.scene, other)
            yield polished(self.data, self.optics, star.otf, scene, parameters.locus, hold, rough=self.rough)
        moments, covariance = np.asarray(parameters.locus.moments()), star.covariance
        if significance(moments, covariance) > DETECTED and _is_long(moments, covariance):
            yield replace(star, parameters=_split(parameters, moments))
        if pair is None and not star.describes(self.data):
            pair = self.pair()
        if pair is not None:
            yield pair

    def weighed(self, star: Start, pairs: list[Start]) -> SceneChoice:
        """The scene with more evidence, and by how much."""
        frame = replace(self, optics=_anchored(self.optics, star.parameters))
        one = _best(frame.readings_of_star(star))
        two = _best(reading for pair in pairs for reading in frame.readings_of_pair(pair))
        if math.isfinite(one.evidence) or math.isfinite(two.evidence):
            log_odds = float(two.evidence - one.evidence)
        else:  # the fit to come will say so of the better
            log_odds = math.inf if two.fit.objective < one.fit.objective - _ALIKE else -math.inf
        close = two.fit.of_scene("separation") < self.fineness
        as_well = two.fit.locus == "stable" and two.fit.objective < one.fit.objective + _ALIKE
        alike = log_odds > -DECIDED or bool(close and as_well)
        chosen = two if log_odds > 0 else one
        start = frame.begun(chosen) if _is_split(chosen.start) else chosen.start
        fit = one.fit if chosen is one and one.fit.locus != "stable" else None
        return SceneChoice(start, log_odds, f"{_said(one)}, or {_said(two)}", alike, fit)

    def begun(self, reading: _Reading) -> Start:
        """Where the fit begins of a pair that was made of a blur."""
        parameters = reading.fit.parameters or reading.start.parameters
        otf = self.optics.otf(parameters.aberrations)
        blur = Mvn.near(reading.fit.moments()[0]) if reading.fit.parameters else None
        where = self.data, self.optics, otf, parameters.scene, blur
        return polished(*where, self.options.hold, rough=self.rough)

    def readings_of_star(self, start: Start) -> Iterator[_Reading]:
        """One star with the best of the loci, with straight ones, and without jitter."""
        common = self.common(start)
        jittered = fit_best_locus(*common)
        told = {one.locus: one.evidence for one in jittered.candidates}
        if told and _is_straight(*jittered.moments()):
            more = [name for name in _STREAKS if name not in told]
            near = self.common(start, jittered)
            told |= {name: weight_of_evidence(fit_locus(name, *near)) for name in more}
        yield self.jittered(start, jittered, told, seen="jitter_undetected" not in jittered.flags)
        if not _surely(start):
            yield self.still(start, common)

    def readings_of_pair(self, start: Start) -> Iterator[_Reading]:
        """Two stars with a normal blur, and without jitter."""
        common = self.common(start)
        fit = fit_locus("mvn", *common)
        yield self.jittered(start, fit, {"mvn": weight_of_evidence(fit)}, seen=_has_a_size(fit))
        if _is_split(start) or not _surely(start):
            yield self.still(start, common)

    def common(self, start: Start, fit: FitResult | None = None):
        """What fits are given, to begin at a start or where one ended."""
        if fit is None or fit.parameters is None:
            moments, parameters, otf = (
                np.asarray(start.parameters.locus.moments()),
                start.parameters,
                start.otf,
            )
        else:
            moments, parameters = fit.moments()[0], fit.parameters
            otf = self.optics.otf(parameters.aberrations)
        return self.data, self.optics, parameters, moments, otf, self.options

    def jittered(self, start: Start, fit: FitResult, evidence: dict[str, float], *, seen: bool) -> _Reading:
        """Each locus is as probable as any other before the frame is seen; what is not seen has no size."""
        if not evidence or not seen:
            return _Reading(start, fit, -math.inf)
        together = float(np.logaddexp.reduce(list(evidence.values()))) - math.log(len(evidence))
        return self.reading(start, fit, together - math.log(self.sizes))

    def still(self, start: Start, common) -> _Reading:
        fit = fit_locus("stable", *common)
        return self.reading(start, fit, log_volume(fit) if fit.status is Status.OK else -math.inf)

    def reading(self, start: Start, fit: FitResult, evidence: float) -> _Reading:
        prior = -math.inf if fit.parameters is None else self.scene_prior(fit)
        return _Reading(start, fit, evidence + prior if evidence == evidence else -math.inf)

    @property
    def sizes(self) -> float:
        """Range of the logarithm of the jitter's variance: from a hundredth of the resolution to a quarter of
        the frame.
        """
        return 2 * math.log(25 * self.width / self.fineness)

    def scene_prior(self, fit: FitResult) -> float:
        """Logarithm of the prior density of what a scene has beside place and light."""
        assert fit.parameters is not None
        scene = fit.parameters.scene
        range_of_separations = math.log(10 * math.sqrt(2) * self.width / self.fineness)
        if not isinstance(scene, Binary):
            return math.log(max(1 - COMPANIONS * range_of_separations, COMPANIONS))
        separation, contrast = float(scene.separation), float(scene.contrast)
        within = float(log_ndtr((contrast - 1) / fit.error("contrast")))  # B is not the brighter
        density = COMPANIONS / (separation * 360.0 * contrast * math.log(_FAINTEST))
        return math.log(density) + within if contrast < _FAINTEST else -math.inf


def _is_clear(start: Start) -> bool:
    """Whether the fluxes of all stars but the brightest are far from none."""
    scene, names = start.parameters.scene, start.names
    if isinstance(scene, Binary):
        contrast, error = float(scene.contrast), math.sqrt(start.covariance_of(("contrast",))[0, 0])
        return min(1 + contrast, (1 + 1 / contrast) * contrast**2) > _CLEAR * error
    fluxes = [name for name in names if name.startswith("flux_")]
    values = np.array([scene.values[name] for name in fluxes])
    return bool(np.all(values > _SHINING * np.sqrt(np.diag(start.covariance_of(fluxes)))))


def _has_a_size(fit: FitResult) -> bool:
    """Whether jitter is seen, of a variance that is positive: a pair may have taken too much of it."""
    moments, covariance = fit.moments()
    error = math.sqrt(max(covariance[0, 0] + covariance[2, 2] + 2 * covariance[0, 2], 0.0))
    return significance(moments, covariance) > DETECTED and bool(moments[0] + moments[2] > _SIZED * error)


def _is_split(start: Start) -> bool:
    """Whether a pair was made of a star's blur, and not fitted yet."""
    return start.parameters.scene.name == Binary.name and "separation" not in start.names


def _surely(start: Start) -> bool:
    """Whether a start shows jitter so clearly that no fit without it is worth its time."""
    return significance(np.asarray(start.parameters.locus.moments()), start.covariance) > _SURELY


def _best(readings: Iterable[_Reading]) -> _Reading:
    """The most probable; of those for which nothing speaks, the one that fits best."""
    return max(readings, key=lambda one: (one.evidence, -np.nan_to_num(one.fit.objective, nan=np.inf)))


def _anchored(optics: Optics, parameters: Parameters) -> Optics:
    """Optics that are expanded more cheaply near some aberrations, for many fits."""
    if not isinstance(optics, OpticalSystem) or not len(parameters.aberrations):
        return optics
    anchor = Anchor.at(optics, parameters.aberrations)
    return AnchoredOptics.about(optics, anchor, max(float(parameters.scene.flux), 1.0))


def _is_straight(moments: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether a blur may have no width."""
    minor, error = minor_variance(moments, covariance)
    return bool(minor < max(_STRAIGHT * error, _THIN * (moments[0] + moments[2] - minor)))


def _is_long(moments: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether a blur is longer than it is wide, beyond doubt."""
    major, minor, angle = axis_variances(moments)
    turned = covariance_on_axis(covariance, angle)
    error = math.sqrt(max(turned[0, 0] + turned[2, 2] - 2 * turned[0, 2], 0.0))
    return not major - minor < _LONG * error


def _with_companion(star: Scene, other: Scene) -> Binary:
    """A star and another beside it."""
    (xa, ya, a), (xb, yb, b) = ((float(s.x), float(s.y), float(s.flux)) for s in (star, other))
    contrast = min(max(a / b, 1 / _FAINTEST), _FAINTEST)
    pair = Binary(
        math.hypot(xb - xa, yb - ya),
        math.degrees(math.atan2(yb - ya, xb - xa)),
        (xa + xb) / 2,
        (ya + yb) / 2,
        a + b,
        contrast,
    )
    return pair.tidied()


def _split(parameters: Parameters, moments: np.ndarray) -> Parameters:
    """Two stars, a little different, with a round blur, that have the moments of a long one."""
    major, minor, angle = axis_variances(moments)
    scene, contrast = parameters.scene, 1.2
    separation = math.sqrt(major - max(minor, 0.0)) * (1 + contrast) / math.sqrt(contrast)
    pair = Binary(separation, angle, scene.x, scene.y, scene.flux, contrast)
    round_blur = Mvn.near(max(minor, 0.0) * np.array([1.0, 0.0, 1.0]))
    return Parameters(pair, round_blur, parameters.aberrations, parameters.background)


def _said(reading: _Reading) -> str:
    """In words."""
    fit = reading.fit
    if fit.parameters is None:
        return "neither"
    scene = fit.parameters.scene
    major, minor, _ = principal_axes(fit.moments()[0])
    jitter = f"a jitter of {major:.3g} x {minor:.3g} arcsec rms" if major > 0 else "no jitter"
    if isinstance(scene, Binary):
        return f"two stars {float(scene.separation):.4g} arcsec apart with {jitter}"
    return f"one star with {jitter}"
