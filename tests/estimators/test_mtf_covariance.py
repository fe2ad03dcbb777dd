"""The covariance of the MTF ratio's moments: against the weight of each pixel, summed wave by wave."""

from types import SimpleNamespace

import numpy as np

from jitterkit.estimators.mtf_ratio import _propagate


def test_each_pixel_has_the_weight_of_all_its_waves(rng):
    ny, nx, columns = 12, 10, 10 // 2 + 1
    ky, kx = (index.ravel() for index in np.indices((ny, columns)))
    # those of fx = 0 too, which are their own mirror's column; none at Nyquist's frequency
    indices = np.flatnonzero((kx < nx // 2) & (ky != ny // 2) & ((kx > 0) | (ky > 0)))
    pull = rng.normal(size=(3, len(indices))) + 1j * rng.normal(size=(3, len(indices)))
    variance = rng.uniform(1, 2, (ny, nx))
    y, x = np.indices((ny, nx))
    weights = np.zeros((3, ny, nx))
    for number, index in enumerate(indices):
        wave = np.exp(2j * np.pi * (ky[index] * y / ny + kx[index] * x / nx))
        weights += 2 * (pull[:, number, None, None].conj() * wave).real
    expected = np.einsum("iyx,jyx,yx->ij", weights, weights, variance)
    found = _propagate(pull, SimpleNamespace(variance=variance, indices=indices))
    # the transform is in single precision
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * np.abs(expected).max())
