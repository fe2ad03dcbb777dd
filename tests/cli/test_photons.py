"""``jitterkit photons``: the table, the files it reads and writes, and what it refuses."""

import inspect
import sys

import numpy as np
import pytest
import typer
from astropy.table import QTable
from typer.testing import CliRunner

from jitterkit.cli.command import as_command
from jitterkit.cli.photons import photons
from jitterkit.errors import ErrorCode
from jitterkit.photons.curve import GLASS, PLATES
from jitterkit.photons.stars import MAGNITUDES, TEMPERATURES

pytest.importorskip("synphot")
runner = CliRunner()
app = typer.Typer()
app.command()(as_command(photons))


def run(*arguments):
    return runner.invoke(app, ["-i", "smallsat", *map(str, arguments)])


def table(tmp_path, *arguments):
    """The table that a run writes, by quantity; the last of those that share a name."""
    path = tmp_path / "table.ecsv"
    done = run(*arguments, "-o", path, "--overwrite")
    assert done.exit_code == 0, done.output
    return {row["quantity"]: row for row in QTable.read(path, format="ascii.ecsv")}


def test_the_defaults_are_the_room_s():
    defaults = {name: given.default for name, given in inspect.signature(photons).parameters.items()}
    assert defaults["temperatures"] == TEMPERATURES
    assert defaults["magnitudes"] == MAGNITUDES
    assert (defaults["glass"], defaults["plates"]) == (GLASS, PLATES)


def test_the_table_says_rates_area_and_photons():
    done = run()
    assert done.exit_code == 0, done.output
    lines = [line.split("  ") for line in done.stdout.splitlines()]
    assert [line[0] for line in lines if line[0]] == [
        "rate of A",
        "rate of B",
        "rate of both",
        "contrast in the band",
        "mean wavelength",
        "exposure",
        "area of the pupil",
        "photons by it",
    ]
    assert "paper" not in done.stdout  # which describes another telescope


def test_toliman_is_set_beside_the_paper_and_its_notebook():
    done = runner.invoke(app, ["--area", "114.67"])  # no need of the diffractive pupil
    assert done.exit_code == 0, done.output
    said = {line[:27].rstrip(): line[27:].split() for line in done.stdout.splitlines()}
    assert said["rate of both"][-3:] == ["830900", "830900", "photons/s/cm²"]
    assert said["area, diameters for radii"][:3] == ["458.7"] * 3
    assert said["contrast in the band"][-2:] == ["3.370", "3.224"]
    assert "3.811 × 10⁷" in done.stdout.splitlines()[-1]


def test_options_and_files_change_the_count_as_they_should(tmp_path):
    plain = table(tmp_path)
    photons_of = lambda rows: rows["photons by it"]["here"]  # noqa: E731
    assert photons_of(table(tmp_path, "--exposure", 0.2)) == pytest.approx(2 * photons_of(plain))
    assert photons_of(table(tmp_path, "--plates", 0)) == pytest.approx(photons_of(plain) / 0.91**2)
    half = tmp_path / "filter.csv"
    half.write_text("wavelength_nm,value\n530,0.5\n640,0.5\n")
    assert photons_of(table(tmp_path, "--filter", half)) == pytest.approx(photons_of(plain) / 2, rel=1e-9)
    fainter = table(tmp_path, "--magnitudes", 0.01, 3.83)
    assert fainter["contrast in the band"]["here"] == pytest.approx(
        10 * plain["contrast in the band"]["here"]
    )


