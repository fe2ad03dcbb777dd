"""Weigh two readings of a frame: one star, or a pair."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from jitterkit.kernel_estimate import significance
from jitterkit.likelihood import Data
from jitterkit.locate import Start, polished, resolution
from jitterkit.loci import Mvn
from jitterkit.optics import Optics
from jitterkit.refit.choose import fit_best_locus
from jitterkit.refit.dwell import fit_dwelling_star, log_maxima, over_orders
from jitterkit.refit.evidence import CHOICES, is_intricate, log_volume
from jitterkit.refit.fit import FitOptions
from jitterkit.refit.locus_fit import FrameFits, fit_locus
from jitterkit.refit.reading import (
    OF_A_PAIR,
    FittedPair,
    Reading,
    best_reading,
    describe,
    has_a_size,
    is_same_maximum,
    is_straight,
    needs_more,
    shows_companion,
)
from jitterkit.refit.result import FitResult, Status
from jitterkit.refit.scene_choice import DECIDED, SceneChoice, SceneEvidence
from jitterkit.refit.scene_prior import COMPANIONS, ScenePrior
from jitterkit.refit.weigh import describe_undecided, weight_of_evidence, with_candidate
from jitterkit.scene import Binary

_STREAKS = ("linear", "shm")
"""Loci that are weighed for a straight blur whether its shape is seen or not: two stars have another."""

_SURELY = 200.0
"""Chi-squared of its moments from which no frame is fitted without jitter: odds of e^100."""

_WORSE = 0.3
"""Deviance per pixel by which the brief fit of a pair may be above one star: a fit lowers it by 0.06."""

_NEARLY = 2.0
"""Ratio of a pair's excess of deviance with a normal blur to that of the best pair, up to which other blurs
are tried: pairs that were wrong had 5 and 23."""

_CATCHES_UP = 10.0
"""Logarithm of the odds against a pair with a normal blur that its straight blur may make up for: it was 0.6
to 7.7 in five pairs, and 31 in one that was 2,400 behind."""

_LAST = max(choice.tier for choice in CHOICES.values())
"""Tier of the loci that are tried only where no other describes a frame."""

_ALIKE = 9.0
"""Deviance by which a scene may fit worse than another, and look like it."""


@dataclass(frozen=True)
class Weighing:
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
    def prior(self) -> ScenePrior:
        """Return what is known of scenes beforehand."""
        return ScenePrior.of(self.optics.nominal)

    @property
    def pixels(self) -> int:
        """Number of pixels in use."""
        return int(np.sum(np.asarray(self.data.used)))

    def weighed(self, star: Start, pairs: list[Start]) -> SceneChoice:
        """The scene with more evidence, and by how much."""
        rival = min([p.deviance_dof * self.pixels for p in pairs if not _is_split(p)], default=math.inf)
        one = best_reading(self.readings_of_star(star, rival))
        # one pair at least, for its evidence
        near = [pair for pair in pairs if not self.is_worse(pair, one)] or pairs[-1:]
        normals = self.normals(near)
        of_pairs = self.readings_of_pairs(normals, one)
        two = best_reading(of_pairs)
        for another in (self.on_any_locus, self.dwelling):
            # one star may move in another way; two that are still are simpler than that
            if two.evidence > one.evidence and two.fit.locus != "stable":
                one = another(one, two)
                of_pairs = self.readings_of_pairs(normals, one) if one.evidence > two.evidence else of_pairs
                two = best_reading(of_pairs)
        if math.isfinite(one.evidence) or math.isfinite(two.evidence):
            log_odds = float(two.evidence - one.evidence)
        else:  # the fit to come will say so of the better
            log_odds = math.inf if two.fit.objective < one.fit.objective - _ALIKE else -math.inf
        chosen = two if log_odds > 0 else one
        tried = [two] if chosen is two else [two, *of_pairs]
        like = [pair for pair in tried if self.look_alike(one, pair, chosen)]
        alike = abs(log_odds) < DECIDED or bool(like)
        start = self.prepared(chosen)
        fit = one.fit if chosen is one and one.fit.locus != "stable" else None
        evidence = self.evidence(one, two) if math.isfinite(log_odds) else None
        readings = f"{describe(one)}, or {describe(like[0] if like else two)}"
        return SceneChoice(start, log_odds, readings, alike, fit, evidence)

    def look_alike(self, star: Reading, pair: Reading, chosen: Reading) -> bool:
        """Return whether a pair and a star fit as well as each other, one of which is chosen.

        Then the image decides nothing.  A pair without jitter may look like any star, and a pair with jitter
        like a star whose jitter is not simple.  It may have no evidence, where its separation is hardly
        determined.  Of a star that is chosen, only pairs count that are closer than the resolution or whose
        companion is seen: one that is too faint fits as well at any separation.
        """
        other = pair if chosen is star else star
        as_well = other.fit.objective < chosen.fit.objective + _ALIKE
        may_be_either = other.fit.locus == "stable" or is_intricate(star.fit.locus)
        is_close = chosen is pair or pair.fit.of_scene("separation") < self.fineness
        return bool((is_close or shows_companion(pair.fit)) and as_well and may_be_either)

    def normals(self, pairs: list[Start]) -> list[FittedPair]:
        """Fit pairs with a normal blur; of those that end at one maximum, the first."""
        fits = [fit_locus("mvn", *self.common(pair)) for pair in pairs]
        first = [i for i, fit in enumerate(fits) if not any(is_same_maximum(fit, o) for o in fits[:i])]
        return [FittedPair(pairs[i], fits[i]) for i in first]

    def readings_of_pairs(self, pairs: list[FittedPair], star: Reading) -> list[Reading]:
        """The pairs that may be read instead of a star.

        Those that a normal blur brings near the frame are fitted with straight ones too, if the star needs
        more than a simple locus or a normal is not enough.
        """
        least = min(np.nan_to_num(pair.normal.objective, nan=np.inf) for pair in pairs) - self.pixels
        readings = []
        for pair in pairs:
            near = pair.normal.objective - self.pixels < max(_NEARLY * least, least + _ALIKE)
            of_pair = self.readings_of_pair(pair, star, straight=near and needs_more(star.fit, pair.normal))
            readings += [replace(reading, normal=pair.normal) for reading in of_pair]
        return readings

    def is_worse(self, pair: Start, star: Reading) -> bool:
        """Return whether a pair was fitted that no straight blur brings as near to a frame as one star."""
        fitted = star.fit.status is Status.OK and not _is_split(pair)
        alike = is_intricate(star.fit.locus) and pair.deviance_dof < star.start.deviance_dof
        return fitted and not alike and pair.deviance_dof > star.fit.objective / self.pixels + _WORSE

    def evidence(self, one: Reading, two: Reading) -> SceneEvidence | None:
        """Return a frame's evidence for one star and for a pair, without their priors."""
        if not set(OF_A_PAIR) <= set(two.fit.names) or not np.all(np.isfinite(two.fit.covariance)):
            return None
        indices = [two.fit.names.index(name) for name in OF_A_PAIR]
        alone = self.prior.log_density(one.fit)
        return SceneEvidence(
            one.evidence - alone,
            two.evidence - self.prior.log_density(two.fit),
            alone,
            math.log(COMPANIONS),
            np.array([two.fit.of_scene(name) for name in OF_A_PAIR]),
            two.fit.covariance[np.ix_(indices, indices)],
        )

    def prepared(self, reading: Reading) -> Start:
        """Prepare the start of what was chosen: a pair's where its normal blur was fitted."""
        normal = reading.normal
        if normal is not None and normal.status is Status.OK and np.all(np.isfinite(normal.covariance)):
            assert normal.parameters is not None
            otf = self.optics.otf(normal.parameters.aberrations)
            deviance = normal.objective / self.pixels
            return Start(normal.parameters, otf, deviance, np.linalg.inv(normal.covariance), normal.names)
        if not _is_split(reading.start):
            return reading.start
        parameters = reading.fit.parameters or reading.start.parameters
        otf = self.optics.otf(parameters.aberrations)
        blur = Mvn.near(reading.fit.moments()[0]) if reading.fit.parameters else None
        where = self.data, self.optics, otf, parameters.scene, blur
        return polished(*where, self.options.hold, rough=self.rough)

    def readings_of_star(self, start: Start, rival: float, *, every: bool = False) -> Iterator[Reading]:
        """One star with the best of the loci, with straight ones or every one, and without jitter.

        A fit is given up that stays far above the deviance of a pair.
        """
        common = self.common(start, rival=rival)
        jittered = fit_best_locus(*common, every=every)
        weights = {one.locus: one.evidence for one in jittered.candidates}
        if weights and jittered.status is Status.OK and is_straight(*jittered.moments()):
            more = [name for name in _STREAKS if name not in weights]
            near = self.common(start, jittered, rival)
            weights |= {name: weight_of_evidence(fit_locus(name, *near, sure=True)) for name in more}
        yield self.jittered(start, jittered, weights, seen="jitter_undetected" not in jittered.flags)
        if not (every or _surely(start) or jittered.status is Status.POOR_FIT):
            yield self.still(start, _fit_still(*self.common(start, rival=min(rival, jittered.objective))))

    def readings_of_pair(self, pair: FittedPair, star: Reading, *, straight: bool) -> Iterator[Reading]:
        """Yield two stars with a normal blur, perhaps with straight ones, and without jitter.

        Straight ones are tried too where a normal one is straight, and might win by being simpler.
        """
        start, normal = pair.start, pair.normal
        weights, seen = {normal.locus: weight_of_evidence(normal)}, has_a_size(normal)
        first = self.jittered(start, normal, weights, seen=seen)
        yield first
        behind = star.evidence - first.evidence
        if straight or (-DECIDED < behind < _CATCHES_UP and is_straight(*normal.moments())):
            near = self.common(start, normal, normal.objective)
            pair.others.update((n, fit_locus(n, *near, sure=True)) for n in _STREAKS if n not in pair.others)
            # beside the normal by itself, whose evidence a mean with worse ones would lower
            fits = [normal, *(pair.others[name] for name in _STREAKS)]
            weights = {fit.locus: weight_of_evidence(fit) for fit in fits}
            yield self.jittered(start, max(fits, key=lambda fit: weights[fit.locus]), weights, seen=seen)
        may_be_still = _is_split(start) or not (seen and _surely(start))  # a start may be far from its fit
        if normal.status is not Status.POOR_FIT and may_be_still:
            if "stable" not in pair.others:
                pair.others["stable"] = _fit_still(*self.common(start, rival=normal.objective))
            yield self.still(start, pair.others["stable"])

    def on_any_locus(self, one: Reading, two: Reading) -> Reading:
        """Return one star as it was read, or with the best of all loci, those of the last tier too."""
        if any(CHOICES[name].tier == _LAST for name in one.fit.tried if name in CHOICES):
            return one
        return best_reading([one, *self.readings_of_star(one.start, two.fit.objective, every=True)])

    def dwelling(self, one: Reading, two: Reading) -> Reading:
        """One star as it was read, or on a path that dwells where a pair's stars are, if more probable."""
        frame = FrameFits(self.data, self.optics, self.options, sure=True)
        path = fit_dwelling_star(frame, two.fit, one.fit)
        if path is None or not math.isfinite(weight_of_evidence(path)):
            return one
        reading = self.on_path(one, path, weight_of_evidence(path))
        if -DECIDED < two.evidence - reading.evidence < log_maxima(path) + DECIDED:
            reading = self.on_path(one, *over_orders(frame, path))
        return best_reading([one, reading])

    def on_path(self, one: Reading, path: FitResult, evidence: float) -> Reading:
        """Return the reading of a star whose fit with a path is another one."""
        before = one.fit
        candidates = with_candidate(before.candidates, path, evidence)
        message = " ".join(filter(None, [path.message, describe_undecided(candidates)]))
        fit = replace(
            path,
            message=message,
            candidates=candidates,
            tried=tuple(dict.fromkeys([*before.tried, path.locus])),
            shape=before.shape,
            shape_err=before.shape_err,
            straight=before.straight,
            seconds=before.seconds + path.seconds,
        )
        weights = dict.fromkeys(CHOICES, -math.inf) | {c.locus: c.evidence for c in candidates}
        return self.jittered(one.start, fit, weights, seen=True)

    def common(self, start: Start, fit: FitResult | None = None, rival: float = math.inf):
        """Return the arguments of fits that begin at a start or where one ended."""
        if fit is None or fit.parameters is None:
            moments, parameters, otf = (
                np.asarray(start.parameters.locus.moments()),
                start.parameters,
                start.otf,
            )
        else:
            moments, parameters = fit.moments()[0], fit.parameters
            otf = self.optics.otf(parameters.aberrations)
        return self.data, self.optics, parameters, moments, otf, replace(self.options, rival=rival)

    def jittered(self, start: Start, fit: FitResult, evidence: dict[str, float], *, seen: bool) -> Reading:
        """Each locus is as probable as any other before the frame is seen; what is not seen has no size."""
        if not evidence or not seen:
            return Reading(start, fit, -math.inf)
        together = float(np.logaddexp.reduce(list(evidence.values()))) - math.log(len(evidence))
        return self.reading(start, fit, together - self.prior.log_sizes)

    def still(self, start: Start, fit: FitResult) -> Reading:
        return self.reading(start, fit, log_volume(fit) if fit.status is Status.OK else -math.inf)

    def reading(self, start: Start, fit: FitResult, evidence: float) -> Reading:
        prior = -math.inf if fit.parameters is None else self.prior.log_density(fit)
        return Reading(start, fit, evidence + prior if evidence == evidence else -math.inf)


def _fit_still(*common) -> FitResult:
    return fit_locus("stable", *common, sure=True)  # signs were tried with a normal


def _is_split(start: Start) -> bool:
    """Return whether a pair was made of a star's blur, and not fitted yet."""
    return start.parameters.scene.name == Binary.name and "separation" not in start.names


def _surely(start: Start) -> bool:
    """Return whether a start shows jitter so clearly that a fit without it is not needed."""
    return significance(np.asarray(start.parameters.locus.moments()), start.covariance) > _SURELY
