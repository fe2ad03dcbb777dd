import io
import pickle
from dataclasses import replace

import numpy as np
import pytest
from drawn import render_frame
from PIL import Image
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.frames.frame import Frame
from jitterkit.loci import LOCI, Path, Stable
from jitterkit.refit.result import FitResult, Status
from jitterkit.report.pictures import choose_pictures, pack_picture, render_pictures
from jitterkit.report.row import make_row

SIMPLE = ("stable", "linear", "shm", "mvn", "ellipse", "lissajous")
"""Loci of one kind: other tests draw frames that were fitted with some of them."""


@pytest.mark.parametrize("locus", ["linear", "shm", "mvn", "stable"])
def test_a_fitted_frame_becomes_one_small_picture(make_fit, locus):
    frame, result = make_fit(locus, path="cube.fits", index=3, several=True)
    report = render_frame(frame, result)
    assert report.name == "cube.fits[3]"
    assert (report.row["frame"], report.row["locus"]) == (3, locus)
    width, height = Image.open(io.BytesIO(report.picture)).size
    assert width > 3 * height
    assert len(pickle.dumps(report)) < 400_000  # it crosses processes


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=pytest.mark.slow) if name in SIMPLE and name != "stable" else name
        for name in LOCI
    ],
)
def test_every_locus_that_a_fit_may_end_with_is_drawn_with_its_kernel(make_fit, name):
    """A run that ended with tones, with a smear or with a path of eight knots was not written."""
    frame, result = make_fit("mvn")
    assert result.parameters is not None
    locus = LOCI[name].near(np.array([0.04, 0.01, 0.02]))
    locus = locus.finer(8) if isinstance(locus, Path) else locus
    fitted = replace(result, locus=name, parameters=result.parameters.with_locus(locus))
    still = replace(fitted, parameters=result.parameters.with_locus(Stable.of()))
    row = make_row(result, frame.path, frame.index, metadata=frame.metadata)
    drawn, unmoved = (render_frame(frame, fit, row).picture for fit in (fitted, still))
    assert (drawn == unmoved) == (name == "stable")


def test_a_frame_without_a_fit_shows_its_data():
    frame = Frame(np.full((8, 8), np.nan), 1.0)
    report = render_frame(frame, FitResult(Status.NO_DATA, "no usable pixel"))
    assert report.alt == "data of array"
    assert report.picture.startswith(b"\x89PNG")


def test_a_packed_picture_holds_three_images_in_single_precision(make_fit):
    frame, result = make_fit("linear", several=True)
    assert len(pack_picture(frame, result)) < 3 * 4 * frame.electrons.size + 3000


def test_pictures_drawn_one_after_the_other_are_those_drawn_alone(make_fit):
    fits = [make_fit(locus, several=True) for locus in ("linear", "stable")]
    frame, bare = fits[0][0], FitResult(Status.NO_DATA, "no usable pixel")
    other = Frame(np.arange(64.0).reshape(8, 8), 1.0)
    packed = [pack_picture(*one) for one in (*fits, (frame, bare), fits[0], (other, bare), fits[1])]
    together = [one.picture for one in render_pictures([({}, data) for data in packed])]
    alone = [one.picture for data in packed for one in render_pictures([({}, data)])]
    assert together == alone
    assert len(set(together)) == 4


def test_a_packed_frame_without_a_fit_shows_its_data():
    frame = Frame(np.full((8, 8), np.nan), 1.0)
    row = {"status": "no_data"}
    (report,) = render_pictures([(row, pack_picture(frame, FitResult(Status.NO_DATA, "no usable pixel")))])
    assert (report.alt, report.row) == ("data of array", row)
    assert report.picture.startswith(b"\x89PNG")


def _row(chi2_dof, status="ok"):
    return {"status": status, "chi2_dof": chi2_dof}


def test_a_short_run_is_shown_whole():
    rows = [_row(1.0), _row(1.2), _row(0.9), _row(float("nan"), "no_star")]
    assert choose_pictures(rows, 4) == [3, 1, 0, 2]


def test_a_long_run_shows_as_many_failures_as_fits_and_the_worst_of_each(rng):
    rows = []
    for chi2 in rng.permutation(1000):
        rows += [_row(1 + chi2 / 1000), _row(5 + chi2 / 1000, "poor_fit"), _row(float("nan"), "no_star")]
    chosen = [rows[position] for position in choose_pictures(rows, 6)]
    assert [(one["status"], round(one["chi2_dof"], 9)) for one in chosen] == [
        ("poor_fit", 5.999), ("poor_fit", 5.998), ("poor_fit", 5.997),
        ("ok", 1.999), ("ok", 1.998), ("ok", 1.997)]  # fmt: skip


def test_no_pictures_can_be_asked_for():
    assert choose_pictures([_row(1.0)], 0) == []
    with refused(ErrorCode.OUT_OF_RANGE, -1):
        choose_pictures([], -1)
