"""What every jitter locus is: the path of the pointing on the detector while the shutter is open.

A locus is a probability density of pointing offsets.  The image is blurred by it, so all the
forward model needs is its transfer function ``M(f)``, exact at every frequency; no image is shifted
and no kernel drawn.  Every locus is centred: its mean offset is zero, so that the position of the
scene is the mean pointing, whatever the path.  ``M`` is real where the path is its own mirror image.

Which one to reach for:

* small against the resolution, or random and fast: ``Mvn`` (there an image shows
  second moments and nothing else); next, with one number for its shape, ``Shaped``;
* slow: ``Linear``; with a bend, ``Path``; measured, ``Trace``;
* a vibration of many cycles: ``Shm`` in one plane, ``Ellipse`` (or, in other words,
  ``Lissajous``) in two, ``Tones`` at two frequencies; of about one cycle, ``PartialShm``;
* a drift under random motion: ``Smear``;
* none: ``Stable``.

Independent motions multiply: ``Product(Linear.of(0.3), Mvn.of(0.05))`` is a locus too.

To add a locus, write one file with one class of this kind and add one line to the registry in
``jitterkit/loci/__init__.py``; the contract test in ``tests/loci`` then holds it to the laws.
"""

from __future__ import annotations

import math
from abc import abstractmethod
from typing import ClassVar, Self

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.conventions import axis_angle


class Locus(eqx.Module):
    """A jitter locus in coordinates that stay regular at zero size.

    Attributes
    ----------
    coords : (k,) array
        What a fit varies; all sizes zero means no jitter.  Build a locus from lengths and angles with
        its ``of`` constructor instead.
    names : tuple of str
        One a coordinate.
    nodes : int
        Of the integral over time that its transfer function is, in each panel; 0 where there is no choice.
    cumulants : (float, float) or None
        Fourth and sixth cumulant along any axis, in units of the standard deviation there; None if they are
        not the same in all directions, or depend on the coordinates.
    """

    coords: Float[Array | np.ndarray, " k"]
    names: ClassVar[tuple[str, ...]]
    nodes: ClassVar[int] = 0
    cumulants: ClassVar[tuple[float, float] | None] = None

    def at(self, coords: Float[Array | np.ndarray, " k"]) -> Self:
        """Return a locus of the same kind at other coordinates."""
        return eqx.tree_at(lambda locus: locus.coords, self, coords)

    def sampled(self, nodes: int) -> Self:
        """Return the locus with so many nodes in the integral over time, where they may be chosen.

        A formula stays as it is, and so does a measured trace, whose samples say how many there are.
        """
        return self

    @abstractmethod
    def transfer(self, fx, fy):
        """Transfer function ``M(f)`` at frequencies in cycles/arcsec; 1 at zero, complex if lopsided."""

    def exact_to(self) -> float:
        """Frequency [cycles/arcsec] up to which ``transfer`` is good to 1e-4; infinite if it is a formula."""
        return math.inf

    @abstractmethod
    def moments(self) -> Float[Array, "3"]:
        """Return the second moments ``(Sxx, Sxy, Syy)`` of the pointing, arcsec²."""

    @abstractmethod
    def describe(self) -> dict[str, float]:
        """Return the sizes [arcsec] and angle [deg] as a person would give them."""

    @classmethod
    @abstractmethod
    def near(cls, moments: Float[Array | np.ndarray, "3"]) -> Self:
        """Return the locus of this kind closest to given second moments: where a fit starts."""

    @abstractmethod
    def points(self, n: int) -> np.ndarray:
        """About ``n`` equally probable pointing offsets ``(m, 2)`` in arcsec, columns x and y."""

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        """Pointing ``(n, 2)`` in arcsec at ``n`` equal steps through one exposure, in order of time.

        Its distribution over the exposure is the locus; where the motion is random, it is one draw.  A locus
        whose :meth:`points` are in order of time has those.
        """
        return self.points(n)


@eqx.filter_jit
def moments_and_slope(locus: Locus):
    """Return the second moments (3,) of a locus, and their slope (3, q) by its coordinates."""
    return locus.moments(), jax.jacfwd(lambda c: locus.at(c).moments())(locus.coords)


def principal_axes(moments) -> tuple[float, float, float]:
    """Principal axes of second moments, as sizes.

    Parameters
    ----------
    moments : (3,) array
        ``(Sxx, Sxy, Syy)``, arcsec².

    Returns
    -------
    major, minor : float
        1 sigma along each axis, arcsec; zero where the variance is negative, as a noisy estimate of
        no jitter may be.
    angle : float
        Of the major axis, degrees counter-clockwise from +x in [0, 180).
    """
    major, minor, angle = axis_variances(moments)
    return float(np.sqrt(max(major, 0.0))), float(np.sqrt(max(minor, 0.0))), angle


def axis_variances(moments) -> tuple[float, float, float]:
    """Variances along the principal axes of second moments.

    Parameters
    ----------
    moments : (3,) array
        ``(Sxx, Sxy, Syy)``, arcsec².

    Returns
    -------
    major, minor : float
        arcsec², with their signs: noise about no jitter makes them negative.
    angle : float
        Of the major axis, degrees counter-clockwise from +x in [0, 180).

    >>> axis_variances([2.0, 1.0, 2.0])
    (3.0, 1.0, 45.0)
    """
    sxx, sxy, syy = np.asarray(moments, float).tolist()
    mean, half = (sxx + syy) / 2, float(np.hypot((sxx - syy) / 2, sxy))
    return mean + half, mean - half, axis_angle(np.degrees(np.arctan2(2 * sxy, sxx - syy)) / 2)


