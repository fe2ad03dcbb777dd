"""How well an expected image explains a frame, and what the frame says about its parameters.

The likelihood is Poisson.  Read noise of variance σ² enters as the shifted Poisson law: ``d + σ²`` is
treated as Poisson with mean ``μ + σ²``, which has the right mean and variance at every pixel and
tends to a normal law where σ² dominates (Snyder et al., J. Opt. Soc. Am. A 12, 272, 1995).  Electrons
that were divided by a flat field count as what they were before: ``r d + σ²``, of mean ``r μ + σ²``.

A pixel at its ceiling is known to hold at least so much.  It is left out, together with all that the
*model* expects near the ceiling (to choose pixels by their data would trim their noise), or it counts with
the probability of reaching the ceiling; see :meth:`Data.of`.

Information is always the expected Fisher information, which is positive by construction; a Hessian at
the data need not be.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jitterkit.forward import Parameters, expected_image, image_and_jacobian
from jitterkit.frames.frame import Frame
from jitterkit.optics.otf import OTF

__all__ = [
    "Data",
    "Misfit",
    "NormalEquations",
    "chi_squared",
    "deviance",
    "equations_of",
    "is_clear",
    "normal_equations",
    "pearson",
]

_FLOOR = 1e-6
"""Smallest expected count, as a share of the frame's mean: ringing must not make it negative."""

_CLEAR = 4.0
"""Sigmas below its ceiling from which a pixel counts: what is trimmed of its noise there is 3e-5 of it."""

_NO_CEILING = 1e15
"""Electrons that no pixel holds: a ceiling that is infinite has no cube root."""

_NEAR = 10.0
"""Sigmas below the ceiling within which some reading lies if any pixel can be expected to reach it."""


class Data(eqx.Module):
    """What the likelihood needs of a frame.

    Attributes
    ----------
    electrons : (ny, nx) array
        Pixels that are not used hold zero.
    read_variance : (ny, nx) array
        What the scene does not make, electrons² before any division by the response.
    used : (ny, nx) bool array
    response : (ny, nx) array or None
        The flat that the electrons were divided by; None for one.
    ceiling : (ny, nx) array or None
        Level from which on a pixel is full; None where nothing comes near it.
    full : (ny, nx) bool array or None
        Pixels that count as having reached the ceiling; None to leave out what comes near it.
    """

    electrons: Float[Array, "ny nx"]
    read_variance: Float[Array, "ny nx"]
    used: Bool[Array, "ny nx"]
    response: Float[Array, "ny nx"] | None
    ceiling: Float[Array, "ny nx"] | None
    full: Bool[Array, "ny nx"] | None

    def __init__(
        self, electrons, read_variance=0.0, used=None, *, response=None, ceiling=None, full=None
    ) -> None:
        electrons = np.asarray(electrons, float)
        used = np.ones(electrons.shape, bool) if used is None else np.asarray(used, bool)
        used = used & np.isfinite(electrons)
        self.electrons = jnp.asarray(np.where(used, electrons, 0.0))
        self.read_variance = jnp.asarray(np.broadcast_to(np.asarray(read_variance, float), electrons.shape))
        self.used = jnp.asarray(used)
        self.response = None if response is None else jnp.broadcast_to(response, electrons.shape)
        ceiling = None if ceiling is None else np.minimum(ceiling, _NO_CEILING)
        self.ceiling = None if ceiling is None else jnp.broadcast_to(ceiling, electrons.shape)
        self.full = None if full is None else jnp.asarray(full, bool)

    @classmethod
    def of(cls, frame: Frame, *, censored: bool = False) -> Data:
        """What a calibrated frame tells.

        Parameters
        ----------
        frame : Frame
        censored : bool
            Whether full pixels count with the probability of being full, or are left out together with
            those that :meth:`clear` finds too near.  To leave them out costs what they would have told
            (a tenth of the separation's error, at 700 full pixels of TOLIMAN's brightest); to count them
            asks that the response is linear up to the ceiling.
        """
        flat = None if np.all(frame.response == 1) else frame.response
        used = ~frame.mask
        counts = np.where(used, frame.electrons * frame.response + frame.read_variance, 0.0)
        level = frame.response * frame.ceiling + frame.read_variance
        near = frame.full | (np.sqrt(counts.clip(0)) + _NEAR / 2 > np.sqrt(level))  # a root's error is 1/2
        return cls(
            frame.electrons,
            frame.read_variance,
            used,
            response=flat,
            ceiling=frame.ceiling if np.any(near) else None,
            full=frame.full if censored and np.any(near) else None,
        )

    @property
    def trims(self) -> bool:
        """Whether something comes near a ceiling and is to be left out."""
        return self.ceiling is not None and self.full is None

    def clear(self, image) -> Data:
        """Leave out what an expected image (ny, nx) brings near the ceiling.

        Returns
        -------
        data : Data
            Without a ceiling; the same where there is none, or where full pixels count.
        """
        if not self.trims:
            return self
        keep = np.asarray(is_clear(jnp.asarray(image), self))
        return Data(self.electrons, self.read_variance, keep, response=self.response)

    @property
    def offset(self) -> Float[Array, "ny nx"]:
        """What is added to electrons and image to make both of them Poisson."""
        return self.read_variance if self.response is None else self.read_variance / self.response

    @property
    def weight(self):
        """Counts before the division by the response, of an electron after it."""
        return 1.0 if self.response is None else self.response


