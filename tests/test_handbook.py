"""README and handbook: every link leads somewhere, every command and code block runs, nothing is left out."""

import re
import shlex
import shutil
import tomllib
from pathlib import Path

import numpy as np
import pytest
import tifffile
import typer.testing
from astropy.io import fits
from skimage.data import camera

from jitterkit.cli.main import app
from jitterkit.docs import read_page, topics
from jitterkit.errors import ErrorCode
from jitterkit.estimators import ESTIMATORS
from jitterkit.instruments import PRESETS
from jitterkit.instruments.toml import SECTIONS
from jitterkit.loci import LOCI
from jitterkit.refit import Status
from jitterkit.report.columns import COLUMNS
from jitterkit.report.flags import FLAGS

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "jitterkit" / "docs"
PAGES = {"README": ROOT / "README.md"} | {
    path.relative_to(DOCS).as_posix().removesuffix(".md"): path for path in sorted(DOCS.rglob("*.md"))
}
TEXTS = {name: path.read_text(encoding="utf-8") for name, path in PAGES.items()}
COMMANDS = {command.callback.__wrapped__.__name__ for command in app.registered_commands}
RUN = [name for name, text in TEXTS.items() if re.search(r"^```(sh|python)$", text, re.M)]
SHORT = {"results", "python", "loci", "extending", "estimators", "commands/info", "commands/docs"}
"""Pages whose blocks run within seconds; those of the others are slow tests."""


def blocks(text, *languages):
    """Return the code blocks of a page as pairs of language and text, in order."""
    return [pair for pair in re.findall(r"^```(\w+)\n(.*?)^```", text, re.S | re.M) if pair[0] in languages]


def lines_of(block):
    """Return the command lines of a shell block, without comments."""
    return [words for line in block.splitlines() if (words := shlex.split(line, comments=True))]


def run(*words):
    done = typer.testing.CliRunner().invoke(app, list(words))
    assert done.exit_code == 0, f"{' '.join(words)}\n{done.output}\n{done.exception!r}"


def test_the_citation_names_this_version():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert f"\nversion: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"## {version}\n" in TEXTS["changes"]


def test_the_readme_is_short():
    assert len(TEXTS["README"].splitlines()) <= 250
    assert PAGES["README"].stat().st_size <= 18_000


@pytest.mark.parametrize("name", PAGES)
def test_every_link_leads_somewhere(name):
    for target in re.findall(r"\]\(([^)]+)\)", re.sub(r"```.*?```", "", TEXTS[name], flags=re.S)):
        position, _, anchor = target.partition("#")
        path = (PAGES[name].parent / position).resolve() if position else PAGES[name]
        assert path.exists(), target
        if anchor:
            headings = re.findall(r"^#+ (.*)$", path.read_text(encoding="utf-8"), re.M)
            assert anchor in {re.sub(r"[^\w -]", "", h.lower()).replace(" ", "-") for h in headings}, target


def test_every_page_is_reached_from_the_readme():
    reached, new = set(), {PAGES["README"]}
    while new:
        page = new.pop()
        reached.add(page)
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.S)
        found = {(page.parent / link).resolve() for link in re.findall(r"\]\(([^)#]+\.md)[)#]", text)}
        new |= found - reached
    assert set(PAGES.values()) - reached == set()


def test_the_terminal_shows_every_page():
    assert {"README", *topics()} == {name.removeprefix("commands/") for name in PAGES}
    for topic, title in topics().items():
        assert read_page(topic).startswith(f"# {title}\n")


def test_every_command_has_a_page_and_a_line_in_the_readme():
    assert {name.removeprefix("commands/") for name in PAGES if name.startswith("commands/")} == COMMANDS
    assert set(re.findall(r"^\| \[`(\w+)`\]", TEXTS["README"], re.M)) == COMMANDS


@pytest.mark.parametrize(
    ("page", "names"),
    [
        ("README", [status.name.lower() for status in Status]),
        ("troubleshooting", [status.name.lower() for status in Status]),
        ("troubleshooting", FLAGS),
        ("results", [column.name for column in COLUMNS if not column.name.endswith("_err")]),
        ("loci", LOCI),
        ("estimators", ESTIMATORS),
        ("commands/info", PRESETS.keys() - {"plain"}),  # the tests' own
    ],
)
def test_nothing_is_left_out(page, names):
    explained = set(re.findall(r"`(\w[\w-]*)`", TEXTS[page]))
    assert set(names) - explained == set()


def test_every_column_has_the_unit_that_the_page_gives():
    text = TEXTS["results"].partition("## Columns of `process`")[2].partition("\n## ")[0]
    told = {}
    for names, unit in re.findall(r"^\| (`.*?)\s*\|(.*?)\|", text, re.M):
        told |= dict.fromkeys(re.findall(r"`(\w+)`", names), unit.strip())
    for column in COLUMNS:
        if column.name in told and column.name not in ("iterations", "seconds"):
            assert told[column.name] == column.unit, column.name


def test_the_table_of_an_instrument_file_has_the_keys_and_units_that_are_read():
    rows = re.findall(r"^\| `\[(\w+)\]` \| `(\w+)` \| (.*?) ?\|", TEXTS["instruments"], re.M)
    read = [(section, key, unit) for section, keys in SECTIONS.items() for key, unit in keys.items()]
    assert sorted(rows) == sorted(read)


