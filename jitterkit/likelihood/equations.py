"""What a frame says about the parameters of its image: deviance, score and information."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.forward import Parameters, expected_image, image_and_jacobian, parameter_names, to_vector
from jitterkit.likelihood.data import Data, ceiling_distance, mean_counts, relative_residual, telling
from jitterkit.optics.otf import OTF
from jitterkit.precision import single


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
def normal_equations(
    parameters: Parameters, otf: OTF, data: Data, free: tuple[int, ...], *, exact: bool = True
) -> NormalEquations:
    """Deviance, score and Fisher information of a frame.

    Parameters
    ----------
    parameters : Parameters
    otf : OTF
    data : Data
    free : tuple of int
        Positions in the parameter vector that vary, ascending.
    exact : bool
        Whether derivatives of the image are in 64 bits; in 32 they take half the time, and score and
        information are off by 1e-5 of their size.  The image is in 64 bits in any case.

    Returns
    -------
    equations : NormalEquations
        ``solve(information, score)`` is the scoring step, the natural gradient.
    """
    if exact:
        image, jacobian = image_and_jacobian(parameters, otf, free)
    else:
        image, (_, jacobian) = expected_image(parameters, otf), single_slopes(parameters, otf, free)
    frame, cost = equations_of(image, jacobian, data), _known_cost(parameters, otf)
    vector, unravel = to_vector(parameters)
    pull = jax.grad(lambda v: _known_cost(unravel(v), otf))(vector) / 2
    return NormalEquations(
        frame.deviance + cost,
        frame.score - pull[np.asarray(free, int)],
        frame.information + known_information(parameters, otf, free),
    )


def equations_of(image, jacobian, data: Data) -> NormalEquations:
    """The :func:`normal_equations` of an expected image (ny, nx) and its derivatives (p, ny, nx)."""
    mean, pull, weight = _pull_and_weight(image, data)
    pull, weight = jax.lax.optimization_barrier((pull, weight))  # once, not for each row
    score = jnp.tensordot(jacobian, pull, 2)
    information = jnp.tensordot(jacobian * weight, jacobian, ((1, 2), (1, 2)))
    return NormalEquations(_deviance(mean, data), score, information)


def _pull_and_weight(image, data: Data):
    """Mean counts, the slope of the log-likelihood by each pixel's expectation, and the information on it."""
    mean = mean_counts(image, data)
    slope = jnp.where(telling(image, data), data.weight, 0.0)
    residual, share = relative_residual(mean, data), 1 / mean
    if data.full is not None:
        residual, share = _with_full(residual, mean, data)
    return mean, slope * residual, slope * share


class WavefrontSlopes(NamedTuple):
    """Hold the derivatives of an image by aberrations, which then enter the image to first order.

    Attributes
    ----------
    places : (k,) int array
        Of the aberrations among the values that vary.
    state : (k,) array
        Where the image is exact, nm.
    slopes : (k, ny, nx) array
    """

    places: np.ndarray
    state: Float[Array, " k"]
    slopes: Float[Array, "k ny nx"]


def deviance_and_score(
    parameters_at: Callable[[Array], Parameters],
    values,
    otf: OTF,
    data: Data,
    wavefront: WavefrontSlopes | None = None,
):
    """Deviance and score of a frame, for use within a compiled program.

    Parameters
    ----------
    parameters_at : callable
        Parameters from values of those that vary.
    values : (p,) array
    otf : OTF
    data : Data
    wavefront : WavefrontSlopes, optional
        In place of the slopes of the optics.

    Returns
    -------
    deviance : float
    score : (p,) array
        By one image and its adjoint, however many parameters there are: no derivative of an image is made.
        It is exact, or with given slopes of first order in the aberrations.
    """

    def image_at(v):
        parameters = parameters_at(v)
        if wavefront is None:
            return expected_image(parameters, otf)
        held, own = otf.modes_held, parameters.aberrations[otf.apart : otf.rows]
        image = expected_image(eqx.tree_at(lambda p: p.aberrations, parameters, own), held)
        change = v[wavefront.places] - wavefront.state
        return image + jnp.tensordot(change, wavefront.slopes, 1)

    image, adjoint = jax.vjp(image_at, values)
    mean, pull, _ = _pull_and_weight(image, data)
    cost, slope = jax.value_and_grad(lambda v: _known_cost(parameters_at(v), otf))(values)
    return _deviance(mean, data) + cost, adjoint(pull)[0] - slope / 2


