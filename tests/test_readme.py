"""The README's promises: its Python runs, its TOML is read, its commands and statuses exist."""

import re
from pathlib import Path

import pytest

from jitterkit.cli.main import app
from jitterkit.estimators import ESTIMATORS
from jitterkit.instruments import PRESETS, read_instrument
from jitterkit.loci import LOCI
from jitterkit.refit import Status

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text(encoding="utf-8")


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.S)


def test_the_python_runs_and_prints_a_separation(monkeypatch, capsys):
    pytest.importorskip("dLuxToliman")
    monkeypatch.chdir(ROOT)
    (code,) = blocks("python")
    exec(compile(code, "README.md", "exec"), {})
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3
    for line in lines:
        separation, error = re.search(r": ([\d.]+) ± ([\d.]+) arcsec", line).groups()
        # the true separation stands in sample_frames/README.md
        assert abs(float(separation) - 9.1234) < 4 * float(error)


def test_the_instrument_file_is_read(tmp_path):
    (text,) = blocks("toml")
    path = tmp_path / "testbed.toml"
    path.write_text(text, encoding="utf-8")
    instrument = read_instrument(path)
    assert instrument.name == "testbed"
    assert instrument.aberrations == ("noll7", "noll8", "noll9", "noll10")


def test_the_commands_exist():
    named = set(re.findall(r"^jitterkit (\w+)", "\n".join(blocks("sh")), re.M))
    assert named == {command.callback.__wrapped__.__name__ for command in app.registered_commands}


def test_every_status_is_explained():
    explained = set(re.findall(r"`(\w+)`", TEXT.split("| status | means |")[1].split("\n\n")[0]))
    assert {status.name.lower() for status in Status} <= explained


@pytest.mark.parametrize("name", [*LOCI, *ESTIMATORS, *PRESETS])
def test_every_locus_estimator_and_preset_is_named(name):
    assert re.search(rf"\b{name}\b", TEXT)


def test_the_scripts_it_names_exist_and_run():
    for name in set(re.findall(r"scripts/(\w+)", TEXT)):
        path = ROOT / "scripts" / name
        assert path.is_file(), name
        assert path.stat().st_mode & 0o100, f"{name} is not executable"


def test_the_picture_is_there():
    (picture,) = re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXT)
    assert (ROOT / picture).is_file()
