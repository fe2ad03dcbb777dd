"""Free and measured paths, against quadrature of their definitions."""

import itertools

import numpy as np
import pytest
import scipy.integrate
import scipy.interpolate
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci import Linear, Path, Trace, read_trace

FX, FY = np.meshgrid(np.linspace(-1.2, 1.2, 9), np.linspace(-1.1, 1.1, 8))
KNOTS = np.array([[0.0, 0.0], [0.4, 0.1], [0.5, 0.4], [0.3, 0.6], [0.2, 0.2]])


def time_average(x, y, fx, fy, breaks):
    """The mean phasor about the mean offset, by adaptive quadrature between breaks."""

    def mean(function):
        pieces = itertools.pairwise(breaks)
        return sum(scipy.integrate.quad(function, a, b, epsabs=1e-14)[0] for a, b in pieces)

    x0, y0 = mean(x), mean(y)

    def phase(t):
        return 2 * np.pi * (fx * (x(t) - x0) + fy * (y(t) - y0))

    return mean(lambda t: np.cos(phase(t))) - 1j * mean(lambda t: np.sin(phase(t)))


@pytest.mark.parametrize("knots", [2, 3, 4, 5])
def test_a_path_is_the_time_average_along_its_spline(knots):
    times = np.linspace(0, 1, knots)
    spline = scipy.interpolate.CubicSpline(times, KNOTS[:knots], bc_type="not-a-knot")
    for fx, fy in [(0.8, 0.3), (-0.5, 1.1)]:
        expected = time_average(lambda t: spline(t)[0], lambda t: spline(t)[1], fx, fy, times)
        assert complex(Path.of(KNOTS[:knots]).transfer(fx, fy)) == pytest.approx(expected, abs=1e-12)


def test_a_path_of_two_knots_is_a_drift():
    path, drift = Path.of([[1.0, 2.0], [1.3, 2.4]]), Linear.of(0.5, np.degrees(np.arctan2(4, 3)))
    assert np.asarray(path.transfer(FX, FY)) == pytest.approx(np.asarray(drift.transfer(FX, FY)), abs=1e-14)
    assert path.names == ("path_x1", "path_y1")


def test_a_path_run_backwards_leaves_the_same_image_and_mirrored_another():
    one, back, mirrored = (Path.of(k) for k in (KNOTS, KNOTS[::-1], KNOTS * [1, -1]))
    assert np.asarray(back.transfer(FX, FY)) == pytest.approx(np.asarray(one.transfer(FX, FY)), abs=1e-14)
    assert np.abs(mirrored.transfer(FX, FY) - one.transfer(FX, FY)).max() > 0.1


def test_where_a_path_as_a_whole_lies_does_not_matter_but_its_knots_are_given_back():
    path = Path.of(KNOTS + np.array([3.0, -2.0]))
    assert np.asarray(path.coords) == pytest.approx(np.asarray(Path.of(KNOTS).coords), abs=1e-14)
    positions = np.reshape(list(path.describe().values()), (-1, 2))
    assert np.diff(positions, axis=0) == pytest.approx(np.diff(KNOTS, axis=0), abs=1e-14)


def test_a_fit_starts_with_the_moments_it_is_given():
    moments = np.array([0.02, 0.01, 0.03])
    assert np.asarray(Path.near(moments).moments()) == pytest.approx(moments, abs=1e-15)


def test_a_fit_of_a_straight_blur_starts_along_it_and_a_little_bent():
    near = np.asarray(Path.near([0.01, 0.01 * np.sqrt(2), 0.02]).moments())  # of variances 0.03 and 0
    angle = 0.5 * np.arctan2(2 * near[1], near[0] - near[2])
    assert angle == pytest.approx(0.5 * np.arctan2(0.02 * np.sqrt(2), -0.01), abs=1e-12)
    line = np.linalg.eigvalsh([[near[0], near[1]], [near[1], near[2]]])
    # along: the greater eigenvalue; across: a parabola of height 0.1 L, whose variance is 4/45 of its square.
    assert line == pytest.approx([4 / 45 * 0.01 * 12 * 0.03, 0.03], rel=1e-7)


