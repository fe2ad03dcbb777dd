"""Tables of measured spectra keep their power; curves keep their power laws; and lines are listed."""

import numpy as np
import pytest
from refusals import refused
from scipy.signal import periodogram, welch

from jitterkit.errors import ErrorCode
from jitterkit.motion import PowerSpectrum, Record, read_motion, split_spectrum, trace_spectrum
from jitterkit.motion.bins import recognise_rows, spectrum_of_bins

RATE, N = 1000.0, 20000
T = np.arange(N) / RATE


def power(spectrum, exposure=0.1):
    """Second moments of everything in a spectrum."""
    split = split_spectrum(spectrum, exposure)
    return split.displacement + split.smear + split.jitter


def densities(x, y=None):
    y = x if y is None else y
    return np.stack([x, np.zeros_like(x), y], axis=1)


@pytest.fixture
def signal(rng):
    """A vibration of 0.1 arcsec at 37 Hz over little noise."""
    return 0.1 * np.sin(2 * np.pi * 37 * T) + 1e-3 * rng.standard_normal(N)


@pytest.fixture
def write(tmp_path):
    def write(columns, header="f,x,y", comment="", fmt="%.8g"):
        path = tmp_path / "psd.csv"
        np.savetxt(
            path, np.column_stack(columns), delimiter=",", header=comment + header, comments="", fmt=fmt
        )
        return path

    return write


@pytest.mark.parametrize("segment", [64, 1000, 4096])
@pytest.mark.parametrize("window", ["hann", "boxcar", "flattop"])
def test_a_welch_table_keeps_its_power(signal, segment, window, write):
    f, p = welch(signal, RATE, window, segment)
    np.testing.assert_allclose(
        power(read_motion(write((f, p, 2 * p))))[[0, 2]] / p[1:].sum() / f[1], [1, 2], 1e-6
    )


def test_a_periodogram_keeps_the_variance_of_the_signal(signal, write):
    f, p = periodogram(signal, RATE)
    assert power(read_motion(write((f, p, p))))[0] == pytest.approx(np.var(signal), rel=1e-6)


def test_a_line_in_the_bins_is_a_line(signal, write):
    f, p = welch(signal, RATE, nperseg=4096)
    said = []
    spectrum = read_motion(write((f, p, p / 4)), log=said.append)
    (line,) = spectrum.lines
    assert line.frequency == pytest.approx(37, abs=0.01)
    assert (line.amplitude, line.minor) == pytest.approx((0.1, 0.05), rel=1e-3)
    assert any("37 Hz" in sentence for sentence in said)


def test_two_axes_that_move_together_are_one_line_on_an_axis():
    f = np.arange(1, 201.0)
    p = np.full(200, 1e-9)
    p[79] = 1e-3
    density = np.stack([3 * p, np.sqrt(3) * p, p], axis=1)
    (line,) = spectrum_of_bins(f, density).lines
    assert (line.frequency, line.angle) == pytest.approx((80, 30))
    assert line.amplitude == pytest.approx(np.sqrt(2 * 4e-3), rel=1e-5)
    assert line.minor == pytest.approx(0, abs=1e-6)


@pytest.mark.parametrize("slope", [0, -2, -4])
def test_noise_of_one_periodogram_has_no_lines_and_all_its_power(slope, rng):
    f = np.arange(1, 20001.0)
    p = rng.exponential(size=20000) * f**slope
    spectrum = spectrum_of_bins(f, densities(p))
    assert spectrum.lines == ()
    # of the last bins, as wide as 5e-5 of their frequency, 1e-12 of that is between them
    assert power(spectrum)[0] == pytest.approx(p.sum(), rel=2e-8)


def test_a_resonance_wider_than_a_few_bins_stays_random():
    f = np.arange(1, 2000) * 0.25
    p = 1e-8 + 1e-2 / ((f**2 - 37**2) ** 2 + (37 * f / 20) ** 2)
    spectrum = spectrum_of_bins(f, densities(p))
    assert spectrum.lines == ()
    assert power(spectrum)[0] == pytest.approx(p.sum() * 0.25, rel=1e-9)


def test_bins_at_equal_ratios_keep_their_power(signal, write):
    """Power of a fine spectrum, summed into twelfths of an octave and divided by their widths."""
    f, p = periodogram(signal, RATE)
    edges = 2 ** (np.arange(-12, 12 * np.log2(500)) / 12)
    held, _ = np.histogram(f, edges, weights=p * f[1])
    found = power(read_motion(write((np.sqrt(edges[1:] * edges[:-1]), *[held / np.diff(edges)] * 2))))
    assert found[0] == pytest.approx(held.sum(), rel=1e-6)


