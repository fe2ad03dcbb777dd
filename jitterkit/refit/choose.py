"""Choose the locus of a frame's jitter, no finer than the frame can tell.

1. A normal density is fitted: its signed moments are regular at zero jitter, and while a blur is
   small against the resolution they are all that an image shows.  Chi-squared of the three moments
   tests for any jitter at all.
2. One scoring step from there measures the excess kurtosis, and how much the separation and the moments
   would change with it.  Where none can be seen, nor any other cumulant, the normal is the answer; with the
   mean of straight blurs' kurtosis, and errors for it, where the blur may be one.
3. Otherwise the simple loci ``linear``, ``shm`` and ``ellipse`` are weighed by their evidence: by what the
   frame says about cumulants where that is enough, else by a fit; the one that is chosen is always fitted.
4. A test of the higher cumulants says whether the best of them fits.  Only where it does not, or where it is
   poor but better than the normal, loci with more freedom are tried, and a free path last of all.

The best-weighed locus is the frame's; the others stay with it as candidates, and where no weight is above
95 % the message says between which loci the frame is undecided and by how much the separation differs.

``stable`` is only chosen where the options say that it may be, and then before anything is fitted: a frame
whose kernel estimate shows no jitter by the test of step 1 gets no parameters of any.  Free moments cost next
to nothing (0.02 % of the error on TOLIMAN), whereas leaving jitter out that is merely undetected biases the
separation of every frame the same way: :mod:`jitterkit.trade.plan` prices it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.stats

from jitterkit.estimators.compressed import ORDERS, CompressedLikelihood, shaped_blur
from jitterkit.estimators.shape import DECISIVE, CumulantStep
from jitterkit.forward import Parameters
from jitterkit.kernel_estimate import significance
from jitterkit.likelihood import Data
from jitterkit.locate import Start
from jitterkit.loci import Shaped
from jitterkit.optics.otf import OTF
from jitterkit.optics.system import Optics
from jitterkit.refit.evidence import CHOICES
from jitterkit.refit.fit import FitOptions
from jitterkit.refit.locus_fit import NORMAL, FrameFits, is_better
from jitterkit.refit.result import FitResult, Status
from jitterkit.refit.squares import straight_blur
from jitterkit.refit.unseen_shape import may_be_straight, of_any_shape
from jitterkit.refit.weigh import Tried, as_fit, describe_undecided, evaluate_by_cumulants, weigh

FALSE_ALARM = 0.01
"""Share of frames without jitter that are said to have some."""

DETECTED = float(scipy.stats.chi2.isf(FALSE_ALARM, 3))
"""Chi-squared of three moments above which they are said to be those of a jitter."""

_UNSEEN = 0.002
"""Share of the separation's error below which its change with the shape does not matter: at 3.8e7 photons
half a microarcsecond, which 250,000 frames would show."""

_KURTOSES = 1.5
"""The most by which the simple loci differ in excess kurtosis: SHM from a normal."""

_SHAPED = 3.0
"""Standard errors from which a kurtosis is looked into however little it matters."""

_MISFIT = 1e-3
"""Chance of its higher cumulants below which a locus does not fit."""

_DOUBTFUL = 0.02
"""The same, below which loci of the second tier are weighed beside one of the first.  Beside an ellipse they
always are: one step sees half of what two tones gain over it, and told 8 of 12 frames of such tones."""

_SHARE = 0.05
"""Of chi-squared's excess, that a step in the cumulants must explain: it was 0.1 to 1 where part of a cycle,
or two tones, of 0.3 to 1.5 arcsec were fitted with simpler loci, 0.26 to 0.98 where streaks of 0.75 to 6
arcsec were fitted with a normal, and 0.01 to 0.02 of frames of another telescope."""

_TAKEN_UP = 0.2
"""Share of a poor normal's excess that another locus must take up for loci with more freedom to be tried
where the score does not ask for them: far from the maximum it sees a part of what is lacking.  An ellipse
took up half of that of a random walk, which a path describes; its score saw 0.04."""


def fit_best_locus(
    data: Data,
    optics: Optics,
    start: Parameters,
    moments,
    otf: OTF | None = None,
    options: FitOptions | None = None,
    covariance: np.ndarray | None = None,
    *,
    sure: bool = False,
    every: bool = False,
) -> FitResult:
    """Fit a frame with the simplest locus that describes it.

    Parameters
    ----------
    data, optics, start, moments, otf, options
        As for :func:`~jitterkit.refit.fit_locus`.
    covariance : (3, 3) array, optional
        Of the moments, arcsec⁴: without it no frame is taken to be still.
    sure : bool
        As for :func:`~jitterkit.refit.fit_locus`.
    every : bool
        Whether to try every locus where jitter is detected, though a simple one may do.

    Returns
    -------
    result : FitResult
        With the candidates compared and their weights, the measured shape, and the flag
        ``jitter_undetected`` where the frame shows no jitter.  A prior in the coordinates of one locus
        says nothing about the others, which are then not tried.
    """
    frame = FrameFits(data, optics, options or FitOptions(), sure)
    still = _fit_still(frame, start, moments, otf, covariance)
    best = _choose(frame, start, moments, otf, every) if still is None else still
    if frame.options.priors.moments is None:
        return best
    # an evidence that holds a prior must not be added up over frames: the prior would count in each
    return replace(best, candidates=tuple(replace(one, evidence=np.nan) for one in best.candidates))


def _fit_still(
    frame: FrameFits, start: Parameters, moments, otf: OTF | None, covariance: np.ndarray | None
) -> FitResult | None:
    """Fit a frame without jitter if the options allow it and it shows none; else return None."""
    asked = frame.options.may_be_still and not frame.options.priors.on_jitter()
    if not asked or covariance is None or not is_jitter_undetected(moments, covariance):
        return None
    fit, *_ = frame.fit("stable", start, moments, otf)
    return _finalize(Tried(fit), ("jitter_undetected",)) if fit.status is Status.OK else None


def _choose(frame: FrameFits, start: Parameters, moments, otf: OTF | None, every: bool) -> FitResult:
    normal, otf, frame = frame.fit("mvn", start, moments, otf)
    if normal.parameters is None or not np.all(np.isfinite(normal.covariance)):
        return normal
    frame = replace(frame, data=frame.data.clear(normal.image))  # one set of pixels for all loci
    if single_star(normal):
        return _finalize(Tried(normal))
    if not significance(*normal.moments()) > DETECTED:
        return _finalize(Tried(normal), ("jitter_undetected",))
    step = CumulantStep.of(normal.parameters, normal.names, otf, frame.data, ORDERS)
    shape = step.shape()
    # a shape that is known well is fitted
    if shape.error < DECISIVE and (blur := shaped_blur(step, otf, frame.data, frame.options.hold)):
        shape = shape._replace(kurtosis=blur.kurtosis, error=blur.kurtosis_err)
    normal = replace(normal, shape=shape.kurtosis, shape_err=shape.error)
    seen = abs(shape.kurtosis) > _SHAPED * shape.error
    moved = _KURTOSES * abs(shape.response.get("separation", 0.0)) > _UNSEEN * normal.error("separation")
    # which shape a wide blur has is only asked where the frame would show that of an ellipse
    visible = may_be_straight(normal) or _SHAPED * shape.error < _KURTOSES
    change = _KURTOSES * np.nan_to_num([shape.response.get(name, 0.0) for name in Shaped.names[:3]])
    widened = visible and significance(change, normal.moments()[1]) > 1.0
    if frame.options.priors.on_coordinates():
        return _finalize(Tried(normal))
    if every:
        return _fit_tiers(frame, normal, otf, step, every=True)
    if not (seen or moved or widened or _wants_more(normal, step)):
        tried = Tried(normal)
        tried.fits[NORMAL] = of_any_shape(normal, step, otf)  # by the same evidence
        return _finalize(tried)
    if normal.status is Status.POOR_FIT and not _wants_more(normal, step):
        return _finalize(Tried(normal))  # another telescope's frame, sky, hot pixels: no locus mends that
    return _fit_tiers(frame, normal, otf, step)


def _try(
    frame: FrameFits, name: str, normal: FitResult, otf: OTF, begin: Start | None
) -> tuple[FitResult, OTF]:
    """Fit a candidate from a normal or from another start; a fit that breaks down returns as failed."""
    assert normal.parameters is not None
    try:
        if begin is not None:
            return frame.fit(name, begin.parameters, begin.parameters.locus.moments(), begin.otf)[:2]
        return frame.fit(name, normal.parameters, normal.moments()[0], otf)[:2]
    except (ArithmeticError, ValueError, np.linalg.LinAlgError) as error:
        return replace(FitResult.from_error(Status.FAILED, error), locus=name), otf


def is_jitter_undetected(moments: np.ndarray, covariance: np.ndarray) -> bool:
    """Return True if second moments (3,) with covariance (3, 3) are consistent with no jitter."""
    return significance(moments, covariance) <= DETECTED


def single_star(fit: FitResult) -> bool:
    """Return True if the second star is lost in the noise: its flux is below five standard errors.

    Its fitted flux would then make up for a wrong locus.
    """
    return "contrast" in fit.names and is_lost(fit.of_scene("contrast"), fit.error("contrast"))


def is_lost(contrast: float, error: float) -> bool:
    """Return True if the flux of a pair's second star is below five of its errors."""
    return not error < 0.2 * (1 + contrast)


