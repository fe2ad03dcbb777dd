import numpy as np
import pytest
from refusals import refused
from scipy import signal

from jitterkit.errors import ErrorCode
from jitterkit.motion import (
    Line,
    PowerSpectrum,
    measure_exposures,
    simulate_exposures,
    simulate_pointing,
    split_spectrum,
)

MIX = np.array([1.0, -0.6, 2.0])


def flat(low, high, variance, lines=()):
    return PowerSpectrum([low, high], np.tile(variance * MIX / (high - low), (2, 1)), lines)


def squares(x, y):
    return np.array([x * x, x * y, y * y]).mean(axis=1)


def test_draws_have_the_variance_and_the_correlation_of_the_spectrum(rng):
    t, x, y = simulate_pointing(flat(2.0, 40.0, 1e-4), 200.0, 0.01, rng)
    assert (len(t), t[-1]) == (20001, pytest.approx(200.0))
    # 38 Hz for 200 s are 7600 independent pairs of amplitudes: a variance is good to 1/sqrt(7600), 5 sigma
    np.testing.assert_allclose(squares(x, y), 1e-4 * MIX, atol=1e-4 * 2 * 5 / np.sqrt(7600))


def test_draws_have_the_density_of_the_spectrum_and_nothing_outside_it(rng):
    spectrum = PowerSpectrum([1.0, 8.0, 30.0], [1e-5 * MIX, 1e-6 * MIX, 1e-6 * MIX])
    record = simulate_pointing(spectrum, 400.0, 0.01, rng)
    f, density = signal.welch(record.x, 100.0, nperseg=400)  # 0.25 Hz, about 180 independent segments
    for low, high in ((2.0, 4.0), (5.0, 7.0), (10.0, 28.0)):
        inside = (f > low) & (f < high)
        ratio = (density[inside] / spectrum.at(f[inside])[:, 0]).mean()
        assert ratio == pytest.approx(1, abs=5 / np.sqrt(180 * inside.sum()) + 0.02)  # and the window's bend
    assert density[f > 32].max() < 1e-4 * density[inside].mean()


def test_what_is_slower_than_the_record_is_in_it_as_drift(rng):
    # one part in 50 of a cycle: a smear of variance (2πfT)² S/12 each, and ten times as much displacement
    spectrum, draws = flat(0.018, 0.022, 1.0), 1500
    records = (simulate_pointing(spectrum, 1.0, 0.25, rng) for _ in range(draws))
    smears = np.array([measure_exposures(record, 1.0).smears[0] for record in records])
    expected = 12 * split_spectrum(spectrum, 1.0).smear
    scatter = 5 * np.sqrt(2 / draws)
    # tones four an octave stand for the band: speeds are right to (2^(1/4) - 1)/2 at worst
    np.testing.assert_allclose(squares(*smears.T), expected, rtol=scatter + 0.1)


def test_lines_have_their_amplitude_axis_and_a_random_phase(rng):
    line = PowerSpectrum(lines=(Line(5.0, 0.2, 60.0, 0.1),))
    _, x, y = simulate_pointing(line, 2.0, 0.001, rng)
    np.testing.assert_allclose(squares(x[:-1], y[:-1]), line.lines[0].moments(), atol=1e-12)
    starts = [simulate_pointing(line, 0.01, 0.01, rng).x[0] for _ in range(200)]
    assert np.std(starts) == pytest.approx(np.sqrt(line.lines[0].moments()[0]), rel=0.2)


def test_one_seed_is_one_record():
    spectrum = flat(0.1, 40.0, 1e-4, (Line(3.0, 0.1),))
    one, same, other = (simulate_pointing(spectrum, 1.0, 0.01, np.random.default_rng(k)) for k in (3, 3, 4))
    np.testing.assert_array_equal(one.x, same.x)
    assert np.all(one.x != other.x)


def test_exposures_of_a_simulated_motion_have_the_split_of_its_spectrum(rng):
    spectrum = PowerSpectrum([0.01, 3.0, 200.0], [1e-4 * MIX, 1e-5 * MIX, 1e-8 * MIX])
    frames = 3000
    split = measure_exposures(simulate_pointing(spectrum, frames * 0.1, 0.1 / 80, rng), 0.1).split()
    expected = split_spectrum(spectrum, 0.1)
    # squares of normal numbers; smears of neighbours are correlated, hence 6 sigma
    for part in ("smear", "jitter"):
        error = 6 * np.sqrt(2 / frames) * np.sqrt(getattr(expected, part)[0] * getattr(expected, part)[2])
        np.testing.assert_allclose(getattr(split, part), getattr(expected, part), atol=error)


def test_loci_of_frames_have_the_blur_of_the_spectrum_on_average(rng):
    lines = (Line(80.0, 0.03, 30.0), Line(900.0, 0.02, 100.0), Line(700.0, 0.01, 0.0, 0.01))
    spectrum = PowerSpectrum([1.0, 2000.0], [1e-5 * MIX, 1e-8 * MIX], lines)
    frames = 300
    loci, means = simulate_exposures(spectrum, 0.1, frames, rng)
    assert len({len(part.times) for locus in loci for part in locus.parts if hasattr(part, "times")}) == 1
    moments = np.array([locus.moments() for locus in loci])
    expected = split_spectrum(spectrum, 0.1).blur
    error = 5 * moments.std(axis=0) / np.sqrt(frames)
    assert np.all(
        np.abs(moments.mean(axis=0) - expected) < error + 0.006 * np.abs(expected)
    )  # and the chords
    assert np.ptp(moments[:, 0]) > 0
    # of a density from 1 Hz on, neighbours of ten or so stand together: a tenth of 300 are independent
    np.testing.assert_allclose(
        squares(*means.T), split_spectrum(spectrum, 0.1).displacement, rtol=5 * np.sqrt(2 / 30)
    )


def test_a_step_too_long_for_a_line_is_refused(rng):
    with refused(ErrorCode.SAMPLING, "60 Hz", "0.01 s", "0.00833333 s"):
        simulate_pointing(PowerSpectrum(lines=(Line(60.0, 0.1),)), 1.0, 0.01, rng)
    with refused(ErrorCode.OUT_OF_RANGE, "0 s"):
        simulate_pointing(PowerSpectrum(lines=(Line(60.0, 0.1),)), 0.0, 0.01, rng)
