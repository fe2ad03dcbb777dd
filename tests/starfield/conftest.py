"""Star fields drawn by direct quadrature: Moffat stars along a path, integrated over pixels."""

import numpy as np
import pytest

from jitterkit.frames import Frame

HALF = 24


def _moffat(square, fwhm, beta):
    alpha = fwhm / 2 / np.sqrt(2 ** (1 / beta) - 1)
    return (beta - 1) / (np.pi * alpha**2) * (1 + square / alpha**2) ** -beta


def draw_star(dx, dy, ux=0.0, uy=0.0, *, fwhm=3.0, beta=3.0, half=HALF):
    """A star of unit flux at (dx, dy) from the middle pixel, drawn along the vector (ux, uy).

    Gauss-Legendre: 3 x 3 nodes a pixel are exact to 1e-4 of the peak for a FWHM of 3 pixels, and three
    nodes a pixel of trail to less.
    """
    steps, shares = np.polynomial.legendre.leggauss(4 + int(3 * np.hypot(ux, uy)))
    nodes, weights = np.polynomial.legendre.leggauss(3)
    grid = np.arange(-half, half + 1)
    fine, weight = (grid[:, None] + nodes / 2).ravel(), np.tile(weights / 2, len(grid))
    image = np.zeros((len(grid), len(grid)))
    for step, share in zip(steps / 2, shares / 2, strict=True):
        square = np.square(fine - dx - step * ux) + np.square(fine - dy - step * uy)[:, None]
        density = _moffat(square, fwhm, beta) * weight * weight[:, None]
        image += share * density.reshape(len(grid), 3, len(grid), 3).sum((1, 3))
    return image


def draw_field(rng, path, *, stars=200, side=680, sky=200.0, fwhm=3.0, faint=3e3):
    """A noisy frame of isolated stars; ``path(x, y)`` is the trail's vector at a place from the centre."""
    image, positions = np.full((side, side), sky), np.zeros((0, 2))
    while len(positions) < stars:
        position = rng.uniform(HALF, side - HALF - 1, 2)
        if len(positions) and np.min(np.hypot(*(positions - position).T)) < 32:
            continue
        positions = np.vstack([positions, position])
        x, y = np.rint(position).astype(int)
        star = draw_star(*(position - [x, y]), *path(*(position - (side - 1) / 2)), fwhm=fwhm)
        flux = np.exp(rng.uniform(np.log(faint), np.log(3e5)))
        image[y - HALF : y + HALF + 1, x - HALF : x + HALF + 1] += flux * star
    return Frame(rng.poisson(image) + rng.normal(0, 5, image.shape), 25.0), positions


def along(length, angle):
    """The same trail everywhere."""
    vector = length * np.cos(np.radians(angle)), length * np.sin(np.radians(angle))
    return lambda x, y: vector


@pytest.fixture(scope="session")
def star():
    return draw_star


@pytest.fixture(scope="session")
def field():
    return draw_field


@pytest.fixture(scope="session")
def trail():
    return along


@pytest.fixture(scope="session")
def sharp():
    """A sharp frame of another field, and where its stars are."""
    return draw_field(np.random.default_rng(7), along(0, 0), stars=100, side=500)


@pytest.fixture(scope="session")
def trailed():
    """200 stars trailed by 4 pixels at 30 degrees, and where they are."""
    return draw_field(np.random.default_rng(8), along(4, 30))
