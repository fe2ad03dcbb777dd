"""How well an expected image explains a frame, and what the frame says about its parameters.

The likelihood is Poisson.  Read noise of variance σ² enters as the shifted Poisson law: ``d + σ²`` is
treated as Poisson with mean ``μ + σ²``, which has the right mean and variance at every pixel and
tends to a normal law where σ² dominates (Snyder et al., J. Opt. Soc. Am. A 12, 272, 1995).

Information is always the expected Fisher information, which is positive by construction; a Hessian at
the data need not be.
"""

from __future__ import annotations

from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jitterkit.forward import Parameters, expected_image, image_and_jacobian
from jitterkit.optics.otf import OTF

__all__ = ["Data", "Misfit", "NormalEquations", "deviance", "normal_equations", "pearson"]

_FLOOR = 1e-6
"""Smallest expected count, as a share of the frame's mean: ringing must not make it negative."""


class Data(eqx.Module):
    """What the likelihood needs of a frame.

    Attributes
    ----------
    electrons : (ny, nx) array
        Masked pixels hold zero.
    read_variance : (ny, nx) array
        Read-out noise, electrons².
    used : (ny, nx) bool array
    """

    electrons: Float[Array, "ny nx"]
    read_variance: Float[Array, "ny nx"]
    used: Bool[Array, "ny nx"]

    def __init__(self, electrons, read_variance=0.0, used=None) -> None:
        electrons = np.asarray(electrons, float)
        used = np.ones(electrons.shape, bool) if used is None else np.asarray(used, bool)
        used = used & np.isfinite(electrons)
        self.electrons = jnp.asarray(np.where(used, electrons, 0.0))
        self.read_variance = jnp.broadcast_to(jnp.asarray(read_variance, float), electrons.shape)
        self.used = jnp.asarray(used)


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
    mean = _mean(image, data)
    weighted = jacobian * jnp.where(_telling(image, data), 1 / mean, 0.0)
    score = jnp.tensordot(weighted, data.electrons + data.read_variance - mean, 2)
    information = jnp.tensordot(weighted, jacobian, ((1, 2), (1, 2)))
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
    """Pearson's chi-squared of an expected image (ny, nx), and the residual in sigmas."""
    image = jnp.asarray(image)
    counts = np.asarray(_telling(image, data))
    mean = np.asarray(_mean(image, data))
    difference = np.asarray(data.electrons + data.read_variance) - mean
    residual = np.where(counts, difference / np.sqrt(mean), np.nan)
    variance = (2 + np.clip(np.asarray(image), 0, None) / mean**2)[counts].sum()
    return Misfit(float(np.nansum(residual**2)), int(counts.sum()), float(np.sqrt(variance)), residual)


def _floor(image, data: Data):
    count = jnp.maximum(jnp.sum(data.used), 1)
    typical = jnp.sum(jnp.where(data.used, jnp.abs(image + data.read_variance), 0.0)) / count
    return _FLOOR * typical + jnp.finfo(image.dtype).tiny


def _mean(image, data: Data):
    return jnp.maximum(image + data.read_variance, _floor(image, data))


def _telling(image, data: Data):
    """Pixels that count: used, and not held up by the floor, where the model says nothing."""
    return data.used & (image + data.read_variance > _floor(image, data))


def _deviance(mean, data: Data):
    """Its slope is minus twice the score at every count, negative ones (read noise) included."""
    count = data.electrons + data.read_variance
    positive = count > 0
    ratio = jnp.where(positive, count, mean) / mean
    below = mean - count * jnp.log(mean)
    return 2 * jnp.sum(
        jnp.where(data.used, jnp.where(positive, mean - count + count * jnp.log(ratio), below), 0.0)
    )
