from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.motion import Line, PowerSpectrum, Record, read_motion


@pytest.fixture
def table(tmp_path):
    def write(text: str) -> Path:
        path = tmp_path / "motion.csv"
        path.write_text(text, encoding="utf-8")
        return path

    return write


def test_densities_are_read_with_and_without_a_cross_spectrum(table):
    plain = read_motion(table("# Hz\nf,x,y\n\n1,2,3\n 10, 0.2 ,0.3\n"))
    np.testing.assert_array_equal(plain.frequencies, [1, 10])
    np.testing.assert_array_equal(plain.density, [[2, 0, 3], [0.2, 0, 0.3]])
    crossed = read_motion(table("f,x,y,xy\n1,2,3,-1\n10,2,3,0.5\n"))
    np.testing.assert_array_equal(crossed.density[:, 1], [-1, 0.5])


def test_lines_are_read_alone_or_below_the_densities(table):
    lines = read_motion(table("frequency,amplitude,angle\n61,0.02,30\n")).lines
    assert lines == (Line(61, 0.02, 30),)
    both = read_motion(table("f,x,y\n1,2,3\n2,2,3\nfrequency,amplitude,angle,minor\n61,0.02,30,0.01\n"))
    assert isinstance(both, PowerSpectrum)
    assert (len(both.frequencies), both.lines) == (2, (Line(61, 0.02, 30, 0.01),))


def test_a_trace_is_recognised_by_its_header(table):
    record = read_motion(table("t,x,y\n0,1,2\n0.5,3,4\n"))
    assert isinstance(record, Record)
    np.testing.assert_array_equal(record, [[0, 0.5], [1, 3], [2, 4]])


