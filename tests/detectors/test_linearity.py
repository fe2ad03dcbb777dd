"""Non-linearity and its inverse."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.detectors.response import collected, measured, slope, turning_point
from jitterkit.errors import ErrorCode
from jitterkit.frames import RawFrame

WELL = 15000.0
LAWS = [(-1e-6,), (-1.5e-5,), (4e-6, -2e-10), (-3e-5, 1.2e-9, -1e-15)]


def test_a_quadratic_law_is_inverted_as_its_formula_says():
    c = -1.5e-5
    shown = np.linspace(0.0, WELL * (1 + c * WELL), 5001)
    charge = (
        2 * shown / (1 + np.sqrt(1 + 4 * c * shown))
    )  # the root of c q² + q = shown that vanishes with it
    assert collected(shown, (c,), WELL) == pytest.approx(charge, abs=1e-10)
    assert measured(np.array([10_000.0]), (c,), WELL)[0] == pytest.approx(8500.0)


@pytest.mark.parametrize("law", LAWS)
def test_inverting_is_exact_to_rounding_inside_the_range_and_beyond(law):
    charge = np.concatenate([np.linspace(-500.0, 2 * WELL, 30_001), [0.0, WELL]])
    # a rounding of the reading is divided by the slope, which is at least 0.2 here; a few of them
    tolerance = 8 * np.finfo(float).eps * 2 * WELL / 0.2
    assert np.abs(collected(measured(charge, law, WELL), law, WELL) - charge).max() < tolerance


@pytest.mark.parametrize("law", LAWS)
def test_the_slope_is_the_derivative_everywhere(law):
    charge, step = np.array([-50.0, 10.0, 4000.0, 14_900.0, 17_000.0]), 1e-2
    difference = (measured(charge + step, law, WELL) - measured(charge - step, law, WELL)) / (2 * step)
    assert slope(charge, law, WELL) == pytest.approx(difference, abs=1e-9)
    assert slope(np.array([-3.0, 0.0]), law, WELL) == pytest.approx([1.0, 1.0])


def test_a_law_turns_where_its_derivative_vanishes():
    assert turning_point([-1e-5]) == pytest.approx(50_000.0)
    assert turning_point([1e-5]) == np.inf
    assert turning_point([0.0]) == np.inf
    # 1 + 2 c1 q + 3 c2 q² = (1 - q/1e4)(1 - q/2e4)
    assert turning_point([-0.75e-4, 1 / 6e8]) == pytest.approx(1e4)


def test_read_noise_grows_by_the_inverse_s_slope():
    # at 12,000 e- the law rises by 1 - 2 1.5e-5 12,000 = 0.64, so 60 e- of reading are 94 of charge
    detector = Detector(gain=1.0, read_noise=60.0, bias=500.0, full_well=20_000.0, nonlinearity=[-1.5e-5])
    n, level = 400, 12_000.0
    frame = detector.calibrate(
        RawFrame.from_array(detector.expose(np.full((n, n), level), np.random.default_rng(4)))
    )
    expected = (60.0**2 + 1 / 12) / 0.64**2
    # the slope is taken at each reading, which scatters by 1 % of the level: second order and below 1e-3
    assert frame.read_variance.mean() == pytest.approx(expected, rel=2e-3)
    assert frame.electrons.var() == pytest.approx(level + expected, rel=4 * np.sqrt(2) / n + 1e-3)
    # curvature: the mean of the inverse is off by -m''/(2 m'³) of the read variance
    curve = 1.5e-5 * 60.0**2 / 0.64**3
    assert frame.electrons.mean() == pytest.approx(level + curve, abs=4 * np.sqrt(level + expected) / n)


@pytest.mark.parametrize(
    ("numbers", "code", "values"),
    [
        ({"nonlinearity": [-1e-6]}, ErrorCode.MISSING_VALUE, ("nonlinearity", "full_well")),
        (
            {"nonlinearity": [-5e-5], "full_well": 15_000.0},
            ErrorCode.CONFLICT,
            ("nonlinearity = [-5e-05]", "10000 e-", "full_well", "15000 e-"),
        ),
        ({"nonlinearity": [], "full_well": 1e4}, ErrorCode.WRONG_SHAPE, ("nonlinearity = []",)),
        ({"nonlinearity": [np.nan], "full_well": 1e4}, ErrorCode.OUT_OF_RANGE, ("nonlinearity = [nan]",)),
        ({"nonlinearity": 1e-6, "full_well": 1e4}, ErrorCode.WRONG_SHAPE, ("nonlinearity = 1e-06",)),
    ],
)
def test_a_law_that_cannot_be_inverted_is_refused(numbers, code, values):
    with refused(code, *values):
        Detector(**numbers)