def _fit_tiers(
    frame: FrameFits,
    normal: FitResult,
    otf: OTF,
    step: CumulantStep,
    begin: Start | None = None,
    every: bool = False,
) -> FitResult:
    """Fit loci tier by tier until one fits, or all; each starts from the fitted normal, or from ``begin``.

    Loci of the first tier that cumulants evaluate well enough are not fitted, unless one is the best of all.
    A wrong sign of an aberration looks like a lack of freedom: other signs are tried before a further tier,
    and again of the last.
    """
    tried, expanded, steps = Tried(normal), {"mvn": otf}, {"mvn": step}
    converged = normal.status is not Status.NOT_CONVERGED and begin is None
    compressed = CompressedLikelihood.of(step, normal.covariance) if converged else None
    excluded = "some" if begin is not None or may_be_straight(normal) else "none"
    signed = {NORMAL}
    tiers = sorted({choice.tier for choice in CHOICES.values()} - {0})
    for tier in tiers:
        names = [n for n, choice in CHOICES.items() if choice.tier == tier and choice.across != excluded]
        if tier == max(tiers):  # a normal that does not fit may be straight though the motion is not
            names += [n for n, choice in CHOICES.items() if choice.across == "some" and n not in tried.fits]
        evaluated = evaluate_by_cumulants(compressed, names) if tier == 1 and compressed is not None else {}
        for name, found in evaluated.items():
            tried.add(as_fit(normal, name, found, otf.names))
        ahead = [name for name in names if name not in evaluated]
        while True:
            for name in ahead:
                fit, expanded[name] = _try(frame, name, normal, otf, begin)
                tried.add(replace(fit, shape=normal.shape, shape_err=normal.shape_err))
            if tried.best.locus == "path":
                path, expanded["path"] = frame.finest_path(tried.best, expanded["path"])
                tried.add(path)
            best = tried.best
            if best.locus in expanded:
                break
            ahead = [best.locus]
        if best.locus not in steps:
            assert best.parameters is not None
            where = best.parameters, best.names, expanded[best.locus]
            steps[best.locus] = CumulantStep.of(*where, frame.data)
        least = _MISFIT if tier > 1 else 1.0 if best.locus == "ellipse" else _DOUBTFUL
        wants_more = _wants_more(best, steps[best.locus], least) or _comes_nearer(best, normal)
        fits = not (every or wants_more)
        last = fits or tier == max(tiers)
        if begin is None and best.locus not in signed and (last or len(signed) == 1):
            signed.add(best.locus)
            if (better := frame.other_signs(best)) is not None:
                retry = _fit_tiers(frame, normal, otf, step, better, every)
                if is_better(retry, best):
                    return retry
        if fits:
            break
    if tried.best.locus == NORMAL and tier == tiers[0] and not may_be_straight(normal):
        tried.fits[NORMAL] = of_any_shape(normal, step, otf)  # by the same evidence
    return replace(_finalize(tried), straight=straight_blur(tried.fits, normal.shape_err, frame))


