import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.motion import Line, PowerSpectrum, cumulative_split, split_line, split_spectrum
from jitterkit.motion.split import motion_between_frames

MIX = np.array([1.0, -0.4, 2.0])
"""x, xy and y of a process whose axes differ and are correlated."""


def weights(z):
    """Displacement, smear and jitter of a tone, from sines and cosines."""
    displacement = (np.sin(z) / z) ** 2
    smear = 3 * (np.sin(z) - z * np.cos(z)) ** 2 / z**4
    return displacement, smear, 1 - displacement - smear


def power_law(slope, low, high, rows=2, level=1e-6):
    f = np.geomspace(low, high, rows)
    return PowerSpectrum(f, level * f[:, None] ** slope * MIX)


def test_a_random_walk_has_the_known_blur_of_one_exposure():
    # Of <(θ(t) - θ(0))²> = D t: about its mean DT/6; 12 <(∫θ u du)²> = 12 DT ∫(x(1-x)/2)² dx = DT/10 of it is
    # smear.  One-sided density D/(2π²f²).  Cut off at f1 and f2 smear loses 5/3 f1 T, jitter 15/(2π² f2 T).
    walk, exposure = 3e-6, 0.1
    spectrum = power_law(-2, 1e-7, 1e5, level=walk / (2 * np.pi**2))
    split = split_spectrum(spectrum, exposure)
    np.testing.assert_allclose(split.smear, walk * exposure / 10 * MIX, rtol=1e-6)
    np.testing.assert_allclose(split.jitter, walk * exposure / 15 * MIX, rtol=1e-4)
    np.testing.assert_allclose(split.blur, split.smear + split.jitter, rtol=1e-15)
    # frames without a gap: D T (1 - 1/3), from the mean of |t - s| over two adjoining squares
    steps = motion_between_frames(spectrum, exposure, exposure)
    np.testing.assert_allclose(steps, 2 / 3 * walk * exposure * MIX, rtol=1e-5)


@pytest.mark.parametrize("slope", [-3.3, -1.0, 0.0, 1.2])
def test_two_rows_hundreds_of_cycles_apart_are_integrated_as_the_power_law_between_them(slope):
    exposure, low, high = 0.5, 0.2, 700.0
    split = split_spectrum(power_law(slope, low, high), exposure)
    f = np.linspace(low, high, 4_000_001)  # 11,000 steps a cycle: trapezia are good to 1e-7
    for part, weight in zip(
        (split.displacement, split.smear, split.jitter), weights(np.pi * f * exposure), strict=True
    ):
        expected = np.trapezoid(1e-6 * f**slope * weight, f) * MIX
        np.testing.assert_allclose(part, expected, rtol=3e-6)


def test_the_parts_sum_to_the_variance_and_more_rows_of_one_law_change_nothing():
    coarse, fine = (split_spectrum(power_law(-1.5, 1e-3, 300.0, rows), 0.1) for rows in (2, 1000))
    total = coarse.displacement + coarse.smear + coarse.jitter
    np.testing.assert_allclose(total, 1e-6 * 2 * (1e-3**-0.5 - 300**-0.5) * MIX, rtol=1e-11)
    np.testing.assert_allclose(coarse.smear, fine.smear, rtol=1e-11)


def test_a_row_of_zeros_is_joined_by_a_straight_line():
    spectrum = PowerSpectrum([0.0, 2.0, 4.0], [[0, 0, 0], [3, 0, 1], [0, 0, 0]])
    np.testing.assert_allclose(spectrum.at([0.5, 2.0, 3.0, 5.0])[:, 0], [0.75, 3.0, 1.5, 0.0])
    split = split_spectrum(spectrum, 1e-9)  # an instant: all displacement
    np.testing.assert_allclose(split.displacement, [6.0, 0.0, 2.0], rtol=1e-12)


def test_the_cross_spectrum_keeps_within_its_bound_between_rows():
    spectrum = PowerSpectrum([1.0, 100.0], [[1, 1, 1], [1e-6, -1e-3, 1]])
    density = spectrum.at(np.geomspace(1, 100, 500))
    assert np.all(density[:, 1] ** 2 <= density[:, 0] * density[:, 2] * (1 + 1e-12))
    np.testing.assert_allclose(spectrum.at([1.0, 100.0]), spectrum.density, rtol=1e-12)


def test_a_line_has_half_its_squared_amplitude_along_its_axis():
    line = Line(7.0, 0.02, 30.0)
    split = split_line(line, 0.1)
    c, s = np.cos(np.radians(30)), np.sin(np.radians(30))
    expected = 0.02**2 / 2 * np.array([c * c, c * s, s * s])
    for part, weight in zip(
        (split.displacement, split.smear, split.jitter), weights(0.7 * np.pi), strict=True
    ):
        np.testing.assert_allclose(part, weight * expected, rtol=1e-12)
    np.testing.assert_allclose(Line(7.0, 0.02, 90.0, 0.01).moments(), [0.5e-4, 0, 2e-4], atol=1e-18)