def information_at(parameters: Parameters, otf: OTF, data: Data, free: tuple[int, ...]):
    """Expected Fisher information from derivatives in 32 bits, for use within a compiled program.

    They are summed in the precision of the parameters, so that it stays positive, and singular where the
    frame does not determine the parameters: to ``eps**2`` of 32 bits.

    Returns
    -------
    information : (p, p) array
    slopes : (p, ny, nx) array
        The derivatives.
    """
    image, slopes = single_slopes(parameters, otf, free)
    _, _, weight = _pull_and_weight(image, single(data))
    rows = slopes.reshape(len(free), -1).astype(parameters.background.dtype)
    return (rows * weight.ravel()) @ rows.T + known_information(parameters, otf, free), slopes


@eqx.filter_jit
def slope_products(parameters: Parameters, otf: OTF, weight, free: tuple[int, ...]) -> Float[Array, "p p"]:
    """Sum the products of the image's derivatives by the free parameters, with weights of pixels (ny, nx)."""
    _, slopes = single_slopes(parameters, otf, free)
    slopes = slopes.astype(parameters.background.dtype)
    return jnp.tensordot(slopes * weight, slopes, ((1, 2), (1, 2)))


@eqx.filter_jit
def single_slopes(parameters: Parameters, otf: OTF, free: tuple[int, ...]):
    """Image (ny, nx) and derivatives (p, ny, nx), both in 32 bits, with the least padding the optics have."""
    parameters, otf = single((parameters, otf.coarse or otf))
    return image_and_jacobian(parameters, otf, free)


def deviance(parameters: Parameters, otf: OTF, data: Data) -> Float[Array, ""]:
    """Twice the log-likelihood lost against a perfect model of the used pixels; about their number.

    What is known of the colours of the stars counts as if it were a pixel for each.
    """
    frame = _deviance(mean_counts(expected_image(parameters, otf), data), data)
    return frame + _known_cost(parameters, otf)


def _known_cost(parameters: Parameters, otf: OTF):
    """Twice the log-likelihood lost by indices and shifts that differ from what is known of them."""
    indices, known, cost = parameters.scene.indices, otf.colours, jnp.zeros((), parameters.background.dtype)
    if otf.further and len(parameters.aberrations) == len(otf.names):
        shifts = parameters.aberrations[-len(otf.further) :]
        cost = jnp.sum(shifts**2 * np.array(otf.sigmas, shifts.dtype) ** -2)
    if indices is None or known is None or otf.tints is None:
        return cost
    return cost + known.precision * jnp.sum((indices - np.array(known.of(len(indices)))) ** 2)


def known_information(parameters: Parameters, otf: OTF, free: tuple[int, ...]) -> np.ndarray:
    """Return the prior information (p, p) on free parameters, by known indices and shifts."""
    scene, known = parameters.scene, {name: s**-2 for name, s in zip(otf.further, otf.sigmas, strict=True)}
    if scene.indices is not None and otf.colours is not None and otf.tints is not None:
        known |= dict.fromkeys(scene.colours, otf.colours.precision)
    names = parameter_names(parameters, otf.names)
    return np.diag([known.get(names[index], 0.0) for index in free])


def _deviance(mean, data: Data):
    """Compute the deviance; its slope is minus twice the score at every count, negative ones included.

    By the residual, because count and mean may be large beside their difference: with model errors of 8 % the
    rounding of their logarithms was 1e-5 of a deviance of 400, in which fits did not settle.
    """
    count = data.electrons + data.offset
    positive = count > 0
    share = jnp.where(positive, relative_residual(mean, data), 0.0)
    below = mean - count * jnp.log(mean)
    each = jnp.where(positive, mean * ((1 + share) * jnp.log1p(share) - share), below) * data.weight
    total = 2 * jnp.sum(jnp.where(data.used, each, 0.0))
    if data.full is None:
        return total
    reached, _ = ceiling_distance(mean, data)
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
    reached, slope = ceiling_distance(mean, data)
    normal = jax.scipy.stats.norm
    chance, density = normal.cdf(reached), normal.pdf(reached)
    hazard = jnp.exp(normal.logpdf(reached) - normal.logcdf(reached))
    below = 1 - chance + reached * density
    above = density * hazard * slope**2 * mean * data.weight
    return jnp.where(data.full, hazard * slope, residual), (below + above) / mean
