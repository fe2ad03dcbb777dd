"""The public model on the same axes: dLuxToliman, by its images along the smear and its points a pixel.

Reach for :func:`public_points`.  Its frames are of a lamp of three lines, as it models a spectrum, and their
truth is jitterkit's image of the same lamp, which direct quadrature confirms (``scripts/benchmark``: to a
chi-squared of 0.004 of a frame at a padding of 64, of 3e-6 at 192).
"""

from __future__ import annotations

import time
from collections.abc import Iterator

import jax
import numpy as np

from jitterkit.forward import Parameters, image_and_jacobian
from jitterkit.loci import Linear
from jitterkit.metric import invert_information
from jitterkit.optics import OpticalSystem, grid_for, lines, toliman_pupil
from jitterkit.optics.public import PUBLIC_LINES, PUBLIC_SHAPE, public_image
from jitterkit.scene import Binary
from jitterkit.trade.grid import Point

_SCALE, _PAD = 0.375, 128
_SETTINGS = tuple((images, samples) for images in (3, 5, 11, 41) for samples in (2, 4, 8))
_ANGLES = (0.0, 45.0, 90.0)
_EVALUATIONS = 3
"""Images that a fit is counted as: fewer than any takes, with its derivatives."""


def public_points(pair: Binary, length: float) -> Iterator[Point]:
    """Measure the public model's settings on a drift.

    Parameters
    ----------
    pair : Binary
        Along a row, in the middle of the frame: only separation, flux and contrast are taken.
    length : float
        arcsec, at 0, 45 and 90 degrees from the pair.

    Yields
    ------
    point : Point
        ``bias`` by one scoring step, rms over the directions: right where it is small against the resolution.
        ``seconds`` are those of three images, the least that a fit can take.
    """
    separation, flux, contrast = (float(getattr(pair, n)) for n in ("separation", "flux", "contrast"))
    spectrum, pupil = lines(*PUBLIC_LINES), toliman_pupil(10)
    otf = OpticalSystem(pupil, spectrum, grid_for(pupil, spectrum, PUBLIC_SHAPE, _SCALE, _PAD)).nominal
    still = Binary(separation, 180.0, 0.0, 0.0, flux, contrast)
    scene = [separation, 90.0, 0.0, 0.0, np.log10(flux), contrast, *np.zeros(7)]
    drifts = []
    for angle in _ANGLES:
        truth = Parameters(still, Linear.of(length, angle), np.zeros(len(otf.names)))
        image, jacobian = map(np.asarray, image_and_jacobian(truth, otf, tuple(range(15))))
        drifts.append((np.array([*scene, length, angle]), image, jacobian.reshape(15, -1)))
    for images, samples in _SETTINGS:
        model, steps, errors, spent = jax.jit(public_image(images, samples)), [], [], []
        for vector, exact, slopes in drifts:
            began = time.perf_counter()
            off = (exact - np.asarray(model(vector))) / exact
            spent.append(time.perf_counter() - began)
            covariance, _ = invert_information(slopes / exact.ravel() @ slopes.T)
            steps.append((covariance @ slopes @ off.ravel())[0])
            errors.append(np.sqrt(covariance[0, 0]))
        bias, sigma = (float(np.sqrt(np.mean(np.square(values)))) for values in (steps, errors))
        name = f"dLux {images} images, {samples} x {samples}"
        yield Point(name, None, _EVALUATIONS * min(spent), bias, 0.0, sigma, sigma)
