"""What is written of a frame: its row, its picture, its kernel and its deblurred image."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from astropy.io import fits
from astropy.wcs import WCS
from refusals import refused

from jitterkit.batch.scene_blur import SceneBlurEstimator
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import Metadata, RawFrame, open_frames, write_fits, write_tiff
from jitterkit.frames.fits import read_image
from jitterkit.kernels import read_kernel
from jitterkit.refit import read_kernel_prior
from jitterkit.run.estimate import estimate_files
from jitterkit.run.products import Products

PART = np.s_[100:300, 100:300]
"""Of a view: to deblur all of it takes four times as long."""


def test_pictures_kernels_and_deblurred_images_are_named_after_the_frame(folder, tmp_path, first):
    products = Products(tmp_path / "a", tmp_path / "b", tmp_path / "c")
    before, sharp = (first(folder / name).data[PART] for name in ("view.fits", "sharpview.fits"))
    write_fits(tmp_path / "view.fits", before)
    table = estimate_files([tmp_path / "view.fits"], SceneBlurEstimator(), keep=products.write)
    assert (tmp_path / "a/view.png").read_bytes().startswith(b"\x89PNG")
    kernel = read_kernel(tmp_path / "b/view.kernel.fits").kernel
    x = np.arange(kernel.shape[1]) - kernel.shape[1] // 2
    spread = kernel.sum(axis=0) @ x**2
    assert spread == pytest.approx(table["sxx"][0].value, rel=1e-6)  # the table's unit is pixels
    assert read_image(tmp_path / "c/view.deblurred.fits")[1]["SOURCE"] == "view.fits"
    after = first(tmp_path / "c/view.deblurred.fits").data
    sharp, before, after = (image[50:-50, 50:-50] for image in (sharp, before, after))
    # a kernel drawn upside down leaves twice the blurred image's distance from the sharp one
    assert np.std(after - sharp) < 0.8 * np.std(before - sharp)
    with refused(ErrorCode.EXISTS, tmp_path / "a/view.png", "--overwrite"):
        Products(tmp_path / "a")


def refusals_of(products, refusals):
    """Writes products, and notes what is refused."""

    def keep(measured):
        try:
            products.write(measured)
        except FrameError as error:
            refusals.append(error)
            raise

    return keep


@pytest.fixture
def namesakes(folder, tmp_path):
    """Two fields of one name, in two directories."""
    other = tmp_path / "other"
    other.mkdir()
    return [folder / "field.fits", Path(shutil.copy(folder / "sharpfield.fits", other / "field.fits"))]


@pytest.mark.parametrize(
    ("kind", "end"),
    [
        ("pictures", "png"),
        ("kernels", "kernel.fits"),
        ("images", "deblurred.fits"),
    ],
)
@pytest.mark.slow
def test_two_frames_of_one_name_do_not_replace_each_others_products(namesakes, tmp_path, kind, end):
    written = []
    for count in (1, 2):
        refusals, products = [], Products(**{kind: tmp_path / str(count)})
        keep = refusals_of(products, refusals)
        table = estimate_files(namesakes[:count], SceneBlurEstimator(stars=True), keep=keep)
        written.append((tmp_path / str(count) / f"field.{end}").read_bytes())
    assert written[0] == written[1]
    assert list(table["status"]) == ["ok", "undetermined"]  # the second field's stars are round
    (refusal,) = refusals
    assert refusal.code is ErrorCode.EXISTS
    assert "field.fits" in str(refusal)
    assert [str(refusal) in message for message in table["message"]] == [False, True]


def test_where_nothing_is_written_frames_may_share_a_name(namesakes):
    refusals = []
    table = estimate_files(namesakes, SceneBlurEstimator(stars=True), keep=refusals_of(Products(), refusals))
    assert list(table["status"]) == ["ok", "undetermined"]  # the second field's stars are round
    assert refusals == []


def test_a_second_frame_of_one_stem_has_products_of_its_file_s_full_name(folder, tmp_path):
    (tmp_path / "field.fit").write_bytes((folder / "field.fits").read_bytes())
    refusals, products = [], Products(kernels=tmp_path / "kernels")
    files = [tmp_path / "field.fit", folder / "field.fits"]
    estimate_files(files, SceneBlurEstimator(stars=True), keep=refusals_of(products, refusals))
    assert refusals == []
    assert (tmp_path / "kernels/field.kernel.fits").exists()
    assert read_kernel(tmp_path / "kernels/field.fits.kernel.fits").cards["SOURCE"] == "field.fits"


@pytest.mark.parametrize("oversample", [2, 3])
def test_an_exported_kernel_has_the_oversampling_asked_for_and_says_so(folder, tmp_path, oversample):
    products = Products(kernels=tmp_path, oversample=oversample)
    table = estimate_files([folder / "field.fits"], SceneBlurEstimator(stars=True), keep=products.write)
    kernel, scale, cards = read_kernel(tmp_path / "field.kernel.fits")
    assert (scale, cards["OVERSAMP"]) == (pytest.approx(0.5 / oversample), oversample)
    assert cards["GS_SCALE"] == scale
    assert all(side % 2 == 1 for side in kernel.shape)
    x = np.arange(kernel.shape[1]) - kernel.shape[1] // 2
    spread = kernel.sum(axis=0) @ (x * scale) ** 2
    assert spread == pytest.approx(table["sxx"][0].to_value("arcsec2"), rel=1e-6)


def test_a_table_carries_what_a_prior_needs_of_it(folder, tmp_path):
    measured = []
    keep = measured.append
    table = estimate_files([folder / "field.fits"], SceneBlurEstimator(stars=True), keep=keep)
    table.write(tmp_path / "k.ecsv", format="ascii.ecsv")
    found = measured[0].estimate
    mean, covariance = read_kernel_prior(tmp_path / "k.ecsv").of("another.fits").moments
    np.testing.assert_allclose(mean, found.moments, rtol=1e-12)
    np.testing.assert_allclose(covariance, found.covariance, rtol=1e-9, atol=1e-9 * found.covariance.max())


class _Same:
    """A measurer that has the same to say of every frame."""

    name, threads, batch_size, plate_scale = "same", 1, 8, None

    def __init__(self, measured):
        self.measured = measured

    def for_batch(self, batch, hdu):
        return self

    def calibrate(self, raw):
        return raw

    def complete(self, raw):
        return self.measured(raw)


@pytest.mark.parametrize("breakage", ["estimate", "picture"])
def test_a_frame_that_breaks_down_takes_no_row_with_it(folder, tmp_path, breakage):
    scenes = SceneBlurEstimator(stars=True)

    def measured(raw):
        found = scenes.complete(raw)
        odd = replace(found.estimate, covariance=np.zeros((3, 3)))
        return replace(found, estimate=odd) if breakage == "estimate" else found

    def keep(one):
        if breakage == "picture":
            raise np.linalg.LinAlgError("Singular matrix")

    another = Path(shutil.copy(folder / "field.fits", tmp_path / "another.fits"))
    with fits.open(another, mode="update") as hdus:
        hdus[0].data[0, 0] += 1  # the same pixels would be a duplicate
    files = [folder / "field.fits", another]
    table = estimate_files(files, _Same(measured), keep=keep)
    assert list(table["status"]) == ["ok", "ok"]
    if breakage == "picture":
        assert table["message"][0].endswith("Singular matrix")
    else:
        assert np.all(np.isnan(table["significance"]))


def test_each_frame_has_a_row_of_its_own(folder, tmp_path):
    (tmp_path / "broken.fits").write_bytes(b"SIMPLE  =                    T")
    files = [folder / "field.fits", tmp_path / "broken.fits", folder / "view.fits", folder / "sharpview.fits"]

    def measured(raw):
        if raw.name == "view.fits":
            raise np.linalg.LinAlgError("Singular matrix")
        return replace(SceneBlurEstimator(stars=True).complete(raw_field), message=raw.name)

    with open_frames(files[0]) as file:
        raw_field = file[0]
    table = estimate_files(files, _Same(measured))
    assert list(table["file"]) == [path.name for path in files]
    assert list(table["status"]) == ["ok", "unreadable", "failed", "ok"]
    assert list(table["reason"]) == ["", "truncated", "internal", ""]
    assert list(table["message"][[0, 2, 3]]) == ["field.fits", "Singular matrix", "sharpview.fits"]
    digests = set(table["digest"][[0, 3]])
    assert len(digests) == 2
    assert "" not in digests


@pytest.mark.parametrize(("size", "told"), [(0.5, True), (5.0, False)])
def test_undetected_jitter_is_called_so_in_its_row_and_its_file(folder, tmp_path, size, told):
    def measured(raw):
        found = SceneBlurEstimator(stars=True).complete(raw)
        # chi-squared of one moment of size standard errors: 0.25 and 25, of three one in 1000 is beyond 16.3
        noise = replace(found.estimate, moments=size * np.array([1e-3, 0, 0]), covariance=np.eye(3) * 1e-6)
        return replace(found, estimate=replace(noise, locus=None))

    (row,) = estimate_files([folder / "field.fits"], _Same(measured), keep=Products(kernels=tmp_path).write)
    cards = read_kernel(tmp_path / "field.kernel.fits").cards
    assert (f"chi-squared {row['significance']:.1f}" in row["message"]) == told
    assert ("undetected" in str(cards.get("COMMENT", ""))) == told


@pytest.mark.parametrize(("spread", "remarked"), [(0.01, True), (0.03, False)])
def test_a_kernel_on_pixels_with_other_moments_than_the_table_is_remarked(folder, spread, remarked):
    def measured(raw):
        found = SceneBlurEstimator(stars=True).complete(raw)
        kernel = np.outer([0, 1, 0], [0.25, 0.5, 0.25])  # a variance of half a pixel² along x, none along y
        moments = np.array([0.1, 0.0, 0.0])  # at 0.5 arcsec a pixel the kernel has 0.125
        pixels = replace(found.estimate, kernel=kernel, locus=None, moments=moments)
        return replace(found, estimate=replace(pixels, covariance=np.eye(3) * spread**2))

    (row,) = estimate_files([folder / "field.fits"], _Same(measured))
    assert ("sxx 0.125" in row["message"]) == remarked


@pytest.mark.parametrize(
    ("file_rows", "said"), [pytest.param(False, "BOTTOM-UP", marks=pytest.mark.slow), (True, "TOP-DOWN")]
)
def test_exports_of_a_tiff_say_the_order_of_their_rows(folder, tmp_path, first, file_rows, said):
    """The trail of the view climbs to the right; with the top row first it falls along the array's rows."""
    data = first(folder / "view.fits").data[PART]
    write_tiff(tmp_path / "view.tif", data.astype(np.float32), metadata={"plate_scale": 0.5})
    products = Products(kernels=tmp_path / "k", images=tmp_path / "i", file_rows=file_rows)
    (row,) = estimate_files([tmp_path / "view.tif"], SceneBlurEstimator(), keep=products.write)
    assert row["status"] == "ok", row["message"]
    (array, cards), (image, image_cards) = (  # as they stand: read_image turns them over
        fits.getdata(tmp_path / name, header=True) for name in ("k/view.kernel.fits", "i/view.deblurred.fits")
    )
    assert cards["ROWORDER"] == image_cards["ROWORDER"] == said
    y, x = (np.arange(n) - n // 2 for n in array.shape)
    slope = np.sign(y @ array @ x)
    assert slope == (-1 if file_rows else 1)
    assert cards["SXY"] > 0  # with y upwards, whatever the rows
    kernel = read_kernel(tmp_path / "k/view.kernel.fits").kernel
    assert y @ kernel @ x > 0
    upright = image[::-1] if file_rows else image
    assert np.corrcoef(upright.ravel(), data.ravel())[0, 1] > 0.8


@pytest.mark.parametrize("file_rows", [False, True])
def test_a_deblurred_image_keeps_the_unit_and_the_sky_of_its_part_of_the_frame(
    folder, tmp_path, first, file_rows
):
    wcs = WCS(naxis=2)
    wcs.wcs.ctype, wcs.wcs.crval, wcs.wcs.crpix = ("RA---TAN", "DEC--TAN"), (219.9, -60.8), (30.0, 40.0)
    wcs.wcs.cd = [[-1e-4, 3e-5], [2e-5, 1.1e-4]]
    metadata = Metadata(wcs=wcs, row_order=-1).override("argument", unit="electron")
    measured = SceneBlurEstimator().complete(
        RawFrame(first(folder / "view.fits").data[PART], metadata=metadata)
    )
    frame = measured.frame.with_fields(origin=(7, 11))
    Products(images=tmp_path, file_rows=file_rows).write(replace(measured, frame=frame))
    image = first(tmp_path / "array.deblurred.fits")  # turns what is top-down over
    assert image.unit == "electron"
    for x, y in ((10, 20), (150, 60)):
        found = image.metadata.wcs.pixel_to_world_values(x, y)
        assert np.allclose(found, wcs.pixel_to_world_values(x + 7, y + 11), rtol=0, atol=1e-10)


def test_exports_of_a_frame_that_begins_with_its_lowest_row_say_nothing_of_rows(folder, tmp_path):
    estimate_files(
        [folder / "field.fits"], SceneBlurEstimator(stars=True), keep=Products(kernels=tmp_path).write
    )
    assert "ROWORDER" not in read_kernel(tmp_path / "field.kernel.fits").cards


def test_a_blur_that_is_no_trail_is_undetermined_and_its_kernel_says_so(folder, tmp_path):
    products = Products(kernels=tmp_path, images=tmp_path)
    (row,) = estimate_files([folder / "sharpfield.fits"], SceneBlurEstimator(stars=True), keep=products.write)
    assert (row["status"], row["reason"]) == ("undetermined", "not_constrained")
    assert "compatible with zero" in row["message"]
    assert np.isnan(row["significance"])
    assert np.isnan(row["sxx"].value)
    assert 0 <= row["length"].to_value("arcsec") < 3 * row["length_err"].to_value("arcsec")
    cards = read_kernel(tmp_path / "sharpfield.kernel.fits").cards
    assert "not known to be jitter" in cards["JITRTYPE"]
    assert not {"JITTER_MAJOR", "JITRSIGM", "JTRANGLE"} & set(cards)
    for told in (cards, read_image(tmp_path / "sharpfield.deblurred.fits")[1]):
        assert str(told["COMMENT"]).startswith("No trail is known")
