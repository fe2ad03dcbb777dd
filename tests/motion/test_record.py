import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.loci import Trace
from jitterkit.motion import Line, Record, measure_exposures, split_line, trace_spectrum


def test_a_drift_is_smear_alone_and_its_length_is_speed_times_exposure(rng):
    t = np.sort(rng.uniform(0, 1, 200))
    exposures = measure_exposures(Record(t, 5 + 0.3 * t, -2 - 0.7 * t), 0.1)
    np.testing.assert_allclose(exposures.smears, [[0.03, -0.07]] * len(exposures.starts), rtol=1e-12)
    np.testing.assert_allclose(exposures.jitters, 0, atol=1e-24)
    middles = exposures.starts + 0.05
    np.testing.assert_allclose(
        exposures.means, np.stack([5 + 0.3 * middles, -2 - 0.7 * middles], 1), rtol=1e-13
    )


def test_a_kink_in_mid_exposure_has_the_known_mean_and_rest():
    # |u| on [-1/2, 1/2]: mean 1/4, no first Legendre term, variance 1/12 - 1/16 = 1/48; and u beside it
    exposures = measure_exposures(
        Record(np.array([3.0, 4.0, 5.0]), np.array([1.0, 0.0, 1.0]), np.array([0.0, 1.0, 2.0])), 2.0
    )
    np.testing.assert_allclose(exposures.means, [[0.5, 1.0]], atol=1e-15)
    np.testing.assert_allclose(exposures.smears, [[0.0, 2.0]], atol=1e-15)
    np.testing.assert_allclose(exposures.jitters, [[4 / 48, 0, 0]], atol=1e-15)


def test_smear_and_rest_are_the_second_moments_that_a_trace_draws(rng):
    t = np.cumsum(rng.uniform(0.01, 0.03, 60))
    x, y = np.cumsum(rng.normal(0, 0.1, (2, 60)), axis=1)
    seen = measure_exposures(Record(t, x, y), 0.31)
    for k, start in enumerate(seen.starts):
        lx, ly = seen.smears[k]
        both = np.array([lx * lx, lx * ly, ly * ly]) / 12 + seen.jitters[k]
        np.testing.assert_allclose(both, Trace.of(t, x, y, start, 0.31).moments(), rtol=1e-10)


def test_a_random_walk_in_time_has_its_known_split(rng):
    # D T/10 and D T/15 as in test_split; straight lines between samples leave out a bridge of D dt/6 each
    steps, exposures, walk = 50, 4000, 2e-4
    places = np.cumsum(rng.normal(0, np.sqrt(walk / steps), (2, steps * exposures + 1)), axis=1)
    split = measure_exposures(Record(np.arange(steps * exposures + 1) / steps, *places), 1.0).split()
    scatter = 5 * np.sqrt(2 / exposures)  # of a mean of squares of normal numbers
    for k in (0, 2):
        assert split.smear[k] == pytest.approx(walk / 10, rel=scatter)
        assert split.jitter[k] == pytest.approx(walk / 15 - walk / 6 / steps, rel=scatter)
    assert split.smear[1] == pytest.approx(0, abs=walk / 10 * scatter)


def test_exposures_all_over_a_vibration_have_its_split():
    # 997 exposures of 0.37 cycles, every 1.3: phases are spread evenly but for 1/997; chords cost (2π/400)²/6
    line, t = Line(3.7, 0.2, 25.0, 0.05), np.arange(0, 132, 1 / 3.7 / 400)
    phase = 2 * np.pi * line.frequency * t
    c, s = np.cos(np.radians(25)), np.sin(np.radians(25))
    along, across = 0.2 * np.cos(phase), 0.05 * np.sin(phase)
    seen = measure_exposures(Record(t, c * along - s * across, s * along + c * across), 0.1, 0.13137)
    split, expected = seen.split(), split_line(line, 0.1)
    for part in ("displacement", "smear", "jitter"):
        np.testing.assert_allclose(getattr(split, part), getattr(expected, part), rtol=5e-3)


def test_a_gap_between_exposures_is_left_out():
    t = np.array([0.0, 1.0, 1.0 + 1e-9, 2.0, 2.0 + 1e-9, 3.0])
    x = np.array([1.0, 1.0, 9.0, 9.0, 5.0, 5.0])
    seen = measure_exposures(Record(t, x, 0 * x), 1.0, 2.0)
    np.testing.assert_allclose(seen.means[:, 0], [1.0, 5.0], atol=1e-7)
    np.testing.assert_allclose(seen.steps(), [16.0, 0, 0], atol=1e-6)


def test_welch_s_spectrum_has_the_variance_and_the_sign_of_the_correlation(rng):
    x = rng.standard_normal(1 << 14)
    y = -0.5 * x + rng.standard_normal(1 << 14)
    f = trace_spectrum(Record(np.arange(1 << 14) * 0.01, x, y))
    # white: variance over 50 Hz; a mean over 1000 frequencies of 15 segments each, good to 2 %
    np.testing.assert_allclose(f.density[:-1].mean(axis=0), np.array([1, -0.5, 1.25]) / 50, rtol=0.06)
    assert f.frequencies[-1] == pytest.approx(50)


@pytest.mark.parametrize(("samples", "rows"), [(2, 0), (3, 0), (4, 2), (17, 8)])
def test_a_record_of_a_few_samples_has_an_empty_spectrum_and_a_split(samples, rows, rng):
    record = Record(np.linspace(0, 1, samples), *rng.normal(size=(2, samples)))
    assert len(trace_spectrum(record).frequencies) == rows
    assert len(measure_exposures(record, 0.1).starts) == 10


def test_records_that_hold_no_exposure_are_refused():
    record = Record(np.array([0.0, 1.0]), np.zeros(2), np.zeros(2))
    with refused(ErrorCode.OUT_OF_RANGE, "1 s", "2 s"):
        measure_exposures(record, 2.0)
    with refused(ErrorCode.OUT_OF_RANGE, "0.5 s", "0.1 s"):
        measure_exposures(record, 0.5, 0.1)
