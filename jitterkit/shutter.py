"""Rolling shutters: the rows of a frame are exposed one after the other, and the pointing moves meanwhile.

Row ``r`` is exposed during a window that begins ``s = (r - r0) line_time`` after that of the frame's
central row ``r0``.  The image that one window sees is a smooth function of ``s``; so a frame is a few images,
each exposed as a whole to the motion of its own window, blended row by row by the polynomial through them:

    image[r] = sum_j l_j(s_r) image_j[r],    image_j = IFFT{ spectrum(f) W(f, s_j) }

with the windows at Chebyshev's points of the frame's read-out time.  One node is a global shutter, two are
the first-order form (linear in the row); more converge geometrically where the motion is smooth.  Give it to
:class:`jitterkit.forward.Parameters` as ``shutter``; there positions are those of the central row's window.

Reach for :class:`Drifting` where the image moves at one speed, for :class:`Following` where the motion was
measured, and for :func:`with_enough_nodes` to have the nodes chosen.
"""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from typing import Self, TypeVar

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.conventions import offsets
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.base import Locus, Stable
from jitterkit.loci.product import Product
from jitterkit.loci.trace_locus import Trace

_TOLERANCE = 3.5e-5
"""Share of an amplitude.  Its square times the photons is chi-squared: 0.05 at most in a frame of 3.8e7."""

_SEEN = 64
"""Windows at which a motion is looked at to choose the nodes, of which there must be fewer."""

_DIRECTIONS = 8
"""In a half circle, of the frequencies it is looked at; at the highest and at half of it."""

_Kind = TypeVar("_Kind", bound="Shutter")


class Shutter(eqx.Module):
    """A rolling shutter and what moved under it.

    Attributes
    ----------
    line_time : float
        From the beginning of one row's window to that of the next row upwards in the array, s; negative where
        the upper row is the earlier.
    nodes : int
        Images that are blended.
    """

    line_time: eqx.AbstractVar[Float[Array, ""]]
    nodes: eqx.AbstractVar[int]

    @abstractmethod
    def window(self, fx, fy, delay):
        """Return the transfer function of the window that begins ``delay`` [s] after the central row's.

        Only what the locus does not hold: ``fx`` and ``fy`` in cycles/arcsec broadcast.
        """

    def completed(self, locus: Locus) -> Locus:
        """Return the whole jitter of the central row, given what the parameters' locus holds of it."""
        return locus

    def transfers(self, fx, fy, ny: int):
        """Return the transfer functions ``(nodes, ...)`` of the windows whose images are blended."""
        delays = jnp.asarray(_points(self.nodes) * (ny - 1) / 2) * self.line_time
        return jax.vmap(lambda delay: self.window(fx, fy, delay))(delays)

    def blend(self, ny: int) -> np.ndarray:
        """Return the weights ``(nodes, ny)`` of each image in each row of a frame; each row's sum to one."""
        return _cardinal(self.nodes, offsets(ny, 2 / max(ny - 1, 1)))


class Drifting(Shutter):
    """A uniform drift.

    The rows shear and stretch the image.  The streak that the drift leaves in every row is the locus's:
    ``Linear`` of the length ``speed * exposure``.

    Attributes
    ----------
    velocity : (2,) array
        Of the image on the detector, along x and y, arcsec/s.

    Notes
    -----
    *Assumes* that the speed is the same through the frame.  What is wrong with it is wrong with the frame: at
    15 us a row and 10 arcsec between the stars of a pair across the rows, 1 mas/s is 0.4 uas of separation.
    One frame does not tell the sense of its streak; where the pair stands in the next one does.
    """

    line_time: Float[Array, ""]
    velocity: Float[Array, "2"]
    nodes: int = eqx.field(static=True)

    def __init__(self, line_time, velocity, nodes: int = 2) -> None:
        self.line_time, self.velocity = jnp.asarray(line_time, float), jnp.asarray(velocity, float)
        self.nodes = _checked_nodes(nodes)
        if self.velocity.shape != (2,):
            problem = "A drift has two velocities, along x and y"
            found = f"got an array of shape {self.velocity.shape}"
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, f"{problem}; {found}.")

    def window(self, fx, fy, delay):
        vx, vy = self.velocity
        return jnp.exp(-2j * jnp.pi * fx * vx * delay) * jnp.exp(-2j * jnp.pi * fy * vy * delay)