def test_a_line_is_a_narrow_peak_of_the_density():
    line, width = Line(13.0, 0.02, 0.0), 1e-4
    height = 0.02**2 / 2 / width
    peak = PowerSpectrum([13 - width / 2, 13 + width / 2], [[height, 0, 0]] * 2)
    for one, other in zip(
        *(vars(split_spectrum(s, 0.1)).values() for s in (peak, PowerSpectrum(lines=(line,)))), strict=True
    ):
        np.testing.assert_allclose(one, other, rtol=1e-4, atol=1e-18)


def test_the_cumulative_split_ends_at_the_whole_and_steps_at_a_line():
    spectrum = PowerSpectrum(*vars(power_law(-1.5, 1e-2, 300.0)).values()).between(0.0, np.inf)
    spectrum = PowerSpectrum(spectrum.frequencies, spectrum.density, (Line(20.0, 0.02, 30.0),))
    f, moments = cumulative_split(spectrum, 0.1)
    whole = split_spectrum(spectrum, 0.1)
    np.testing.assert_allclose(moments[-1], [whole.displacement, whole.smear, whole.jitter], rtol=1e-11)
    before, after = moments[f == 20.0][[0, -1]]
    np.testing.assert_allclose((after - before)[2], split_line(spectrum.lines[0], 0.1).jitter, rtol=1e-9)
    assert np.all(np.diff(f) >= 0)


def test_pieces_of_a_spectrum_make_the_whole():
    spectrum = PowerSpectrum(
        [0.1, 5.0, 900.0], [1e-4 * MIX, 1e-5 * MIX, 1e-9 * MIX], (Line(10.0, 0.1, 20.0),)
    )
    pieces = [split_spectrum(spectrum.between(*ends), 0.1) for ends in ((0, 0.03), (0.03, 10), (10, np.inf))]
    whole = split_spectrum(spectrum, 0.1)
    np.testing.assert_allclose((pieces[0] + pieces[1] + pieces[2]).smear, whole.smear, rtol=1e-10)
    np.testing.assert_allclose(pieces[0].blur, 0)
    assert len(spectrum.between(0, 10).lines) == 0


@pytest.mark.parametrize(
    ("frequencies", "density", "code", "values"),
    [
        ([1.0], [[1, 0, 1]], ErrorCode.WRONG_SHAPE, ["(n, 3)", "(1, 3)", "(1,)"]),
        ([1.0, 2.0], [[1, 0], [1, 0]], ErrorCode.WRONG_SHAPE, ["(n, 3)", "(2, 2)", "(2,)"]),
        ([2.0, 2.0], [[1, 0, 1]] * 2, ErrorCode.MALFORMED, ["row 2", "2 Hz"]),
        ([-1.0, 2.0], [[1, 0, 1]] * 2, ErrorCode.OUT_OF_RANGE, ["row 1", "-1 Hz"]),
        ([1.0, 2.0], [[1, 0, 1], [1, 0, -1]], ErrorCode.OUT_OF_RANGE, ["2 Hz", "1, -1"]),
        ([1.0, 2.0], [[1, 0, 1], [np.nan, 0, 1]], ErrorCode.OUT_OF_RANGE, ["2 Hz", "nan, 1"]),
        ([1.0, 2.0], [[1, 0, 4], [1, 3, 4]], ErrorCode.OUT_OF_RANGE, ["2 Hz", " 3,", " 2;"]),
    ],
)
def test_a_spectrum_that_cannot_be_is_refused(frequencies, density, code, values):
    with refused(code, *values):
        PowerSpectrum(frequencies, density)


@pytest.mark.parametrize(
    ("sizes", "name", "value"),
    [
        ((0, 1), "frequency", 0),
        ((1, -1), "amplitude", -1),
        ((1, 1, np.nan), "angle", "nan"),
        ((1, 1, 0, -1), "minor", -1),
        ((np.inf, 1), "frequency", "inf"),
    ],
)
def test_a_line_that_cannot_be_is_refused(sizes, name, value):
    with refused(ErrorCode.OUT_OF_RANGE, name, value):
        Line(*sizes)


@pytest.mark.parametrize("exposure", [0.0, -1.0, np.nan, np.inf])
def test_an_exposure_that_cannot_be_is_refused(exposure):
    with refused(ErrorCode.OUT_OF_RANGE, f"{exposure:g} s"):
        split_spectrum(PowerSpectrum(lines=(Line(1, 1),)), exposure)