TIMES = np.array([10.0, 10.2, 10.25, 10.5, 10.85, 11.0])
X, Y = np.array([0.0, 0.1, 0.2, 0.15, 0.0, -0.1]), np.array([0.0, 0.05, 0.0, 0.1, 0.2, 0.15])


@pytest.mark.parametrize(("start", "exposure"), [(None, None), (10.1, 0.6), (10.2, None)])
def test_a_trace_is_the_time_average_over_the_exposure(start, exposure):
    locus = Trace.of(TIMES, X, Y, start, exposure)
    begin = TIMES[0] if start is None else start
    end = TIMES[-1] if exposure is None else begin + exposure
    inside = np.array([t for t in TIMES if begin < t < end])
    breaks = (np.concatenate([[begin], inside, [end]]) - begin) / (end - begin)

    def position(values):
        return lambda s: np.interp(begin + s * (end - begin), TIMES, values)

    for fx, fy in [(0.8, 0.3), (-0.5, 1.1)]:
        expected = time_average(position(X), position(Y), fx, fy, breaks)
        # 13 nodes a piece, each turning the phase by 1 rad
        assert complex(locus.transfer(fx, fy)) == pytest.approx(expected, abs=1e-12)


def test_a_trace_of_two_samples_is_a_drift():
    trace, drift = Trace.of([5, 7], [0, 0.3], [0, 0.4]), Linear.of(0.5, np.degrees(np.arctan2(4, 3)))
    assert np.asarray(trace.transfer(FX, FY)) == pytest.approx(np.asarray(drift.transfer(FX, FY)), abs=1e-13)


def test_three_nodes_a_piece_are_as_good_as_said():
    t = np.linspace(0, 1, 41)
    step = 0.3 * np.diff(np.sin(40 * t))
    exact = 0.0
    x = 0.3 * np.sin(40 * t)
    mean = np.mean((x[1:] + x[:-1]) / 2)
    for a, d in zip(x[:-1], step, strict=True):  # a straight piece is a sinc about its middle
        exact += np.exp(-2j * np.pi * (a + d / 2 - mean)) * np.sinc(d) / 40
    found = complex(Trace.of(t, x, 0 * t).transfer(1.0, 0.0))
    share = np.mean((2 * np.pi * np.abs(step)) ** 6)
    assert abs(found - exact) < 5e-7 * share


def test_when_the_samples_come_does_not_matter_where_they_lie_on_one_line():
    # A drift at constant speed, sampled at any times.
    t = np.array([0.0, 0.01, 0.02, 0.3, 0.9, 1.0])
    drift = np.asarray(Linear.of(0.5).transfer(FX, FY))
    assert np.asarray(Trace.of(t, 0.5 * t, 0 * t).transfer(FX, FY)) == pytest.approx(drift, abs=1e-6)


@pytest.mark.parametrize(
    ("build", "code", "values"),
    [
        (lambda: Trace.of([0, 1], [0, 1], [0]), ErrorCode.WRONG_SHAPE, ["(2,), (2,) and (1,)"]),
        (lambda: Trace.of([0], [0], [0]), ErrorCode.TOO_FEW, ["(1,), (1,) and (1,)"]),
        (lambda: Trace.of([0, 1, 1], [0] * 3, [0] * 3), ErrorCode.MALFORMED, ["sample 2", "1 s after 1 s"]),
        (lambda: Trace.of([0, 3, 1], [0] * 3, [0] * 3), ErrorCode.MALFORMED, ["sample 2", "1 s after 3 s"]),
        (lambda: Trace.of([0, 1], [0, np.nan], [0, 0]), ErrorCode.OUT_OF_RANGE, ["x is nan", "sample 1"]),
        (
            lambda: Trace.of([0, 1, 2], [0] * 3, [0] * 3, 0.2, 0.5),
            ErrorCode.TOO_FEW,
            ["0.2 to 0.7 s", "0 to 2 s"],
        ),
        (
            lambda: Trace.of([0, 1, 2], [0] * 3, [0] * 3, 1.0, 5.0),
            ErrorCode.OUT_OF_RANGE,
            ["0 to 2 s", "1 to 6 s"],
        ),
        (lambda: Path.of([[0.0, 0.0]]), ErrorCode.TOO_FEW, ["[[0.0, 0.0]]"]),
        (lambda: Path.of([1.5, 2.0]), ErrorCode.WRONG_SHAPE, ["[1.5, 2.0]"]),
        (lambda: Path.of([[1.5], [2.0]]), ErrorCode.WRONG_SHAPE, ["[[1.5], [2.0]]"]),
        (lambda: Path.of([[0.0, 0.0], [np.inf, 0.0]]), ErrorCode.OUT_OF_RANGE, ["[inf, 0.0]"]),
    ],
)
def test_impossible_paths_are_refused(build, code, values):
    with refused(code, *values, error=ConfigurationError):
        build()


