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
    said = []
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
    said = []
    found = read_trace(write(header, T, *ANGLES), tell=said.append)
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