class NormalEquations(NamedTuple):
    """A frame's deviance, score and information at one point of the parameters.

    Attributes
    ----------
    deviance : float
    score : (p,) array
        Derivative of the log-likelihood.
    information : (p, p) array
        Expected Fisher information.
    """

    deviance: Float[Array, ""]
    score: Float[Array, " p"]
    information: Float[Array, "p p"]


@eqx.filter_jit
def normal_equations(parameters: Parameters, otf: OTF, data: Data, free: tuple[int, ...]) -> NormalEquations:
    """Deviance, score and Fisher information of a frame.

    Parameters
    ----------
    parameters : Parameters
    otf : OTF
    data : Data
    free : tuple of int
        Positions in the parameter vector that vary, ascending.

    Returns
    -------
    equations : NormalEquations
        ``solve(information, score)`` is the scoring step, the natural gradient.
    """
    image, jacobian = image_and_jacobian(parameters, otf, free)
    return equations_of(image, jacobian, data)


def equations_of(image, jacobian, data: Data) -> NormalEquations:
    """The :func:`normal_equations` of an expected image (ny, nx) and its derivatives (p, ny, nx)."""
    mean = _mean(image, data)
    slope = jnp.where(_telling(image, data), data.weight, 0.0)
    residual, share = _residual(mean, data), 1 / mean
    if data.full is not None:
        residual, share = _with_full(residual, mean, data)
    score = jnp.tensordot(jacobian, slope * residual, 2)
    information = jnp.tensordot(jacobian * (slope * share), jacobian, ((1, 2), (1, 2)))
    return NormalEquations(_deviance(mean, data), score, information)


def deviance(parameters: Parameters, otf: OTF, data: Data) -> Float[Array, ""]:
    """Twice the log-likelihood lost against a perfect model of the used pixels; about their number."""
    return _deviance(_mean(expected_image(parameters, otf), data), data)


class Misfit(NamedTuple):
    """How far a frame is from its expected image.

    Attributes
    ----------
    chi2 : float
        Pearson's; its expectation under the model is ``pixels``, at any flux.
    pixels : int
        How many count: used, and expected to hold something.
    spread : float
        Standard deviation of ``chi2`` under the model: each pixel adds ``2 + μ/(μ+σ²)²`` to its square.
    residual : (ny, nx) array
        ``(data - image)/sqrt(image + read variance)``; NaN where a pixel does not count.
    """

    chi2: float
    pixels: int
    spread: float
    residual: np.ndarray


def pearson(image, data: Data) -> Misfit:
    """Pearson's chi-squared of an expected image (ny, nx), and the residual in sigmas.

    Pixels that may reach their ceiling are left out: what of their noise is seen is not Poisson.
    """
    chi2, pixels, spread, residual = _pearson(jnp.asarray(image), data)
    return Misfit(float(chi2), int(pixels), float(spread), np.asarray(residual))


