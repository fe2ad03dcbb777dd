"""Cosmic rays in what a fit leaves over."""

from __future__ import annotations

import numpy as np

from jitterkit.refit.outliers import find_rays


def test_noise_has_no_rays(rng):
    residual = rng.standard_normal((128, 128))
    residual[3, 4] = np.nan
    assert not find_rays(residual).any()


def test_a_track_is_found_whole_and_its_surroundings_are_not(rng):
    residual = rng.uniform(-2, 2, (64, 64))
    for i in range(6):
        residual[20 + i, 30 + i] = 20.0 if i == 2 else 4.0  # joined over corners
    residual[50, 50] = 5.0  # bright, but chance makes such pixels
    residual[10, 10] = -30.0  # rays leave charge, they do not take it
    hit = find_rays(residual)
    assert sorted(zip(*np.nonzero(hit), strict=True)) == [(20 + i, 30 + i) for i in range(6)]


def test_a_model_that_does_not_fit_has_no_rays():
    residual = np.where(np.add.outer(np.arange(64), np.arange(64)) % 3 == 0, 20.0, 0.0)
    assert not find_rays(residual).any()