def test_spectra_and_efficiency_come_from_files(tmp_path):
    nm = np.arange(400, 801)
    for name, values in (("a", np.ones(401)), ("b", 5 * np.ones(401)), ("qe", np.full(401, 0.5))):
        rows = "\n".join(f"{x},{y}" for x, y in zip(nm, values, strict=True))
        (tmp_path / f"{name}.csv").write_text("wavelength_nm,value\n" + rows)
    rows = table(
        tmp_path,
        *(
            "--spectrum-a",
            tmp_path / "a.csv",
            "--spectrum-b",
            tmp_path / "b.csv",
            "--qe",
            tmp_path / "qe.csv",
        ),
        *("--magnitudes", 1.0, 3.5),
    )
    assert rows["contrast in the band"]["here"] == pytest.approx(10.0)  # 2.5 magnitudes, whatever the units
    assert rows["mean wavelength"]["here"] == pytest.approx(585.0)


def test_the_picture_is_a_png(tmp_path):
    done = run("--plot", tmp_path / "p.png")
    assert done.exit_code == 0, done.output
    assert (tmp_path / "p.png").read_bytes().startswith(b"\x89PNG")
    assert str(tmp_path / "p.png") in done.stderr
    assert "p.png" not in done.stdout


@pytest.mark.parametrize(
    ("arguments", "code", "values"),
    [
        (["--spectrum-a", "none.csv"], ErrorCode.NOT_FOUND, ["none.csv"]),
        (["--spectrum-b", "short.csv"], ErrorCode.SAMPLING, ["short.csv", "530 to 640 nm"]),
        (["--spectrum-a", "power.csv"], ErrorCode.UNKNOWN_UNIT, ["power.csv", "flux"]),
        (["--filter", "percent.csv"], ErrorCode.OUT_OF_RANGE, ["90"]),
        (["--plates", "0", "--glass", "0.9"], ErrorCode.CONFLICT, ["--glass", "--plates 0"]),
        (
            ["--spectrum-a", "a.csv", "--spectrum-b", "b.csv", "--temperatures", "5000", "4000"],
            ErrorCode.CONFLICT,
            ["--temperatures", "without a spectrum"],
        ),
        (["--glass", "0"], ErrorCode.OUT_OF_RANGE, ["glass = 0.0"]),
        (["--area", "-1"], ErrorCode.OUT_OF_RANGE, ["area = -1.0", "cm²"]),
        (["--plot", "p.pdf"], ErrorCode.WRONG_SUFFIX, ["p.pdf", ".png"]),
        (["--output", "there.ecsv"], ErrorCode.EXISTS, ["there.ecsv", "--overwrite"]),
        (["-i", "psf.toml", "--filter", "short.csv"], ErrorCode.MISSING_VALUE, ["'x'", "--area"]),
        (["-i", "psf.toml"], ErrorCode.MISSING_VALUE, ["'x'", "--filter"]),
        (["-i", "lines.toml"], ErrorCode.UNSUPPORTED, []),
    ],
)
def test_what_cannot_be_counted_is_one_sentence_and_exit_status_two(
    arguments, code, values, tmp_path, monkeypatch, check_error
):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "short.csv").write_text("530,1\n640,1\n")
    (tmp_path / "percent.csv").write_text("530,90\n640,90\n")
    (tmp_path / "power.csv").write_text("wavelength_nm,flux_erg\n400,1\n800,1\n")
    (tmp_path / "there.ecsv").touch()
    head = '[instrument]\nname = "x"\nplate_scale = 0.4\nshape = [16, 16]\nexposure = 0.1\n'
    (tmp_path / "psf.toml").write_text(head + '[psf]\nfile = "star.fits"\n')
    (tmp_path / "lines.toml").write_text(
        head + "[telescope]\ndiameter = 0.1\n[spectrum]\nlines = [532, 560, 633]\n"
    )
    from jitterkit.frames import write_fits

    write_fits(tmp_path / "star.fits", np.pad([[100.0]], 8)[:-1, :-1].astype("float32"))
    check_error(run(*arguments), code, *values)


def test_without_synphot_one_sentence_names_the_extra(monkeypatch, check_error):
    monkeypatch.setitem(sys.modules, "synphot", None)
    check_error(run(), ErrorCode.MISSING_PACKAGE, "synphot", '"jitterkit[spectra]"')