def chi_squared(image, data: Data):
    """The numbers of :func:`pearson`, for use within a compiled program: chi-squared, pixels and spread."""
    return _pearson(image, data)[:3]


@eqx.filter_jit
def _pearson(image, data: Data):
    mean = _mean(image, data)
    counts = _telling(image, data) & data.used
    if data.ceiling is not None:
        counts &= _clears(mean, data)
    residual = jnp.where(counts, _residual(mean, data) * jnp.sqrt(mean * data.weight), jnp.nan)
    variance = jnp.where(counts, 2 + jnp.clip(image, 0) / (data.weight * mean**2), 0.0).sum()
    return jnp.nansum(residual**2), counts.sum(), jnp.sqrt(variance), residual


@eqx.filter_jit
def is_clear(image, data: Data):
    """Pixels (ny, nx) that are used and that an expected image leaves clear of their ceiling."""
    return data.used if data.ceiling is None else data.used & _clears(_mean(image, data), data)


def _clears(mean, data: Data):
    """Whether an expected count stays clear of its ceiling."""
    return _ceiling_distance(mean, data)[0] < -_CLEAR


def _floor(image, data: Data):
    count = jnp.maximum(jnp.sum(data.used), 1)
    typical = jnp.sum(jnp.where(data.used, jnp.abs(image + data.offset), 0.0)) / count
    return _FLOOR * typical + jnp.finfo(image.dtype).tiny


def _mean(image, data: Data):
    return jnp.maximum(image + data.offset, _floor(image, data))


def _telling(image, data: Data):
    """Pixels that count: used or full, and not held up by the floor, where the model says nothing."""
    counting = data.used if data.full is None else data.used | data.full
    return counting & (image + data.offset > _floor(image, data))


def _residual(mean, data: Data):
    """Derivative of a pixel's log-likelihood by its mean count: the excess as a share of the mean."""
    return (data.electrons + data.offset - mean) / mean


def _deviance(mean, data: Data):
    """Its slope is minus twice the score at every count, negative ones (read noise) included."""
    count = data.electrons + data.offset
    positive = count > 0
    ratio = jnp.where(positive, count, mean) / mean
    below = mean - count * jnp.log(mean)
    each = jnp.where(positive, mean - count + count * jnp.log(ratio), below) * data.weight
    total = 2 * jnp.sum(jnp.where(data.used, each, 0.0))
    if data.full is None:
        return total
    reached, _ = _ceiling_distance(mean, data)
    return total - 2 * jnp.sum(jnp.where(data.full, jax.scipy.stats.norm.logcdf(reached), 0.0))


def _with_full(residual, mean, data: Data):
    """Score and information of a pixel's mean count, where it may reach its ceiling.

    Returns
    -------
    residual : (ny, nx) array
        Of a full pixel, the slope of the logarithm of its chance to be full.
    share : (ny, nx) array
        Information on the mean, of the counts below the ceiling and of reaching it together: 1/mean far
        below the ceiling, nothing far above.
    """
    assert data.full is not None
    reached, slope = _ceiling_distance(mean, data)
    normal = jax.scipy.stats.norm
    chance, density = normal.cdf(reached), normal.pdf(reached)
    hazard = jnp.exp(normal.logpdf(reached) - normal.logcdf(reached))
    below = 1 - chance + reached * density
    above = density * hazard * slope**2 * mean * data.weight
    return jnp.where(data.full, hazard * slope, residual), (below + above) / mean


def _ceiling_distance(mean, data: Data):
    """Sigmas by which an expected count lies above its ceiling, and their slope by the count.

    Wilson and Hilferty's cube root makes a Poisson law normal (Proc. Natl. Acad. Sci. 17, 684, 1931): the
    chance of reaching the ceiling is right to 6e-4 at ten counts, 5e-6 at a thousand and 4e-7 at 15,000.
    """
    assert data.ceiling is not None
    count, level = data.weight * mean, data.weight * (data.ceiling + data.offset) + 0.5
    root = jnp.cbrt(count / level)
    steep = 3 * jnp.sqrt(level)
    return steep * (root - 1 + 1 / (9 * level)), steep * root / (3 * count)