def test_every_code_is_explained_as_the_package_does():
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", TEXTS["troubleshooting"], re.M))
    assert {code.value: rows.get(code.value) for code in ErrorCode} == {c.value: c.meaning for c in ErrorCode}


def test_the_picture_is_there():
    (picture,) = re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXTS["README"])
    assert (ROOT / picture).is_file()


def test_every_script_that_is_named_is_there_and_runs():
    for name in set(re.findall(r"scripts/(\w+)", "".join(TEXTS.values()))):
        path = ROOT / "scripts" / name
        assert path.is_file(), name
        assert path.stat().st_mode & 0o100, f"{name} is not executable"


def test_every_command_line_has_options_that_exist():
    """Lines that are only shown are checked too; those in sh blocks are run below."""
    group = typer.main.get_command(app)
    for name, text in TEXTS.items():
        for _, block in blocks(text, "sh", "text"):
            for words in (line.split() for line in block.splitlines() if line.startswith("jitterkit ")):
                options = {word for word in words if word.startswith("-") and not re.match(r"-[\d.]", word)}
                known = {
                    option for p in group.commands[words[1]].params for option in (*p.opts, *p.secondary_opts)
                }
                assert options <= known, (name, words)


def _stars(rng, trail):
    """A field of round stars on 240 x 240 pixels, or of stars that a drift along x has drawn out."""
    rows, columns = np.mgrid[:240, :240]
    image = np.full((240, 240), 100.0)
    positions = [(30 + 36 * i, 30 + 36 * j) for i in range(6) for j in range(6)]
    for (y, x), flux in zip(positions, rng.uniform(2e4, 6e4, len(positions)), strict=True):
        for shift in np.linspace(-trail / 2, trail / 2, 1 if trail == 0 else 41):
            spot = np.exp(-((columns - x - shift) ** 2 + (rows - y) ** 2) / (2 * 1.8**2)) / (
                2 * np.pi * 1.8**2
            )
            image += flux * spot / (1 if trail == 0 else 41)
    return rng.poisson(image).astype(np.float32)


def _smeared(length):
    """A photograph whose pixels a uniform motion along x has drawn out."""
    return sum(np.roll(camera().astype(float), k, axis=1) for k in range(length)) / length


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    """A directory with the files that the handbook speaks of."""
    position = tmp_path_factory.mktemp("handbook")
    (position / "sample_frames").symlink_to(ROOT / "sample_frames")
    (_, text), *_ = blocks(TEXTS["instruments"], "toml")
    (position / "testbed.toml").write_text(text, encoding="utf-8")
    rng = np.random.default_rng(5)
    for name, count in (("night", 4), ("incoming", 1)):
        (position / name).mkdir()
        for k in range(count):
            made = [
                str(position / name / f"{k:04}.fits"),
                "-i",
                str(position / "testbed.toml"),
                "--seed",
                str(k),
            ]
            run("simulate", *made, *shlex.split("--separation 5 --theta 30 --locus linear --length 0.2"))
    levels = {"bias": [0.0] * 4, "dark": [0.0] * 4, "flat": np.repeat([500.0, 2000.0, 5000.0, 8000.0], 2)}
    for kind, electrons in levels.items():
        (position / kind).mkdir()
        for k, level in enumerate(electrons):
            read = np.round(30 + (rng.poisson(level, (48, 44)) + rng.normal(0, 2.4, (48, 44))) / 3.7)
            header = fits.Header(
                {"EXPTIME": 0.0 if kind == "bias" else 1.0 if kind == "dark" else level / 1e4}
            )
            fits.writeto(position / kind / f"{k}.fits", np.clip(read, 0, 4095).astype(np.uint16), header)
    fits.writeto(position / "sharp.fits", _stars(rng, 0.0))
    fits.writeto(position / "trailed.fits", _stars(rng, 6.0))
    tifffile.imwrite(position / "photo.tif", _smeared(12).astype(np.float32))
    return position


@pytest.fixture
def workplace(inputs, tmp_path, monkeypatch):
    """A copy of it for one page, into which the page writes."""
    position = tmp_path / "place"
    shutil.copytree(inputs, position, symlinks=True)
    monkeypatch.chdir(position)
    return position


@pytest.mark.parametrize(
    "name", [name if name in SHORT else pytest.param(name, marks=pytest.mark.slow) for name in RUN]
)
def test_every_command_and_code_block_runs(name, workplace, capsys):
    pytest.importorskip("dLuxToliman")
    text = TEXTS[name]
    if "results/results.ecsv" in text and "-o results" not in text:
        run("process", "night/0000.fits", "-i", "testbed.toml", "--locus", "mvn", "-o", "results")
    scope = {}
    for language, block in blocks(text, "sh", "python"):
        if language == "sh":
            for words in lines_of(block):
                assert words[0] == "jitterkit"
                run(*words[1:])
        else:
            exec(compile(block, name, "exec"), scope)
    if name == "README":  # the true separation stands in sample_frames/README.md
        found = re.findall(r": ([\d.]+) ± ([\d.]+) arcsec, ", capsys.readouterr().out)
        assert len(found) == 3
        for separation, error in found:
            assert abs(float(separation) - 9.1234) < 4 * float(error)
