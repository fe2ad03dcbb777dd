"""Runs of files with an error of the flat field, which neither a frame nor the mean chi-squared shows."""

import json
import re
from functools import partial

import numpy as np
import pytest

from jitterkit.batch.executor import execute
from jitterkit.batch.store import Store
from jitterkit.cli.run import finalize
from jitterkit.frames import write_fits
from jitterkit.report.residual_stack import ResidualStack
from jitterkit.run import process_files
from jitterkit.simulate import fits_header

FRAMES, FLAT = 48, 0.007
"""In a night, and the rms error of a pixel's sensitivity."""


@pytest.fixture(scope="module")
def nights(drawn, telescope, tmp_path_factory):
    """Frames of a bright pair, with and without the flat."""
    rng, where = np.random.default_rng(4), tmp_path_factory.mktemp("nights")
    simulated = drawn(rng, flux=1e6)
    flat = 1 + FLAT * rng.normal(size=telescope.shape)
    for name, sensitivity in (("flat", flat), ("noise", np.ones(telescope.shape))):
        (where / name).mkdir()
        image = simulated.expected * sensitivity
        frames = [telescope.detector.expose(image, rng).astype(np.uint16) for _ in range(FRAMES)]
        for number in range(4):
            header = fits_header(simulated, telescope)
            write_fits(where / name / f"{number}.fits", np.stack(frames[number::4]), header=header)
    return where


@pytest.fixture(scope="module")
def process(processor):
    def process(night, out, executor=None, **options):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("jitterkit.run.process.batch_size", lambda shape: 16)
            return process_files([night], out, processor, executor=executor, **options)

    return process


@pytest.fixture(scope="module")
def flat(nights, process, tmp_path_factory):
    return process(nights / "flat", tmp_path_factory.mktemp("flat") / "out", threads=1)


def stacks(run):
    with Store(run.directory / "ledger.sqlite") as store:
        return store.stacks()


def test_the_stack_shows_a_flat_field_that_no_chi_squared_does(flat, telescope, capsys):
    fit = flat.summary["fit"]
    assert flat.summary["status"] == {"ok": FRAMES}
    assert fit["sigmas"] < 5 < 8 < fit["structure_sigmas"]
    assert fit["stack_frames"] == FRAMES
    written = json.loads((flat.directory / "summary.json").read_text())["fit"]
    assert written["structure_sigmas"] == fit["structure_sigmas"]
    finalize(flat, telescope)
    (said,) = (line for line in capsys.readouterr().out.splitlines() if "stacked residual" in line)
    page = (flat.directory / "report.html").read_text()
    assert said in page
    assert len(re.findall('alt="Sum of the residuals', page)) == 1


def test_the_bias_of_the_flat_is_less_than_it_may_hide(flat):
    separation = flat.summary["separation"]
    assert abs(separation["mean"] - 8.0) < flat.summary["fit"]["may_hide"] + 3.5 * separation["error"]


def test_a_night_of_noise_and_its_copies_have_no_structure(nights, process, telescope, tmp_path, capsys):
    """Twice the same noise is no structure: taken for two frames' it would have 22 sigmas."""
    (tmp_path / "copies").mkdir()
    for path in sorted((nights / "noise").iterdir())[:2]:
        for name in ("a", "b"):
            (tmp_path / "copies" / f"{name}{path.name}").write_bytes(path.read_bytes())
    run = process(tmp_path / "copies", tmp_path / "out", threads=2)
    assert run.summary["status"] == {"ok": FRAMES / 2, "duplicate": FRAMES / 2}
    assert run.summary["fit"]["stack_frames"] == FRAMES / 2
    assert abs(run.summary["fit"]["structure_sigmas"]) < 3.5
    finalize(run, telescope)
    assert "stacked" not in capsys.readouterr().out


def test_an_interrupted_run_has_the_stack_of_one_that_was_not(flat, nights, process, tmp_path):
    def interrupted(batches, *positional, **options):
        for done, record in enumerate(execute(batches, *positional, threads=2, **options)):
            if done == 1:
                raise KeyboardInterrupt
            yield record

    with pytest.raises(KeyboardInterrupt):
        process(nights / "flat", tmp_path / "out", interrupted)
    with Store(tmp_path / "out" / "ledger.sqlite") as store:
        (half,) = map(ResidualStack.unpack, store.stacks().values())
    assert 0 < half.frames < FRAMES
    resumed = process(nights / "flat", tmp_path / "out", partial(execute, threads=2), resume=True)
    assert stacks(resumed) == stacks(flat)
    assert repr(resumed.summary["fit"]) == repr(flat.summary["fit"])
