import json
from dataclasses import replace

import numpy as np
import pytest

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.metadata import Metadata
from jitterkit.refit.result import Candidate, FitResult, Status
from jitterkit.report.columns import COLUMNS
from jitterkit.report.flags import decode_flags
from jitterkit.report.row import make_row


def test_a_row_holds_the_fit_with_its_errors(make_fit):
    row = make_row(make_fit("linear")[1], "/night/frame.fits", 3, pa=263.0)
    assert (row["file"], row["frame"], row["path"]) == ("frame.fits", 3, "/night/frame.fits")
    assert (row["status"], row["locus"], row["iterations"], row["seconds"]) == ("ok", "linear", 6, 0.25)
    assert abs(row["separation"] - 8.1) < 5 * 2.4e-4
    assert row["separation_err"] == pytest.approx(2.4e-4)
    assert row["separation_crlb"] == pytest.approx(0.98 * 2.4e-4)
    assert (row["x"], row["x_err"], row["y"], row["y_err"]) == pytest.approx((1.5, 1e-4, -0.8, 2e-4))
    assert (row["flux"], row["contrast"]) == pytest.approx((3.811e7, 3.37))
    assert (row["theta"], row["pa"]) == pytest.approx((37.0, 263.0))
    assert row["pa_err"] == row["theta_err"] == pytest.approx(0.002)
    assert (row["noll4"], row["noll10"], row["noll10_err"]) == pytest.approx((4.0, 10.0, 0.05))


def test_the_jitter_of_a_linear_smear_is_its_length_over_root_twelve(make_fit):
    row = make_row(make_fit("linear")[1], "f")
    assert (row["jitter_length"], row["jitter_angle"]) == pytest.approx((0.75, 30.0))
    assert (row["jitter_major"], row["jitter_minor"]) == pytest.approx((0.75 / np.sqrt(12), 0), abs=1e-8)
    # Sxx = (L² + L² cos 2phi)/24, of which cos 30° squared is the share: by hand
    assert row["sxx"] == pytest.approx(0.75**2 / 12 * 0.75)
    # d Sxx = (|dc| cos(60°) + dc + sin(60°) ds)/24 with dc = ds = 1e-5
    assert row["sxx_err"] == pytest.approx(1e-5 / 24 * np.hypot(0.5 + 1, np.sqrt(0.75)))


def test_the_error_of_the_plate_scale_has_a_column_of_its_own(make_fit):
    result = make_fit("linear")[1]
    known = Metadata().override("instrument file a.toml", plate_scale=0.375, plate_scale_err=1e-5)
    row, plain = make_row(result, "f", metadata=known), make_row(result, "f", metadata=Metadata())
    assert row["separation_scale_err"] == pytest.approx(row["separation"] * 1e-5)
    assert row["separation_err"] == plain["separation_err"]
    assert np.isnan([plain["separation_scale_err"], make_row(result, "f")["separation_scale_err"]]).all()


@pytest.mark.parametrize(
    ("known", "corrected"),
    [
        ({"va_factor": 1.0001}, 8.1 * 1.0001),
        ({"orbit_change": 0.02}, 8.1 - 0.02),
        ({"va_factor": 1.0001, "orbit_change": -0.02}, 8.1 * 1.0001 + 0.02),
        ({}, np.nan),
    ],
)
def test_corrections_stand_beside_the_separation_as_it_was_measured(make_fit, known, corrected):
    result = make_fit("linear")[1]
    scene = replace(result.parameters.scene, separation=np.array(8.1))
    result = replace(result, parameters=replace(result.parameters, scene=scene))
    row = make_row(result, "f", metadata=Metadata().override("header X", **known))
    assert row["separation"] == 8.1
    assert row["separation_corrected"] == pytest.approx(corrected, rel=1e-14, nan_ok=True)
    for name in ("va_factor", "orbit_change"):
        assert row[name] == pytest.approx(known.get(name, np.nan), nan_ok=True)


def test_a_locus_without_size_has_no_angle_no_length_and_no_errors(make_fit):
    row = make_row(make_fit("stable")[1], "f")
    assert row["sxx"] == row["jitter_major"] == 0
    assert np.isnan([row[n] for n in ("sxx_err", "jitter_angle", "jitter_length")]).all()


def test_what_was_held_has_a_value_and_no_error(make_fit):
    row = make_row(make_fit()[1], "f")
    assert row["background"] == 400
    assert np.isnan(row["background_err"])


def test_a_failed_frame_is_a_row_of_nan_with_its_sentence():
    row = make_row(FitResult(Status.NO_STAR, ""), "dark.fits")
    assert (row["status"], row["reason"], row["message"]) == ("no_star", "no_star", Status.NO_STAR.value)
    numbers = [row[c.name] for c in COLUMNS if c.kind is float and c.name != "seconds"]
    assert np.isnan(numbers).all()
    assert all(isinstance(row[c.name], c.kind) for c in COLUMNS)


