"""Every locus is within the reach of ``jitterkit simulate``, and its truth in the header."""

import inspect

import numpy as np
import pytest
from astropy.io import fits
from typer.testing import CliRunner

from jitterkit.cli.loci import build_locus, locus_sizes, other_sizes, parse_sizes
from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.loci import LOCI, Mvn, Path

runner = CliRunner()

SIZES = {
    "stable": {},
    "linear": {"length": 0.5, "angle": 20.0},
    "shm": {"length": 0.5},
    "mvn": {"sigma_major": 0.2, "sigma_minor": 0.1, "angle": 30.0},
    "ellipse": {"semi_major": 0.3, "semi_minor": 0.1, "angle": 30.0},
    "lissajous": {"amplitude_x": 0.3, "amplitude_y": 0.2, "phase": 50.0},
    "tones": {"length1": 0.5, "angle1": 10.0, "length2": 0.3, "angle2": 80.0},
    "partial": {"length": 0.6, "angle": 30.0, "cycles": 0.7, "phase": 30.0},
    "smear": {"length": 0.5, "angle": 30.0, "sigma_major": 0.1, "sigma_minor": 0.05, "sigma_angle": 80.0},
    "shaped": {"sigma_major": 0.2, "sigma_minor": 0.1, "angle": 30.0, "kurtosis": -1.0},
    "skewed": {"sigma_major": 0.2, "sigma_minor": 0.1, "angle": 30.0, "cumulant_xxx": 2e-3},
    "path": {"knots": "0:0,0.2:0.1,0.3:0.3"},
}


def test_the_help_names_the_sizes_that_each_locus_is_built_from():
    built = {name: list(inspect.signature(kind.of).parameters) for name, kind in LOCI.items()}
    assert locus_sizes() == built
    assert "semi_major, semi_minor of ellipse; " in other_sizes()
    assert "linear" not in other_sizes()  # --length and --angle say it all
    said = " ".join(runner.invoke(app, ["simulate", "--help"]).output.replace("│", " ").split())
    assert "cycles, phase of partial" in said


def simulate(path, *arguments):
    return runner.invoke(app, ["simulate", str(path), "-i", "smallsat", "--no-noise", *arguments])


@pytest.mark.parametrize("name", LOCI)
def test_every_locus_is_built_from_its_sizes_and_describes_itself_by_them(name):
    sizes = parse_sizes([f"{size}={value}" for size, value in SIZES[name].items()])
    described = build_locus(name, sizes).describe()
    if name == "path":
        positions = np.reshape(list(described.values()), (-1, 2))
        assert np.diff(positions, axis=0) == pytest.approx(np.array([[0.2, 0.1], [0.1, 0.2]]), abs=1e-14)
    else:
        assert {size: described[size] for size in sizes} == pytest.approx(sizes, abs=1e-9)


def test_a_partial_vibration_is_simulated_and_its_truth_stands_in_the_header(tmp_path):
    path = tmp_path / "partial.fits"
    options = ["--length", "0.6", "--angle", "30", "--set", "cycles=0.7", "--set", "phase=-40"]
    done = simulate(path, "--locus", "partial", *options)
    assert done.exit_code == 0, done.output
    header = fits.getheader(path)
    assert header["TRULOCUS"] == "partial"
    found = [header[key] for key in ("TRULEN", "TRUANG", "TRUCYCLE", "TRUPHASE")]
    assert found == pytest.approx([0.6, 30.0, 0.7, -40.0], rel=1e-9)


def test_a_path_s_knots_are_numbered_and_named_in_the_comments(tmp_path):
    path = tmp_path / "path.fits"
    done = simulate(path, "--locus", "path", "--set", "knots=0:0,0.2:0.1,0.3:0.3")
    assert done.exit_code == 0, done.output
    header = fits.getheader(path)
    assert [header.comments[f"TRUJ{k}"] for k in (1, 2, 6)] == ["true x1", "true y1", "true y3"]
    expected = Path.of([[0, 0], [0.2, 0.1], [0.3, 0.3]]).describe()
    assert header["TRUJ5"] == pytest.approx(expected["x3"])


def test_a_measured_trace_is_simulated_over_one_exposure(tmp_path):
    table, path = tmp_path / "gyro.csv", tmp_path / "trace.fits"
    t = np.linspace(0, 10, 101)  # the exposure of the preset is shorter
    table.write_text("t,x,y\n" + "\n".join(f"{v},{0.1 * v},0" for v in t))
    from jitterkit.instruments import load_instrument

    exposure = load_instrument("smallsat").exposure
    done = simulate(path, "--trace", str(table), "--set", "start=1")
    assert done.exit_code == 0, done.output
    header = fits.getheader(path)
    assert header["TRULOCUS"] == "trace"
    assert header["TRUSXX"] == pytest.approx((0.1 * exposure) ** 2 / 12, rel=1e-9)


def test_a_shear_is_one_minus_the_ratio_of_the_sigmas():
    locus = build_locus("mvn", {"sigma_major": 0.2, "shear": 0.5, "angle": 30.0})
    assert np.asarray(locus.coords) == pytest.approx(np.asarray(Mvn.of(0.2, 0.1, 30.0).coords))


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        (
            "--locus partial",
            ErrorCode.MISSING_VALUE,
            ["partial", "--length", "--angle, --set cycles, --set phase"],
        ),
        (
            "--locus ellipse",
            ErrorCode.MISSING_VALUE,
            ["ellipse", "--set semi_major, --set semi_minor", "--angle"],
        ),
        (
            "--locus shm --length 1 --set cycles=2",
            ErrorCode.UNKNOWN_NAME,
            ["shm", "--set cycles", "--length"],
        ),
        (
            "--locus mvn --sigma 0.2 --shear 0.5 --set sigma_minor=0.1",
            ErrorCode.CONFLICT,
            ["mvn", "--shear", "--set sigma_minor"],
        ),
        ("--locus mvn --shear 0.5", ErrorCode.MISSING_VALUE, ["mvn", "--sigma, --shear", "--angle"]),
        ("--locus linear --length 1 --shear 0.2", ErrorCode.UNKNOWN_NAME, ["linear", "--shear"]),
        ("--locus partial --length 1 --set phase", ErrorCode.MALFORMED, ["--set phase"]),
        ("--locus partial --length 1 --set cycles=9", ErrorCode.OUT_OF_RANGE, ["0.05 to 3", "9"]),
        ("--locus path --set knots=3", ErrorCode.WRONG_TYPE, ["path", "--set knots", "3"]),
        ("--locus linear --set length=1:2", ErrorCode.WRONG_TYPE, ["linear", "--length"]),
        ("--locus path --set knots=0:0,1", ErrorCode.MALFORMED, ["--set knots=0:0,1"]),
        ("--locus linear --length 1 --set angle=nan", ErrorCode.OUT_OF_RANGE, ["--set angle = nan"]),
        ("--trace gyro.csv --locus shm", ErrorCode.CONFLICT, ["--trace", "--locus"]),
        ("--trace gyro.csv --length 1", ErrorCode.CONFLICT, ["--trace", "--length"]),
        ("--trace none.csv", ErrorCode.NOT_FOUND, ["none.csv"]),
        ("--trace short.csv", ErrorCode.OUT_OF_RANGE, ["short.csv", "0 to 0.001 s"]),
    ],
)
def test_what_a_locus_does_not_take_is_one_sentence_and_exit_status_two(
    arguments, code, values, tmp_path, monkeypatch, check_error
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.csv").write_text("t,x,y\n0,0,0\n0.0005,0,0\n0.001,0,0\n")
    check_error(simulate("a.fits", *arguments.split()), code, *values)
