"""Images of a moving star by direct sums over the pupil: no formula of the package is used."""

import numpy as np

_ARCSEC = np.pi / 648000


def star_image(x, y, electrons, path, shape=(48, 44), scale=0.375, width=1.0, opd=0.0):
    """Electrons of a star behind the telescope of all tests.

    ``path`` has (dx, dy, share of time) [arcsec]; a pixel responds over a square of ``width`` pixels.  The
    wavefront error ``opd`` [nm] is (64, 64) as :func:`pupil_places`.
    """
    fine = (np.arange(64 * 8) - 255.5) / 512 * 0.125
    radius = np.hypot(fine[:, None], fine)
    clear = ((radius < 0.0625) & (radius > 0.02)).reshape(64, 8, 64, 8).mean((1, 3))
    metres, nodes, shares = fine.reshape(64, 8).mean(1), *np.polynomial.legendre.leggauss(3)
    rows, columns = (
        (((np.arange(n) - (n - 1) / 2)[:, None] + nodes * width / 2) * scale).ravel() for n in shape
    )
    image = np.zeros((shape[0] * 3, shape[1] * 3))
    at, parts = np.polynomial.legendre.leggauss(5)  # of a flat band
    for nm, part in zip(585 + 55 * at, parts / 2, strict=True):
        wave = 2 * np.pi / (nm * 1e-9) * _ARCSEC
        density = (scale * _ARCSEC * (metres[1] - metres[0]) / (nm * 1e-9)) ** 2 / clear.sum()
        field = clear * np.exp(2j * np.pi * np.asarray(opd) / nm)
        for dx, dy, share in path:
            across = np.exp(-1j * wave * np.outer(metres, columns - x - dx))
            along = np.exp(-1j * wave * np.outer(rows - y - dy, metres))
            image += electrons * part * share * density * np.abs(along @ field @ across) ** 2
    weighted = image.reshape(shape[0], 3, shape[1], 3)
    return np.einsum("asbt,s,t->ab", weighted, shares / 2, shares / 2)


def pupil_places():
    """Return x and y of the pupil's samples (64, 64), in units of its radius."""
    y, x = np.mgrid[:64, :64] / 32 - 63 / 64
    return x, y


def drift(length, angle, points=8):
    """Path along a line at a constant speed, by Gauss-Legendre quadrature."""
    nodes, shares = np.polynomial.legendre.leggauss(points)
    dx, dy = length / 2 * np.cos(np.radians(angle)), length / 2 * np.sin(np.radians(angle))
    return [(dx * t, dy * t, share / 2) for t, share in zip(nodes, shares, strict=True)]
