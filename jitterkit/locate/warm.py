"""Starting values for a frame of a run, by a frame of the same telescope that has been fitted.

Frames of a run repeat each other but for position, light, blur and a little of the wavefront.  A
:class:`ReferenceFrame` is made of what fits one of them.  Another is registered to it by a correlation, and a
short fit from there gives all of its parameters in a few milliseconds, where a search takes a hundred.  Of a
large frame only a cut-out about its stars is used, so small that the errors of the blur grow by a hundredth.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass, replace

import equinox as eqx
import jax
import numpy as np
from scipy import fft
from scipy.ndimage import gaussian_filter

from jitterkit.forward import Parameters, free_parameters, parameter_names
from jitterkit.likelihood import Data, known_information, single_slopes
from jitterkit.linearisation import relinearised_scoring
from jitterkit.locate.cut_out import SPARE, inner, off_centre, window
from jitterkit.locate.padding import DARK, MAY_MOVE
from jitterkit.locate.registration import RegistrationResult
from jitterkit.loci import Mvn
from jitterkit.optics import Anchor, AnchoredOptics, OpticalSystem
from jitterkit.scoring import Prior

_SEEN = 0.25
"""Share of its pixels that a frame must show: from few of them several pairs look alike."""

_BRIGHTER = 3.0
"""Factor by which light may differ: a cut-out that does for a faint frame leaves out much of a bright one."""

_AROUND = 1.5
"""Pixels, 1 sigma, of what stands in for pixels that are not used, to find the pair by."""

_TOLERANCE, _STEPS = 0.05, 20
"""Standard errors that a start may be off, and evaluations at most."""

_EXPANSIONS = 8
"""Of the optics, at most: four left half of the frames of ``smallsat`` unsettled, where focus shows by its
square."""

_UNSEEN = 0.5
"""Sigmas of the whole image that linearised optics may be off by: less than a twentieth of an error of the
moments, to which a test holds it with both comas of a small telescope."""

_OF_LIGHT = ("flux", "background")
"""How parameters are called about which a frame says less, the more light it has."""


@dataclass(frozen=True)
class ReferenceFrame:
    """A frame that others are registered to.  Build it with :meth:`of`.

    Attributes
    ----------
    parameters : Parameters
        What fits it, about the centre of its cut-out, with a normal locus.
    optics : AnchoredOptics
        On the cut-out's pixels.
    image : (ny, nx) array
        Expected image of the whole frame.
    spectrum : (ny, nx//2 + 1) complex array
        Conjugate of its transform, without its mean.
    corner : (2,) int array
        First pixel ``(y, x)`` of the cut-out.
    rim : (int, int)
        Pixels ``(y, x)`` along each side of the cut-out that are left out: a cut-out is periodic, and light
        that leaves it on one side comes back on the other.  Zero where the whole frame is used.
    information : (p, p) array
    names : tuple of str
        Of what is fitted.
    free : tuple of int
        Positions of the names in the parameter vector.
    """

    parameters: Parameters
    optics: AnchoredOptics
    image: np.ndarray
    spectrum: np.ndarray
    corner: np.ndarray
    rim: tuple[int, int]
    information: np.ndarray
    names: tuple[str, ...]
    free: tuple[int, ...]

    @staticmethod
    def serves(parameters: Parameters, aberrations: tuple[str, ...], hold: Collection[str]) -> bool:
        """Return whether frames like one can be registered to it.

        They cannot where something of the stars or of their blur is held, nor where rows are exposed one
        after the other.
        """
        own = {*parameters.scene.names, *parameters.locus.names}
        fitted = set(parameter_names(parameters, aberrations)) - own
        return set(hold).issubset(fitted) and parameters.shutter is None

    @classmethod
    def of(
        cls,
        parameters: Parameters,
        system: OpticalSystem,
        anchor: Anchor,
        hold: Collection[str] = (),
    ) -> ReferenceFrame | None:
        """Build from the parameters that fit one frame.

        Parameters
        ----------
        parameters : Parameters
        system : OpticalSystem
        anchor : Anchor
            Of the system, near the frame's aberrations.
        hold : collection of str
            Parameters to keep.

        Returns
        -------
        reference : ReferenceFrame or None
            None if frames cannot be registered to it (:meth:`serves`).
        """
        otf = anchor.otf(parameters.aberrations)
        if not cls.serves(parameters, otf.names, hold):
            return None
        parameters = parameters.with_locus(Mvn.near(parameters.locus.moments()))
        names, free = free_parameters(parameters, otf, hold)
        image, jacobian = map(np.asarray, single_slopes(parameters, otf, free))
        roots = jacobian / np.sqrt(np.maximum(image, DARK * image.max()))
        moments = [names.index(name) for name in Mvn.names]
        known = known_information(parameters, otf, free)
        cut = window(parameters, roots, known, moments, system)
        corner, size, rim = cut or (np.zeros(2, int), image.shape, (0, 0))
        if cut is not None:
            system = replace(system, grid=replace(system.grid, shape=size, pad=0))
            anchor = anchor.within(system.grid)
        slopes = roots[(slice(None), *inner(corner, size, rim))].reshape(len(names), -1)
        y, x = -off_centre(corner, size, image.shape) * system.grid.plate_scale
        moved = parameters.shifted(x, y)
        optics = AnchoredOptics.about(system, anchor, float(parameters.scene.flux), parameters.aberrations)
        spectrum = np.conj(fft.rfft2((image - image.mean()).astype(np.float32)))
        return cls(moved, optics, image, spectrum, corner, rim, slopes @ slopes.T + known, names, free)

    def locate(self, data: Data) -> RegistrationResult | None:
        """Find pair, wavefront and blur of another frame.

        Parameters
        ----------
        data : Data
            Pixels that may reach their ceiling are left out.

        Returns
        -------
        start : RegistrationResult or None
            None if the frame does not show the pair and the wavefront of this one: it has another shape, few
            pixels, another light by a factor of three, or (where cut-outs are used) a pair that is cut by its
            edge; or the fit does not settle near this one.  A blur that is not normal shows in
            :meth:`RegistrationResult.misfit`.
        """
        if data.used.shape != self.image.shape or np.mean(data.used) < _SEEN:
            return None
        shift = self._shift(data)
        steps, size = np.round(shift).astype(int), self.optics.system.grid.shape
        corner = np.clip(self.corner + steps, 0, np.subtract(self.image.shape, size))
        beside = shift - (corner - self.corner)
        if any(self.rim) and np.abs(beside).max() > SPARE:
            return None
        near = np.roll(self.image, steps, (0, 1))[inner(corner, size, (0, 0))]
        cut = jax.tree.map(lambda part: np.asarray(part)[inner(corner, size, (0, 0))], data)
        inside = np.zeros(size, bool)
        inside[inner((0, 0), size, self.rim)] = True
        cut = eqx.tree_at(lambda d: d.used, cut, cut.used & inside)
        if not cut.used.any():
            return None
        light = float(np.sum(cut.electrons, where=cut.used) / np.sum(near, where=cut.used))
        if not 1 / _BRIGHTER < light < _BRIGHTER:
            return None
        cut = _cleared(cut, near * light)
        y, x = beside * self.optics.system.grid.plate_scale
        start = self.parameters.shifted(x, y)
        start = eqx.tree_at(lambda p: p.scene, start, start.scene.brightened(light))
        return self._fitted(start, cut, light, corner)

    def is_near(self, start: RegistrationResult) -> bool:
        """Return whether the stars of a registered frame are within :data:`MAY_MOVE` pixels of those here."""
        grid, scene, there = self.optics.system.grid, self.parameters.scene, start.parameters.scene
        offset = off_centre(self.corner, grid.shape, self.image.shape) * grid.plate_scale
        moved = np.array([there.y - scene.y, there.x - scene.x]) + start.offset - offset
        return float(np.abs(moved).max()) < MAY_MOVE * grid.plate_scale

    def _fitted(
        self, start: Parameters, cut: Data, light: float, corner: np.ndarray
    ) -> RegistrationResult | None:
        root = np.sqrt(np.array([1 / light if name.startswith(_OF_LIGHT) else light for name in self.names]))
        optics = replace(self.optics, photons=max(float(start.scene.flux), 1.0))
        end, otf, *_ = relinearised_scoring(
            start,
            optics.nominal,
            optics,
            cut,
            self.free,
            Prior.none(len(self.free)),
            max_error=_UNSEEN,
            max_expansions=_EXPANSIONS,
            max_steps=_STEPS,
            tolerance=_TOLERANCE,
            known=self.information * np.outer(root, root),
            errors=False,
        )
        if not bool(end.converged):
            return None
        offset = off_centre(corner, optics.system.grid.shape, self.image.shape)
        y, x = offset * optics.system.grid.plate_scale
        return RegistrationResult(cut, end.parameters, otf, np.asarray(end.information), self.names, (y, x))

    def _shift(self, data: Data) -> np.ndarray:
        """Return the shift ``(y, x)`` [pixels] of the pair from its position here, to about a tenth."""
        seen = data.electrons if np.all(data.used) else _without_holes(data)
        match = fft.irfft2(fft.rfft2(np.asarray(seen, np.float32)) * self.spectrum, s=self.image.shape)
        row, column = map(int, np.unravel_index(np.argmax(match), match.shape))
        return np.array([_peak(match[:, column], row), _peak(match[row], column)])


def _cleared(data: Data, image: np.ndarray) -> Data:
    """Without what an expected image brings near its ceiling; no pixel counts as full."""
    trimmed = Data(
        data.electrons, data.read_variance, data.used, response=data.response, ceiling=data.ceiling
    )
    return trimmed.clear(image)


def _without_holes(data: Data) -> np.ndarray:
    """Fill pixels that are not used with a mean of those around: a star with a full core has a core."""
    light, share = (
        gaussian_filter(np.asarray(part, float), _AROUND, mode="constant")
        for part in (np.where(data.used, data.electrons, 0.0), data.used)
    )
    return np.where(data.used, data.electrons, light / np.maximum(share, 1e-3))


def _peak(values: np.ndarray, position: int) -> float:
    """Return the place where a periodic row is highest, by a parabola; negative in its far half."""
    size = len(values)
    left, middle, right = (values[(position + step) % size] for step in (-1, 0, 1))
    bend = left - 2 * middle + right
    vertex = 0.5 * (left - right) / bend if bend < 0 else 0.0
    return (position + size // 2) % size - size // 2 + float(np.clip(vertex, -0.5, 0.5))
