"""A run with everything in it: good frames come out, bad ones are rows with a sentence."""

import json
from pathlib import Path

import numpy as np
import pytest
from refusals import refused

from jitterkit.batch import FrameProcessor
from jitterkit.batch.template_blur import TemplateBlurEstimator
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import write_fits, write_tiff
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import Mvn
from jitterkit.refit import KernelPrior
from jitterkit.report.flags import decode_flags
from jitterkit.report.table import read_table
from jitterkit.run import process_files
from jitterkit.run.estimate import estimate_files
from jitterkit.simulate import fits_header, tiff_metadata

pytestmark = pytest.mark.usefixtures("few_pictures")


def write(path, simulated, telescope, **cards):
    header = fits_header(simulated, telescope) | cards
    return write_fits(path, simulated.raw.data.astype(np.uint16), header=header)


@pytest.fixture(scope="module")
def spoilt(telescope, tmp_path_factory, drawn):
    """A directory with a good frame and everything that goes wrong."""
    rng = np.random.default_rng(8)
    where = tmp_path_factory.mktemp("night")
    good = drawn(rng)
    write(where / "a-good.fits", good, telescope)
    whole = write(where / "truncated.fits", good, telescope).read_bytes()
    (where / "truncated.fits").write_bytes(whole[: len(whole) // 2])
    (where / "text.fits").write_text("dear diary,\n")
    write_fits(where / "nan.fits", np.full(telescope.shape, np.nan))
    write_fits(where / "blank.fits", np.full(telescope.shape, 30, np.uint16))
    sky = telescope.detector.expose(np.full(telescope.shape, 20.0), rng)
    write_fits(where / "nostar.fits", sky.astype(np.uint16))
    write(where / "scale.fits", good, telescope, PIXSCALE=0.3)
    write(where / "absurd.fits", good, telescope, PIXSCALE=37.5)
    (where / "colour.tif").write_bytes(_colour_tiff(rng))
    write(where / "z-good.fits", drawn(rng), telescope)
    return where


def _colour_tiff(rng) -> bytes:
    """A small RGB TIFF, written by hand: 8 bits, one strip."""
    import struct

    pixels = rng.integers(0, 255, (16, 16, 3), dtype=np.uint8).tobytes()
    tags = [
        (256, 3, 1, 16), (257, 3, 1, 16), (258, 3, 3, 200), (259, 3, 1, 1), (262, 3, 1, 2),
        (273, 4, 1, 256), (277, 3, 1, 3), (278, 3, 1, 16), (279, 4, 1, len(pixels)), (284, 3, 1, 1),
    ]  # fmt: skip
    directory = struct.pack("<H", len(tags))
    for tag, kind, count, value in tags:
        packed = struct.pack("<HH", value, 0) if kind == 3 and count == 1 else struct.pack("<I", value)
        directory += struct.pack("<HHI", tag, kind, count) + packed
    head = struct.pack("<2sHI", b"II", 42, 8) + directory + struct.pack("<I", 0)
    return head.ljust(200, b"\0") + struct.pack("<3H", 8, 8, 8).ljust(56, b"\0") + pixels


@pytest.fixture(scope="module")
def run(spoilt, processor, tmp_path_factory):
    return process_files([spoilt], tmp_path_factory.mktemp("out") / "results", processor)


STATUS = {
    "a-good.fits": ("ok", "", []),
    "truncated.fits": ("unreadable", "truncated", ["truncated.fits"]),
    "text.fits": ("unreadable", "unknown_format", ["text.fits", "dear diary"]),
    "nan.fits": ("no_data", "no_data", []),
    "blank.fits": ("no_star", "no_star", []),
    "nostar.fits": ("no_star", "no_star", []),
    "scale.fits": ("poor_fit", "model_mismatch", ["0.3 arcsec", "PIXSCALE", "0.375", "--plate-scale"]),
    "absurd.fits": ("mismatch", "sampling", ["37.5 arcsec", "PIXSCALE", "--plate-scale"]),
    "colour.tif": ("unreadable", "colour", ["colour.tif", " 3 "]),
    "z-good.fits": ("ok", "", []),
}


@pytest.mark.parametrize("name", STATUS)
def test_each_frame_ends_with_its_own_status_reason_and_values(name, run):
    (row,) = (row for row in run.table if row["file"] == name)
    status, reason, values = STATUS[name]
    assert (row["status"], row["reason"]) == (status, reason), row["message"]
    if status == "ok":
        values = [f"{row['chi2_dof']:.4g}"]
    assert [value for value in values if value not in row["message"]] == [], row["message"]


def test_good_frames_beside_bad_ones_are_unharmed(run, spoilt, processor, tmp_path):
    alone = process_files([spoilt / "z-good.fits"], tmp_path / "alone", processor).table[0]
    (beside,) = (row for row in run.table if row["file"] == "z-good.fits")
    # alone it is fitted without an anchor, and in either way the optics may be off by 0.1 sigma of the image
    for name in ("separation", "theta", "sxx"):
        assert abs(alone[name] - beside[name]) < 0.1 * alone[f"{name}_err"], name
    assert beside["chi2_dof"] == pytest.approx(alone["chi2_dof"], rel=1e-4)
    assert abs(alone["separation"].value - 8.0) < 5 * alone["separation_err"].value


def test_the_three_files_hold_the_run(run):
    table = read_table(run.directory / "results.ecsv")
    assert len(table) == len(STATUS)
    assert str(table["separation"].unit) == "arcsec"
    assert table.meta["instrument"] == "plain"
    summary = json.loads((run.directory / "summary.json").read_text())
    assert summary["status"]["ok"] == 2
    assert summary["separation"]["n"] == 2
    page = (run.directory / "report.html").read_text()
    assert "dear diary" in page
    assert "<script" not in page


def test_failures_are_counted(run):
    assert run.failures == len(STATUS) - 2


def test_results_are_not_replaced_unasked(run, spoilt, processor):
    with refused(ErrorCode.EXISTS, run.directory / "results.ecsv", "--overwrite"):
        process_files([spoilt], run.directory, processor)


def test_nor_is_somebody_s_own_configuration(spoilt, processor, tmp_path):
    (tmp_path / "configuration.json").write_text("mine")
    with refused(ErrorCode.EXISTS, tmp_path / "configuration.json", "--overwrite"):
        process_files([spoilt], tmp_path, processor)
    assert (tmp_path / "configuration.json").read_text() == "mine"


def test_a_path_that_does_not_exist_is_reported_before_any_work(tmp_path, processor):
    with refused(ErrorCode.NOT_FOUND, tmp_path / "nowhere.fits", error=FrameError):
        process_files([tmp_path / "nowhere.fits"], tmp_path / "out", processor)
    assert not (tmp_path / "out").exists()


def test_a_directory_that_is_a_file_is_refused(spoilt, processor):
    with refused(ErrorCode.NOT_WRITABLE, spoilt / "text.fits"):
        process_files([spoilt / "a-good.fits"], spoilt / "text.fits", processor)


def test_a_tiff_gives_what_its_fits_gives(telescope, processor, tmp_path, rng, drawn):
    simulated = drawn(rng, theta=75.0)
    write(tmp_path / "frame.fits", simulated, telescope)
    write_tiff(
        tmp_path / "frame.tif", simulated.raw.data.astype(np.uint16), metadata=tiff_metadata(simulated)
    )
    fits, tiff = (
        process_files([tmp_path / f"frame.{end}"], tmp_path / f"out_{end}", processor).table[0]
        for end in ("fits", "tif")
    )
    assert fits["status"] == tiff["status"] == "ok"
    # upside down, theta would be -75
    assert fits["theta"] == tiff["theta"]
    assert abs(fits["theta"].value - 75.0) < 0.5


def test_a_world_coordinate_system_gives_a_position_angle(telescope, processor, tmp_path, rng, drawn):
    simulated = drawn(rng, theta=90.0)
    cards = {
        "CTYPE1": "RA---TAN", "CRPIX1": 22.5, "CRVAL1": 219.9, "CUNIT1": "deg", "CD1_1": -0.375 / 3600,
        "CTYPE2": "DEC--TAN", "CRPIX2": 24.5, "CRVAL2": -60.8, "CUNIT2": "deg", "CD2_2": 0.375 / 3600,
        "CD1_2": 0.0, "CD2_1": 0.0,
    }  # fmt: skip
    write(tmp_path / "sky.fits", simulated, telescope, **cards)
    (row,) = process_files([tmp_path / "sky.fits"], tmp_path / "out", processor).table
    # north is up and east is left: a pair along +y lies at position angle zero
    angle = (row["pa"].value + 180) % 360 - 180
    assert abs(angle) < 0.5


def test_estimates_come_as_a_table(spoilt, processor):
    table = estimate_files([spoilt], TemplateBlurEstimator(processor))
    good = table[table["status"] == "ok"]
    assert set(good["file"]) >= {"a-good.fits", "z-good.fits"}
    assert {"no_star", "unreadable", "no_data"} <= set(table["status"])
    row = good[list(good["file"]).index("a-good.fits")]
    truth = np.asarray(Mvn.of(0.1, 0.05, 20.0).moments())
    for name, value in zip(("sxx", "sxy", "syy"), truth, strict=True):
        assert abs(row[name].value - value) < 5 * row[f"{name}_err"].value


def test_sample_frames_directory_is_where_the_readme_says():
    assert (Path(__file__).parents[2] / "sample_frames").is_dir()


def test_a_prior_that_the_frame_contradicts_is_a_flag_in_its_row(telescope, tmp_path, rng, drawn):
    estimate = KernelEstimate(np.array([0.5, 0.0, 0.5]), np.eye(3) * 1e-4, "score", "yesterday.fits[0]")
    write(tmp_path / "frame.fits", drawn(rng), telescope)
    processor = FrameProcessor(telescope, locus="mvn", prior=KernelPrior("a file", (estimate,)))
    (row,) = process_files([tmp_path / "frame.fits"], tmp_path / "out", processor).table
    assert row["status"] == "ok"
    assert "prior_contradicted" in decode_flags(row["flags"])
