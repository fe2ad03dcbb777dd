"""Noise that is correlated, as resampling and smoothing leave it."""

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter, shift

from jitterkit.likelihood import Data, pearson
from jitterkit.loci import Mvn
from jitterkit.refit import fit_frame


@pytest.mark.parametrize("resampled", [False, True])
def test_a_frame_that_was_resampled_is_told_by_its_noise(bench, optics, rng, resampled):
    """Bilinear interpolation by half a pixel adds 1/4 pix² to the blur, and correlates neighbours by 0.5."""
    truth, scale = bench.truth(Mvn.of(0.12, 0.06, 30.0), flux=3e5), optics.nominal.grid.plate_scale
    image = rng.poisson(bench.image(truth)) + rng.normal(0, 30.0, optics.nominal.grid.shape)
    image = shift(image, 0.5, order=1, mode="nearest") if resampled else image
    result = fit_frame(Data(image, 30.0**2 / (4 if resampled else 1)), optics, truth)
    assert ("noise_correlated" in result.flags) == resampled
    assert ("correlated (0.5" in result.message or "correlated (0.4" in result.message) == resampled
    sxx, true = result.moments()[0][0], truth.locus.moments()[0]
    assert sxx - true == pytest.approx(0.25 * scale**2 * resampled, abs=0.05 * scale**2)


@pytest.mark.parametrize("pattern", ["white", "rows", "gradient"])
def test_rows_and_gradients_of_a_sky_do_not_pass_for_smoothing(rng, pattern):
    """Noise that all pixels of a row share, and a slope of the sky, are no resampling."""
    added = {"white": 0.0, "rows": rng.normal(0, 0.4, (64, 1)), "gradient": np.linspace(-0.6, 0.6, 64)}
    noise = rng.normal(0, 0.9, (64, 64)) + added[pattern]
    found = pearson(np.zeros((64, 64)), Data(noise, 1.0))
    assert found.correlated_noise(np.zeros((64, 64))) == ""
    smooth = pearson(np.zeros((64, 64)), Data(gaussian_filter(noise, 0.7) * 2, 1.0))
    assert "correlated" in smooth.correlated_noise(np.zeros((64, 64)))