def test_hst_s_frequencies_are_read():
    lines = read_motion(Path(__file__).parents[2] / "sample_frames" / "motion" / "hst.csv").lines
    assert {0.1, 4, 15, 30, 61, 300} <= {line.frequency for line in lines}


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        ("", ErrorCode.MALFORMED, ["f,x,y"]),
        ("f,x,y\n", ErrorCode.MALFORMED, ["f,x,y"]),
        ("f,x,y\n1,2,3\n", ErrorCode.TOO_FEW, ["line 2"]),
        ("freq,psd\n1,2\n", ErrorCode.MALFORMED, ["line 1", "'freq,psd'"]),
        ("f,x,y\n1,2\n", ErrorCode.MALFORMED, ["line 2", "2 columns", "f,x,y"]),
        ("#\nf,x,y\n1,2,three\n", ErrorCode.MALFORMED, ["line 3", "column y", "'three'"]),
        ("f,x,y\n1,2,nan\n", ErrorCode.OUT_OF_RANGE, ["line 2", "column y", "'nan'"]),
        ("f,x,y\n2,1,1\n1,1,1\n", ErrorCode.MALFORMED, ["row 2", "1 Hz"]),
        ("f,x,y\n1,1,1\n2,1,1\nf,x,y,xy\n", ErrorCode.DUPLICATE, ["line 4"]),
        ("frequency,amplitude,angle\n-1,1,0\n", ErrorCode.OUT_OF_RANGE, ["line 2", "frequency", -1]),
        ("t,x,y\n0,0,0\n0,0,0\n", ErrorCode.MALFORMED, ["sample 1", "0 s"]),
        ("f,x,y\n0,1,1\n", ErrorCode.TOO_FEW, ["line 2"]),
        ("# PSD in mas^2/Hz\nf,x,y\n1,1,1\n2,1,1\n", ErrorCode.CONFLICT, ["line 1", "'mas'", "x [mas]"]),
        ("# f in rad/s\nf,x,y\n1,1,1\n2,1,1\n", ErrorCode.CONFLICT, ["line 1", "'rad/s'"]),
        ("# ASD of the tip\nf,x,y\n1,1,1\n2,1,1\n", ErrorCode.CONFLICT, ["line 1", "'ASD'"]),
        ("#\n# rms\nfrequency,amplitude,angle\n1,1,0\n", ErrorCode.CONFLICT, ["line 2", "'rms'"]),
        ("# t in ms\nt,x,y\n0,0,0\n1,1,0\n", ErrorCode.CONFLICT, ["line 1", "'ms'"]),
        ("t;x;y\n0;1,000;0\n1;2,000;0\n", ErrorCode.MALFORMED, ["line 2", "column x", "'1,000'"]),
        ("t;x;y\n0;0,1;0\n1;0.1;0\n", ErrorCode.MALFORMED, ["line 2", "column x", "'0,1'"]),
        ("t,x,y\n0,1_0,0\n1,1,0\n", ErrorCode.MALFORMED, ["line 2", "column x", "'1_0'"]),
        ("# time x ray\n0 1 2\n", ErrorCode.MALFORMED, ["line 2", "t,x,y"]),
        (
            "# %ECSV 1.0\n# - {name: x, unit: mas, datatype: float64}\nt x y\n0 1 2\n",
            ErrorCode.CONFLICT,
            ["line 2", "'mas'"],
        ),
        ("# mas\nhello\n1\n", ErrorCode.CONFLICT, ["line 1", "'mas'"]),
        ("t,x [px],y [px]\n0,0,0\n1,1,0\n", ErrorCode.UNKNOWN_UNIT, ["'px'"]),
        ("f [rad/s],x,y\n1,1,1\n2,1,1\n", ErrorCode.CONFLICT, ["f [rad/s]", "per rad/s"]),
        ("f [rad/s],x [mas² s],y [mas² s]\n1,1,1\n2,1,1\n", ErrorCode.CONFLICT, ["f [rad/s]", "per rad/s"]),
        ("f,x [dB(mas²/Hz)],y [dB(mas²/Hz)]\n1,1,1\n2,1,1\n", ErrorCode.UNKNOWN_UNIT, ["'dB(mas²/Hz)'"]),
        ("f,x [dB],y [dB]\n1,1,1\n2,1,1\n", ErrorCode.UNKNOWN_UNIT, ["'dB'"]),
        ("t,x [deg],y [deg]\n0,359.999,0\n1,0.001,0\n", ErrorCode.OUT_OF_RANGE, ["45 degrees", "0 s"]),
        ("t,x [deg],y [deg]\n0,179.999,0\n1,0.001,0\n", ErrorCode.OUT_OF_RANGE, ["45 degrees", "0 s"]),
    ],
)
def test_what_is_no_motion_is_one_sentence_with_its_place(text, code, values, table):
    with refused(code, *values) as caught:
        read_motion(table(text))
    assert str(caught.value).startswith(str(table("")))


@pytest.mark.parametrize(
    ("text", "values"),
    [
        ("frequency,amplitude,angle\n3,1e300,0\n", ("line 2", "amplitude", "1e+300", "1e+15")),
        ("frequency,amplitude,angle,minor\n3,1,0,1e16\n", ("line 2", "minor", "1e+16")),
        ("f,x,y\n1,1e300,1e300\n2,1,1\n", ("1 Hz", "1e+300", "1e+30")),
        ("f,asd_x,asd_y\n1,1e200,1\n2,1,1\n", ("1 Hz", "inf, 1")),
    ],
)
def test_motions_larger_than_any_angle_are_refused(text, values, table):
    with refused(ErrorCode.OUT_OF_RANGE, *values):
        read_motion(table(text))


def test_a_file_that_is_no_table_is_refused(table, tmp_path):
    with refused(ErrorCode.MALFORMED, "field limit"):
        read_motion(table('{"t":"' + "0" * 200_000 + '","x":0}'))
    with refused(ErrorCode.MALFORMED, "line 1") as caught:
        read_motion(table("{ " + "0" * 200_000))
    assert len(str(caught.value)) < 500
    (tmp_path / "t.csv").write_bytes(b"t,x,y\xb5\n0,0,\0\n")
    with refused(ErrorCode.MALFORMED, tmp_path / "t.csv", "f,x,y"):
        read_motion(tmp_path / "t.csv")


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with refused(ErrorCode.NOT_FOUND, tmp_path / "none.csv", "f,x,y"):
        read_motion(tmp_path / "none.csv")