@pytest.mark.parametrize("shift", [np.fft.fftshift, np.asarray], ids=["ascending", "as fft orders them"])
def test_a_two_sided_table_has_the_same_power(signal, shift, write):
    f, p = welch(signal, RATE, nperseg=1000, return_onesided=False)
    found = power(read_motion(write((shift(f), shift(p), shift(p)))))
    assert found[0] == pytest.approx(p[1:].sum() * f[1], rel=1e-6)


def test_frequencies_and_their_negatives_may_differ_by_rounding(signal, write):
    f = np.arange(-500, 500, 0.1)  # -0.1 is there as -0.1000000000113
    _, p = welch(signal, RATE, nperseg=len(f), return_onesided=False)
    p = np.fft.fftshift(p)
    read = read_motion(write((f, p, p), fmt="%.18e"))
    assert power(read)[0] == pytest.approx(0.1 * p[np.abs(f) > 0.01].sum(), rel=1e-6)
    with refused(ErrorCode.MALFORMED, "400.1 Hz", "one side"):
        read_motion(write((f[1000:], p[1000:], p[1000:]), fmt="%.18e"))


@pytest.mark.parametrize(("low", "high"), [(45, 55), (37.3, 80), (20, 60)])
def test_a_gap_in_the_bins_has_no_power(signal, low, high, write):
    f, p = welch(signal, RATE, nperseg=4096)
    keep, said = (f < low) | (f > high), []
    read = read_motion(write((f[keep], p[keep], p[keep])), kind="bins", log=said.append)
    assert power(read)[0] == pytest.approx(f[1] * p[keep][1:].sum(), rel=1e-3)
    assert any(f"from {f[keep][f[keep] < low][-1]:.5g} to" in sentence for sentence in said)


@pytest.mark.parametrize(
    "missing", [slice(300, 301), slice(300, 302), slice(200, 400), np.r_[200:203, 400:401, 405:450]]
)
@pytest.mark.parametrize("form", ["%.18e,%.18e,%.18e", "%.2f,%.6e,%.6e"])
def test_rows_that_are_uniform_but_for_gaps_are_bins(signal, missing, form, write):
    f, p = (np.delete(values, missing) for values in welch(signal, RATE, nperseg=1024))
    said = []
    read = read_motion(write((f, p, p), fmt=form), log=said.append)
    assert power(read)[0] == pytest.approx(RATE / 1024 * p[1:].sum(), rel=2e-3)
    assert any("bins of a measured spectrum" in sentence for sentence in said)
    assert any("missing from" in sentence for sentence in said)


@pytest.mark.parametrize(
    "f",
    [[*range(20, 320, 10), 500, 1000, 2000], [*range(1, 11), *range(91, 101)]],
    ids=["beyond", "far apart"],
)
def test_points_of_a_curve_are_no_bins_though_some_are_uniform(f):
    f = np.array(f)
    with refused(ErrorCode.MISSING_VALUE, "--kind"):
        recognise_rows(f, densities(f**-1.0))


def test_a_table_that_says_it_is_two_sided_is_doubled(write):
    f, said = np.arange(1, 101.0), []
    path = write((f, 0 * f + 1e-6, 0 * f), comment="# two-sided\n")
    assert power(read_motion(path, log=said.append))[0] == pytest.approx(2e-4, rel=1e-6)
    assert any("two-sided" in sentence for sentence in said)
    path.write_text("# one-sided, once two-sided\n" + path.read_text())
    with refused(ErrorCode.CONFLICT, path, "one-sided", "two-sided"):
        read_motion(path)


@pytest.mark.parametrize(
    ("header", "factor"),
    [
        ("f [Hz],x [arcsec2/Hz],y [arcsec²/Hz]", 1),
        ("f (kHz),x (mas^2/kHz),y (mas^2/kHz)", 1e-6),
        ("freq,psd_x[urad2/Hz],psd_y[urad2/Hz]", (1e-6 * 180 / np.pi * 3600) ** 2),
        ("f,asd_x,asd_y", 1e-6),
        ("frequency,x[mas/sqrt(Hz)],y[mas/√Hz]", 1e-12),
        ("f,x_asd[mas/rtHz],y_asd[mas/rtHz]", 1e-12),
    ],
)
def test_units_and_roots_of_densities_are_read_from_the_header(header, factor, write):
    """A density of 1e-6 in the unit of the header, over 100 units of frequency."""
    f = np.arange(1, 101.0)
    found = power(read_motion(write((f, 0 * f + 1e-6, 0 * f + 1e-6), header)))
    assert found[0] == pytest.approx(100 * 1e-6 * factor, rel=1e-6)


