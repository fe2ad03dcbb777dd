"""The blur of a frame that shows again what another has shown: the score estimate in a few milliseconds.

Frames of one telescope repeat each other but for place, light, blur and a little of the wavefront.  A
:class:`Repeat` is made from what one frame has told.  Another is registered to it by a correlation and moved
onto it; a few steps by the first frame's derivatives come near, and an expansion there gives the blur, tests
its shape, and tells whether to believe it; where the shape is told, others are made at it.  All is fitted
that :func:`~jitterkit.estimators.score.estimate_score` fits; of the frame only a cut-out is used, so small
that the errors of a frame like the first grow by a hundredth.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from scipy.fft import next_fast_len

from jitterkit.estimators.compare import SETTLED, End, compared, several
from jitterkit.estimators.first import SPARE, First, Fourth, invert, moved, offset_of, within
from jitterkit.estimators.shape import doubted
from jitterkit.forward import Parameters, free_parameters, image_and_jacobian, parameter_names, to_vector
from jitterkit.kernel_estimate import KernelEstimate, is_detected
from jitterkit.likelihood import Data
from jitterkit.loci import Locus
from jitterkit.metric import invert_information
from jitterkit.optics import Anchor, AnchoredOptics, OpticalSystem
from jitterkit.scene import Binary

__all__ = ["Repeat", "Repeated"]

_DEARER = 1.01
"""Factor by which the errors of the moments may grow, for the sake of a smaller cut-out."""

_SHARE = 6
"""Rims that a frame must be wide: of a smaller one too much would be left out."""

_SEEN = 0.25
"""Share of its pixels that a frame must show: from few of them several pairs look alike."""

_ASKED_FOR = frozenset({*Binary.names, *Fourth.names})
"""What must be fitted: what a first frame has is not another's."""

_DARK = 1e-5
"""Share of the brightest pixel that no variance falls below, where the way depends on it, not the goal."""

_SURE = 5.0
"""Standard deviations by which chi-squared may exceed what is expected of it."""

_UNSEEN = 0.5
"""Sigmas of the whole image that the anchor may leave out.  Of the errors of the moments it is a fiftieth on
TOLIMAN (every mode and mixtures, blurs of none to 0.3 arcsec), a twentieth of a small telescope's coma."""

_NEAR = 0.5
"""Share of the way to there that is near: a wavefront that went so far may go on as far again."""


class Repeated(NamedTuple):
    """What a frame has told.

    Attributes
    ----------
    estimate : KernelEstimate
    parameters : Parameters
        Everything that was fitted, with a ``Shaped`` locus.
    near : bool
        Whether the wavefront is near that of the first frame; if not, others may soon be out of reach.
    """

    estimate: KernelEstimate
    parameters: Parameters
    near: bool