@pytest.mark.parametrize("status", Status)
def test_whatever_is_not_usable_has_an_error_code_for_a_reason(status):
    row = make_row(FitResult(status, ""), "f")
    if status.usable:
        assert row["reason"] == ""
    else:
        assert ErrorCode(row["reason"]) in ErrorCode


def test_the_reason_is_the_code_of_the_error_that_stopped_the_frame():
    error = FrameError(ErrorCode.TRUNCATED, "a.fits", "holds 12 of 2880 bytes", "copy it again")
    row = make_row(FitResult.from_error(Status.UNREADABLE, error), "a.fits")
    assert (row["status"], row["reason"], row["message"]) == ("unreadable", "truncated", str(error))
    row = make_row(FitResult.from_error(Status.FAILED, ZeroDivisionError("x"), "it broke down."), "a.fits")
    assert (row["status"], row["reason"], row["message"]) == ("failed", "internal", "it broke down.")


def test_remarks_of_frame_fit_and_header_become_one_number_and_strange_ones_a_word(make_fit):
    result = replace(make_fit("stable")[1], flags=("jitter_undetected", "haunted"))
    metadata = Metadata(warnings=("GAIN = 'low' is not a number",)).override("argument", exposure=0.1)
    row = make_row(result, "f", flags=("saturated",), metadata=metadata)
    assert decode_flags(row["flags"]) == ("other", "saturated", "jitter_undetected", "header_odd")
    assert row["message"] == "fitted in 6 steps (haunted) Warnings of its file: GAIN = 'low' is not a number."
    assert row["exposure"] == 0.1


def test_a_message_ends_with_the_first_three_warnings_of_the_file(make_fit):
    metadata = Metadata(warnings=tuple(f"warning {number}" for number in range(5)))
    message = make_row(make_fit("stable")[1], "f", metadata=metadata)["message"]
    assert [f"warning {number}" in message for number in range(5)] == [True] * 3 + [False] * 2
    assert "2 more" in message


def test_candidates_are_json_with_the_best_first():
    tried = (
        Candidate("shm", 12.3456789, 0.25, 8.1, 2.4e-4, -7.1234),
        Candidate("linear", float("nan"), 0.75, float("nan")),
    )
    row = make_row(FitResult(Status.OK, "", candidates=tried), "f")
    best, second = json.loads(row["candidates"])
    assert (best["locus"], best["weight"]) == ("linear", 0.75)
    assert {best[name] for name in ("objective", "separation", "separation_err", "evidence")} == {None}
    assert (second["locus"], second["objective"]) == ("shm", 12.346)
    assert (second["separation_err"], second["evidence"]) == (2.4e-4, -7.123)


def test_theta_is_a_direction_and_a_variance_below_zero_no_error(make_fit):
    result = make_fit()[1]
    scene = result.parameters.scene
    turned = type(scene)(8.1, -323.0, 0, 0, 1e6, 3)
    parameters = type(result.parameters)(turned, result.parameters.locus, result.parameters.aberrations)
    row = make_row(replace(result, parameters=parameters, covariance=-result.covariance), "f")
    assert row["theta"] == pytest.approx(37.0)
    assert np.isnan(row["separation_err"])


def test_aberrations_that_were_held_have_a_value_without_an_error(make_fit):
    result = make_fit()[1]
    held = replace(result, names=result.names[:6], covariance=result.covariance[:6, :6], crlb=result.crlb[:6])
    row = make_row(held, "f")
    assert row["noll4"] == 4
    assert np.isnan(row["noll4_err"])


def test_a_file_name_cannot_break_a_table(make_fit):
    row = make_row(make_fit()[1], "/n\n1/a\tb\udcff.fits")
    assert row["file"] == r"a\tb\udcff.fits"
    assert row["path"] == r"/n\n1/a\tb\udcff.fits"


def test_the_spread_over_candidates_is_weighted_and_leaves_out_what_has_no_weight(make_fit):
    linear, shm = Candidate("linear", 10.0, 0.8, 8.1), Candidate("shm", 12.0, 0.2, 8.1 + 5e-6)
    lost = Candidate("ellipse", np.nan, 0.0, np.nan)
    row = make_row(replace(make_fit("linear")[1], candidates=(linear, shm, lost)), "f")
    # two points of weights w and 1 - w a distance d apart scatter by d sqrt(w (1 - w))
    assert row["separation_spread"] == pytest.approx(5e-6 * np.sqrt(0.8 * 0.2), rel=1e-6)
    assert row["locus_weight"] == 0.8
    alone = make_row(replace(make_fit("linear")[1], candidates=(linear,)), "f")
    assert np.isnan([alone["separation_spread"], alone["locus_weight"]]).all()


def test_a_measured_shape_has_its_error(make_fit):
    row = make_row(replace(make_fit()[1], shape=-1.3, shape_err=0.4), "f")
    assert (row["shape"], row["shape_err"]) == (-1.3, 0.4)
    assert np.isnan(make_row(make_fit()[1], "f")["shape"])