@pytest.mark.parametrize(
    ("header", "code", "values"),
    [
        ("f,x[furlong],y", ErrorCode.UNKNOWN_UNIT, ["'furlong'", "x", "arcsec2/Hz"]),
        ("f,x[mas/Hz],y", ErrorCode.UNKNOWN_UNIT, ["'mas/Hz'", "x"]),
        ("f[s],x,y", ErrorCode.UNKNOWN_UNIT, ["'s'", "f", "Hz"]),
        ("f,x[mas/√Hz],y", ErrorCode.CONFLICT, ["roots"]),
    ],
)
def test_a_unit_that_does_not_suit_is_refused(header, code, values, write):
    f = np.arange(1, 101.0)
    path = write((f, f, f), header)
    with refused(code, path, *values):
        read_motion(path)


def test_a_drawn_curve_keeps_its_power_law(write):
    """f^-2 from 0.1 to 100 Hz by four points, and by 3 points an octave apart: the integral is 1/a - 1/b."""
    said = []
    for f in (np.array([0.1, 1.0, 10.0, 100.0]), 2.0 ** np.arange(-3, 8)):
        found = power(read_motion(write((f, f**-2, 0 * f)), log=said.append))
        assert found[0] == pytest.approx(1 / f[0] - 1 / f[-1], rel=1e-6)
    assert sum("curve" in sentence for sentence in said) == 2


def test_a_row_at_zero_is_left_out_with_a_word(write):
    f, said = np.arange(101.0), []
    p = np.where(f == 0, 1e6, 1e-6)
    assert power(read_motion(write((f, p, p)), log=said.append))[0] == pytest.approx(1e-4, rel=1e-6)
    assert any("0 Hz" in sentence for sentence in said)


def test_rows_that_may_be_either_are_asked_about(write, rng):
    f = np.sort(rng.uniform(1, 100, 40))
    p = rng.exponential(size=40)
    path = write((f, p, p))
    with refused(ErrorCode.MISSING_VALUE, path, 40, "--kind bins", "--kind curve"):
        read_motion(path)
    bins, curve = (power(read_motion(path, kind=kind))[0] for kind in ("bins", "curve"))
    middles = np.concatenate(
        [[f[0] - (f[1] - f[0]) / 2], (f[1:] + f[:-1]) / 2, [f[-1] + (f[-1] - f[-2]) / 2]]
    )
    assert bins == pytest.approx(np.sum(p * np.diff(middles)), rel=1e-6)
    fine = np.geomspace(f[0], f[-1], 400001)
    drawn = np.exp(np.interp(np.log(fine), np.log(f), np.log(p)))
    assert curve == pytest.approx(np.trapezoid(drawn, fine), rel=1e-3)


def test_rows_where_it_does_not_matter_are_not_asked_about(rng):
    f = np.sort(rng.uniform(1, 100, 400))
    assert recognise_rows(f, densities(1 / (100 + f))) == "curve"


def test_frequencies_that_were_rounded_in_print_are_still_uniform(write, signal):
    f, p = welch(signal, RATE, nperseg=4096)
    assert power(read_motion(write((f, p, p), fmt="%.2f,%.6e,%.6e")))[0] == pytest.approx(
        p[1:].sum() * f[1], rel=1e-3
    )


def test_the_estimate_of_a_record_keeps_its_power_and_lists_its_line(signal):
    spectrum = trace_spectrum(Record(T, signal, 0 * T))
    (line,) = spectrum.lines
    assert (line.frequency, line.amplitude, line.minor) == pytest.approx((37, 0.1, 0), rel=1e-3, abs=1e-9)
    assert power(spectrum)[0] == pytest.approx(np.var(signal), rel=0.01)


def test_options_for_another_kind_of_table_are_refused(tmp_path, write):
    trace = tmp_path / "trace.csv"
    trace.write_text("t,x,y\n0,0,0\n1,1,1\n")
    with refused(ErrorCode.CONFLICT, trace, "--kind"):
        read_motion(trace, kind="bins")
    path = write((np.arange(1, 10.0),) * 3)
    with refused(ErrorCode.CONFLICT, path, "--rates"):
        read_motion(path, rates="deg/s")
    with refused(ErrorCode.UNKNOWN_NAME, "'line'", "bins", "curve"):
        read_motion(path, kind="line")
    with refused(ErrorCode.UNKNOWN_UNIT, "rates", "deg/s"):
        read_motion(trace, rates="")
    lines = tmp_path / "lines.csv"
    lines.write_text("frequency,amplitude,angle\n3,0.2,0\n")
    with refused(ErrorCode.CONFLICT, lines, "--kind", "lines"):
        read_motion(lines, kind="curve")
    assert isinstance(read_motion(path), PowerSpectrum)