def test_a_trace_is_read_from_a_table(tmp_path):
    path = tmp_path / "gyro.csv"
    path.write_text("# star tracker 2\nt, x, y\n0, 0.1, 0.2\n\n0.5,0.2,-1e-2\n# a gap\n1,0.3,0\n")
    t, x, y = read_trace(path)
    np.testing.assert_array_equal([t, x, y], [[0, 0.5, 1], [0.1, 0.2, 0.3], [0.2, -0.01, 0]])


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        ("", ErrorCode.MALFORMED, ["'nothing'", "t,x,y"]),
        ("0,1,2\n1,2,3\n", ErrorCode.MALFORMED, ["'0,1,2'", "t,x,y"]),
        ("t,x,y\n0,0,0\n1,oops,0\n", ErrorCode.MALFORMED, ["line 3", "column x", "'oops'"]),
        ("t,x,y\n0,0,0\n1,0,nan\n", ErrorCode.OUT_OF_RANGE, ["line 3", "column y", "'nan'"]),
        ("t,x,y\n0,0\n", ErrorCode.MALFORMED, ["line 2", "2 columns", "t,x,y"]),
        ("t,x,y\n0,0,0\n", ErrorCode.TOO_FEW, ["(1,), (1,) and (1,)"]),
        ("t,x,y\n1,0,0\n0,0,0\n", ErrorCode.MALFORMED, ["sample 1", "0 s after 1 s"]),
    ],
)
def test_a_table_that_is_no_trace_is_refused_with_its_place(text, code, values, tmp_path):
    path = tmp_path / "gyro.csv"
    path.write_text(text)
    with refused(code, path, *values, error=ConfigurationError):
        read_trace(path)


def test_a_table_that_cannot_be_read_is_refused_by_its_name(tmp_path):
    with refused(ErrorCode.NOT_FOUND, tmp_path / "none.csv", "t,x,y", error=ConfigurationError):
        read_trace(tmp_path / "none.csv")
    with refused(ErrorCode.NOT_READABLE, tmp_path, "t,x,y", error=ConfigurationError):
        read_trace(tmp_path)
    path = tmp_path / "gyro.csv"
    path.write_bytes(b"t,x,y\n\xff\xfe,0,0\n")
    with refused(ErrorCode.MALFORMED, path, "line 2", "column t", error=ConfigurationError):
        read_trace(path)


@pytest.mark.parametrize("knots", [2, 3, 4])
def test_a_path_that_passes_more_positions_is_the_same_curve(knots):
    path = Path.of(KNOTS[:knots])
    finer = path.finer(knots + 2)
    assert finer.knots == knots + 2
    np.testing.assert_allclose(finer.points(50), path.points(50), atol=1e-12)
    np.testing.assert_allclose(finer.moments(), path.moments(), rtol=1e-10)


def test_a_path_at_more_steps_passes_more_positions():
    """A report draws a path from its name and its coordinates."""
    path = Path.of(KNOTS)
    again = Path.near(np.array([1.0, 0.0, 1.0])).at(np.asarray(path.coords))
    assert (again.knots, again.names) == (path.knots, path.names)
    np.testing.assert_allclose(again.points(50), path.points(50), atol=1e-15)
