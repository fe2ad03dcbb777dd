"""The inverse question, asked back: the size that was found costs what was allowed."""

import math

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.errors import ErrorCode
from jitterkit.forecast import forecast, jitter_of_kind, jitter_requirements, noise_free_fit, sweep
from jitterkit.forecast.requirement import MOTIONS, largest_size, moment_bias
from jitterkit.loci import Linear, Mvn, PartialShm


def test_the_largest_size_is_found_from_any_guess():
    for guess in (1e-4, 0.1, 20.0):
        assert largest_size(lambda size: 3 * size**2, 0.12, guess) == pytest.approx(0.2, rel=2e-3)
    steps = []
    assert largest_size(lambda size: steps.append(size) or 1e-3 + size**2, 1e-4) == 0.0  # never as low
    assert len(steps) < 20
    assert largest_size(lambda size: 0.0, 0.1) == math.inf
    assert largest_size(lambda size: 1.0, 0.1) == 0.0
    assert math.isnan(largest_size(lambda size: 0.0 if size < 1 else math.nan, 0.1))


@pytest.mark.slow
def test_jitter_as_large_as_allowed_costs_the_time_that_was_allowed(bench):
    found = jitter_requirements(bench.under(), bench.otf, 0.2, angles=(0.0, 90.0), cycles=(0.2,))
    still = forecast(bench.under(), bench.otf).error("separation")
    assert [one.motion for one in found] == [m for m in [*MOTIONS, "vibration"] for _ in range(2)]
    for one in found:
        turned = one.angle + 150.0  # the pair's own direction
        if one.motion != "vibration":
            loci = [jitter_of_kind(one.motion, one.size, turned)]
        else:
            loci = [PartialShm.of(one.size, turned, 0.2, phase) for phase in np.arange(8) * 45.0]
        told = np.mean([forecast(bench.under(locus), bench.otf).error("separation") ** -2 for locus in loci])
        # the size is found to 0.1 %, and the loss grows with its square
        assert 1 / (told * still**2) - 1 == pytest.approx(0.2, rel=5e-3)
    along, across = (one.size for one in found if one.motion == "linear")
    assert along < across  # jitter along the pair hurts more


@pytest.mark.slow
def test_a_slow_vibration_may_be_as_large_as_its_frames_are_smeared(bench):
    # a loss of 2 %, which grows with the square of the size: the mean over phases is then that of squares
    (linear, *_, slow) = jitter_requirements(bench.under(), bench.otf, 0.02, angles=(0.0,), cycles=(0.05,))
    # a frame sees 2 pi a cos(phase) of the amplitude; the mean over phases of its square is a half
    assert 2 * math.pi * 0.05 * slow.size / 2 * 0.5**0.5 == pytest.approx(linear.size, rel=0.02)
    assert slow.rms == pytest.approx(linear.rms, rel=0.02)


@pytest.mark.parametrize(
    ("locus", "fitted"),
    [
        (Linear.of(0.6, 0.0), "mvn"),
        (PartialShm.of(0.5, 10.0, 0.7, 30.0), "mvn"),
        (Mvn.of(0.05), "linear"),
        (Mvn.of(0.05, 0.01, 40.0), "stable"),
    ],
)
def test_fisher_scoring_finds_the_bias_that_the_exact_fit_has(bench, locus, fitted):
    exact = noise_free_fit(bench.under(locus), fitted, bench.optics, otf=bench.otf)
    found = moment_bias(bench.under(locus), fitted, bench.otf)
    # optics linear in the aberrations, and 1e-4 of an error that the fit may leave, are all that differs
    assert found == pytest.approx(exact.bias, rel=0.01, abs=1e-4 * exact.error)


def test_with_its_own_locus_nothing_is_biased_and_any_jitter_is_allowed(bench):
    found = jitter_requirements(bench.under(), bench.otf, 1e-6, fitted="mvn", angles=(30.0,), cycles=())
    sizes = {one.motion: one.size for one in found}
    assert sizes["mvn,shear=0"] == sizes["mvn,shear=0.7"] == math.inf
    assert 0 < sizes["shm"] < sizes["linear"] < math.inf
    assert abs(
        moment_bias(bench.under(Linear.of(sizes["linear"], 180.0)), "mvn", bench.otf)
    ) == pytest.approx(1e-6, rel=0.01)


def test_nothing_allowed_is_refused_and_so_is_a_frame_that_determines_nothing(bench):
    with refused(ErrorCode.NOT_CONSTRAINED):
        jitter_requirements(bench.under(), bench.otf, 0.1, Detector(gain=1.0, saturation=1.0))
    with refused(ErrorCode.OUT_OF_RANGE, 0):
        jitter_requirements(bench.under(), bench.otf, 0)


def test_a_sweep_holds_the_forecast_of_every_combination(bench):
    def point(length, flux):
        return forecast(bench.under(Linear.of(length), flux=flux), bench.otf)

    grid = sweep(point, {"length": [0.2, 0.5], "flux": [1e5, 4e5, 1.6e6]})
    assert grid.error().shape == (2, 3)
    assert grid.error()[1, 2] == point(0.5, 1.6e6).error("separation")
    np.testing.assert_allclose(grid.error()[:, 0], 2 * grid.error()[:, 1])  # four times the photons
    np.testing.assert_array_equal(grid.points()["flux"], [1e5, 4e5, 1.6e6] * 2)
