import io
import pickle

import numpy as np
import pytest
from PIL import Image
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.frames.frame import Frame
from jitterkit.refit.result import FitResult, Status
from jitterkit.report.pictures import FrameReport, Gallery, render_frame


@pytest.mark.parametrize("locus", ["linear", "shm", "mvn", "stable"])
def test_a_fitted_frame_becomes_one_small_picture(make_fit, locus):
    frame, result = make_fit(locus, path="cube.fits", index=3, several=True)
    report = render_frame(frame, result)
    assert report.name == "cube.fits[3]"
    assert (report.row["frame"], report.row["locus"]) == (3, locus)
    width, height = Image.open(io.BytesIO(report.picture)).size
    assert width > 3 * height
    assert len(pickle.dumps(report)) < 400_000  # it crosses processes


def test_a_frame_without_a_fit_shows_its_data():
    frame = Frame(np.full((8, 8), np.nan), 1.0)
    report = render_frame(frame, FitResult(Status.NO_DATA, "no usable pixel"))
    assert report.alt == "data of array"
    assert report.picture.startswith(b"\x89PNG")


def _report(chi2_dof, status="ok"):
    return FrameReport(f"{status} {chi2_dof}", {"status": status, "chi2_dof": chi2_dof}, b"")


def test_a_short_run_is_shown_whole():
    gallery = Gallery(4)
    for chi2 in (1.0, 1.2, 0.9):
        gallery.add(_report(chi2))
    gallery.add(_report(float("nan"), "no_star"))
    assert [report.row["chi2_dof"] for report in gallery.chosen()[1:]] == [1.2, 1.0, 0.9]
    assert gallery.chosen()[0].row["status"] == "no_star"


def test_a_long_run_shows_as_many_failures_as_fits_and_the_worst_of_each(rng):
    gallery = Gallery(6)
    for chi2 in rng.permutation(1000):
        gallery.add(_report(1 + chi2 / 1000))
        gallery.add(_report(5 + chi2 / 1000, "poor_fit"))
        gallery.add(_report(float("nan"), "no_star"))
    shown = [(report.row["status"], round(report.row["chi2_dof"], 9)) for report in gallery.chosen()]
    assert shown == [("poor_fit", 5.999), ("poor_fit", 5.998), ("poor_fit", 5.997),
                     ("ok", 1.999), ("ok", 1.998), ("ok", 1.997)]  # fmt: skip


def test_no_pictures_can_be_asked_for():
    gallery = Gallery(0)
    gallery.add(_report(1.0))
    assert gallery.chosen() == []
    with refused(ErrorCode.OUT_OF_RANGE, -1):
        Gallery(-1)
