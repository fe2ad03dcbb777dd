"""Choose the scene of a frame: one star, a pair, or several stars.

0. Where three bright peaks or more are far apart, stars are searched for; if they describe the frame beyond
   doubt, or nothing else does, they are the answer.  So are a pair and four stars or more that are not
   much fainter.
1. Where the brightest peaks are two, far apart, a pair is searched for; one that describes the frame, wider
   than blur and resolution, with a companion that is certain, is the answer.  If one of them is much fainter,
   step 2 comes first.  Where the pair does not describe the frame, six stars or more are searched for, one
   of which may outshine the others.
2. Otherwise one star with a normal blur is fitted.  It is the answer if it describes the frame, nothing
   stands out of its residual, and its blur is not that of two stars: a long one.
3. Otherwise one star is fitted with the best of the loci, two with a normal blur, both also without jitter,
   and they are weighed by their evidence.  Two are fitted with straight blurs too where one needs more than a
   simple locus, and one with every locus where two with jitter are more probable, and on a path that dwells
   where the two are.  Two stars closer than the resolution and a straight blur are nearly the same image.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

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
    settled,
)
from jitterkit.loci import Mvn, axis_variances, covariance_on_axis, principal_axes
from jitterkit.optics import Optics
from jitterkit.refit.choose import DETECTED
from jitterkit.refit.fit import FitOptions
from jitterkit.refit.priors import Priors
from jitterkit.refit.scene_choice import SceneChoice
from jitterkit.refit.scene_prior import FAINTEST
from jitterkit.refit.weigh_scenes import Weighing
from jitterkit.scene import Binary, Scene, Star, Stars

__all__ = ["SCENES", "choose_scene"]

SCENES = (Star.name, Binary.name, Stars.name)
"""Names of the scenes that can be searched for."""

_OF_PAIRS = set(Binary.own) - set(Star.own)
"""Parameters that one star has not."""

_WIDE, _FAR_OUT, _CLEAR = 1.0, 6.0, 8.0
"""Of a pair that is certain: its separation in resolutions, and in 1 sigma of its blur (a star that vibrates
is fitted by two with 4.4 at most); its faint star's flux in errors."""

_COMPANY, _LIKE_B = 3, 0.06
"""Further stars from which a pair is none, if one of them is less than three magnitudes fainter than B."""

_SHINING = 4.0
"""Errors of its flux that each of several stars must shine by."""

_APART, _BRIGHT = 1.5, 100.0
"""Separation, in resolutions, and contrast of two peaks that an image shows without a fit."""

_LIKE_RINGS = 10.0
"""Contrast of these from which the fainter may be a diffraction ring or a speckle.  The search for a pair
takes as long as all else: then it is made only if one star does not do."""

_STANDS_OUT, _BY_CHANCE = 25.0, 16.0
"""Chi-squared of a companion from which the residual of a star is looked into, and up to which it is noise,
the best of some ten thousand positions.  Aberrations explain a part of a companion: between them a pair is
searched for where an image shows two peaks."""

_NEARER, _BEYOND = 2.0, (4.0, 9.0)
"""Of a pair that needs no weighing: the least ratio of one star's excess of deviance (over one per pixel) to
the pair's; and its least separation, in resolutions and in 1 sigma of its blur along its axis.  A star that
dwells at both ends of 0.7 cycles is fitted by two with 9.4 of these at 2.5 resolutions, with 7.4 at 4.7."""

