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
    positions = np.cumsum(rng.normal(0, np.sqrt(walk / steps), (2, steps * exposures + 1)), axis=1)
    split = measure_exposures(Record(np.arange(steps * exposures + 1) / steps, *positions), 1.0).split()
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


def samples(rate=1000, duration=20.0):
    """A trace of vibrations of 0.1 and 0.05 arcsec: rms 70.7 and 35.4 mas."""
    t = np.arange(round(duration * rate)) / rate
    return t, 0.1 * np.sin(2 * np.pi * 37 * t), 0.05 * np.cos(2 * np.pi * 11 * t)


def exposures_one_by_one(t, x, y, exposure, holes):
    """Jitter variances of exposures back to back, by straight-line fits to the samples in each.

    An exposure with a hole in it is left out.
    """
    found = []
    for k in range(int((t[-1] - t[0]) / exposure + 1e-6)):
        start, end = t[0] + k * exposure, t[0] + (k + 1) * exposure
        if any(start < last - 1e-9 and end > first + 1e-9 for first, last in holes):
            continue
        inside = (t >= start - 1e-9) & (t <= end + 1e-9)
        rest = [v[inside] - np.polyval(np.polyfit(t[inside], v[inside], 1), t[inside]) for v in (x, y)]
        found.append([np.mean(r**2) for r in rest])
    return np.mean(found, axis=0), len(found)


@pytest.mark.parametrize("epoch", [0.0, 1.7e9], ids=["from 0", "since 1970"])
@pytest.mark.parametrize(
    "holes",
    [[(5.002, 15.0)], [(1.23, 1.31), (4.05, 4.06), (7.999, 12.5)], [(0.001, 3.333)], [(15.0, 19.998)]],
    ids=["one", "three", "at the beginning", "at the end"],
)
def test_exposures_in_which_a_trace_has_a_gap_are_left_out(holes, epoch):
    t, x, y = samples()
    keep = ~np.any([(t > a + 1e-9) & (t < b - 1e-9) for a, b in holes], axis=0)
    seen = measure_exposures(Record(t[keep] + epoch, x[keep], y[keep]), 0.1)
    expected, count = exposures_one_by_one(t[keep], x[keep], y[keep], 0.1, holes)
    assert (len(seen.starts), seen.planned) == (count, 199)
    # 100 samples an exposure: the fit to them is the integral to a few in a hundred squared
    np.testing.assert_allclose(seen.jitters[:, [0, 2]].mean(axis=0), expected, rtol=0.02)
    assert np.abs(seen.means).max() < 0.1


def test_single_samples_that_were_lost_are_bridged(rng):
    t, x, y = samples()
    keep = rng.random(len(t)) > 0.05
    keep[[0, -1]] = True
    whole, thinned = (
        measure_exposures(Record(*v), 0.1).split() for v in ((t, x, y), (t[keep], x[keep], y[keep]))
    )
    np.testing.assert_allclose(thinned.jitter[[0, 2]], whole.jitter[[0, 2]], rtol=0.01)


def test_motion_between_frames_is_not_taken_over_a_gap():
    """A staircase of 1 arcsec a second that goes on through a hole of 4 s: each frame is 1 arcsec further."""
    t = np.arange(0, 20, 0.01)
    x = np.floor(t + 1e-9)
    keep = (t < 8.005) | (t > 11.995)
    seen = measure_exposures(Record(t[keep], x[keep], 0 * t[keep]), 0.5, 1.0)
    assert list(seen.numbers) == [*range(8), *range(12, 20)]
    np.testing.assert_allclose(seen.steps(), [1, 0, 0], atol=1e-9)


def test_a_trace_without_an_exposure_free_of_gaps_is_refused():
    t, x, y = samples(duration=2.0)
    keep = np.arange(len(t)) % 50 < 30
    with refused(ErrorCode.OUT_OF_RANGE, 39, "0.021 s", 19, "0.1 s"):
        measure_exposures(Record(t[keep], x[keep], y[keep]), 0.1)


def test_the_spectrum_of_a_trace_with_a_gap_is_that_of_its_longest_piece():
    t, x, y = samples()
    keep = (t < 3) | (t > 8)
    (fast,) = trace_spectrum(Record(t[keep], x[keep], 0 * y[keep])).lines
    assert (fast.frequency, fast.amplitude) == pytest.approx((37, 0.1), rel=0.01)


def test_welch_s_spectrum_has_the_variance_and_the_sign_of_the_correlation(rng):
    x = rng.standard_normal(1 << 14)
    y = -0.5 * x + rng.standard_normal(1 << 14)
    f = trace_spectrum(Record(np.arange(1 << 14) * 0.01, x, y))
    # white: variance over 50 Hz; a mean over 1000 frequencies of 15 segments each, good to 2 %
    np.testing.assert_allclose(f.density[:-1].mean(axis=0), np.array([1, -0.5, 1.25]) / 50, rtol=0.06)
    assert f.frequencies[-1] == pytest.approx(50, abs=0.05)  # and half a bin of 50/1024 Hz


@pytest.mark.parametrize(("samples", "rows"), [(2, 0), (3, 0), (4, 4), (17, 16)])
def test_a_record_of_a_few_samples_has_an_empty_spectrum_and_a_split(samples, rows, rng):
    record = Record(np.linspace(0, 1, samples), *rng.normal(size=(2, samples)))
    assert len(trace_spectrum(record).frequencies) == rows  # both ends of each bin
    assert len(measure_exposures(record, 0.1).starts) == 10


def test_a_record_of_more_exposures_than_fit_into_the_memory_is_refused():
    """Times in nanoseconds that are taken for seconds."""
    with refused(ErrorCode.OUT_OF_RANGE, "6e+09 s", "6e+10", "0.1 s"):
        measure_exposures(Record(np.array([0.0, 6e9]), np.zeros(2), np.zeros(2)), 0.1)


def test_records_that_hold_no_exposure_are_refused():
    record = Record(np.array([0.0, 1.0]), np.zeros(2), np.zeros(2))
    with refused(ErrorCode.OUT_OF_RANGE, "1 s", "2 s"):
        measure_exposures(record, 2.0)
    with refused(ErrorCode.OUT_OF_RANGE, "0.5 s", "0.1 s"):
        measure_exposures(record, 0.5, 0.1)