class Following(Shutter):
    """Any measured motion: each window has the exact transfer function of its own part of the record.

    The parameters' locus holds what the record does not: ``Stable``, or a normal for what its sensor missed.

    Attributes
    ----------
    times : (n,) array
        Ascending, s from the beginning of the central row's window; every row's window lies within.
    positions : (n, 2) array
        Pointing along x and y, arcsec, from its mean over the central row's window; straight between the
        times.
    exposure : float
        Length of a row's window, s.
    """

    line_time: Float[Array, ""]
    times: Float[Array, " n"]
    positions: Float[Array, "n 2"]
    exposure: Float[Array, ""]
    nodes: int = eqx.field(static=True)

    @classmethod
    def of(cls, line_time: float, t, x, y, start: float, exposure: float, rows: int, nodes: int = 2) -> Self:
        """Build from a record of the pointing.

        Parameters
        ----------
        line_time : float
            s.
        t : (n,) array
            Times in seconds, ascending, at any intervals.
        x, y : (n,) array
            Pointing in arcsec; a common offset does not matter.
        start : float
            When the window of the central row begins, s: that of the frame as it is modelled, not of the
            detector it may be cut out of.
        exposure : float
            Likewise the window's length, s.
        rows : int
            Of the frame.
        nodes : int
            Images to blend; let :func:`with_enough_nodes` choose.

        Raises
        ------
        ConfigurationError
            If the record is not one, or does not cover the windows of all rows.
        """
        t, x, y = (np.asarray(v, float) for v in (t, x, y))
        central = Trace.of(t, x, y, start, exposure)
        wait = (rows - 1) / 2 * abs(float(line_time))
        first, last = start - wait, start + exposure + wait
        slack = 1e-9 * (last - first)  # the windows may end with the record, to rounding
        if first < t[0] - slack or last > t[-1] + slack:
            raise ConfigurationError(
                ErrorCode.OUT_OF_RANGE,
                f"The rows of the frame are exposed from {first:g} to {last:g} s, but the trace runs from "
                f"{t[0]:g} to {t[-1]:g} s; give a longer trace or another start.",
            )
        kept = slice(max(np.searchsorted(t, first, "right") - 1, 0), np.searchsorted(t, last, "left") + 1)
        at_start = np.array([np.interp(start, t, x), np.interp(start, t, y)])
        positions = np.stack([x, y], axis=1)[kept] - at_start + np.asarray(central.positions[0])
        return cls(
            line_time=jnp.asarray(line_time, float),
            times=jnp.asarray(t[kept] - start),
            positions=jnp.asarray(positions),
            exposure=jnp.asarray(exposure, float),
            nodes=_checked_nodes(nodes),
        )

    def window(self, fx, fy, delay):
        return self._trace(delay).transfer(fx, fy)

    def completed(self, locus: Locus) -> Locus:
        trace = self._trace(0.0)
        return trace if isinstance(locus, Stable) else Product(trace, locus)

    def _trace(self, delay) -> Trace:
        """The part of one window; samples outside it are gathered at its ends, where they weigh nothing."""
        shares = jnp.clip((self.times - delay) / self.exposure, 0.0, 1.0)
        at = delay + self.exposure * shares
        positions = [jnp.interp(at, self.times, self.positions[:, axis]) for axis in (0, 1)]
        return Trace(jnp.zeros(0), shares, jnp.stack(positions, axis=1))


def with_enough_nodes(shutter: _Kind, ny: int, highest: float, tolerance: float = _TOLERANCE) -> _Kind:
    """Return a shutter with as many nodes as its motion needs.

    Parameters
    ----------
    shutter : Shutter
    ny : int
        Rows of the frame.
    highest : float
        Highest frequency in the image, cycles/arcsec: the ``nyquist`` of the OTF's grid.
    tolerance : float
        Error of an amplitude, as a share of it, that may remain.

    Returns
    -------
    shutter : Shutter
        The same with the fewest nodes, two or more, that are good enough.

    Raises
    ------
    ConfigurationError
        If 63 are not.
    """
    errors = _errors(shutter, ny, highest)
    enough = np.flatnonzero(errors[2:] < tolerance)
    if not enough.size:
        raise ConfigurationError(
            ErrorCode.SAMPLING,
            f"The pointing moves too fast for {_SEEN - 1} images to be blended over the "
            f"{(ny - 1) * abs(float(shutter.line_time)):g} s that {ny} rows take; give a smoother trace, or "
            "fewer rows.",
        )
    return dataclasses.replace(shutter, nodes=2 + int(enough[0]))


def interpolation_error(shutter: Shutter, ny: int, highest: float) -> float:
    """Error of the blending, root mean square over the rows, as a share of the amplitude that suffers most.

    Parameters
    ----------
    shutter, ny, highest
        As in :func:`with_enough_nodes`.

    Returns
    -------
    error : float
        Its square times the photons bounds chi-squared, by far: an image has little at high frequencies.

    Notes
    -----
    What a polynomial through Chebyshev's points misses has the mean square of the Chebyshev coefficients that
    it leaves out: half of it for their own terms, half for what these are taken for.  The coefficients are
    measured from 64 windows, at the highest frequency and half of it in 8 directions.
    """
    return float(_errors(shutter, ny, highest)[shutter.nodes])


def _errors(shutter: Shutter, ny: int, highest: float) -> np.ndarray:
    """:func:`interpolation_error` of 0 to 63 nodes."""
    angles = np.pi * np.arange(_DIRECTIONS) / _DIRECTIONS
    fx, fy = (np.outer([highest, highest / 2], f(angles)).ravel() for f in (np.cos, np.sin))
    points = _points(_SEEN)
    delays = jnp.asarray(points * (ny - 1) / 2) * shutter.line_time
    seen = np.asarray(_windows(shutter, fx, fy, delays))
    series = np.linalg.solve(np.polynomial.chebyshev.chebvander(points, _SEEN - 1), seen)
    return np.sqrt(np.cumsum(np.abs(series[::-1]) ** 2, axis=0)[::-1].max(axis=1))


@eqx.filter_jit
def _windows(shutter: Shutter, fx, fy, delays):
    return jax.lax.map(lambda delay: shutter.window(fx, fy, delay), delays)


def _points(nodes: int) -> np.ndarray:
    """Chebyshev's points in (-1, 1), ascending."""
    return -np.cos(np.pi * (np.arange(nodes) + 0.5) / nodes)


def _cardinal(nodes: int, at: np.ndarray) -> np.ndarray:
    """Return the polynomials (nodes, m) that are one at their own point and zero at the others."""
    basis = np.polynomial.chebyshev.chebvander
    return np.linalg.solve(basis(_points(nodes), nodes - 1).T, basis(at, nodes - 1).T)


def _checked_nodes(nodes: int) -> int:
    if not 1 <= nodes < _SEEN:
        problem = f"A shutter blends 1 to {_SEEN - 1} images; got nodes = {nodes}."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    return int(nodes)