def _wants_more(fit: FitResult, step: CumulantStep, least: float = _MISFIT) -> bool:
    """Return True if the shape of the blur does not fit, rather than pixels, sky or scale."""
    try:
        lack = step.lack_of_fit()
    except np.linalg.LinAlgError:  # no answer: the fit stands as it is
        return False
    return lack.chance < least and lack.chi2 > _SHARE * (fit.chi2 - fit.dof)


def _comes_nearer(fit: FitResult, normal: FitResult) -> bool:
    """Return whether a locus describes a frame better than a normal, and neither does well."""
    excess = fit.chi2 - fit.dof, normal.chi2 - normal.dof
    return fit.status is Status.POOR_FIT and bool(excess[0] < (1 - _TAKEN_UP) * excess[1])


def _finalize(tried: Tried, flags: tuple[str, ...] = ()) -> FitResult:
    """Return the best of the fits with all as candidates; the first where none describes the frame."""
    fits = tried.fits
    if not any(fit.status is Status.OK for fit in fits.values()):
        tried = Tried(next(iter(fits.values())))
    candidates = weigh(list(tried.fits.values()), list(tried.evidence.values()))
    best = tried.best
    return replace(
        best,
        message=" ".join(filter(None, [best.message, describe_undecided(candidates)])),
        flags=(*best.flags, *flags),
        candidates=candidates,
        tried=tuple(fits),
        seconds=sum(fit.seconds for fit in tried.fits.values()),
    )
