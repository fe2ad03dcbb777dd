"""The blur from second moments of the stars, under a Gaussian window about each.

The moments of the frame are set against those of its template, measured by the same windows on the same
pixels; the blur is what must be added to the template for the two to agree.  A wide window sees the
variance of any motion whatever its shape; a narrow one has less noise.  Simple and easily checked by
hand, but on optics that spread their light it wastes most of it: a second opinion, not the first.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.forward import Parameters, expected_image, image_and_jacobian, parameter_names, to_vector
from jitterkit.kernel_estimate import KernelEstimate, is_detected
from jitterkit.likelihood import Data
from jitterkit.loci import Linear, Mvn
from jitterkit.optics.otf import OTF

_WINDOWS = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0)
"""1 sigma of the windows to choose from, in pixels."""

_STEPS = 12
"""At most; five suffice where the window suits the blur."""

_CONVERGED = 0.02
"""Step, in standard errors, that ends them."""


def estimate_moments(
    data: Data, template: Parameters, otf: OTF, *, hold: Collection[str] = ()
) -> KernelEstimate:
    """Estimate second moments from windowed moments of the image.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations; its locus is ignored.  Its position and flux need not be exact.
    otf : OTF
    hold : collection of str
        For the sake of a common signature: all but blur, position and flux is held at the template's values.

    Returns
    -------
    estimate : KernelEstimate

    Raises
    ------
    UndeterminedError
        If no blur gives the template the frame's moments.

    Notes
    -----
    Of windows from 1 to 8 pixels, the one with the least noise where no blur is detected, else the one
    with the least mean square error: that of the noise, and what a drift of the size found would add by
    not being a normal.  On TOLIMAN errors are 15 times the Cramér-Rao bound with the narrowest window and
    200 times with the widest, which in turn is within 1 % for a drift up to 1.5 arcsec, 3 % at 3.
    Masked pixels count in neither image.
    """
    start = template.with_locus(Mvn.near(jnp.zeros(3)))
    window = _chosen(_windows(start, data, otf), _Point.at(start, data, otf), data, otf)
    vector, unravel = to_vector(start)
    values = np.array(vector)
    for _ in range(_STEPS):
        point = _Point.at(unravel(values), data, otf)
        step, covariance = point.step(window)
        values[list(point.free)] += step
        if not np.all(np.isfinite(values)) or abs(step[2]) > abs(values[point.free[2]]):
            break
        if np.all(np.abs(step) < _CONVERGED * np.sqrt(np.diag(covariance))):
            return KernelEstimate(values[list(point.free[3:])], covariance[3:, 3:], "moments")
    problem = "No blur gives the template the second moments of the frame"
    remedy = "check the template's scene, or use the score estimator where the frame is faint"
    raise UndeterminedError(ErrorCode.MODEL_MISMATCH, f"{problem}; {remedy}.")


class _Point(NamedTuple):
    """A template with some blur: how far the frame is from it, and what moves it.

    Attributes
    ----------
    parameters : Parameters
    free : tuple of int
        Positions of x, y, flux and the three moments among the parameters.
    residual, variance : (n,) array
        Of the frame; of a pixel.
    slopes : (6, n) array
        Derivatives of the image.
    """

    parameters: Parameters
    free: tuple[int, ...]
    residual: np.ndarray
    variance: np.ndarray
    slopes: np.ndarray

    @classmethod
    def at(cls, parameters: Parameters, data: Data, otf: OTF) -> _Point:
        names = parameter_names(parameters, otf.names)
        free = tuple(names.index(name) for name in ("x", "y", "flux", *Mvn.names))
        image, slopes = (np.asarray(a) for a in image_and_jacobian(parameters, otf, free))
        residual = np.asarray(data.electrons) - image
        variance = np.asarray((np.clip(image, 0, None) + data.offset) / data.weight)
        return cls(parameters, free, residual.ravel(), variance.ravel(), slopes.reshape(len(free), -1))

    def step(self, window: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Step (6,) that makes the statistics agree to first order, and its covariance."""
        gain = self.gain(window)
        return gain @ self.residual, (gain * self.variance) @ gain.T

    def gain(self, window: np.ndarray) -> np.ndarray:
        """Pull (6, n) of every pixel on the parameters."""
        return np.linalg.solve(window @ self.slopes.T, window)


def _windows(template: Parameters, data: Data, otf: OTF) -> list[np.ndarray]:
    """Return the weights (6, n) of the light and its first and second moments under each window."""
    used = np.asarray(data.used)
    y, x = ((np.arange(n) - (n - 1) / 2) * otf.grid.plate_scale for n in used.shape)
    xs, ys, _ = (np.asarray(s) for s in template.scene.sources())
    every = []
    for sigma in np.array(_WINDOWS) * otf.grid.plate_scale:
        total = np.zeros((6, *used.shape))
        for dx, dy in ((x[None] - x0, y[:, None] - y0) for x0, y0 in zip(xs, ys, strict=True)):
            powers = np.broadcast_arrays(1.0, dx, dy, dx**2, dx * dy, dy**2)
            total += np.exp(-(dx**2 + dy**2) / (2 * sigma**2)) * np.stack(powers)
        every.append((total * used).reshape(6, -1))
    return every


def _chosen(windows: list[np.ndarray], sharp: _Point, data: Data, otf: OTF) -> np.ndarray:
    """Return the window with the least noise; with the least mean square error, where it sees a blur."""
    steps, covariances = zip(*(sharp.step(window) for window in windows), strict=True)
    noise = np.array([np.trace(covariance[3:, 3:]) for covariance in covariances])
    least = int(np.argmin(noise))
    if not is_detected(steps[least][3:], covariances[least][3:, 3:]):
        return windows[least]
    drift = Linear.near(jnp.asarray(steps[-1][3:]))  # as the widest window sees it
    normal = Mvn.near(drift.moments())
    point = _Point.at(sharp.parameters.with_locus(normal), data, otf)
    streak = np.asarray(expected_image(sharp.parameters.with_locus(drift), otf)).ravel()
    difference = streak - (np.asarray(data.electrons).ravel() - point.residual)
    bias = np.array([point.gain(window)[3:] @ difference for window in windows])
    return windows[int(np.argmin(noise + (bias**2).sum(axis=1)))]
