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

__all__ = ["Data", "NormalEquations", "deviance", "normal_equations", "pearson"]

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
    weighted = jacobian * jnp.where(data.used, 1 / mean, 0.0)
    score = jnp.tensordot(weighted, data.electrons + data.read_variance - mean, 2)
    information = jnp.tensordot(weighted, jacobian, ((1, 2), (1, 2)))
    return NormalEquations(_deviance(mean, data), score, information)


def deviance(parameters: Parameters, otf: OTF, data: Data) -> Float[Array, ""]:
    """Twice the log-likelihood lost against a perfect model of the used pixels; about their number."""
    return _deviance(_mean(expected_image(parameters, otf), data), data)


def pearson(image, data: Data) -> tuple[float, np.ndarray]:
    """Pearson's chi-squared of an expected image, and the residual in sigmas.

    Returns
    -------
    chi2 : float
        Its expectation under the model is the number of used pixels, at any flux.
    residual : (ny, nx) array
        ``(data - image)/sqrt(image + read variance)``; NaN where masked.
    """
    mean = np.asarray(_mean(jnp.asarray(image), data))
    difference = np.asarray(data.electrons + data.read_variance) - mean
    residual = np.where(np.asarray(data.used), difference / np.sqrt(mean), np.nan)
    return float(np.nansum(residual**2)), residual


def _mean(image, data: Data):
    mean = image + data.read_variance
    count = jnp.maximum(jnp.sum(data.used), 1)
    typical = jnp.sum(jnp.where(data.used, jnp.abs(mean), 0.0)) / count
    return jnp.maximum(mean, _FLOOR * typical + jnp.finfo(mean.dtype).tiny)


def _deviance(mean, data: Data):
    count = jnp.maximum(data.electrons + data.read_variance, 0.0)
    ratio = jnp.where(count > 0, count, mean) / mean
    return 2 * jnp.sum(jnp.where(data.used, mean - count + count * jnp.log(ratio), 0.0))