@pytest.mark.parametrize(
    ("words", "factor"),
    [
        ("two-sided", 2),
        ("two_sided", 2),
        ("Two‑sided", 2),
        ("both sides", 2),
        ("sided: two", 2),
        ("return_onesided=False", 2),
        ("twosided", 2),
        ("double-sided", 2),
        ("2-sided", 2),
        ("not one-sided", 2),
        ("one-sided", 1),
        ("single-sided", 1),
        ("not two-sided", 1),
        ("of the tip", 1),
    ],
)
def test_densities_of_two_sides_are_doubled_where_a_comment_says_so(words, factor, table):
    spectrum = read_motion(table(f"# densities, {words}\nf,x,y\n1,2,3\n10,0.2,0.3\n"))
    np.testing.assert_allclose(spectrum.density[:, 0], [2 * factor, 0.2 * factor])


def test_a_comment_may_name_units_where_the_header_does(table):
    record = read_motion(table("# from degrees, in mas\nt [ms],x [mas],y [mas]\n0,1,2\n500,3,4\n"))
    np.testing.assert_allclose(record, [[0, 0.5], [1e-3, 3e-3], [2e-3, 4e-3]])


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        ("# in mas^2/Hz\nf [Hz],x,y\n1,2,3\n2,2,3\n", ErrorCode.CONFLICT, ("line 1", "'mas'", "x [mas]")),
        ("# time in ms\nt,x [mas],y [mas]\n0,1,2\n1,3,4\n", ErrorCode.CONFLICT, ("line 1", "'ms'", "t [ms]")),
        (
            "# peak-to-peak\nfrequency,amplitude [mas],angle\n10,1,0\n",
            ErrorCode.CONFLICT,
            ("'peak-to-peak'",),
        ),
        ("# rms\nfrequency,amplitude [mas],angle\n10,1,0\n", ErrorCode.CONFLICT, ("'rms'", "zero to peak")),
        ("# cumulative\nf,x,y\n1,2,3\n2,2,3\n", ErrorCode.CONFLICT, ("'cumulative'",)),
        ("f,x [mas2/Hz],y\n1,2,3\n2,2,3\n", ErrorCode.CONFLICT, ("x [mas2/Hz], y", "only some")),
        ("t,x [mas],y\n0,1,2\n1,3,4\n", ErrorCode.CONFLICT, ("x [mas], y", "only some")),
        ("frequency,amplitude,angle\n10,1,0\n20,1,0\n10,1,0\n", ErrorCode.DUPLICATE, ("10 Hz", "twice")),
    ],
)
def test_a_table_that_says_its_units_or_lines_by_halves_is_refused(text, code, values, table):
    with refused(code, *values):
        read_motion(table(text))


def test_two_units_for_the_same_rates_are_refused(table):
    path = table("t,wx [deg/s],wy [deg/s]\n0,1,2\n1,3,4\n2,3,4\n")
    with refused(ErrorCode.CONFLICT, "rad/s", "wx [deg/s]"):
        read_motion(path, rates="rad/s")


@pytest.mark.parametrize(
    "words",
    [
        *("arcsec/rtHz", "arcsec/√Hz", "arcsec/sqrt(Hz)", "per root Hz", "arcsec Hz^-1/2", "arcsec/Hz^0.5"),
        *(
            "linear spectral density",
            "amplitude spectrum",
            "scaling='spectrum'",
            "power per bin",
            "running sum",
        ),
        *(
            "mas²/Hz",
            "μrad²/Hz",
            "nrad^2/Hz",
            "(arcsec/s)^2/Hz",
            "rate PSD",
            "f in kHz",
            "rpm",
            "ω",
            "cycles/min",
            "units mas2/Hz",
            "log of the density",
        ),
    ],
)
def test_a_comment_with_another_unit_or_amplitude_is_refused_where_columns_have_none(words, table):
    with refused(ErrorCode.CONFLICT, "line 1"):
        read_motion(table(f"# {words}\nf,x,y\n1,2,3\n2,2,3\n"))