_LONG = 3.0
"""Standard errors by which a blur is longer than wide, from which it may be that of two stars."""


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
        anything else do not enter, nor does a model error that the data do not allow for.
    rough : bool
        As for :func:`~jitterkit.locate.locate_binary`.

    Returns
    -------
    choice : SceneChoice or None
        None if no star rises above the noise.
    """
    options = options or FitOptions()
    frame = _Frame(data, optics, replace(options, priors=Priors(), model_error=0.0), rough)
    if _OF_PAIRS & {*options.hold, *options.priors.terms}:  # who knows them knows that there is a pair
        pair = frame.pair()
        return None if pair is None else SceneChoice(pair, math.inf)
    bright = bright_stars(data, optics.nominal)
    several = frame.stars() if bright is not None and len(bright.x) > 2 else None
    if several is not None and frame.beyond_doubt(several):
        return SceneChoice(several, math.inf)
    peaks = find_pairs(data, optics.nominal, most=1)
    apart = bool(peaks) and float(peaks[0].scene.separation) > _APART * frame.fineness
    contrast = float(peaks[0].scene.contrast) if apart else math.inf
    star = frame.star() if contrast > _LIKE_RINGS else None
    if star is not None and frame.is_one(star):
        return SceneChoice(star, -math.inf)
    pair = frame.pair() if contrast < _BRIGHT else None
    if pair is not None and frame.beyond_doubt(pair):
        faint = pair.parameters.scene.values["contrast"] > _LIKE_RINGS
        pair = frame.settled(pair) if faint else pair
        if not faint or frame.beyond_doubt(pair):
            return SceneChoice(frame.pair_or_field(pair), math.inf)
    if several is None and pair is not None and frame.is_apart(pair) and not pair.describes(data):
        # beside a star that outshines the others no three are bright
        field = frame.stars(_COMPANY + 3)
        if field is not None and frame.beyond_doubt(field):
            return SceneChoice(field, math.inf)
    star = star or frame.star()
    if star is None:
        return None
    if pair is not None and frame.comes_nearer(pair, star):
        return SceneChoice(frame.pair_or_field(pair), math.inf)
    if several is not None and frame.is_apart(several):
        return frame.best_of(star, pair, several)
    star = frame.settled(star)
    if frame.is_one(star):
        return SceneChoice(star, -math.inf)
    pairs = list(frame.pairs_instead(star, pair))
    if not pairs:
        return SceneChoice(star, -math.inf)
    choice = frame.weighed(star, pairs)
    return replace(choice, start=frame.pair_or_field(choice.start))


@dataclass(frozen=True)
class _Frame(Weighing):
    """A frame whose scene is asked for."""

    def pair(self) -> Start | None:
        return locate_binary(self.data, self.optics, self.options.hold, rough=self.rough)

    def star(self) -> Start | None:
        return locate_star(self.data, self.optics, self.options.hold, rough=self.rough)

    def settled(self, start: Start) -> Start:
        """Return a start that was fitted roughly, fitted until its optics are exact.

        An error of the optics looks like a faint companion.
        """
        return settled(start, self.data, self.optics, self.options.hold) if self.rough else start

    def stars(self, least: int = 3) -> Start | None:
        """Three stars or more, if they stay so many when everything is fitted."""
        found = locate_stars(self.data, self.optics, self.options.hold, rough=self.rough)
        return found if found is not None and len(found.parameters.scene.sources()[0]) >= least else None

    def pair_or_field(self, pair: Start) -> Start:
        """A pair as it is, or its stars as a field where it is but the brightest two of many."""
        p = pair.parameters
        if p.scene.others is None or not isinstance(p.scene, Binary):
            return pair
        (_, _, (_, fainter)), others = p.scene.stars(), p.scene.others
        if len(others.x) <= _COMPANY or float(others.flux[0]) <= _LIKE_B * float(fainter):
            return pair
        where = self.data, self.optics, pair.otf, Stars.of(*p.scene.sources()), p.locus, self.options.hold
        return polished(*where, rough=self.rough)

    def beyond_doubt(self, start: Start) -> bool:
        """Return whether stars describe the frame, and no blur of one star could."""
        every = len(start.parameters.scene.sources()[0])
        return self.is_apart(start, every) and _is_clear(start) and start.describes(self.data)

    def comes_nearer(self, pair: Start, star: Start) -> bool:
        """Return whether a pair that no blur of one star makes comes much nearer to the frame than a star.

        Only the shape of its blur may not fit yet.
        """
        alike = pair.parameters.scene.values["contrast"] < _LIKE_RINGS
        nearer = star.deviance_dof - 1 > _NEARER * (pair.deviance_dof - 1)
        return bool(alike and nearer) and self.is_beyond_a_motion(pair) and _is_clear(pair)

    def is_beyond_a_motion(self, pair: Start) -> bool:
        """Return whether a pair is too wide, and its blur along its axis too small, for a moving star."""
        x, y, _ = (np.asarray(part) for part in pair.parameters.scene.sources())
        dx, dy = x[1] - x[0], y[1] - y[0]
        sxx, sxy, syy = np.asarray(pair.parameters.locus.moments())
        squared, blur = dx**2 + dy**2, dx**2 * sxx + 2 * dx * dy * sxy + dy**2 * syy  # times squared
        wide, small = _BEYOND
        return bool(squared > (wide * self.fineness) ** 2 and squared**2 > small**2 * blur)

    def is_apart(self, start: Start, brightest: int = 3) -> bool:
        """Return whether the brightest stars are wider apart than the pieces of one blur."""
        major, _, _ = principal_axes(start.parameters.locus.moments())
        x, y, flux = (np.asarray(part) for part in start.parameters.scene.sources())
        first = np.argsort(-flux)[:brightest]
        apart = np.hypot(x[first] - x[first, None], y[first] - y[first, None])
        least = apart[np.triu_indices(len(first), 1)].min()
        return bool(least > max(_WIDE * self.fineness, _FAR_OUT * major))

    def best_of(self, star: Start, pair: Start | None, several: Start) -> SceneChoice:
        """The simplest that describes the frame, or where none does the nearest."""
        if star.describes(self.data):
            return SceneChoice(star, -math.inf)
        if pair is not None and pair.describes(self.data):
            return SceneChoice(self.pair_or_field(pair), math.inf)
        return SceneChoice(several, math.inf)

    def is_one(self, star: Start) -> bool:
        """Return whether one star describes the frame, without a sign of a second."""
        return star.describes(self.data) and self.beside(star, _BY_CHANCE) is None and not _looks_long(star)

    def beside(self, star: Start, least: float = _STANDS_OUT) -> Star | None:
        """Return the strongest source in a star's residual, if it reduces chi-squared enough."""
        image = np.asarray(expected_image(star.parameters, star.otf))
        other, gain = Residual(self.data, image, star.otf, star.parameters.locus).star()
        return other if gain > least else None

    def pairs_instead(self, star: Start, pair: Start | None) -> Iterator[Start]:
        """Pairs that a frame may show in place of a star; ``pair`` has been searched for."""
        hold, parameters = self.options.hold, star.parameters
        other = self.beside(star)
        if other is not None:
            scene = _with_companion(parameters.scene, other)
            yield polished(self.data, self.optics, star.otf, scene, parameters.locus, hold, rough=self.rough)
        if _looks_long(star):
            yield replace(star, parameters=_split(parameters, np.asarray(parameters.locus.moments())))
        if pair is None and not star.describes(self.data):
            pair = self.pair()
        if pair is not None:
            yield pair


