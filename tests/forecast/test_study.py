"""The cross-fit of kinds of jitter with loci, and the rows that choose."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.forecast import cross_fit, jitter_of_kind
from jitterkit.forecast.kinds import KINDS
from jitterkit.forecast.study import Panel
from jitterkit.loci import principal_axes


def test_the_worst_bias_is_in_errors_of_a_mean_of_few_draws():
    one = np.array([4.0])
    panel = Panel("linear", "mvn", np.array([[-1.0, 1.0]]), one, one, one, ("mvn",))
    assert panel.worst == pytest.approx(4.0)  # two draws two apart: a deviation of √2, and an error of 1
    assert panel.mean == (0.0, pytest.approx(1.0))


@pytest.fixture(scope="module")
def panels(bench):
    columns = {
        kind: [jitter_of_kind(kind, 0.6, angle) for angle in (20.0, 110.0)] for kind in ("linear", "mvn")
    }
    rows = ["stable", "linear", "mvn", "auto", "auto, a frame"]
    found = cross_fit(columns, rows, bench.under(), bench.optics, 300, np.random.default_rng(6))
    return {(panel.data, panel.fitted): panel for panel in found}


@pytest.mark.slow
def test_every_pair_of_data_and_locus_has_a_panel(panels):
    assert list(panels) == [
        (d, f) for d in ("linear", "mvn") for f in ("stable", "linear", "mvn", "auto", "auto, a frame")
    ]
    for panel in panels.values():
        assert panel.offsets.shape == (2, 300)


@pytest.mark.slow
def test_the_rows_of_a_column_see_the_same_frames(panels):
    right, wrong = panels["linear", "linear"], panels["linear", "mvn"]
    # the noise they share correlates them; unshared it would not
    assert np.corrcoef(right.offsets[0], wrong.offsets[0])[0, 1] > 0.9
    assert abs(np.corrcoef(right.offsets[0], right.offsets[1])[0, 1]) < 4 / np.sqrt(300)


@pytest.mark.slow
def test_the_mean_is_the_noise_free_bias_within_its_error(panels):
    for (_, fitted), panel in panels.items():
        if fitted == "auto, a frame":
            assert np.all(np.isnan(panel.bias))
            continue
        mean, error = panel.mean
        assert abs(mean - panel.bias.mean()) < 4 * error
        assert (
            error == pytest.approx(panel.offsets.std() / np.sqrt(600), rel=0.2)
            or abs(panel.bias).max() > error
        )


@pytest.mark.slow
def test_auto_takes_the_locus_of_the_data_and_is_not_biased(panels):
    assert set(panels["linear", "auto"].chosen) == {"linear"}
    assert set(panels["mvn", "auto"].chosen) <= {"mvn", "ellipse"}
    assert panels["linear", "auto"].worst < 1e-3
    assert panels["linear", "mvn"].worst > 1 > panels["mvn", "auto"].worst
    np.testing.assert_array_equal(panels["linear", "auto"].offsets, panels["linear", "linear"].offsets)


@pytest.mark.parametrize(
    ("kind", "rms"), [("linear", 12**-0.5), ("shm", 8**-0.5), ("mvn", 1 / 2.354820), ("ellipse", 8**-0.5)]
)
def test_equal_sizes_are_not_equal_jitter(kind, rms):
    major, _, angle = principal_axes(jitter_of_kind(kind, 1.0, 25.0).moments())
    assert (major, angle) == (pytest.approx(rms, rel=1e-6), pytest.approx(25.0))


def test_a_kind_is_shaped_by_name():
    sheared = jitter_of_kind("mvn,shear=0.7", 0.3, 0.0).describe()
    assert sheared["sigma_minor"] == pytest.approx(0.3 * sheared["sigma_major"])
    partial = jitter_of_kind("partial,cycles=1.2, phase=-20", 0.3, 0.0).describe()
    assert (partial["cycles"], partial["phase"]) == (pytest.approx(1.2), pytest.approx(-20))
    assert set(KINDS) == {"linear", "shm", "mvn", "ellipse", "partial"}


@pytest.mark.parametrize(
    ("kind", "code", "values"),
    [
        ("wobble", ErrorCode.UNKNOWN_NAME, ["'wobble'", *KINDS]),
        ("mvn,shear", ErrorCode.MALFORMED, ["'mvn,shear'"]),
        ("mvn,cycles=1", ErrorCode.UNKNOWN_NAME, ["mvn", "cycles", "shear"]),
        ("linear,shear=1", ErrorCode.UNKNOWN_NAME, ["linear", "shear"]),
        ("ellipse,ratio=5", ErrorCode.OUT_OF_RANGE, ["ratio = 5", "0 to 1"]),
        ("ellipse,ratio=-0.5", ErrorCode.OUT_OF_RANGE, ["ratio = -0.5"]),
        ("ellipse,ratio=nan", ErrorCode.OUT_OF_RANGE, ["ratio = nan"]),
    ],
)
def test_what_is_no_kind_is_reported_in_a_sentence(kind, code, values):
    with refused(code, *values):
        jitter_of_kind(kind, 0.1, 0.0)
