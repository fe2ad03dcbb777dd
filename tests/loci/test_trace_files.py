"""Traces from files: units in the header, rates that are integrated, gaps."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.loci import Trace, read_trace, trace_gaps

T = np.arange(0, 2, 0.001)
ANGLES = 0.1 * np.sin(2 * np.pi * 5 * T), 0.05 * np.cos(2 * np.pi * 3 * T)
RATES = 0.1 * 10 * np.pi * np.cos(2 * np.pi * 5 * T), -0.05 * 6 * np.pi * np.sin(2 * np.pi * 3 * T)
"""arcsec and arcsec/s."""

DEGREE, RADIAN = 3600.0, 180 / np.pi * 3600


class Said(list):
    """Sentences, without those on columns that have no unit."""

    def append(self, sentence):
        if "gives no unit" not in sentence:
            super().append(sentence)


@pytest.fixture
def write(tmp_path):
    def write(header, *columns):
        path = tmp_path / "trace.csv"
        np.savetxt(path, np.column_stack(columns), delimiter=",", header=header, comments="", fmt="%.15g")
        return path

    return write


@pytest.mark.parametrize(
    ("header", "rates", "unit"),
    [
        ("t,wx,wy", None, 1.0),
        ("t,wx,wy", "deg/s", DEGREE),
        ("t [s],wx [deg/s],wy [deg/s]", None, DEGREE),
        ("time (s),wx (rad/s),wy (rad/s)", None, RADIAN),
        ("t,x [mas/s],y [mas/s]", None, 1e-3),
        ("t,x,y", "rad/s", RADIAN),
        ("t,wx [deg/h],wy [deg/h]", None, 1.0),
    ],
)
def test_rates_are_integrated_when_the_header_or_an_option_says_so(header, rates, unit, write):
    said = Said()
    _, x, y = read_trace(write(header, T, *(v / unit for v in RATES)), rates, said.append)
    # Simpson's rule is off by (2 pi 5 / 1000)⁴ / 180 of the swing, ten times that at the ends
    for found, angle in zip((x, y), ANGLES, strict=True):
        np.testing.assert_allclose(found, angle - np.trapezoid(angle, T) / T[-1], atol=1e-6)
    assert len(said) == 1


@pytest.mark.parametrize(
    ("header", "factors"),
    [
        ("t,x,y", (1, 1, 1)),
        ("t [ms],x [mas],y [arcsec]", (1e-3, 1e-3, 1)),
        ("T [s],X [deg],Y [urad]", (1, DEGREE, 1e-6 * RADIAN)),
    ],
)
def test_angles_are_converted_and_not_integrated(header, factors, write):
    said = Said()
    found = read_trace(write(header, T, *ANGLES), log=said.append)
    for values, written, factor in zip(found, (T, *ANGLES), factors, strict=True):
        np.testing.assert_allclose(values, written * factor, rtol=1e-12, atol=1e-15)
    assert said == []


@pytest.mark.parametrize(
    ("header", "rates", "code", "values"),
    [
        ("t,x [deg/s],y [deg]", None, ErrorCode.CONFLICT, ["x [deg/s]", "y [deg]"]),
        ("t,wx [deg],wy [deg]", None, ErrorCode.CONFLICT, ["wx [deg]", "wy [deg]"]),
        ("t,x [deg],y [deg]", "deg/s", ErrorCode.CONFLICT, ["x [deg]"]),
        ("t,x,y", "deg", ErrorCode.CONFLICT, ["x", "y"]),
        ("t,wx,wy", "parsec", ErrorCode.UNKNOWN_UNIT, ["'parsec'", "wx", "arcsec/s"]),
        ("t [m],x,y", None, ErrorCode.UNKNOWN_UNIT, ["'m'", "t", "s"]),
        ("t,a,b", None, ErrorCode.MALFORMED, ["'t,a,b'", "t,x,y"]),
    ],
)
def test_what_is_neither_is_refused(header, rates, code, values, write):
    path = write(header, T, *RATES)
    with refused(code, path, *values):
        read_trace(path, rates)


def test_what_the_pointing_did_in_a_gap_is_not_made_up(write):
    """A rate that happens to be high at both ends of a hole of 10 s would carry the pointing far away."""
    keep = (T < 0.9997) | (T > 1.2)
    t = np.where(T > 1.1, T + 10, T)[keep]
    _, x, _ = read_trace(write("t,wx,wy", t, *(v[keep] for v in RATES)))
    assert np.abs(x).max() < 0.2
    for piece in (t < 5, t > 5):
        expected = ANGLES[0][keep][piece]
        np.testing.assert_allclose(np.ptp(x[piece]), np.ptp(expected), rtol=1e-3)


def test_gaps_are_holes_of_several_steps():
    t = np.arange(100.0)
    t[50:] += 9.0
    t[70:] += 2.0  # two samples were lost
    assert list(trace_gaps(t)) == [49]
    assert list(trace_gaps([0.0, 1.0, 100.0])) == []  # a path of two pieces


def test_a_trace_with_a_gap_in_the_exposure_is_refused():
    t = T[(T < 0.4005) | (T > 0.5995)]
    x = np.sin(t)
    assert Trace.of(t, x, x, 0.0, 0.4).moments()[0] > 0
    with refused(ErrorCode.OUT_OF_RANGE, "0.4", "0.6 s", "0.3", "0.7 s"):
        Trace.of(t, x, x, 0.3, 0.4)


NOISE = 0.1 * np.random.default_rng(4).standard_normal((2, 5000))
CODES = [  # values in samples 100 to 102, or a share of all, samples left out, what is said
    (-999.0, 3, 3, "-999 in 3 samples"), (-9999.0, 3, 3, "-9999 in 3"), (99.99, 3, 3, "99.99 in 3"),
    (1e30, 3, 3, "1e+30 in 3"), (1e30, 1, 1, "1e+30 in 1"), (-32768.0, 3, 3, "-32768 in 3"),
    (np.nan, 3, 3, "3 samples of the trace have no value"),
    (2.048, 40, 40, "2.048 in 40"),  # a sensor at its limit
    (-999.0, 2000, 2000, "-999 in 2000"), (3.7, 2000, 0, "does not change"),
    (5.1, 1, 0, "1 of 5000 samples, the farthest 5.1"), (-999.0, 1, 0, "-999 in one sample"),
]  # fmt: skip


@pytest.mark.parametrize(("value", "count", "lost", "word"), CODES)
@pytest.mark.parametrize("header", ["t,x,y", "t,wx [mas/s],wy [mas/s]"])
def test_numbers_that_stand_for_missing_ones_are_gaps(value, count, lost, word, header, write):
    t, (x, y) = 0.01 * np.arange(5000), NOISE.copy()
    y[100 : 100 + count] = value
    said = Said()
    found = read_trace(write(header, t, x, y), log=said.append)
    kept = np.ones(len(t), bool)
    kept[100 : 100 + count] = not lost
    np.testing.assert_allclose(found[0], t[kept])
    if header == "t,x,y":
        np.testing.assert_allclose(found[1:], (x[kept], y[kept]))
    said = [sentence for sentence in said if "integrated" not in sentence]
    assert len(said) == bool(word)
    assert not word or word in said[0]


def test_one_outlier_of_a_short_trace_is_said(write):
    """Of 50 samples one is more than a hundredth."""
    (x, y), said = NOISE[:, :50].copy(), Said()
    x[20] = 5.1
    assert len(read_trace(write("t,x,y", np.arange(50.0), x, y), log=said.append)[0]) == 50
    assert ["1 of 50 samples, the farthest 5.1" in sentence for sentence in said] == [True]


def test_several_codes_are_found_and_without_a_listener_python_warns(write):
    t, (x, y) = 0.01 * np.arange(5000), NOISE.copy()
    x[10:20], x[30:32], y[40:45] = -9999.0, 1e20, 99.0
    with pytest.warns(UserWarning, match="has no value|far from all others") as caught:
        assert len(read_trace(write("t,x,y", t, x, y))[0]) == 5000 - 17
    assert len(caught) == 3


@pytest.mark.parametrize(
    "x",
    [
        np.round(10 * np.sin(T * 30)) * 11,  # of a coarse converter: -99 and 99 have neighbours
        np.where(T % 0.4 < 0.2, 0.0, 5.0),
        np.where(T < 1.9, 0.001 * np.sin(40 * T), 5 * (T - 1.9)),  # a slew
        np.cumsum(np.random.default_rng(1).choice([-1.0, 1.0], T.size)),
    ],
)
def test_motion_of_all_kinds_has_no_missing_samples(x, write):
    said = Said()
    assert len(read_trace(write("t,x,y", T, x, np.zeros_like(T)), log=said.append)[0]) == T.size
    assert not said


@pytest.mark.parametrize("length", [8, 300])
@pytest.mark.parametrize("step", [None, 0.05])
def test_a_sensor_that_holds_its_last_value_is_reported(length, step, write):
    t, (x, y) = 0.01 * np.arange(5000), NOISE.copy()
    if step is not None:
        x = np.round(x / step) * step  # of a converter
    x[1000 : 1000 + 10 * length] = x[1000]
    said = Said()
    assert len(read_trace(write("t,x,y", t, x, y), log=said.append)[0]) == len(t)
    assert len(said) == 1
    assert f"from t = {t[1000]:g} to {t[999 + 10 * length]:g}" in said[0]


def test_a_path_that_somebody_drew_is_kept(write):
    said, x = Said(), np.array([0.0, 0.1, 0.2, 8.0, 8.0, 0.1])
    np.testing.assert_array_equal(read_trace(write("t,x,y", np.arange(6), x, x), log=said.append)[1], x)
    assert not said


@pytest.mark.parametrize(
    ("header", "words"),
    [("t,x,y", "t, x, y: read as s, arcsec, arcsec"), ("t [s],wx,wy", "wx, wy: read as arcsec/s, arcsec/s")],
)
def test_the_units_of_columns_without_one_are_said(header, words, write):
    said = []
    read_trace(write(header, T, *ANGLES), log=said.append)
    assert f"The header gives no unit for {words}." in said


@pytest.mark.parametrize(
    "words",
    [
        *("t in μs", "time (msec)", "t/ms", "t in ns", "days", "t: MJD", "ticks of 10 s"),
        *(
            "µrad",
            "μrad²",
            "microradians",
            "Degrees",
            "MAS",
            "°",
            "x, y in px",
            "microns",
            "lambda/D",
            "arcmin",
            "units mas2",
            "in 10 mas",
            "units of 7.7 ms",
            "10 log10",
        ),
        *("in weeks", "t in years", "positions in pixels"),
        *("arcsec/s", '"/s', "gyro rates", "angular velocity", "increments per sample"),
    ],
)
def test_a_comment_with_another_unit_is_refused_where_the_columns_have_none(words, write):
    with refused(ErrorCode.CONFLICT, "line 1"):
        read_trace(write(f"# {words}\nt,x,y", T, *ANGLES))


@pytest.mark.parametrize(
    "words",
    [
        *("s and arcseconds", "sampling rate 1000 Hz", "start: MJD 61000.5", "rate: 1000 Hz", "eV rms"),
        *("latency 7.7 ms", "camera of 512 x 512 pixels", "0.375 arcsec per pixel", "slew of 37 deg"),
        *("filter: -3 dB at 20 Hz", "wheel at 3000 rpm", "20 deg C", "log file 3", "recorded on day 3"),
        *("samples: 3 minutes of 12 days", "number of counts: 12", "rms 0.123 arcsec"),
    ],
)
def test_a_comment_without_another_unit_is_none(words, write):
    np.testing.assert_allclose(read_trace(write(f"# {words}\nt,x,y", T, *ANGLES))[1], ANGLES[0])


@pytest.mark.parametrize(
    "words", ["step {step} ms", "record of {end} ms", "peak {peak} mas", "scatter {rms} mas"]
)
def test_a_number_of_the_table_itself_says_its_unit(words, write):
    t = np.arange(300) * 2.0
    x, y = 80 * np.sin(t / 9), 50 * np.cos(t / 9)
    numbers = {"step": 2, "end": t[-1], "peak": 80, "rms": np.hypot(np.std(x), np.std(y))}
    with refused(ErrorCode.CONFLICT, "line 1"):
        read_trace(write(f"# {words.format(**numbers)}\nt,x,y", t, x, y))
    with_another = {name: 1.4 * number for name, number in numbers.items()}
    np.testing.assert_allclose(read_trace(write(f"# {words.format(**with_another)}\nt,x,y", t, x, y))[1], x)


@pytest.mark.parametrize(
    ("header", "times"),
    [
        ("t", ["2026-02-28T23:59:59.75", "2026-03-01T00:00:00.25", "2026-03-01T00:00:01"]),
        ("time [UTC]", ["2026-02-28 23:59:59.75Z", "2026-03-01 00:00:00.25Z", "2026-03-01 00:00:01Z"]),
        ("t", ["2026-03-01T01:59:59.75+02:00", "2026-03-01T02:00:00.25+02:00", "2026-03-01T02:00:01+02:00"]),
    ],
)
def test_times_may_be_dates(header, times, tmp_path):
    path = tmp_path / "trace.csv"
    path.write_text(f"{header},x,y\n" + "".join(f"{when},{k},0\n" for k, when in enumerate(times)))
    np.testing.assert_allclose(read_trace(path, log=str)[0] - T_MARCH, [-0.25, 0.25, 1], atol=1e-6)


T_MARCH = 1772323200
"""1 March 2026, seconds since 1970: 56 years of 365 days, 14 leap days and 59 days."""


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        ("t [ms],x,y\n2026-03-01T00:00:00,0,0\n2026-03-01T00:00:01,1,0\n", ErrorCode.CONFLICT, ["'ms'"]),
        ("t,x,y\n2026-03-01T00:00:00,0,0\n1.5,1,0\n", ErrorCode.MALFORMED, ["line 3", "'1.5'"]),
        ("t,x,y\n0,0,0\n2026-03-01T00:00:00,1,0\n", ErrorCode.MALFORMED, ["line 3", "column t"]),
        ("t,x,y\n01.03.2026 00:00,0,0\n", ErrorCode.MALFORMED, ["line 2", "column t"]),
    ],
)
def test_times_that_are_dates_by_halves_are_refused(text, code, values, tmp_path):
    (tmp_path / "trace.csv").write_text(text)
    with refused(code, *values):
        read_trace(tmp_path / "trace.csv")
