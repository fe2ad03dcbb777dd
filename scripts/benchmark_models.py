"""What scripts/benchmark measures: direct quadrature, the public model's functions and jitterkit's.

Every ``measure_`` function takes the length of the smear (arcsec) and the number of timed runs.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np

jax.config.update("jax_enable_x64", True)

from jitterkit.trade.public import public_image  # noqa: E402

LINES = np.linspace(530.0, 640.0, 3)
FLUX, CONTRAST, SEPARATION = 3.811e7, 3.37, 10.0
ANGLE = 25.0  # of the smear, degrees
SHAPE, SCALE = (128, 128), 0.375
OFF = np.array([1e-3, 5e-3, 1e-3, -1e-3, 3e-4, 3e-3, 1, -1, 1, -1, 1, -1, 1, 5e-3, -0.2])
"""Where a refit starts, from the truth: arcsec, deg, arcsec, arcsec, share, ratio, nm, arcsec, deg."""
NOWHERE = np.zeros(15)


# --- the reference: every ray summed, no formula shared with either model ---------------------------


def direct_image(length: float) -> np.ndarray:
    """The frame by Gauss-Legendre quadrature inside every pixel (4 x 4) and along the smear (8)."""
    pupil = jitterkit_pupil()
    time_nodes, shares = np.polynomial.legendre.leggauss(8)
    inside, weights = np.polynomial.legendre.leggauss(4)
    centres = SCALE * (np.arange(SHAPE[0]) - (SHAPE[0] - 1) / 2)
    nodes = (centres[:, None] + SCALE / 2 * inside).ravel()
    arcsec = np.pi / 648000
    metres = pupil.pitch * (np.arange(256) - 127.5)
    smear = length / 2 * np.array([np.cos(np.radians(ANGLE)), np.sin(np.radians(ANGLE))])
    stars = [(SEPARATION / 2, CONTRAST / (1 + CONTRAST)), (-SEPARATION / 2, 1 / (1 + CONTRAST))]
    image = np.zeros((nodes.size, nodes.size))
    for wave in 2 * np.pi / (LINES * 1e-9):
        field = pupil.transmission * np.exp(1j * wave * 1e-9 * pupil.opd)
        area = (wave * pupil.pitch * SCALE * arcsec / 2 / np.pi) ** 2 / float(pupil.light)
        for x, light in stars:
            for t, share in zip(time_nodes, shares / 2, strict=True):
                rows = np.exp(-1j * wave * arcsec * np.outer(nodes - t * smear[1], metres))
                columns = np.exp(-1j * wave * arcsec * np.outer(metres, nodes - x - t * smear[0]))
                amplitude = rows @ field @ columns
                image += light * share * area / len(LINES) * (amplitude.real**2 + amplitude.imag**2)
    weights = np.tile(weights / 2, SHAPE[0])
    return FLUX * (weights[:, None] * image * weights).reshape(128, 4, 128, 4).sum(axis=(1, 3))


# --- the public model -------------------------------------------------------------------------------


def public_truth(length: float) -> np.ndarray:
    """Separation, position angle, x, y, log flux, contrast, seven aberrations [m], length, angle."""
    return np.array([SEPARATION, 90.0, 0, 0, np.log10(FLUX), CONTRAST, *np.zeros(7), length, ANGLE])


def public_loss(image: Callable, data) -> Callable:
    """Minus the Poisson log-likelihood."""

    def loss(vector):
        mean = image(vector)
        return jnp.sum(mean - data * jnp.log(mean))

    return loss


def measure_public_image(length, repeats):
    image = jax.jit(public_image())
    return timed(lambda: image(public_truth(length)), repeats)[0]


def measure_public_accuracy(length, repeats):
    return {"chi2": chi_squared(public_image()(public_truth(length)), direct_image(length))}


def measure_public_gradient(length, repeats):
    image = public_image()
    truth = public_truth(length)
    gradient = jax.jit(jax.grad(public_loss(image, image(truth))))
    return timed(lambda: gradient(truth), repeats)[0]


def measure_public_fisher(length, repeats):
    image = public_image()
    truth = public_truth(length)
    fisher = jax.jit(jax.hessian(public_loss(image, image(truth))))
    result, matrix = timed(lambda: fisher(truth), 1)
    return result | {"sigma": sigma_separation(matrix)}


def measure_public_refit(length, repeats):
    """Natural gradient descent, as in the paper: one Hessian, then gradients."""
    image = public_image()
    data = direct_image(length)
    unit = np.array([1, -1, 1, 1, 1 / np.log(10), 1, *[1e-9] * 7, 1, 1])
    start = public_truth(length) + OFF * unit
    gradient = jax.jit(jax.grad(public_loss(image, data)))
    hessian = jax.jit(jax.hessian(public_loss(image, image(start))))
    jax.block_until_ready(gradient(start))
    began = time.perf_counter()
    information = np.asarray(hessian(start))
    inverse = inverted(information)
    vector, steps, arrived = start, 0, False
    while not arrived and steps < 30:
        move = inverse @ np.asarray(gradient(vector))
        vector, steps = vector - move, steps + 1
        arrived = move @ information @ move < 1e-2
    seconds = time.perf_counter() - began
    return {"warm": seconds, "steps": steps, "bias": 1e6 * (vector[0] - SEPARATION)}


# --- jitterkit --------------------------------------------------------------------------------------


def jitterkit_pupil():
    from jitterkit.optics import toliman_pupil

    return toliman_pupil(10)


def jitterkit_system(pad=64):
    from jitterkit.optics import OpticalSystem, grid_for, lines

    spectrum = lines(*LINES)
    pupil = jitterkit_pupil()
    return OpticalSystem(pupil, spectrum, grid_for(pupil, spectrum, SHAPE, SCALE, pad))


def jitterkit_truth(length: float, off: np.ndarray = NOWHERE):
    from jitterkit.forward import Parameters
    from jitterkit.loci import Linear
    from jitterkit.scene import Binary

    contrast = CONTRAST + off[5]
    scene = Binary(SEPARATION + off[0], 180.0 + off[1], off[2], off[3], FLUX * (1 + off[4]), contrast)
    return Parameters(scene, Linear.of(length + off[13], ANGLE + off[14]), off[6:13])


def measure_jitterkit_accuracy(length, repeats):
    from jitterkit.forward import expected_image

    truth, found = direct_image(length), {}
    for name, pad in (("chi2", 64), ("chi2_widest", 192)):
        found[name] = chi_squared(
            expected_image(jitterkit_truth(length), jitterkit_system(pad).nominal), truth
        )
    return found


def measure_jitterkit_image(length, repeats):
    import equinox as eqx

    from jitterkit.forward import expected_image

    image, parameters, otf = (
        eqx.filter_jit(expected_image),
        jitterkit_truth(length),
        jitterkit_system().nominal,
    )
    return timed(lambda: image(parameters, otf), repeats)[0]


def measure_jitterkit_recomputed(length, repeats):
    import equinox as eqx

    from jitterkit.forward import expected_image

    system, parameters, image = jitterkit_system(), jitterkit_truth(length), eqx.filter_jit(expected_image)
    return timed(lambda: image(parameters, system.otf(parameters.aberrations, derivatives=False)), repeats)[0]


def jitterkit_equations(length):
    """Score and Fisher matrix of the fifteen parameters, optics recomputed."""
    import equinox as eqx

    from jitterkit.forward import expected_image
    from jitterkit.likelihood import Data, normal_equations

    system, parameters = jitterkit_system(), jitterkit_truth(length)
    data = Data(expected_image(parameters, system.nominal))
    equations, free = eqx.filter_jit(normal_equations), tuple(range(15))
    return lambda: equations(parameters, system.otf(parameters.aberrations), data, free)


def measure_jitterkit_gradient(length, repeats):
    equations = jitterkit_equations(length)
    return timed(lambda: equations().score, repeats)[0]


def measure_jitterkit_fisher(length, repeats):
    equations = jitterkit_equations(length)
    result, matrix = timed(lambda: equations().information, repeats)
    return result | {"sigma": sigma_separation(matrix)}


def measure_jitterkit_refit(length, repeats):
    from jitterkit.likelihood import Data
    from jitterkit.refit import fit_frame

    system, data, start = jitterkit_system(), Data(direct_image(length)), jitterkit_truth(length, OFF)
    result, fitted = timed(lambda: fit_frame(data, system, start), repeats)
    bias = 1e6 * (float(fitted.parameters.scene.separation) - SEPARATION)
    return result | {"steps": fitted.iterations, "bias": bias}


# --- figures and times ------------------------------------------------------------------------------


def chi_squared(image, truth) -> float:
    """What the error of an image adds to the chi-squared of a frame."""
    return float(np.sum((np.asarray(image) - truth) ** 2 / truth))


def inverted(information) -> np.ndarray:
    """Inverse of an information matrix whose parameters differ by decades."""
    matrix = np.asarray(information)
    scale = np.sqrt(np.abs(np.diag(matrix)))
    return np.linalg.inv(matrix / np.outer(scale, scale)) / np.outer(scale, scale)


def sigma_separation(information) -> float:
    """Error of the separation, µas."""
    return float(1e6 * np.sqrt(inverted(information)[0, 0]))


def timed(call: Callable, repeats: int) -> tuple[dict, object]:
    """Seconds of the first call, which compiles, the median of ``repeats`` more, and the last result."""
    seconds = []
    for _ in range(1 + repeats):
        began = time.perf_counter()
        value = jax.block_until_ready(call())
        seconds.append(time.perf_counter() - began)
    return {"cold": seconds[0], "warm": float(np.median(seconds[1:]))}, value
