"""Loci weighed without an image: by what a frame says about cumulants.

A blur that is small against the resolution enters an image through its cumulants.  Score and information over
them, computed once where a normal fits, hold nearly all that the frame says about the locus.  To fit another
one is then a problem in its own two or three coordinates.  Loci whose transfer function depends only on the
variance along a frequency serve: streaks and ellipses.  Where the sixth cumulants make a difference, so may
those beyond, and only a locus that is far behind is known to be.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from jitterkit.estimators.shape import CumulantStep, ShapedBlur, fit_shape
from jitterkit.forward import GRADIENT, Parameters
from jitterkit.likelihood import Data
from jitterkit.loci import Locus, Mvn, Shaped
from jitterkit.loci.base import moments_and_slope
from jitterkit.loci.cumulants import form_cumulants
from jitterkit.metric import invert_information
from jitterkit.optics.otf import OTF

ORDERS = (3, 4, 6)
"""Of the cumulants that a frame is asked about."""

CLOSE = 0.2
"""Log-likelihood that a fit may be off by to count as one to the image: of 66 on TOLIMAN those below this
were off by half of it at most."""

_BENT = 0.2
"""What a change of the moments, as a share of them, adds to its effect in second order: 0.16 of it on
TOLIMAN, for blurs of 0.1 to 0.2 arcsec rms at 1e6 to 4e7 photons."""

_STEPS, _CONVERGED = 20, 1e-4
"""Largest number of steps in the coordinates of a locus; gain in log-likelihood at which they end."""


class CompressedFit(NamedTuple):
    """A locus fitted to what a frame says about cumulants.

    Attributes
    ----------
    locus : Locus
    names : tuple of str
        Of everything that would be fitted with it.
    covariance : (q, q) array
        Of these.
    moved : dict
        Change of everything but the locus from where the normal has it, by name.
    gain : float
        Log-likelihood over the normal's.
    left_out : float
        What the gain may be off by, while that is small against it: by the cumulants beyond the sixth, which
        were worth less than the sixth alone, and by what the moments do to second order.
    """

    locus: Locus
    names: tuple[str, ...]
    covariance: np.ndarray
    moved: dict[str, float]
    gain: float
    left_out: float

    def at(self, normal: Parameters, aberrations: tuple[str, ...]) -> Parameters:
        """Parameters of the normal, with the locus and what follows it; with the names of the aberrations."""
        scene, by = normal.scene, self.moved
        return Parameters(
            scene.at([value + by.get(name, 0.0) for name, value in scene.values.items()]),
            self.locus,
            np.asarray(normal.aberrations) + [by.get(name, 0.0) for name in aberrations],
            normal.background + by.get("background", 0.0),
            gradient=normal.gradient + np.array([by.get(name, 0.0) for name in GRADIENT]),
            diffusion=None if normal.diffusion is None else normal.diffusion + by.get("diffusion", 0.0),
            shutter=normal.shutter,
        )

    def of_locus(self) -> np.ndarray:
        """Return the covariance of the coordinates of the locus."""
        indices = [self.names.index(name) for name in self.locus.names]
        return self.covariance[np.ix_(indices, indices)]


@dataclass(frozen=True)
class CompressedLikelihood:
    """The log-likelihood about a fitted normal, to second order in what was fitted and in cumulants.

    Build it with :meth:`of`.  Its coordinates are what was fitted beside the moments, then the moments, then
    the cumulants of :data:`ORDERS`.

    Attributes
    ----------
    normal : Mvn
    names : tuple of str
        Of what was fitted.
    score, curvature : (p + c,), (p + c, p + c) array
        Of the log-posterior.
    """

    normal: Mvn
    names: tuple[str, ...]
    score: np.ndarray
    curvature: np.ndarray

    @classmethod
    def of(cls, step: CumulantStep, covariance: np.ndarray | None = None) -> CompressedLikelihood | None:
        """Build from a step of the orders :data:`ORDERS`, taken where a fit has converged.

        Parameters
        ----------
        step : CumulantStep
        covariance : (p, p) array, optional
            Of what was fitted, where it holds priors: on the optics, or on the moments of whatever locus.

        Returns
        -------
        likelihood : CompressedLikelihood or None
            None if the step is not from a normal with all of its moments.
        """
        names, size, normal = step.names, len(step.names), step.parameters.locus
        if not isinstance(normal, Mvn) or not set(Mvn.names) <= set(names):
            return None
        curvature, score = step.information.copy(), step.score.copy()
        if covariance is not None:
            curvature[:size, :size], sound = invert_information(np.asarray(covariance, float))
            score[:size] = 0.0  # at rest
            if not sound:
                return None
        order = [n for n, name in enumerate(names) if name not in Mvn.names]
        order += [names.index(name) for name in Mvn.names]
        order += range(size, len(score))
        return cls(normal, names, score[order], curvature[np.ix_(order, order)])

    @property
    def beside(self) -> tuple[str, ...]:
        """Return the parameters that were fitted beside the moments."""
        return tuple(name for name in self.names if name not in Mvn.names)

    def fit(self, kind: type[Locus]) -> CompressedFit | None:
        """Fit a locus; None if its transfer function depends on more than a variance."""
        if kind.cumulants is None and kind is not Shaped:
            return None
        try:
            locus, change, slope = self._scoring_loop(kind)
            names, covariance = self._covariance(locus, slope)
        except np.linalg.LinAlgError:
            return None
        moved = dict(zip(self.beside, map(float, self._following[2] @ change), strict=True))
        return CompressedFit(locus, names, covariance, moved, self._gain(change), self._left_out(change))

    def _left_out(self, change: np.ndarray) -> float:
        _, curvature, _ = self._following
        sixth, moments = slice(-1 - ORDERS[-1], None), slice(0, 3)
        beyond, taken_up = (change[part] @ curvature[part, part] @ change[part] for part in (sixth, moments))
        own = np.abs(np.asarray(self.normal.moments())).max()
        return float(beyond + _BENT * taken_up * np.abs(change[moments]).max() / own)

    @cached_property
    def _following(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Score and curvature of moments and cumulants, all else following, and how it follows them."""
        size = len(self.names) - len(Mvn.names)
        beside, asked = slice(size), slice(size, None)
        follow = -np.linalg.solve(self.curvature[beside, beside], self.curvature[beside, asked])
        return (
            self.score[asked] + follow.T @ self.score[beside],
            self.curvature[asked, asked] + self.curvature[asked, beside] @ follow,
            follow,
        )

    def _scoring_loop(self, kind: type[Locus]) -> tuple[Locus, np.ndarray, np.ndarray]:
        """Return the best-fitting locus, the change of moments and cumulants to it, and its slope."""
        score, curvature, _ = self._following
        locus = kind.near(self.normal.moments())
        change, slope = self._change(locus)
        for _ in range(_STEPS):
            uphill = slope.T @ (score - curvature @ change)
            step = np.linalg.solve(slope.T @ curvature @ slope, uphill)
            if not step @ uphill > _CONVERGED:
                break
            for _ in range(_STEPS):
                there = locus.at(np.asarray(locus.coords) + step)
                new, turned = self._change(there)
                if self._gain(new) > self._gain(change):
                    locus, change, slope = there, new, turned
                    break
                step = step / 2
            else:
                break
        return locus, change, slope

    def _change(self, locus: Locus) -> tuple[np.ndarray, np.ndarray]:
        """Change of moments and cumulants from the normal to a locus, and its slope by the coordinates."""
        moments, slope = map(np.asarray, moments_and_slope(locus))
        changes, slopes = [moments - np.asarray(self.normal.moments())], [slope]
        for order in ORDERS:
            if order % 2:
                changes.append(np.zeros(order + 1))
                slopes.append(np.zeros((order + 1, len(locus.coords))))
                continue
            (form, bend), (size, growth) = form_cumulants(moments, order // 2), _cumulant(locus, order)
            changes.append(size * form)
            slopes.append(size * bend @ slope + np.outer(form, growth))
        return np.concatenate(changes), np.concatenate(slopes)

    def _gain(self, change: np.ndarray) -> float:
        score, curvature, _ = self._following
        return float(score @ change - 0.5 * change @ curvature @ change)

    def _covariance(self, locus: Locus, slope: np.ndarray) -> tuple[tuple[str, ...], np.ndarray]:
        """Return the covariance of all parameters fitted with a locus, in the order of its names.

        Raises
        ------
        LinAlgError
            If the curvature is not that of a maximum: a normal that fits badly leaves such cumulants.
        """
        beside, first = self.beside, self.names.index(Mvn.names[0])
        names = (*beside[:first], *locus.names, *beside[first:])
        turn = np.zeros((len(self.score), len(names)))
        turn[np.arange(len(beside)), [names.index(one) for one in beside]] = 1.0
        turn[len(beside) :, first : first + len(locus.names)] = slope
        covariance, sound = invert_information(turn.T @ self.curvature @ turn)
        if not sound:
            raise np.linalg.LinAlgError("the curvature is not that of a maximum")
        return names, covariance


def shaped_blur(step: CumulantStep, otf: OTF, data: Data, hold: Collection[str]) -> ShapedBlur | None:
    """Fit a blur and its kurtosis: to what cumulants tell, or where that is not enough to the image.

    Parameters
    ----------
    step, otf, data, hold
        As for :func:`~jitterkit.estimators.shape.fit_shape`; the step is from the normal, of the orders
        :data:`ORDERS`.
    """
    compressed = CompressedLikelihood.of(step)
    fitted = None if compressed is None else compressed.fit(Shaped)
    if fitted is None or not fitted.left_out < CLOSE:
        return fit_shape(step.parameters, 0.0, otf, data, hold, step.information_of_shaped())
    return ShapedBlur(fitted.at(step.parameters, otf.names), fitted.of_locus())


def _cumulant(locus: Locus, order: int) -> tuple[float, np.ndarray]:
    """Cumulant along an axis, in units of the standard deviation there, and its slope by the coordinates."""
    if not isinstance(locus, Shaped):
        assert locus.cumulants is not None
        return locus.cumulants[order // 2 - 2], np.zeros(len(locus.coords))
    k, last = float(locus.coords[3]), np.array([0.0, 0.0, 0.0, 1.0])
    if order == 4:
        return k, last
    if k > 0:
        return 10 * k**2 / 3, 20 * k / 3 * last
    return 20 * k**2 / (3 - k), 20 * k * (6 - k) / (3 - k) ** 2 * last
