"""Runs of files with an error of the flat field, which neither a frame nor the mean chi-squared shows."""

import json
import re
from dataclasses import replace
from functools import partial

import equinox as eqx
import numpy as np
import pytest
from astropy.table import QTable

from jitterkit.batch.executor import execute
from jitterkit.batch.store import Store
from jitterkit.cli.run import finalize
from jitterkit.forward import Parameters, expected_image
from jitterkit.frames import write_fits
from jitterkit.instruments import read_instrument
from jitterkit.likelihood import Data
from jitterkit.locate import polished
from jitterkit.loci import Mvn
from jitterkit.refit import fit_frame
from jitterkit.report.residual_stack import ResidualStack
from jitterkit.run import process_files
from jitterkit.run.stacked_stars import bias_without, find_stacked_stars
from jitterkit.scene import Binary, FurtherStars, Star
from jitterkit.simulate import fits_header

pytestmark = pytest.mark.usefixtures("few_pictures")

FRAMES, FLAT = 48, 0.007
"""In a night, and the rms error of a pixel's sensitivity."""

FAINT_FRAMES = 14
THIRD, ANGLE, FAINTER = 6.0, np.radians(130.0), 9.9
"""Of a star beside the pair: from A [arcsec], its direction, and magnitudes that it is fainter."""


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
    def process(night, out, executor=None, by=processor, **options):
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("jitterkit.run.process.batch_size", lambda shape: 16)
            return process_files([night], out, by, executor=executor, **options)

    return process


@pytest.fixture(scope="module")
def flat(nights, process, tmp_path_factory):
    return process(nights / "flat", tmp_path_factory.mktemp("flat") / "out", threads=1)


@pytest.fixture(scope="module")
def faint(drawn, telescope, tmp_path_factory):
    """Frames, each at a place of its own, of a pair with a star of four standard errors in one of them."""
    rng, where = np.random.default_rng(9), tmp_path_factory.mktemp("faint")
    for number in range(FAINT_FRAMES):
        at = {"x": 1.0 + rng.uniform(-0.4, 0.4), "y": -2.0 + rng.uniform(-0.4, 0.4)}
        frame = drawn(rng, flux=1e6, **at)
        pair, star = frame.truth, THIRD * np.array([np.cos(ANGLE), np.sin(ANGLE)])
        x, y, flux = (float(part[0]) for part in pair.scene.stars())
        alone = Star(x + star[0], y + star[1], flux * 10 ** (-0.4 * FAINTER))
        light = expected_image(
            replace(pair, scene=alone, background=0.0), telescope.system().otf(pair.aberrations)
        )
        counts = telescope.detector.expose(frame.expected + np.asarray(light), rng).astype(np.uint16)
        write_fits(where / f"{number:02d}.fits", counts, header=fits_header(frame, telescope))
    return where


def test_a_star_that_no_frame_shows_is_found_and_left_out(faint, process, processor, tmp_path, capsys):
    telescope = processor.instrument
    run = process(faint, tmp_path / "one", threads=2)
    assert run.summary["status"] == {"ok": FAINT_FRAMES}
    assert not any(run.table["stars"])
    table = QTable.read(run.directory / "further_stars.ecsv")
    (star,) = run.summary["fit"]["further_stars"]
    truth = {"separation": THIRD, "angle_from_b": np.degrees(ANGLE) - 30.0, "delta_mag": FAINTER}
    for name, value in truth.items():
        assert star[name] == table[name][0].value
        assert abs(star[name] - value) < 3.5 * star[f"{name}_err"], name
    assert star["sigmas"] > 10
    without, one = run.summary["fit"]["without_further_stars"], run.summary["separation"]
    assert without["mean"] == one["mean"] - without["bias"]
    assert without["error"] == np.hypot(one["error"], without["bias_err"])
    assert abs(without["mean"] - 8.0) < 3.5 * without["error"]
    # frames that were fitted with the star have no such bias, and their part of the mean has none
    table = run.table.copy()
    table["stars"] = ["a star"] * 5 + [""] * (FAINT_FRAMES - 5)
    packed = {name: ResidualStack.unpack(one) for name, one in stacks(run).items()}
    part = find_stacked_stars(packed, table, processor)
    assert part.bias == pytest.approx(without["bias"] * (1 - 5 / FAINT_FRAMES), rel=0.1)
    finalize(run, telescope)
    assert "copy of further_stars.ecsv as stars in [sky]" in capsys.readouterr().out
    (tmp_path / "again.toml").write_text(
        f'[instrument]\nbase = "smallsat"\n[sky]\nstars = "{run.directory / "further_stars.ecsv"}"\n'
    )
    known = replace(telescope, sky=read_instrument(tmp_path / "again.toml").sky)
    run = process(faint, tmp_path / "two", threads=2, by=replace(processor, instrument=known))
    assert run.summary["status"] == {"ok": FAINT_FRAMES}
    assert "further_stars" not in run.summary["fit"]
    assert not (run.directory / "further_stars.ecsv").exists()


@pytest.mark.parametrize("place", [(2.0, 4.0), (-5.0, 1.0)])
def test_the_bias_by_a_star_is_that_of_a_fit_without_it(telescope, place):
    system, fainter = telescope.system(), 10 ** (-0.4 * 8.0)
    state, jitter = [5.0, -8.0], Mvn.of(0.15, 0.1, 20.0)
    third = FurtherStars(*(np.array([part]) for part in (*place, 2e9 * fainter)))
    truth = Parameters(Binary(8.0, 30.0, 0.3, -0.2, 2e9, 3.37, third), jitter, state, 5.0)
    otf = system.otf(np.array(state))
    data = Data(np.asarray(expected_image(truth.completed(otf), otf)), 4.0)
    found = polished(data, system, otf, otf.with_colours(truth.scene), jitter, ())
    alone = eqx.tree_at(lambda p: p.scene, truth, Binary(8.0, 30.0, 0.3, -0.2, 2e9, 3.37))
    fitted = fit_frame(data, system, alone, otf)
    bias, error = bias_without(found, data, system, ())
    assert fitted.of_scene("separation") - 8.0 == pytest.approx(bias, rel=0.02)
    assert 0 < error < 0.05 * abs(bias)


def stacks(run):
    with Store(run.directory / "ledger.sqlite") as store:
        return store.stacks()


@pytest.mark.slow
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


@pytest.mark.slow
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
