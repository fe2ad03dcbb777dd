"""The reference scene, and its image computed the long way: every ray summed, no formula shared.

The field of the sampled pupil is summed at Gauss-Legendre nodes inside every pixel, for every
wavelength, star and instant, squared, and averaged.
"""

import numpy as np
import pytest

from jitterkit.forward import Parameters, image_and_jacobian, parameter_names
from jitterkit.optics import Grid, expand, lines
from jitterkit.scene import Binary

ARCSEC = np.pi / 648000


def path_nodes(locus, **size):
    """Offsets (m, 2) of the pointing [arcsec] and the share of the time at each."""
    if locus == "stable":
        return np.zeros((1, 2)), np.ones(1)
    if locus == "path":  # the parabola through three knots, its mean (k0 + 4 k1 + k2)/6 taken off
        t, weights = np.polynomial.legendre.leggauss(10)
        k0, k1, k2 = np.asarray(size["knots"])[:, None]
        positions = k1 + (k2 - k0) / 2 * t[:, None] + (k0 + k2 - 2 * k1) / 2 * t[:, None] ** 2
        return positions - (k0 + 4 * k1 + k2) / 6, weights / 2
    if locus == "tones":  # every phase of one with every phase of the other
        streaks = [streak_nodes("shm", size[f"length{k}"], 5) for k in (1, 2)]
        (first, w1), (second, w2) = streaks
        one, two = (turned(v, 0 * v, size[f"angle{k}"]) for k, v in ((1, first), (2, second)))
        return (one[:, None] + two[None]).reshape(-1, 2), np.outer(w1, w2).ravel()
    if locus == "mvn":  # Gauss-Hermite along both axes
        (t, wt), (u, wu) = (np.polynomial.hermite_e.hermegauss(n) for n in (7, 5))
        along, across = np.meshgrid(size["sigma_major"] * t, size["sigma_minor"] * u)
        weights = np.outer(wu, wt).ravel() / (2 * np.pi)
    elif locus == "ellipse":
        phase, weights = 2 * np.pi * np.arange(12) / 12, np.full(12, 1 / 12)
        along, across = size["semi_major"] * np.cos(phase), size["semi_minor"] * np.sin(phase)
    elif locus == "partial":  # time runs from -1/2 to 1/2; the mean is taken off
        t, weights = np.polynomial.legendre.leggauss(14)
        weights = weights / 2
        phase = np.pi * size["cycles"] * t + np.radians(size["phase"])
        along = size["length"] / 2 * (np.sin(phase) - np.sin(phase) @ weights)
        across = 0 * along
    else:
        along, weights = streak_nodes(locus, size["length"], 8)
        across = 0 * along
    return turned(along.ravel(), across.ravel(), size["angle"]), weights


def streak_nodes(locus, length, n):
    """Places along a straight line, and the share of the time at each."""
    if locus == "linear":  # uniform speed: Gauss-Legendre in time
        t, weights = np.polynomial.legendre.leggauss(n)
        return length / 2 * t, weights / 2
    # a sinusoid: equal steps of its phase, Gauss-Chebyshev in position
    return length / 2 * np.cos((2 * np.arange(n) + 1) * np.pi / (2 * n)), np.full(n, 1 / n)


def turned(along, across, angle):
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return np.stack([c * along - s * across, s * along + c * across], axis=1)


def pixel_nodes(n, scale, order):
    """Positions [arcsec] from the frame's centre of the nodes in a row of pixels, and their weights."""
    t, w = np.polynomial.legendre.leggauss(order)
    centres = scale * (np.arange(n) - (n - 1) / 2)
    return (centres[:, None] + scale / 2 * t).ravel(), np.tile(w / 2, n)