@dataclass(frozen=True)
class Repeat:
    """What one frame of many has shown.  Build it with :meth:`of`.

    Attributes
    ----------
    first : First
        The frame.
    optics : AnchoredOptics
        Of the telescope; tells how far they reach.
    """

    first: First
    optics: AnchoredOptics

    @classmethod
    def of(
        cls, parameters: Parameters, system: OpticalSystem, hold: Collection[str] = ("background",)
    ) -> Repeat | None:
        """From what fits one frame.

        Parameters
        ----------
        parameters : Parameters
            Of a binary.
        system : OpticalSystem
        hold : collection of str
            Parameters to keep.

        Returns
        -------
        repeat : Repeat or None
            None where the frame is undersampled, or so small that its rim is much of it; or if something of
            the pair or of its blur is held.
        """
        rim = _rim(parameters, system)
        if system.grid.refine > 1 or min(system.grid.shape) < _SHARE * max(rim):
            return None
        state, near = np.asarray(parameters.aberrations), Fourth.near(parameters.locus.moments())
        parameters = parameters.with_locus(near)
        bare = _sized(system, system.grid.shape)
        otf = bare.otf(state)
        if not set(hold).issubset(parameter_names(parameters, otf.names)):
            return None  # coordinates of another locus
        names, free = free_parameters(parameters, otf, hold)
        if not _ASKED_FOR.issubset(names):
            return None
        kurtosis = names.index(Fourth.names[-1])
        whole, jacobian = (np.asarray(part) for part in image_and_jacobian(parameters, otf, free))
        others, moments = np.delete(jacobian, kurtosis, 0), slice(kurtosis - 3, kurtosis)
        corner, size = _cut(parameters, whole, others, moments, rim, bare.grid.plate_scale)

        parameters = moved(parameters, -offset_of(corner, size, whole.shape) * system.grid.plate_scale)
        bare = _sized(system, size)
        optics = AnchoredOptics.about(bare, Anchor.at(bare, state), 1.0)
        image, jacobian = image_and_jacobian(parameters, optics.nominal, free)
        slopes = within(rim, jacobian / jnp.maximum(image, _DARK * image.max())).astype(jnp.float32)
        information = jnp.tensordot(slopes, within(rim, jacobian), ((1, 2), (1, 2)))
        first = First(
            parameters,
            optics.anchor,
            optics.nominal,
            to_vector(parameters)[0][np.asarray(free)],
            slopes,
            invert(information, np.arange(len(names)) != kurtosis)[0],
            jnp.asarray(whole),
            jnp.conj(jnp.fft.rfft2(whole - whole.mean())).astype(jnp.complex64),
            jnp.asarray(corner),
            rim,
            free,
            names,
        )
        return cls(first, optics)

    def estimate(self, data: Data) -> Repeated | None:
        """Estimate the blur of another frame.

        Parameters
        ----------
        data : Data
            Of the same shape.  Pixels that may reach their ceiling are left out.

        Returns
        -------
        repeated : Repeated or None
            None if the frame does not repeat what this one has shown.

        Notes
        -----
        *Fails when* pair or wavefront are other ones, the pair is at the edge of the frame, or its light is
        another by a factor of three: then a step is left, chi-squared is large or the state out of the
        anchor's reach, and the answer is None.
        """
        (end,) = self._compare([data], 1)
        return None if end is None else self.told(end)

    def compare(self, frames: Sequence[Data]) -> list[End | None]:
        """Compare several frames, for :meth:`told`: in less time than one by one.

        Returns
        -------
        ends : list of End or None
            None of a frame that is of another shape, or shows few pixels.
        """
        return self._compare(frames, several(self.first.whole.shape))

    def _compare(self, frames: Sequence[Data], size: int) -> list[End | None]:
        seen = [data for data in frames if self._shows(data.used)]
        ends = iter(compared(self.first, seen, size))
        return [next(ends) if self._shows(data.used) else None for data in frames]

    def _shows(self, used) -> bool:
        return used.shape == self.first.whole.shape and np.asarray(used).mean() >= _SEEN

    def told(self, end: End) -> Repeated | None:
        """What the comparison of a frame tells; None if it does not repeat what this one has shown."""
        photons = max(float(end.values[self.first.names.index("flux")]), 1.0)
        left_out = replace(self.optics, photons=photons).left_out(end.parameters.aberrations)
        if not (end.excess < _SURE and left_out < _UNSEEN and end.remains < SETTLED):
            return None
        return Repeated(self._estimate(end), end.parameters, left_out < _NEAR**3 * _UNSEEN)

    def _estimate(self, end: End) -> KernelEstimate:
        """As :func:`~jitterkit.estimators.score.estimate_score` has it."""
        k = self.first.kurtosis
        covariance, _ = invert_information(end.information)
        if end.values[k]:
            return _with_shape(end.parameters.locus, covariance[k - 3 : k + 1, k - 3 : k + 1])
        variance = covariance[k, k]
        response = -covariance[k] / variance
        held = covariance - variance * np.outer(response, response)
        moments, spread = np.asarray(end.values[k - 3 : k]), held[k - 3 : k, k - 3 : k]
        if not is_detected(moments, spread):
            return KernelEstimate(moments, spread, "score")
        doubt = doubted(spread, response[k - 3 : k])
        shape, shape_err = float(covariance[k] @ end.score), float(np.sqrt(variance))
        return KernelEstimate(moments, doubt, "score", shape=shape, shape_err=shape_err)


def _with_shape(locus: Locus, covariance: np.ndarray) -> KernelEstimate:
    """With moments and kurtosis."""
    *moments, shape = np.asarray(locus.coords)
    shape_err = float(np.sqrt(covariance[3, 3]))
    spread = covariance[:3, :3]
    return KernelEstimate(
        np.array(moments), spread, "score", shape=float(shape), shape_err=shape_err, locus=locus
    )


def _sized(system: OpticalSystem, shape: tuple[int, int]) -> OpticalSystem:
    """A telescope on so many pixels and no padding."""
    return replace(system, grid=replace(system.grid, shape=shape, pad=0))


def _rim(parameters: Parameters, system: OpticalSystem) -> tuple[int, int]:
    """Pixels ``(y, x)`` along each side that light reaches from the other one, as a cut-out is periodic."""
    x, y, _ = parameters.scene.sources()
    middle = np.array([parameters.scene.y, parameters.scene.x])[:, None]
    reach = np.abs(np.array([y, x]) - middle).max(axis=1) / system.grid.plate_scale
    rim_y, rim_x = (int(np.ceil(pixels)) + SPARE for pixels in reach)
    return rim_y, rim_x


def _cut(
    parameters: Parameters,
    image: np.ndarray,
    jacobian: np.ndarray,
    moments: slice,
    rim: tuple[int, int],
    pitch: float,
) -> tuple[np.ndarray, tuple[int, int]]:
    """First pixel and size ``(y, x)`` of the smallest cut-out about a pair that tells enough of its blur."""
    root = jacobian / np.sqrt(np.maximum(image, _DARK * image.max()))
    scene, shape = parameters.scene, np.array(image.shape)
    middle = np.array([scene.y, scene.x]) / pitch + (shape - 1) / 2

    def errors(half: int) -> np.ndarray:  # the fewer pixels, the larger
        (top, left), (bottom, right) = (
            np.clip(np.round(middle) + by, 0, shape).astype(int) for by in (-half, half)
        )
        part = root[:, top:bottom, left:right].reshape(len(root), -1)
        return np.sqrt(np.diag(invert_information(part @ part.T)[0])[moments])

    most = int(max(shape))
    least = errors(most)
    half = 1 + bisect_left(range(1, most), True, key=lambda h: bool(np.all(errors(h) < _DEARER * least)))
    size = [min(next_fast_len(2 * (half + edge), real=True), n) for edge, n in zip(rim, shape, strict=True)]
    corner = np.clip(np.round(middle).astype(int) - np.array(size) // 2, 0, shape - size)
    return corner, (size[0], size[1])
