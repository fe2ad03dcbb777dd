"""Blur of star fields and of scenes without stars, from file to table, alone and beside a reference."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.batch import scene_blur
from jitterkit.batch.scene_blur import METHODS, SceneBlurEstimator, sharpest
from jitterkit.errors import ErrorCode
from jitterkit.frames import RawFrame, write_fits
from jitterkit.run.estimate import estimate_files
from jitterkit.starfield.trail import _CONDITION


def test_a_star_field_alone_gives_a_conditional_length_in_arcsec(folder, trail):
    (row,) = estimate_files([folder / "field.fits"], SceneBlurEstimator(stars=True))
    assert row["status"] == "ok"
    assert row["length"].to_value("arcsec") == pytest.approx(trail * 0.5, rel=0.05)
    # 40 stars: an axis to a degree, four times its error allowed
    assert abs((row["angle"].to_value("deg") + 90) % 180 - 90) < 4 * row["angle_err"].to_value("deg") < 4
    assert row["message"].startswith("smear: ")
    assert _CONDITION in row["message"]


def test_a_reference_that_shows_stars_is_taken_for_a_star_field(folder, trail, first):
    measurer = SceneBlurEstimator(reference=first(folder / "sharpfield.fits"))
    (row,) = estimate_files([folder / "field.fits"], measurer)
    assert row["length"].to_value("arcsec") == pytest.approx(trail * 0.5, rel=0.05)
    assert _CONDITION not in row["message"]


def test_the_roundest_frame_of_a_set_serves_as_reference(folder):
    assert sharpest([folder / "field.fits", folder / "sharpfield.fits"]).name == "sharpfield.fits"


def test_the_roundest_may_be_any_frame_of_a_file(folder, tmp_path, first):
    fields = [first(folder / name).data for name in ("field.fits", "sharpfield.fits")]
    cube = write_fits(tmp_path / "cube.fits", np.stack(fields), header={"BUNIT": "electron", "PIXSCALE": 0.5})
    found = sharpest([folder / "field.fits", cube])
    assert found.name == "cube.fits[1]"
    np.testing.assert_allclose(found.data, fields[1])


def test_the_reference_s_own_row_says_that_it_is_the_reference(folder, tmp_path, first):
    (tmp_path / "link.fits").symlink_to(folder / "sharpfield.fits")
    measurer = SceneBlurEstimator(reference=first(folder / "sharpfield.fits"), stars=True)
    table = estimate_files([tmp_path / "link.fits", folder / "field.fits"], measurer)
    assert list(table["status"]) == ["reference", "ok"]
    assert list(table["reason"]) == ["is_reference", ""]
    assert "link.fits" in table["message"][0]
    assert np.isnan(table["sxx"][0].value)


@pytest.mark.slow
def test_of_a_cube_only_the_frame_that_is_the_reference_is_left_out(tmp_path, view, first):
    rng = np.random.default_rng(6)
    cube = np.stack([view(rng, 0.0), view(rng, 9.0)])
    path = write_fits(tmp_path / "cube.fits", cube.astype(np.float32))
    measurer = SceneBlurEstimator(reference=first(path), stars=False)
    measurer.check([path])
    table = estimate_files([path], measurer)
    assert list(table["status"]) == ["reference", "ok"]
    assert table["length"][1].to_value("pix") == pytest.approx(9.0, abs=0.5)


def test_a_file_that_cannot_be_read_keeps_no_set_from_having_a_roundest_frame(folder, tmp_path):
    (tmp_path / "bad.fits").write_text("not a frame")
    found = sharpest([tmp_path / "bad.fits", folder / "field.fits", folder / "sharpfield.fits"])
    assert found.name == "sharpfield.fits"


def test_a_reference_that_serves_one_file_of_a_set_is_not_refused(folder, tmp_path, first):
    small = write_fits(tmp_path / "a.fits", np.ones((30, 40)))
    SceneBlurEstimator(reference=first(folder / "sharpview.fits")).check([small, folder / "view.fits"])
    with refused(ErrorCode.WRONG_SHAPE, "sharpview.fits", "400 x 400", "a.fits 40 x 30"):
        SceneBlurEstimator(reference=first(folder / "sharpview.fits")).check([small])


@pytest.mark.parametrize("with_reference", [True, False])
def test_a_view_gives_its_smear_in_pixels_with_and_without_a_sharp_one(folder, with_reference, first):
    reference = first(folder / "sharpview.fits") if with_reference else None
    (row,) = estimate_files([folder / "view.fits"], SceneBlurEstimator(reference=reference))
    assert row["status"] == "ok", row["message"]
    assert row["length"].to_value("pix") == pytest.approx(17.3, abs=0.5)
    assert row["angle"].to_value("deg") == pytest.approx(30.0, abs=1.0)


def test_what_an_image_does_not_hold_is_a_row_that_says_so_and_harms_no_other(folder):
    table = estimate_files([folder / "sharpview.fits", folder / "view.fits"], SceneBlurEstimator())
    assert list(table["status"]) == ["undetermined", "ok"]
    assert list(table["reason"]) == ["not_constrained", ""]


def test_a_view_in_noise_serves_as_reference_and_noise_does_not():
    # neighbours alike by a tenth of their variance: of 160 000 pixels chance makes one in 400 of it
    rng = np.random.default_rng(7)
    noise = rng.normal(0, 1, (400, 400))
    waves = 0.3 * np.sqrt(2) * np.sin(np.arange(400) / 20)
    SceneBlurEstimator(reference=RawFrame.from_array(noise + waves), stars=False).check([])
    with refused(ErrorCode.NO_SIGNAL, "array"):
        SceneBlurEstimator(reference=RawFrame.from_array(noise), stars=False).check([])


@pytest.mark.parametrize("stars", [None, True])
def test_the_stars_of_a_reference_are_looked_for_once(folder, stars, monkeypatch, first):
    looked = []
    monkeypatch.setattr(scene_blur, "field_psf", lambda frame: looked.append(frame.name))
    measurer = SceneBlurEstimator(reference=first(folder / "sharpfield.fits"), stars=stars)
    measurer.check([folder])
    assert looked == ["sharpfield.fits"]


def test_a_sharp_view_of_another_size_is_refused_in_words(folder):
    measurer = SceneBlurEstimator(reference=RawFrame.from_array(np.ones((100, 120))), stars=False)
    (row,) = estimate_files([folder / "view.fits"], measurer)
    assert (row["status"], row["reason"]) == ("failed", "wrong_shape")
    assert "120 x 100" in row["message"]
    assert "view.fits 400 x 400" in row["message"]


def test_a_sharp_view_of_another_plate_scale_is_refused_in_words(folder, tmp_path, first):
    for name, file, scale in (("sharp", "sharpview.fits", 1.0), ("smeared", "view.fits", 0.5)):
        write_fits(tmp_path / f"{name}.fits", first(folder / file).data, header={"PIXSCALE": scale})
    measurer = SceneBlurEstimator(reference=first(tmp_path / "sharp.fits"), stars=False)
    with refused(ErrorCode.WRONG_INSTRUMENT, "1.0 arcsec", "frame 0.5"):
        measurer.complete(first(tmp_path / "smeared.fits"))


def test_an_unknown_method_lists_the_known_ones():
    with refused(ErrorCode.UNKNOWN_NAME, "'guess'", *METHODS):
        SceneBlurEstimator(method="guess")
