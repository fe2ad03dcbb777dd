"""The public model on the same axes: dLuxToliman, by its images along the smear and its points a pixel.

Reach for :func:`public_points`.  Its frames are of a lamp of three lines, as it models a spectrum, and their
truth is jitterkit's image of the same lamp, which direct quadrature confirms (``scripts/benchmark``: to a
chi-squared of 0.004 of a frame at a padding of 64, of 3e-6 at 192).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import jax
import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forward import Parameters, image_and_jacobian
from jitterkit.loci import Linear
from jitterkit.metric import invert_information
from jitterkit.optics import OpticalSystem, grid_for, lines, toliman_pupil
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


PUBLIC_LINES = (530.0, 585.0, 640.0)
"""nm, equally strong: what it takes for a band here."""

PUBLIC_SHAPE = (128, 128)


def public_image(images: int = 5, samples: int = 4) -> Callable:
    """Return the public model's frame of alpha Centauri under linear jitter.

    Parameters
    ----------
    images : int
        Along the smear.
    samples : int
        Points along the side of a pixel.

    Returns
    -------
    image : callable
        Of a vector of 15: separation [arcsec], position angle [deg], x, y [arcsec], log10 of the flux,
        contrast, seven aberrations [m], length [arcsec] and angle [deg] of the smear.  Returns (128, 128).

    Raises
    ------
    ConfigurationError
        If dLuxToliman is not installed.
    """
    import equinox as eqx

    try:
        from dLuxToliman import AlphaCen, JitteredToliman, TolimanOpticalSystem
    except ImportError:
        problem = "dLuxToliman is not installed; install jitterkit[toliman]."
        raise ConfigurationError(ErrorCode.MISSING_PACKAGE, problem) from None
    optics = TolimanOpticalSystem(noll_indices=list(range(4, 11)), oversample=samples)
    source = AlphaCen(n_wavels=len(PUBLIC_LINES))
    telescope = JitteredToliman(optics, source, 0.1, 0.0, n_psfs=images, jitter_shape="linear")

    def where(t):
        s = t.source
        scene = [s.separation, s.position_angle, s.x_position, s.y_position, s.log_flux, s.contrast]
        return [*scene, t.optics.layers["aperture"].coefficients, t.jitter_mag, t.jitter_angle]

    def image(vector):
        values = [*vector[:6], vector[6:13], vector[13], vector[14]]
        fine = eqx.tree_at(where, telescope, values).jitter_model()
        return fine.reshape(PUBLIC_SHAPE[0], samples, PUBLIC_SHAPE[1], samples).sum(axis=(1, 3))

    return image
