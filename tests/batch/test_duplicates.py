"""Frames that are in a run several times count once; the first of them, whoever was done first."""

import gzip
import os
import shutil
from functools import partial

import numpy as np
import pytest
from astropy.io import fits

from jitterkit.batch import FrameProcessor
from jitterkit.batch.template_blur import TemplateBlurEstimator
from jitterkit.frames import write_fits
from jitterkit.refit import FitResult, Status
from jitterkit.report.row import make_row
from jitterkit.run import process_files
from jitterkit.run.estimate import estimate_files
from jitterkit.run.rows import Record
from jitterkit.simulate import fits_header

pytestmark = pytest.mark.usefixtures("few_pictures")


@pytest.fixture(scope="module")
def night(tmp_path_factory, drawn, telescope):
    """Two frames, and every kind of duplicate of the first."""
    night = tmp_path_factory.mktemp("night")
    (night / "other").mkdir()
    for name, seed in (("a.fits", 1), ("b.fits", 2)):
        simulated = drawn(np.random.default_rng(seed))
        header = fits_header(simulated, telescope)
        write_fits(night / name, simulated.raw.data.astype(np.uint16), header=header)
    first = night / "a.fits"
    shutil.copy(first, night / "a copy.fits")
    shutil.copy(first, night / "other" / "a.fits")
    (night / "link.fits").symlink_to("a.fits")
    os.link(first, night / "hard.fits")
    (night / "z.fits.gz").write_bytes(gzip.compress(first.read_bytes()))
    values = fits.getdata(first).astype(float)
    write_fits(night / "double.fits", values, header=header)
    write_fits(night / "cube.fits", np.stack([values, fits.getdata(night / "b.fits"), values]), header=header)
    return night


def test_every_kind_of_duplicate_counts_once(night, tmp_path, processor):
    run = process_files([night, night / "other"], tmp_path / "out", processor)
    table = run.table
    rows = {f"{row['path']} [{row['frame']}]".removeprefix(f"{night}/"): row for row in table}
    assert len(rows) == len(table) == 11
    ok = [name for name, row in rows.items() if row["status"] == "ok"]
    assert ok == ["a copy.fits [0]", "b.fits [0]"]
    assert run.failures == 0
    for name in rows.keys() - set(ok):
        row = rows[name]
        assert row["status"] == "duplicate"
        assert row["reason"] == "duplicate"
        original = "b.fits [0]" if name == "cube.fits [1]" else "a copy.fits [0]"
        assert str(night / original) in row["message"]
        assert row["digest"] == rows[original]["digest"]
        assert np.isnan([row["separation"].value, row["sxx"].value, row["flux"].value, row["chi2_dof"]]).all()
    values, errors = (table[name][table["status"] == "ok"].value for name in ("separation", "separation_err"))
    weights = errors**-2
    assert run.summary["separation"]["n"] == 2
    assert run.summary["separation"]["mean"] == pytest.approx(
        (values * weights).sum() / weights.sum(), rel=1e-12
    )
    assert run.summary["separation"]["error"] == pytest.approx(weights.sum() ** -0.5, rel=1e-12)
    assert run.summary["status"] == {"duplicate": 9, "ok": 2}


LETTERS = {"0.fits": "x", "1.fits": "yx", "2.fits": "y", "3.fits": "z", "4.fits": "xz"}
"""Pixels of the frames of some files: a letter each."""


def spell(batches, processor, finish, *, backwards=False, most=9, **_):
    """Do some batches without a fit: the digest of a frame is its letter; z cannot be fitted at first."""
    batches = list(batches)
    for batch in batches[::-1][:most] if backwards else batches[:most]:
        rows = []
        for path, position in batch.items:
            letter = LETTERS[path.name][position]
            bad = letter == "z" and path.name == "3.fits"
            fit = FitResult(Status.POOR_FIT if bad else Status.OK, letter)
            rows.append(
                make_row(fit, path, position, digest=letter) | {"separation": 1.0, "separation_err": 2.0}
            )
        yield Record(batch, rows, {})
    if len(batches) > most:
        raise KeyboardInterrupt


@pytest.fixture
def run(tmp_path, processor, monkeypatch):
    monkeypatch.setattr("jitterkit.run.process.batch_size", lambda shape: 2)
    monkeypatch.setattr("jitterkit.run.process.count_frames", lambda path, hdu: len(LETTERS[path.name]))
    (tmp_path / "in").mkdir()
    for name in LETTERS:
        (tmp_path / "in" / name).touch()

    def run(resume=False, watch=None, **how):
        executor = partial(spell, **how)
        return process_files(
            [tmp_path / "in"], tmp_path / "out", processor, executor=executor, resume=resume, watch=watch
        )

    return run


EXPECTED = ["ok", "ok", "duplicate", "duplicate", "poor_fit", "duplicate", "ok"]
"""The last is the first with its pixels that could be fitted."""


def test_batches_that_end_in_any_order_give_the_same_rows(run):
    """As on a cluster: the first of the table counts, not the first that was done."""
    done = run(backwards=True)
    assert list(done.table["status"]) == EXPECTED
    assert done.failures == 1
    assert done.summary["separation"]["n"] == 3
    assert done.summary["separation"]["error"] == pytest.approx(2 / np.sqrt(3), rel=1e-12)


def test_a_run_that_is_resumed_knows_the_pixels_of_the_time_before(run):
    told = []
    with pytest.raises(KeyboardInterrupt):
        run(most=1)
    done = run(resume=True, watch=lambda row: told.append(row["status"]))
    assert list(done.table["status"]) == EXPECTED
    assert told == EXPECTED


def test_an_estimate_counts_a_duplicate_once(night, telescope):
    """A prior made of the table would else count its photons twice."""
    table = estimate_files([night], TemplateBlurEstimator(FrameProcessor(telescope)))
    numbers = table["sxx"].value[table["status"] == "ok"]
    assert list(table["file"][table["status"] == "ok"]) == ["a copy.fits", "b.fits"]
    assert np.isfinite(numbers).all()
    assert set(table["status"]) == {"ok", "duplicate"}
    assert np.isnan(table["sxx"].value[table["status"] == "duplicate"]).all()
    assert len(set(table["digest"])) == 2