def moments_on_axis(moments, angle: float) -> np.ndarray:
    """Return the second moments along and across an axis.

    Parameters
    ----------
    moments : (3,) array
        ``(Sxx, Sxy, Syy)``, arcsec².
    angle : float
        Of the axis, degrees counter-clockwise from +x.  What is given on an axis at ``angle`` is on x and y
        by ``-angle``.

    Returns
    -------
    moments : (3,) array
        The variance along the axis, the cross moment, and the variance across.

    >>> moments_on_axis([3.0, 0.5, 1.0], 90.0).round(9)
    array([ 1. , -0.5,  3. ])
    """
    return _projection(angle) @ np.asarray(moments)


def covariance_on_axis(covariance, angle: float) -> np.ndarray:
    """Covariance (3, 3) of second moments along and across an axis, as :func:`moments_on_axis` has them."""
    rows = _projection(angle)
    return rows @ np.asarray(covariance) @ rows.T


def turned(along, across, angle: float) -> np.ndarray:
    """Return the offsets ``(n, 2)`` from components along and across an axis at ``angle`` degrees."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.stack([along * c - across * s, along * s + across * c], axis=-1)


def _projection(angle: float) -> np.ndarray:
    """Return the matrix from ``(Sxx, Sxy, Syy)`` to the moments along, crosswise and across: ``R' Σ R``."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.array([[c * c, 2 * s * c, s * s], [-s * c, c * c - s * s, s * c], [s * s, -2 * s * c, c * c]])


def whole_cycles(n: int, rng: np.random.Generator) -> np.ndarray:
    """Phases (n,) of a vibration through one exposure, in radians.

    Whole cycles from a random phase; how many, so that each has 16 to 32 steps, is drawn too, and two
    vibrations at once are unrelated.
    """
    cycles = rng.integers(max(1, n // 32), max(1, n // 16), endpoint=True)
    return 2 * np.pi * cycles * (np.arange(n) + 0.5) / n + rng.uniform(0, 2 * np.pi)


class OfVariance(Locus):
    """A locus whose transfer function depends only on the variance ``f'Σf`` along a frequency.

    Attributes
    ----------
    profile : callable
        The transfer function of that variance (class attribute).
    """

    profile: ClassVar[staticmethod]

    def variance_along(self, fx, fy):
        """Return ``f'Σf`` at frequencies in cycles/arcsec, Σ the second moments [arcsec²]."""
        sxx, sxy, syy = self.moments()
        return sxx * fx**2 + 2 * sxy * fx * fy + syy * fy**2

    def transfer(self, fx, fy):
        return type(self).profile(self.variance_along(fx, fy))


class Stable(OfVariance):
    """A telescope that stands still: ``M = 1``."""

    names: ClassVar[tuple[str, ...]] = ()
    profile = staticmethod(jnp.ones_like)

    @classmethod
    def of(cls) -> Self:
        """Return the only one there is."""
        return cls(jnp.zeros(0))

    @classmethod
    def near(cls, moments) -> Self:
        return cls.of()

    def moments(self):
        return jnp.zeros(3)

    def describe(self) -> dict[str, float]:
        return {}

    def points(self, n: int) -> np.ndarray:
        return np.zeros((1, 2))

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return np.zeros((n, 2))


_SECOND = 0.1
"""Largest ratio of the second order of the variance of Sxx + Syy to its first at which it is added."""


def moments_of(
    locus: Locus, names: tuple[str, ...], covariance: np.ndarray, *, order: int = 2
) -> tuple[np.ndarray, np.ndarray]:
    """Second moments of a locus whose coordinates are known to a covariance.

    Parameters
    ----------
    locus : Locus
    names : tuple of str
        Of the free parameters, those of the locus among them.
    covariance : (p, p) array
        Of the free parameters.
    order : int
        1 or 2: how errors of the coordinates are propagated.  The Syy of a streak along x goes with the
        square of its direction: to first order it has no error.

    Returns
    -------
    moments : (3,) array
        ``(Sxx, Sxy, Syy)``, arcsec².
    covariance : (3, 3) array
        arcsec⁴; zero unless all coordinates of the locus are free.  Of first order for a streak that is
        hardly longer than its error, whose moments are normal, not its coordinates.
    """
    indices = [names.index(n) for n in locus.names if n in names]
    if len(indices) < len(locus.names) or not indices:
        return np.asarray(locus.moments()), np.zeros((3, 3))
    moments, slope = map(np.asarray, moments_and_slope(locus))
    own = covariance[np.ix_(indices, indices)]
    first = slope @ own @ slope.T
    errors = np.diag(np.sqrt(np.diag(own)))
    linear = np.array_equal(slope[:, :3], np.eye(3))  # its coordinates are the moments
    if order < 2 or linear or not np.all(np.isfinite(first)) or not np.all(np.diag(errors) > 0):
        return moments, first
    ahead, behind = (
        np.array([moments_and_slope(locus.at(locus.coords + way * step))[1] for step in errors])
        for way in (1, -1)
    )
    bends = (ahead - behind) / (2 * np.diag(errors)[:, None, None]) @ own.T  # (q, 3, q)
    second = 0.5 * np.einsum("ikj,jli->kl", bends, bends)
    total = np.array([1.0, 0.0, 1.0])
    return moments, first + second * bool(total @ second @ total < _SECOND * total @ first @ total)