@pytest.mark.parametrize(
    ("header", "words", "row"),
    [
        ("f,x [mas²/Hz],y [mas²/Hz]", "f in rad/s", "1,2,3"),
        ("f,x [mas²/Hz],y [mas²/Hz]", "angular frequency", "1,2,3"),
        ("frequency,amplitude [mas],angle", "angles in rad", "1,2,0.5"),
    ],
)
def test_a_unit_of_the_other_columns_does_not_cover_one_without(header, words, row, table):
    with refused(ErrorCode.CONFLICT, "line 1"):
        read_motion(table(f"# {words}\n{header}\n{row}\n{row.replace('1', '2', 1)}\n"))


@pytest.mark.parametrize(
    "header", ["f,asd_x,psd_y", "f,asd_x [mas²/Hz],asd_y [mas²/Hz]", "f,psd_x [mas/√Hz],psd_y [mas/√Hz]"]
)
def test_a_name_and_a_unit_that_contradict_each_other_are_refused(header, table):
    with refused(ErrorCode.CONFLICT):
        read_motion(table(f"{header}\n1,2,3\n2,2,3\n"))


@pytest.mark.parametrize(("comment", "zero"), [("", True), ("# twosided\n", True), ("# twosided\n", False)])
@pytest.mark.parametrize("n", [16, 17])
def test_a_two_sided_table_up_to_the_sampling_frequency_is_folded(comment, zero, n, table):
    """Sines of 0.1 and 0.05 arcsec have the variances 0.005 and 0.00125."""
    t = np.arange(n) / n
    x = 0.1 * np.sin(2 * np.pi * 2 * t) + 0.05 * np.cos(2 * np.pi * 3 * t) + 1e-4 * np.cos(2 * np.pi * t)
    power = np.abs(np.fft.fft(x) / n) ** 2 + 1e-12  # at steps of 1 Hz
    rows = "".join(f"{f},{p:.6g},{p:.6g}\n" for f, p in enumerate(power) if f or zero)
    said = []
    spectrum = read_motion(table(f"{comment}f,x,y\n{rows}"), kind="bins", log=said.append)
    assert spectrum.highest <= n // 2 + 0.5
    moments = sum((line.moments()[0] for line in spectrum.lines), 0.0)
    widths = np.diff(spectrum.frequencies)[::2]
    np.testing.assert_allclose(moments + widths @ spectrum.density[::2, 0], 0.00625, rtol=1e-3)
    assert spectrum.at([2.0])[0, 0] == pytest.approx(0.005, rel=1e-3)
    assert any("mirror" in sentence for sentence in said)


def test_a_drawn_band_is_no_mirrored_table(table):
    band = "".join(f"{f},{v},{v}\n" for f, v in enumerate([1, 2, 4, 7, 9, 7, 4, 2, 1], 1))
    assert read_motion(table(f"f,x,y\n{band}"), kind="curve").highest == 9
    flat = "".join(f"{f},1,1\n" for f in range(1, 20))
    assert read_motion(table(f"f,x,y\n{flat}"), kind="curve").highest == 19


@pytest.mark.parametrize(
    "text",
    [
        "t;x;y\n0;0,5;1\n1,5;-1,000;2e-1\n",
        "t\tx\ty\n0\t0,5\t1\n1,5\t-1\t0,2\n",
        't,x,y\n0,"0,5",1\n"1,5",-1,"0,2"\n',
        "t;x;y;\n0;0,5;1;\n1,5;-1;0,2;\n",
        "sep=;\nt;x;y\n0;0,5;1\n1,5;-1;0,2\n",
        "# gyro\n# t x y\n0 0.5 1\n1.5 -1 0.2\n",
        "% t [ms], x [mas], y [mas]\n0, 500, 1000\n1500, -1D3, 2e2\n",
        "t_s,x/mas,y_mas\n0,500,1000\n1.5,\u22121000,200\n",
        '"Time, ms","X, mas","Y, mas"\n0,500,1000\n1500,-1000,200\n',
    ],
)
@pytest.mark.parametrize("coding", ["utf-8", "utf-16"])
def test_tables_of_other_countries_and_programs_are_read(text, coding, tmp_path):
    (tmp_path / "trace.csv").write_bytes(text.encode(coding))
    np.testing.assert_allclose(read_motion(tmp_path / "trace.csv"), [[0, 1.5], [0.5, -1], [1, 0.2]])


