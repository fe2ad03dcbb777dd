"""The shell: light to start, data on stdout, talk on stderr, exit statuses as promised."""

import json
import os
import subprocess
import sys
import tomllib

import numpy as np
import pytest
from astropy.io import fits
from scipy.ndimage import gaussian_filter
from typer.testing import CliRunner

from jitterkit.cli.main import app
from jitterkit.errors import ErrorCode
from jitterkit.frames import open_frames, write_fits

runner = CliRunner()


@pytest.fixture
def frame(tmp_path):
    path = tmp_path / "frame.fits"
    done = runner.invoke(app, ["simulate", str(path), "-i", "plain", "--locus", "mvn", "--sigma", "0.1"])
    assert done.exit_code == 0, done.output
    return path


def test_help_loads_nothing_heavy():
    code = (
        "import sys\n"
        "from jitterkit.cli.main import app\n"
        "try: app(['--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'jax', 'numpy', 'scipy', 'astropy', 'matplotlib', 'cv2', 'tifffile'} & set(sys.modules)\n"
        "print('loaded', sorted(heavy))\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip().endswith("loaded []")


WRONG_PATHS = [
    ["process", "nothing.fits", "-o", "out"],
    ["process", "ready", "-o", "ready"],
    ["estimate", "nothing.fits"],
    ["estimate", "ready", "-o", "ready/results.ecsv"],
    ["estimate", "ready", "--reference", "ready/results.ecsv"],
    ["simulate", "ready/a.fits"],
    ["forecast", "-o", "ready/results.ecsv"],
    ["crossfit", "-o", "ready/results.ecsv"],
    ["photons", "-o", "ready/results.ecsv"],
    ["motion", "ready/a.csv", "-o", "ready/results.ecsv"],
]


def test_what_is_wrong_with_paths_is_reported_before_jax_is_loaded(tmp_path):
    """One process for all: what a command loads is still there for those after it."""
    (tmp_path / "ready").mkdir()
    for name in ("a.fits", "results.ecsv"):
        (tmp_path / "ready" / name).touch()
    code = (
        "import sys\n"
        "from jitterkit.cli.main import app\n"
        f"for arguments in {WRONG_PATHS!r}:\n"
        "    try: app(arguments)\n"
        "    except SystemExit as end:\n"
        "        print(end.code, sorted({'jax', 'scipy', 'astropy'} & set(sys.modules)), *arguments)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.stdout.splitlines() == [" ".join(["2 []", *arguments]) for arguments in WRONG_PATHS], (
        done.stderr
    )


def test_every_command_has_help():
    for command in ("info", "simulate", "estimate", "process", "forecast", "crossfit", "motion", "photons"):
        done = runner.invoke(app, [command, "--help"])
        assert done.exit_code == 0
        assert "--help" in done.output


def test_the_version_is_the_package_s():
    from importlib.metadata import version

    assert runner.invoke(app, ["--version"]).output.strip() == f"jitterkit {version('jitterkit')}"


def test_info_says_where_each_number_comes_from(frame):
    done = runner.invoke(app, ["info", str(frame)])
    assert done.exit_code == 0
    (gain,) = (line for line in done.stdout.splitlines() if line.split()[:1] == ["gain"])
    assert "3.7" in gain
    assert "header EGAIN" in gain


def test_info_goes_on_after_a_bad_file(frame, tmp_path, check_error):
    (tmp_path / "bad.fits").write_text("not a frame")
    done = runner.invoke(app, ["info", str(tmp_path)])
    check_error(done, ErrorCode.UNKNOWN_FORMAT, tmp_path / "bad.fits", status=1)
    assert "frame.fits" in done.stdout


def test_simulated_truth_stands_in_the_header(frame):
    from astropy.io import fits

    header = fits.getheader(frame)
    assert header["TRUSEP"] == 10.0
    assert header["TRULOCUS"] == "mvn"
    assert header["BITPIX"] == 16


def test_simulated_tiffs_have_their_numbers_beside_them(tmp_path):
    path = tmp_path / "s.tif"
    done = runner.invoke(app, ["simulate", str(path), "-i", "plain", "--frames", "2", "--scatter"])
    assert done.exit_code == 0, done.output
    names = sorted(p.name for p in tmp_path.iterdir())
    assert names == ["s-0.tif", "s-0.toml", "s-1.tif", "s-1.toml"]
    truths = [tomllib.loads((tmp_path / f"s-{i}.toml").read_text())["truth"] for i in (0, 1)]
    assert truths[0]["TRUTHETA"] != truths[1]["TRUTHETA"]


def test_one_seed_gives_one_frame(tmp_path):
    pixels = []
    for name, seed in (("a", "3"), ("b", "3"), ("c", "4")):
        path = tmp_path / f"{name}.fits"
        assert runner.invoke(app, ["simulate", str(path), "-i", "plain", "--seed", seed]).exit_code == 0
        with open_frames(path) as file:
            pixels.append(file[0].data)
    np.testing.assert_array_equal(pixels[0], pixels[1])
    assert np.any(pixels[0] != pixels[2])


def test_process_prints_the_separation_and_leaves_its_files(frame, tmp_path, check_error):
    out = tmp_path / "out"
    done = runner.invoke(app, ["process", str(frame), "-o", str(out), "-i", "plain"])
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("separation ")
    files = ["configuration.json", "ledger.sqlite", "report.html", "results.ecsv", "summary.json"]
    assert sorted(path.name for path in out.iterdir()) == files
    mean, error = (json.loads((out / "summary.json").read_text())["separation"][k] for k in ("mean", "error"))
    assert abs(mean - 10.0) < 5 * error
    again = runner.invoke(app, ["process", str(frame), "-o", str(out), "-i", "plain"])
    check_error(again, ErrorCode.EXISTS, out, "--overwrite")


def test_process_prints_what_a_fitted_frame_leaves_in_doubt(frame, tmp_path):
    data, header = fits.getdata(frame, header=True)
    kept = fits.Header([(key, header[key]) for key in ("EXPTIME", "PIXSCALE")])
    kept["NCOMBINE"] = 3
    fits.writeto(tmp_path / "few.fits", data, kept)
    done = runner.invoke(
        app, ["process", str(tmp_path / "few.fits"), "-o", str(tmp_path / "out"), "-i", "plain"]
    )
    assert done.exit_code == 0, done.output
    (line,) = [line for line in done.stderr.splitlines() if "Flags of fitted frames" in line]
    for said in ("header_odd (1)", "few.fits [0]", "NCOMBINE = 3"):
        assert said in line


def test_estimate_prints_a_message_of_many_frames_once_and_at_most_fifty_messages(tmp_path):
    write_fits(tmp_path / "empty.fits", np.full((3, 16, 16), np.nan))
    for number in range(55):  # whose messages name their files
        fits.writeto(tmp_path / f"{number}.fits", np.eye(16), fits.Header({"BUNIT": "nJy"}))
    done = runner.invoke(app, ["estimate", str(tmp_path), "-i", "plain", "-o", str(tmp_path / "a.csv")])
    assert done.exit_code == 1
    lines = [line for line in done.stderr.splitlines() if ".fits [" in line]
    assert len(lines) == 50
    assert "... and 6 more" in done.stderr
    done = runner.invoke(app, ["estimate", str(tmp_path / "empty.fits"), "-i", "plain"])
    (line,) = [line for line in done.stderr.splitlines() if "empty.fits [" in line]
    assert line.endswith("(3 frames)")


def test_some_failed_frames_are_exit_status_one(frame, tmp_path):
    write_fits(tmp_path / "blank.fits", np.zeros((128, 128), np.uint16))
    done = runner.invoke(app, ["process", str(tmp_path), "-o", str(tmp_path / "out"), "-i", "plain"])
    assert done.exit_code == 1
    assert "blank.fits [0] no_star" in done.stderr


def test_estimate_prints_a_table(frame):
    done = runner.invoke(app, ["estimate", str(frame), "-i", "plain", "--estimator", "mtf"])
    assert done.exit_code == 0, done.output
    assert "arcsec2" in done.stdout
    assert "frame.fits" in done.stdout


def useless_frames(where):
    rng = np.random.default_rng(2)
    (where / "words.txt").write_text("not a frame")
    (where / "link.fits").symlink_to(where / "frame.fits")
    write_fits(where / "nan.fits", np.full((128, 128), np.nan))
    write_fits(where / "dark.fits", rng.normal(100.0, 3.0, (128, 128)))
    write_fits(where / "small.fits", gaussian_filter(rng.normal(size=(80, 90)), 2))


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        ("process nowhere.fits -o out", ErrorCode.NOT_FOUND, ["nowhere.fits"]),
        ("process . -o out -i tolliman", ErrorCode.UNKNOWN_NAME, ["'tolliman'", "'toliman'"]),
        ("process . -o out -i smallsat --locus zigzag", ErrorCode.UNKNOWN_NAME, ["'zigzag'", "linear"]),
        ("process . -o out -i smallsat --estimator guess", ErrorCode.UNKNOWN_NAME, ["'guess'", "score"]),
        ("process . -o out -i smallsat --gain -1", ErrorCode.OUT_OF_RANGE, ["gain = -1.0"]),
        ("simulate a.fits -i smallsat --locus linear", ErrorCode.MISSING_VALUE, ["linear", "--length"]),
        (
            "simulate a.fits -i smallsat --locus mvn --length 1",
            ErrorCode.UNKNOWN_NAME,
            ["mvn", "--length", "--sigma"],
        ),
        ("simulate a.fits -i smallsat --length 1", ErrorCode.UNKNOWN_NAME, ["--length", "--locus"]),
        ("simulate a.png -i smallsat", ErrorCode.WRONG_SUFFIX, ["a.png", ".fits", ".tif"]),
        ("simulate a.fits -i smallsat --contrast 0.5", ErrorCode.OUT_OF_RANGE, ["contrast = 0.5"]),
        ("simulate a.fits -i smallsat --flux -3", ErrorCode.OUT_OF_RANGE, ["flux = -3"]),
        ("simulate a.fits -i smallsat --separation nan", ErrorCode.OUT_OF_RANGE, ["separation = nan"]),
        ("simulate a.fits -i smallsat --x 100", ErrorCode.SAMPLING, ["105 arcsec", "along x"]),
        (
            "simulate a.fits -i smallsat --locus mvn --sigma 1 --shear 2",
            ErrorCode.OUT_OF_RANGE,
            ["shear", "2.0"],
        ),
        ("simulate frame.fits", ErrorCode.EXISTS, ["frame.fits", "--overwrite"]),
        ("simulate nowhere/a.fits", ErrorCode.NOT_FOUND, ["nowhere", "a.fits"]),
        ("estimate . -o nowhere/table.ecsv", ErrorCode.NOT_FOUND, ["nowhere", "table.ecsv"]),
        ("estimate . -o frame.fits", ErrorCode.CONFLICT, ["frame.fits"]),
        ("estimate . --export frame.fits", ErrorCode.NOT_WRITABLE, ["frame.fits"]),
        ("estimate . --blind --stars", ErrorCode.CONFLICT, ["--blind", "--stars"]),
        ("estimate . --stars --estimator mtf", ErrorCode.CONFLICT, ["--estimator mtf", "--stars"]),
        ("estimate . --blind --estimator guess", ErrorCode.UNKNOWN_NAME, ["'guess'", "cepstrum"]),
        ("estimate . --oversample 3", ErrorCode.MISSING_VALUE, ["--oversample", "--export"]),
        (
            "estimate . --estimator nnls --export new --oversample 3",
            ErrorCode.CONFLICT,
            ["nnls", "--oversample", "--estimator score"],
        ),
        ("estimate . --blind --no-background", ErrorCode.CONFLICT, ["--no-background", "--blind"]),
        ("estimate . --stars -i smallsat", ErrorCode.CONFLICT, ["--instrument", "--stars"]),
        (
            "estimate . --reference dark.fits -i smallsat",
            ErrorCode.CONFLICT,
            ["--instrument", "--reference"],
        ),
        ("estimate . --stars --file-rows", ErrorCode.MISSING_VALUE, ["--file-rows", "--export"]),
        ("estimate . --reference nowhere.fits", ErrorCode.NOT_FOUND, ["nowhere.fits"]),
        ("estimate . --reference words.txt", ErrorCode.UNKNOWN_FORMAT, ["words.txt"]),
        ("estimate . --reference dark.fits --no-stars", ErrorCode.NO_SIGNAL, ["dark.fits"]),
        ("estimate . --reference dark.fits --stars", ErrorCode.NO_STAR, ["dark.fits"]),
        ("estimate . --reference nan.fits", ErrorCode.NO_DATA, ["nan.fits"]),
        (
            "estimate frame.fits --reference small.fits",
            ErrorCode.WRONG_SHAPE,
            ["small.fits", "90 x 80", "frame.fits", "44 x 48"],
        ),
        ("estimate frame.fits --reference link.fits --no-stars", ErrorCode.BAD_REFERENCE, ["link.fits"]),
    ],
)
def test_usage_errors_are_one_sentence_and_exit_status_two(
    arguments, code, values, frame, monkeypatch, check_error
):
    monkeypatch.chdir(frame.parent)
    if "--reference" in arguments:
        useless_frames(frame.parent)
    done = runner.invoke(app, arguments.split())
    check_error(done, code, *values)
    assert done.stdout == ""


def test_a_closed_pipe_is_not_an_error(frame):
    read, write = os.pipe()
    os.close(read)
    code = f"import sys; sys.argv = ['jitterkit', 'info', {str(frame)!r}]\n"
    code += "from jitterkit.cli.main import run; run()"
    done = subprocess.run([sys.executable, "-c", code], stdout=write, stderr=subprocess.PIPE, text=True)
    os.close(write)
    assert "Traceback" not in done.stderr