def integrate(pupil, aberrations, spectrum, shape, scale, stars, path, order):
    """Electrons in every pixel; ``stars`` are (x, y, electrons), ``path`` offsets and shares of time."""
    n, pitch = len(pupil.transmission), pupil.diameter / len(pupil.transmission)
    metres = pitch * (np.arange(n) - (n - 1) / 2)
    (y, wy), (x, wx) = (pixel_nodes(m, scale, order) for m in shape)
    light = float(pupil.light)
    opd = pupil.opd + np.tensordot(aberrations, pupil.basis, 1)
    image = np.zeros((y.size, x.size))
    for wavelength, weight in spectrum:
        wave = 2 * np.pi / (wavelength * 1e-9)
        field = pupil.transmission * np.exp(1j * wave * 1e-9 * opd)
        area = (wave * pitch * scale * ARCSEC / (2 * np.pi)) ** 2 / light
        for sx, sy, electrons in stars:
            for (jx, jy), share in zip(*path, strict=True):
                rows = np.exp(-1j * wave * ARCSEC * np.outer(y - sy - jy, metres))
                columns = np.exp(-1j * wave * ARCSEC * np.outer(metres, x - sx - jx))
                amplitude = rows @ field @ columns
                image += (weight * electrons * share * area) * (amplitude.real**2 + amplitude.imag**2)
    weighted = wy[:, None] * image * wx
    return weighted.reshape(shape[0], order, shape[1], order).sum(axis=(1, 3))


@pytest.fixture(scope="session")
def direct_image():
    """Image of a pair of stars by direct quadrature.

    ``direct_image(pupil, spectrum, shape, scale, pair, locus, size, aberrations=None, order=4)`` with
    ``spectrum`` pairs of (nm, weight), ``pair`` the names and values of SCIENCE's scene, and ``size``
    the locus's sizes.  Four nodes a pixel integrate TOLIMAN's highest frequency (0.43 cycles/pixel)
    with a relative error of 2e-6; eight instants a smear of 0.75 arcsec to 1e-12.
    """

    def image(pupil, spectrum, shape, scale, pair, locus, size, aberrations=None, order=4):
        half = pair["separation"] / 2
        dx, dy = half * np.cos(np.radians(pair["theta"])), half * np.sin(np.radians(pair["theta"]))
        b = pair["flux"] / (1 + pair["contrast"])
        stars = [
            (pair["x"] - dx, pair["y"] - dy, pair["contrast"] * b),
            (pair["x"] + dx, pair["y"] + dy, b),
        ]
        aberrations = np.zeros(len(pupil.basis)) if aberrations is None else aberrations
        return integrate(pupil, aberrations, spectrum, shape, scale, stars, path_nodes(locus, **size), order)

    return image


@pytest.fixture(scope="session")
def direct_stars():
    """Image of stars ``(x, y, electrons)`` by direct quadrature, with arguments as ``integrate`` has them."""
    return integrate


@pytest.fixture(scope="session")
def reference_otf(toliman):
    """SCIENCE's reference scene: five lines with both end points.

    They are a lamp, not the band from 530 to 640 nm: for the band the error of the separation is
    464.5 and not 485.2 uas.
    """
    return expand(toliman, lines(*np.linspace(530, 640, 5)), Grid((128, 128), 0.375))


@pytest.fixture(scope="session")
def sigma_separation():
    """CRLB of the separation [uas] of the reference scene, everything but the background free."""

    def sigma(otf, locus, flux, read_noise=0.0):
        parameters = Parameters(Binary(10.0, 180.0, 0.0, 0.0, flux, 3.37), locus, np.zeros(7))
        free = len(parameter_names(parameters, otf.names)) - 1
        image, rows = (np.asarray(a) for a in image_and_jacobian(parameters, otf, tuple(range(free))))
        whitened = (rows / np.sqrt(image + read_noise**2)).reshape(free, -1)
        # Its inverse is the covariance, through singular values: the parameters span twelve decades.
        size = np.linalg.norm(whitened, axis=1)
        pseudo_inverse = np.linalg.pinv(whitened / size[:, None])
        return 1e6 * np.linalg.norm(pseudo_inverse[:, 0]) / size[0]

    return sigma
