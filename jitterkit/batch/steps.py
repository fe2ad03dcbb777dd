"""The steps of one frame, each of which can be used alone.

    RawFrame --calibrate--> Frame --locate--> SceneEstimate --estimate--> KernelEstimate
                                                   |
                                                   +-----------fit------> FitResult --diagnose--> FitResult

A frame that shows too little to be located has a FitResult with a status instead.
:class:`~jitterkit.batch.FrameProcessor` does all five with one set of options, and again without pixels that
do not belong to a frame.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from dataclasses import replace
from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.batch.diagnose import diagnose, unusable
from jitterkit.batch.records import SceneEstimate
from jitterkit.batch.warm_start import AUTO, SCORE, WarmStart
from jitterkit.detectors.misplaced import misplaced
from jitterkit.estimators import KernelEstimate, estimator
from jitterkit.frames import Frame, RawFrame
from jitterkit.frames.altered import without_border
from jitterkit.frames.cut_off import with_cut_off
from jitterkit.frames.region import find_region
from jitterkit.instruments import Instrument, resolve
from jitterkit.likelihood import Data
from jitterkit.linearisation import LINEARISATION_TOLERANCE
from jitterkit.locate import Start, locate_binary, locate_star, locate_stars, settled
from jitterkit.optics import OpticalSystem, Optics, SelfAnchoringOptics
from jitterkit.refit import SCENES, FitOptions, FitResult, Priors, Status, choose_scene, fit_locus
from jitterkit.refit.choose import fit_best_locus, is_lost
from jitterkit.refit.evidence import CHOICES
from jitterkit.refit.fit import linearisation_tolerance
from jitterkit.refit.scene_choice import SceneChoice, found_allowing
from jitterkit.refit.squares import with_free_squares
from jitterkit.scene import Star

__all__ = ["calibrate", "diagnose", "estimate", "fit", "locate", "search"]

_SEARCHES = dict(zip(SCENES, (locate_star, locate_binary, locate_stars), strict=True))


def calibrate(raw: RawFrame, instrument: Instrument, overrides: Mapping[str, Any] | None = None) -> Frame:
    """Complete a frame's metadata, cut out its stars if it is large, and turn it into electrons.

    Parameters
    ----------
    raw : RawFrame
    instrument : Instrument
        A frame larger than its shape is cut to that, about the brightest stars.
    overrides : mapping, optional
        Metadata that take precedence over those of the file, by field.

    Returns
    -------
    frame : Frame
        Its digest is that of the whole frame, as the file holds it.

    Raises
    ------
    JitterkitError
        If the frame does not suit the instrument.
    """
    digest = raw.digest
    raw = with_cut_off(without_border(resolve(raw, instrument, overrides or {})))
    raw = raw.with_metadata(raw.metadata.warn(*misplaced(raw, instrument.detector)))
    ny, nx = instrument.shape
    large = raw.shape[0] > ny or raw.shape[1] > nx
    if large:
        raw = find_region(raw, (min(ny, raw.shape[0]), min(nx, raw.shape[1])))
    frame = instrument.detector.calibrate(raw)
    flags = (*frame.flags, *["masked"] * bool(raw.mask.any()), *["cut_out"] * large)
    return frame.with_fields(flags=flags, digest=digest)


def locate(
    frame: Frame,
    optics: Optics,
    scene: str = AUTO,
    *,
    options: FitOptions | None = None,
    censored: bool = False,
    warm: WarmStart | None = None,
    rough: bool = False,
    shape: bool = True,
) -> SceneEstimate | FitResult:
    """Find the stars of a frame, and a normal blur: by a search, or registered to a reference frame.

    Parameters
    ----------
    frame : Frame
    optics : Optics
        On the frame's grid.
    scene : str
        ``"auto"`` for the simplest that the frame supports, ``"star"``, ``"binary"`` or ``"stars"``.
    options : FitOptions, optional
    censored : bool
        As for :meth:`jitterkit.likelihood.Data.of`.
    warm : WarmStart, optional
        What is known of the frame beforehand.
    rough : bool
        Whether to leave the last steps of a search to a fit.
    shape : bool
        Whether to measure the shape of the blur where the frame is registered to another.

    Returns
    -------
    start : SceneEstimate or FitResult
        Where fits start; a FitResult whose status says why not.
    """
    options, data = options or FitOptions(), Data.of(frame, censored=censored)
    optics = _own(optics, frame, options)
    if warm is not None:
        registered = warm.register(frame, data, optics, options.hold, rough=not shape)
        if registered is not None:
            return registered
    found, clean = search(frame, optics, scene, data, options, warm, rough=rough)
    if isinstance(found, FitResult):
        return found
    if found.undecided:
        return FitResult(
            Status.UNDETERMINED,
            f"A pair closer than the resolution, or a smear: {found.readings}; the odds are "
            f"{math.exp(found.log_odds):.2g} to 1 for the pair. Give --scene if it is known.",
        )
    start, ambiguity = found.start, found.ambiguity
    if not ambiguity and warm is not None and warm.scene == found.scene:
        ambiguity = warm.ambiguity
    dropped = int(np.count_nonzero(data.used) - np.count_nonzero(clean.used))
    moments = np.asarray(start.parameters.locus.moments())
    normal = KernelEstimate(moments, start.covariance, SCORE, source=frame.name, digest=frame.digest)
    return SceneEstimate(clean, start.parameters, normal, optics, start.otf, ambiguity, found.fit, dropped)


def search(
    frame: Frame,
    optics: Optics,
    scene: str,
    data: Data,
    options: FitOptions,
    warm: WarmStart | None = None,
    *,
    rough: bool = False,
) -> tuple[SceneChoice | FitResult, Data]:
    """Choose the scene of a frame, and return its data without pixels that no star can have made."""
    optics = _own(optics, frame, options)

    def choose(data: Data, *, rough: bool = False) -> SceneChoice | FitResult:
        """Choose the scene of cleaned data, or say why that cannot be done."""
        if (refused := unusable(frame, data)) is not None:
            return refused
        expected = warm.scene if scene == AUTO and warm is not None else scene
        seen = warm.choices.get(frame.digest) if warm is not None else None
        if seen is not None and (expected in (AUTO, seen.scene) or seen.evidence is None):
            # it agrees with the others, or is in no doubt
            return seen if rough else replace(seen, start=settled(seen.start, data, optics, options.hold))
        start = None if expected == AUTO else _SEARCHES[expected](data, optics, options.hold, rough=rough)
        choice = None
        # a frame of a run need not be as the run is
        if start is not None and (expected == scene or (start.describes(data) and not _lacks_a_star(start))):
            readings = ("", False) if seen is None else (seen.readings, expected == Star.name)
            choice = SceneChoice(start, -math.inf if expected == Star.name else math.inf, *readings)
        elif scene == AUTO:
            choice = choose_scene(data, optics, options, rough=rough)
        if choice is None:
            return FitResult(Status.NO_STAR, f"{Status.NO_STAR.value}: there is no star to fit.")
        return choice

    return found_allowing(choose, data, optics.nominal, options.model_error, rough=rough)


def _own(optics: Optics, frame: Frame, options: FitOptions) -> Optics:
    """Return optics that keep what the fits of a frame ask for again, unless they do so already."""
    if not isinstance(optics, OpticalSystem):
        return optics
    strict = linearisation_tolerance(options.tolerance) / LINEARISATION_TOLERANCE
    return SelfAnchoringOptics(optics, frame.light / strict**2)  # as exact as for a frame with more light


def estimate(start: SceneEstimate, kernel: str = SCORE, *, hold: Collection[str] = ()) -> KernelEstimate:
    """Estimate the blur of a frame whose stars are located.

    Parameters
    ----------
    start : SceneEstimate
        From :func:`locate`.
    kernel : str
        Name of the estimator, one of :data:`~jitterkit.estimators.ESTIMATORS`.
    hold : collection of str
        Parameters to keep at their values in ``start``.

    Returns
    -------
    estimate : KernelEstimate
    """
    known = start.estimate
    if kernel == SCORE and start.searched is None:
        return known  # by which the frame was registered
    where = {"optics": start.optics} if kernel == SCORE else {}
    found = estimator(kernel)(start.data, start.parameters, start.otf, hold=hold, **where)
    return replace(found, source=known.source, digest=known.digest)


def fit(
    start: SceneEstimate,
    priors: Priors | None = None,
    *,
    locus: str = AUTO,
    options: FitOptions | None = None,
) -> FitResult:
    """Fit scene, optics, jitter and background of a frame together.

    Parameters
    ----------
    start : SceneEstimate
        From :func:`locate`.
    priors : Priors, optional
        Beside those of the options.
    locus : str
        ``"auto"`` for the simplest that the frame supports, or a name in ``LOCI``.
    options : FitOptions, optional

    Returns
    -------
    result : FitResult
        Its status is that of the fit alone; :func:`~jitterkit.batch.diagnose.diagnose` completes it.
    """
    options = options or FitOptions()
    priors = options.priors if priors is None else options.priors.joined(priors)
    options = replace(options, priors=priors)
    if priors.terms:
        start = _with_likelier_signs(start, priors)
    where = (start.data, start.optics, start.parameters, start.estimate.moments, start.otf, options)
    informed, sure = priors.terms or priors.if_free or priors.moments is not None, start.searched is None
    if locus != AUTO:
        result = fit_locus(locus, *where, sure=sure)
    elif start.fit is not None and not informed:
        result = start.fit
    else:
        result = fit_best_locus(*where, start.estimate.covariance, sure=sure)
    if result.image is not None and (chosen := CHOICES.get(result.locus)) and chosen.is_simple:
        result = with_free_squares(result, start.data.clear(result.image), start.optics, options)
    return replace(result, estimate=start.estimate)


def _with_likelier_signs(start: SceneEstimate, priors: Priors) -> SceneEstimate:
    """Return a start with the signs of a prior, where no image shows those of some aberrations."""
    nominal = start.optics.system.nominal
    names, unseen = nominal.names, nominal.blind()
    value = np.asarray(start.parameters.aberrations)
    other = np.where([name in unseen for name in names], -value, value)
    known = [(i, *priors.terms[name]) for i, name in enumerate(names) if name in priors.terms]
    costs = [sum(((state[i] - mean) / sigma) ** 2 for i, mean, sigma in known) for state in (value, other)]
    if not costs[1] < costs[0]:
        return start
    parameters = eqx.tree_at(lambda p: p.aberrations, start.parameters, jnp.asarray(other))
    searched = None if start.searched is None else start.optics.otf(other)
    return replace(start, parameters=parameters, searched=searched)


def _lacks_a_star(start: Start) -> bool:
    """Return True if one star is a pair because its run is one of pairs: the other is lost in the noise."""
    if "contrast" not in start.names:
        return False
    error = math.sqrt(start.covariance_of(("contrast",))[0, 0])
    return is_lost(float(start.parameters.scene.values["contrast"]), error)
