"""The picture of a trade: every point where it belongs, on logarithmic axes."""

import math

import numpy as np
import pytest

from jitterkit.report.trade_plots import plot_trade

NAMES = ["fast", "balanced", "slow", "peer", "no"]
SECONDS, ERRORS = [0.004, 0.04, 0.4, 2.0, math.nan], [0.1, 1e-3, 1e-9, 0.5, math.nan]


@pytest.fixture
def ax():
    return plot_trade(
        NAMES, SECONDS, ERRORS, front=["balanced", "fast"], presets=["fast", "balanced"], peers=["peer"]
    )


def test_points_stand_where_they_belong(ax):
    marks = {line.get_marker(): line.get_xydata() for line in ax.lines if line.get_marker() == "s"}
    np.testing.assert_allclose(marks["s"], [[2000.0, 0.5]])
    assert [text.get_text() for text in ax.texts] == NAMES[:4]
    assert ax.get_xscale() == ax.get_yscale() == "log"


def test_the_front_is_joined_from_the_fastest_on(ax):
    (line,) = [line for line in ax.lines if len(line.get_xdata()) == 2]
    np.testing.assert_allclose(line.get_xydata(), [[4.0, 0.1], [40.0, 1e-3]])


def test_an_error_that_nobody_will_see_is_drawn_at_the_edge(ax):
    positions = [tuple(line.get_xydata()[0]) for line in ax.lines if len(line.get_xdata()) == 1]
    assert (400.0, 1e-5) in positions
    assert ax.get_ylim()[0] < 1e-5


def test_no_name_covers_another():
    crowd = [f"setting {number}" for number in range(40)]
    ax = plot_trade(crowd, [0.1 + 1e-3 * k for k in range(40)], [1e-3] * 40, presets=["setting 7"])
    boxes = [text.get_window_extent() for text in ax.texts]
    assert ax.texts[0].get_text() == "setting 7"  # presets have the first choice
    assert 5 <= len(boxes) < 40
    assert not any(one.overlaps(other) for k, one in enumerate(boxes) for other in boxes[:k])


def test_without_a_number_it_says_so():
    ax = plot_trade(["no"], [math.nan], [math.nan])
    assert ax.texts[0].get_text() == "no settings could be measured"
