"""Optics and scene of reference frames, so that later frames need not be searched.

A :class:`WarmStart` holds for the frames on one grid; :class:`WarmStartCache` keeps those of the latest
reference frames.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from threading import Lock

import jax.numpy as jnp
import numpy as np

from jitterkit.batch.records import SceneEstimate
from jitterkit.estimators.score import estimate_from_normal
from jitterkit.frames import Frame
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import MISFIT, Data
from jitterkit.linearisation import LINEARISATION_TOLERANCE
from jitterkit.locate import ReferenceFrame
from jitterkit.locate.padding import grid_for_derivatives
from jitterkit.loci import Mvn
from jitterkit.optics import Anchor, AnchoredOptics, OpticalSystem, Optics
from jitterkit.precision import single
from jitterkit.refit import FitOptions, SceneChoice
from jitterkit.refit.fit import linearisation_tolerance
from jitterkit.refit.together import scene_together

GridKey = tuple[tuple[int, int], float]
"""Shape ``(ny, nx)`` and plate scale [arcsec]."""

AUTO = "auto"
"""In place of a scene's name: the simplest that the frame supports."""

SCORE = "score"
"""The estimator that is what finding the stars does, as far as a fit's start goes."""


@dataclass(frozen=True)
class WarmStart:
    """Hold what is known of the frames on one grid before they are fitted.

    Attributes
    ----------
    scene : str
        Name of the scene that they show, or :data:`AUTO` where they leave that open.
    ambiguity : str
        Another scene that looks the same, in a sentence.
    anchored : AnchoredOptics or None
        None for optics that cannot change.
    reference : ReferenceFrame or None
        The frame to which they may be registered; then stars and blur need not be searched for.
    choices : mapping
        The choices of reference frames that were searched alone, by their digests.
    coarse : Anchor or None
        For derivatives of images, on a grid with less padding; for frames whose stars are near those of the
        reference frame.
    """

    scene: str
    ambiguity: str = ""
    anchored: AnchoredOptics | None = None
    reference: ReferenceFrame | None = None
    choices: Mapping[str, SceneChoice] = field(default_factory=dict)
    coarse: Anchor | None = None

    def optics(self, frame: Frame) -> AnchoredOptics:
        """Return the optics for a frame: how far they reach depends on its light."""
        assert self.anchored is not None
        return replace(self.anchored, photons=frame.light)

    def changes(self, frame: Frame) -> bool:
        """Return whether a frame starts otherwise than from a cold start."""
        own = self.choices.get(frame.digest)
        return own is None or self.scene not in (AUTO, own.scene)

    def register(
        self, frame: Frame, data: Data, optics: Optics, hold: Collection[str], *, rough: bool
    ) -> SceneEstimate | None:
        """Return what a frame shows that repeats the reference frame; None for one that does not.

        Parameters
        ----------
        frame : Frame
        data : Data
            Of the frame.
        optics : Optics
            As :meth:`optics` returns them.
        hold : collection of str
            Parameters that are not free.
        rough : bool
            Whether a normal blur will do for an estimate.
        """
        if self.reference is None or (start := self.reference.locate(data)) is None:
            return None
        parameters = start.parameters
        excess, correlated = start.misfit(parameters) if rough else (np.inf, "")
        if excess < MISFIT:
            moments = np.asarray(parameters.locus.moments())
            estimate = KernelEstimate(moments, start.covariance, SCORE)
        else:
            cut_out = None if rough else self.reference.optics  # a fit that follows frees squares itself
            estimate, parameters = estimate_from_normal(parameters, start.otf, start.data, hold, cut_out)
            excess, correlated = start.misfit(parameters)
            if not excess < MISFIT:
                return None
            parameters = parameters.with_locus(Mvn.near(jnp.asarray(estimate.moments)))
        if not np.all(np.isfinite(estimate.covariance)):
            return None
        estimate = replace(estimate, source=frame.name, digest=frame.digest)
        parameters, ambiguity = start.in_frame(parameters), self.ambiguity
        if self.coarse is not None and isinstance(optics, AnchoredOptics) and self.reference.is_near(start):
            optics = replace(optics, coarse=self.coarse)
        return SceneEstimate(
            data, parameters, estimate, optics, ambiguity=ambiguity, excess=excess, correlated=correlated
        )