def test_a_header_behind_a_mark_begins_a_table_of_lines(table):
    both = read_motion(table("# f,x,y\n1,2,3\n2,2,3\n# frequency,amplitude,angle\n61,0.02,30\n"))
    assert (len(both.frequencies), both.lines) == (2, (Line(61, 0.02, 30),))


_PER_HZ = 1e-6 * np.array([2.0, 0.2])


@pytest.mark.parametrize(
    ("frequency", "density", "hertz", "factor"),
    [
        ("rad/s", "mas²/(rad/s)", 2 * np.pi, 1 / (2 * np.pi)),
        ("rad s-1", "mas^2 s/rad", 2 * np.pi, 1 / (2 * np.pi)),
        ("rad/s", "mas²/Hz", 2 * np.pi, 1),
        ("rpm", "mas²·Hz⁻¹", 60, 1),
        ("cycles/s", "(mas)^2/hz", 1, 1),
        ("hz", "mas/sqrtHz", 1, None),
        ("Hz", "milliarcseconds/Hz^0.5", 1, None),
        ("Hz", "mas Hz^-1/2", 1, None),
    ],
)
def test_units_of_spectra_are_read_as_people_write_them(frequency, density, hertz, factor, tmp_path):
    written = _PER_HZ * 1e6 * factor if factor else np.sqrt(_PER_HZ * 1e6)
    rows = "".join(f"{f * hertz!r},{v!r},{v!r}\n" for f, v in zip((1.0, 10.0), written.tolist(), strict=True))
    path = tmp_path / "psd.csv"
    header = f"f [{frequency}],x [{density}],y [{density}]\n"
    path.write_text(header + rows, encoding="utf-8" if "⁻" in density else "cp1252")
    spectrum = read_motion(path)
    np.testing.assert_allclose(spectrum.frequencies, [1, 10])
    np.testing.assert_allclose(spectrum.density[:, 0], _PER_HZ)


@pytest.mark.parametrize("mark", [";", "\t", "  ", "; "])
def test_columns_may_be_separated_by_what_separates_the_names(mark, table):
    rows = [["t [s]", "x [mas]", "y [mas]"], *([f"{k / 10}", f"{k}", "-1"] for k in range(12))]
    trace = read_motion(table("\n".join(mark.join(row) for row in rows) + "\n"))
    np.testing.assert_allclose(trace.t, np.arange(12) / 10)
    np.testing.assert_allclose(trace.x, np.arange(12) / 1000)
    np.testing.assert_allclose(trace.y, -0.001)


@pytest.mark.parametrize(
    "words",
    [
        *("total rms 0.1 arcsec", "0.1 arcsec rms", "log-spaced", "sampled at 7 kHz"),
        *("star of magnitude 3.5", "degrees of freedom: 12", "wheel of 720 rpm"),
        *("3 minutes of data", "counts: 12"),
    ],
)
def test_a_comment_about_something_else_is_no_unit_of_densities(words, table):
    spectrum = read_motion(table(f"# {words}\nf,x,y\n1,2,3\n10,0.2,0.3\n"))
    np.testing.assert_allclose(spectrum.density[:, 0], [2, 0.2])


@pytest.mark.parametrize("words", ["angle in deg", "deg from +x", "wheel of 720 rpm", "sampled at 7 kHz"])
def test_a_comment_about_something_else_is_no_unit_of_lines(words, table):
    spectrum = read_motion(table(f"# {words}\nfrequency,amplitude,angle\n12,0.1,30\n"))
    assert (spectrum.lines[0].frequency, spectrum.lines[0].amplitude) == (12, 0.1)


@pytest.mark.parametrize("words", ["amplitude and angle in deg", "up to 44 kHz", "fit rms 3"])
def test_a_comment_that_may_be_about_lines_is_refused(words, table):
    with refused(ErrorCode.CONFLICT, "line 1"):
        read_motion(table(f"# {words}\nfrequency,amplitude,angle\n12,0.1,30\n44,0.2,30\n"))