def _is_clear(start: Start) -> bool:
    """Return whether the fluxes of all stars but the brightest are significant."""
    scene, names = start.parameters.scene, start.names
    if isinstance(scene, Binary):
        contrast, error = float(scene.contrast), math.sqrt(start.covariance_of(("contrast",))[0, 0])
        return min(1 + contrast, (1 + 1 / contrast) * contrast**2) > _CLEAR * error
    fluxes = [name for name in names if name.startswith("flux_")]
    values = np.array([scene.values[name] for name in fluxes])
    return bool(np.all(values > _SHINING * np.sqrt(np.diag(start.covariance_of(fluxes)))))


def _looks_long(star: Start) -> bool:
    """Return whether a star's blur is significant, and significantly longer than wide."""
    moments, covariance = np.asarray(star.parameters.locus.moments()), star.covariance
    if not significance(moments, covariance) > DETECTED:
        return False
    major, minor, angle = axis_variances(moments)
    turned = covariance_on_axis(covariance, angle)
    error = math.sqrt(max(turned[0, 0] + turned[2, 2] - 2 * turned[0, 2], 0.0))
    return not major - minor < _LONG * error


def _with_companion(star: Scene, other: Scene) -> Binary:
    """A star and another beside it."""
    (xa, ya, a), (xb, yb, b) = ((float(s.x), float(s.y), float(s.flux)) for s in (star, other))
    contrast = min(max(a / b, 1 / FAINTEST), FAINTEST)
    pair = Binary(
        math.hypot(xb - xa, yb - ya),
        math.degrees(math.atan2(yb - ya, xb - xa)),
        (xa + xb) / 2,
        (ya + yb) / 2,
        a + b,
        contrast,
    )
    return pair.canonical()


def _split(parameters: Parameters, moments: np.ndarray) -> Parameters:
    """Two stars, a little different, with a round blur, that have the moments of a long one."""
    major, minor, angle = axis_variances(moments)
    scene, contrast = parameters.scene, 1.2
    separation = math.sqrt(major - max(minor, 0.0)) * (1 + contrast) / math.sqrt(contrast)
    pair = Binary(separation, angle, scene.x, scene.y, scene.flux, contrast)
    round_blur = Mvn.near(max(minor, 0.0) * np.array([1.0, 0.0, 1.0]))
    return replace(parameters, scene=pair, locus=round_blur)