SearchedFrame = tuple[Frame, SceneChoice]
"""A reference frame, and its scene by a search."""


def from_searched_frames(
    searched: Sequence[SearchedFrame],
    warm_start: Callable[[Frame, SceneChoice], WarmStart | None],
    scene_only: bool,
) -> WarmStart | None:
    """Return the warm start from reference frames on one grid.

    Parameters
    ----------
    searched : sequence of (Frame, SceneChoice)
    warm_start : callable
        From one of these to its warm start.
    scene_only : bool
        Whether they are too few to give more than their scene.

    Returns
    -------
    warm_start : WarmStart or None
        Of the first frame that is sure of its scene, if there is one of which one star does not fit as well
        as its pair; if none is sure, of their joint choice.
    """
    if not scene_only and (sure := [look for look in searched if look[1].is_sure]):
        return warm_start(*next((look for look in sure if look[1].is_clear), sure[0]))
    scene = scene_together([choice for _, choice in searched])
    if scene_only:
        return WarmStart(scene or AUTO, choices={frame.digest: choice for frame, choice in searched})
    alike = [look for look in searched if look[1].scene == scene]
    if alike:
        return warm_start(*alike[0])
    return None if scene is None else WarmStart(scene)


class WarmStartCache:
    """The warm starts of the latest reference frames."""

    def __init__(self) -> None:
        self._key: Hashable = None
        self._latest: Mapping[GridKey, WarmStart] = {}
        self._lock = Lock()

    def __reduce__(self) -> tuple:
        return WarmStartCache, ()  # a lock does not travel to other processes

    def get(
        self, key: Hashable, find: Callable[[], Mapping[GridKey, WarmStart]]
    ) -> Mapping[GridKey, WarmStart]:
        """Return the warm starts of some reference frames, found unless they are the latest."""
        with self._lock:  # threads of two batches may ask
            if key != self._key:
                self._latest, self._key = find(), key
            return self._latest


def warm_start(optics: Optics, choice: SceneChoice, options: FitOptions) -> WarmStart | None:
    """Return the warm start that one reference frame gives.

    Parameters
    ----------
    optics : Optics
        Of the frame's grid.
    choice : SceneChoice
        The frame's scene, with the parameters that fit it.
    options : FitOptions
        Of the fits to come.

    Returns
    -------
    warm_start : WarmStart or None
        None if the optics cannot change.
    """
    parameters = choice.start.parameters
    if not len(parameters.aberrations) or not isinstance(optics, OpticalSystem):
        return None
    # as exact as for a frame with more light
    strict = linearisation_tolerance(options.tolerance) / LINEARISATION_TOLERANCE
    light, smaller = float(parameters.scene.flux) / strict**2, None
    # who asks for more digits has the derivatives of the whole grid
    if strict >= 1 and ReferenceFrame.serves(parameters, optics.names, options.hold):
        smaller = grid_for_derivatives(parameters, optics.otf(parameters.aberrations))
    # of exactly that state: rounded to a nm in 19 modes it was off by 0.7 of its reach; second derivatives of
    # the whole grid would take most of a run's memory and of its time
    anchor = Anchor.at(optics, np.asarray(parameters.aberrations), smaller)
    anchored = AnchoredOptics.about(optics, anchor, light, parameters.aberrations)
    reference = ReferenceFrame.of(parameters, optics, anchor, options.hold)
    coarse = single(anchor.within(smaller)) if smaller else None
    return WarmStart(choice.scene, choice.ambiguity_of_run, anchored, reference, coarse=coarse)
