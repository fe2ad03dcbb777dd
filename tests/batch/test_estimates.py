"""Blur of frames from file to table, pictures and kernels: binaries, star fields, scenes without stars."""

from dataclasses import replace

import numpy as np
import pytest
import skimage.data
from scipy.ndimage import map_coordinates
from scipy.special import erf

from jitterkit.batch import Processor, scenes
from jitterkit.batch.kernels import BinaryMeasurer, estimate_files
from jitterkit.batch.products import Products
from jitterkit.batch.reference import sharpest
from jitterkit.batch.scenes import SceneMeasurer
from jitterkit.errors import ConfigurationError
from jitterkit.frames import RawFrame, open_frames, write_fits
from jitterkit.frames.fits import read_image
from jitterkit.instruments import load_instrument
from jitterkit.kernels import read_kernel
from jitterkit.loci import Linear
from jitterkit.refit import read_kernel_prior
from jitterkit.scene import Binary
from jitterkit.simulate import fits_header, simulate_sequence

LENGTH, SIGMA = 5.0, 1.5


def stars(rng, length, n=40, size=256):
    """Gaussian stars trailed along +x: a Gaussian across, a difference of error functions along."""
    y, x = np.indices((size, size))
    image = np.zeros((size, size))
    for x0, y0, flux in zip(*rng.uniform(20, size - 20, (2, n)), rng.uniform(2e4, 1e5, n), strict=True):
        across = np.exp(-((y - y0) ** 2) / (2 * SIGMA**2)) / (SIGMA * np.sqrt(2 * np.pi))
        ends = [(x - x0 + s * length / 2) / (SIGMA * np.sqrt(2)) for s in (1, -1)]
        along = (erf(ends[0]) - erf(ends[1])) / (2 * length)
        image += flux * across * along
    return rng.poisson(image + 50.0) + rng.normal(0, 3.0, image.shape)


def view(rng, length, angle=0.0):
    """A photograph smeared by averaging shifted copies, interpolated by cubic splines."""
    photograph = skimage.data.camera().astype(float)
    y, x = np.indices((400, 400)) + 56.0
    steps = length * ((np.arange(64) + 0.5) / 64 - 0.5)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    smeared = np.mean([map_coordinates(photograph, [y - t * s, x - t * c]) for t in steps], axis=0)
    return smeared + rng.normal(0, photograph.std() / 100, smeared.shape)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    rng = np.random.default_rng(5)
    folder = tmp_path_factory.mktemp("scenes")
    unit = {"BUNIT": "electron"}
    write_fits(folder / "field.fits", stars(rng, LENGTH), header={**unit, "PIXSCALE": 0.5})
    write_fits(folder / "sharpfield.fits", stars(rng, 1e-3), header={**unit, "PIXSCALE": 0.5})
    write_fits(folder / "view.fits", view(rng, 17.3, 30.0).astype(np.float32))
    write_fits(folder / "sharpview.fits", view(rng, 0.0).astype(np.float32))
    return folder


def first(path) -> RawFrame:
    with open_frames(path) as file:
        return file[0]


def test_a_star_field_alone_gives_a_conditional_length_in_arcsec(folder):
    (row,) = estimate_files([folder / "field.fits"], SceneMeasurer(stars=True))
    assert row["status"] == "ok"
    assert row["length"].to_value("arcsec") == pytest.approx(LENGTH * 0.5, rel=0.05)
    # 40 stars: an axis to a degree, four times its error allowed
    assert abs((row["angle"].to_value("deg") + 90) % 180 - 90) < 4 * row["angle_err"].to_value("deg") < 4
    assert "smear: one direction" in row["message"]
    assert "holds if stars are round" in row["message"]


def test_a_reference_that_shows_stars_is_taken_for_a_star_field(folder):
    measurer = SceneMeasurer(reference=first(folder / "sharpfield.fits"))
    (row,) = estimate_files([folder / "field.fits"], measurer)
    assert row["length"].to_value("arcsec") == pytest.approx(LENGTH * 0.5, rel=0.05)
    assert "holds if stars are round" not in row["message"]


def test_the_roundest_frame_of_a_set_serves_as_reference(folder):
    assert sharpest([folder / "field.fits", folder / "sharpfield.fits"]).name == "sharpfield.fits"


def test_the_roundest_may_be_any_frame_of_a_file(folder, tmp_path):
    fields = [first(folder / name).data for name in ("field.fits", "sharpfield.fits")]
    cube = write_fits(tmp_path / "cube.fits", np.stack(fields), header={"BUNIT": "electron", "PIXSCALE": 0.5})
    found = sharpest([folder / "field.fits", cube])
    assert found.name == "cube.fits[1]"
    np.testing.assert_allclose(found.data, fields[1])


def test_the_reference_s_own_row_says_that_it_is_the_reference(folder, tmp_path):
    (tmp_path / "link.fits").symlink_to(folder / "sharpfield.fits")
    measurer = SceneMeasurer(reference=first(folder / "sharpfield.fits"), stars=True)
    table = estimate_files([tmp_path / "link.fits", folder / "field.fits"], measurer)
    assert list(table["status"]) == ["reference", "ok"]
    assert table["message"][0] == "link.fits is the reference that the others are compared with."
    assert np.isnan(table["sxx"][0].value)


def test_of_a_cube_only_the_frame_that_is_the_reference_is_left_out(tmp_path):
    rng = np.random.default_rng(6)
    cube = np.stack([view(rng, 0.0), view(rng, 9.0)])
    path = write_fits(tmp_path / "cube.fits", cube.astype(np.float32))
    measurer = SceneMeasurer(reference=first(path), stars=False)
    measurer.check([path])
    table = estimate_files([path], measurer)
    assert list(table["status"]) == ["reference", "ok"]
    assert table["length"][1].to_value("pix") == pytest.approx(9.0, abs=0.5)


def test_a_file_that_cannot_be_read_keeps_no_set_from_having_a_roundest_frame(folder, tmp_path):
    (tmp_path / "bad.fits").write_text("not a frame")
    found = sharpest([tmp_path / "bad.fits", folder / "field.fits", folder / "sharpfield.fits"])
    assert found.name == "sharpfield.fits"


def test_a_reference_that_serves_one_file_of_a_set_is_not_refused(folder, tmp_path):
    small = write_fits(tmp_path / "a.fits", np.ones((30, 40)))
    SceneMeasurer(reference=first(folder / "sharpview.fits")).check([small, folder / "view.fits"])
    with pytest.raises(ConfigurationError, match=r"it has 400 x 400 pixels, a\.fits 40 x 30; give another"):
        SceneMeasurer(reference=first(folder / "sharpview.fits")).check([small])


@pytest.mark.parametrize("oversample", [2, 3])
def test_an_exported_kernel_has_the_oversampling_asked_for_and_says_so(folder, tmp_path, oversample):
    products = Products(kernels=tmp_path, oversample=oversample)
    table = estimate_files([folder / "field.fits"], SceneMeasurer(stars=True), keep=products.write)
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
    table = estimate_files([folder / "field.fits"], SceneMeasurer(stars=True), keep=keep)
    table.write(tmp_path / "k.ecsv", format="ascii.ecsv")
    found = measured[0].estimate
    mean, covariance = read_kernel_prior(tmp_path / "k.ecsv").of("another.fits").moments
    np.testing.assert_allclose(mean, found.moments, rtol=1e-12)
    np.testing.assert_allclose(covariance, found.covariance, rtol=1e-9, atol=1e-9 * found.covariance.max())


@pytest.mark.parametrize("with_reference", [True, False])
def test_a_view_gives_its_smear_in_pixels_with_and_without_a_sharp_one(folder, with_reference):
    reference = first(folder / "sharpview.fits") if with_reference else None
    (row,) = estimate_files([folder / "view.fits"], SceneMeasurer(reference=reference))
    assert row["status"] == "ok", row["message"]
    assert row["length"].to_value("pix") == pytest.approx(17.3, abs=0.5)
    assert row["angle"].to_value("deg") == pytest.approx(30.0, abs=1.0)


def test_what_an_image_does_not_hold_is_a_row_that_says_so_and_harms_no_other(folder):
    table = estimate_files([folder / "sharpview.fits", folder / "view.fits"], SceneMeasurer())
    assert list(table["status"]) == ["undetermined", "ok"]
    assert "too small" in table["message"][0] or "no" in table["message"][0]


def test_a_view_in_noise_serves_as_reference_and_noise_does_not():
    # neighbours alike by a tenth of their variance: of 160 000 pixels chance makes one in 400 of it
    rng = np.random.default_rng(7)
    noise = rng.normal(0, 1, (400, 400))
    waves = 0.3 * np.sqrt(2) * np.sin(np.arange(400) / 20)
    SceneMeasurer(reference=RawFrame.from_array(noise + waves), stars=False).check([])
    with pytest.raises(ConfigurationError, match="it shows nothing but noise; give another"):
        SceneMeasurer(reference=RawFrame.from_array(noise), stars=False).check([])


@pytest.mark.parametrize("stars", [None, True])
def test_the_stars_of_a_reference_are_looked_for_once(folder, stars, monkeypatch):
    looked = []
    monkeypatch.setattr(scenes, "field_psf", lambda frame: looked.append(frame.name))
    measurer = SceneMeasurer(reference=first(folder / "sharpfield.fits"), stars=stars)
    measurer.check([folder])
    assert looked == ["sharpfield.fits"]


def test_a_sharp_view_of_another_size_is_refused_in_words(folder):
    measurer = SceneMeasurer(reference=RawFrame.from_array(np.ones((100, 120))), stars=False)
    (row,) = estimate_files([folder / "view.fits"], measurer)
    assert row["status"] == "failed"
    assert "cannot serve as reference: it has 120 x 100 pixels, view.fits 400 x 400; give" in row["message"]


def test_an_unknown_method_lists_the_known_ones():
    with pytest.raises(ConfigurationError, match="no blind estimator 'guess'; choose from blind"):
        SceneMeasurer(method="guess")


def test_pictures_kernels_and_deblurred_images_are_named_after_the_frame(folder, tmp_path):
    products = Products(tmp_path / "a", tmp_path / "b", tmp_path / "c")
    table = estimate_files([folder / "view.fits"], SceneMeasurer(), keep=products.write)
    assert (tmp_path / "a/view.png").read_bytes().startswith(b"\x89PNG")
    kernel = read_kernel(tmp_path / "b/view.kernel.fits").kernel
    x = np.arange(kernel.shape[1]) - kernel.shape[1] // 2
    spread = kernel.sum(axis=0) @ x**2
    assert spread == pytest.approx(table["sxx"][0].value, rel=1e-6)  # the table's unit is pixels
    assert read_image(tmp_path / "c/view.deblurred.fits")[1]["SOURCE"] == "view.fits"
    paths = folder / "sharpview.fits", folder / "view.fits", tmp_path / "c/view.deblurred.fits"
    sharp, before, after = (first(path).data[50:-50, 50:-50] for path in paths)
    # a kernel drawn upside down leaves twice the blurred image's distance from the sharp one
    assert np.std(after - sharp) < 0.8 * np.std(before - sharp)
    with pytest.raises(ConfigurationError, match=r"view\.png exists; give --overwrite"):
        Products(tmp_path / "a")


def test_a_frame_without_a_pair_is_a_row_with_a_status(tmp_path):
    write_fits(tmp_path / "dark.fits", np.random.default_rng(1).normal(100.0, 3.0, (64, 64)))
    measurer = BinaryMeasurer(Processor(load_instrument("smallsat")))
    (row,) = estimate_files([tmp_path / "dark.fits"], measurer)
    assert row["status"] == "no_star"
    assert np.isnan(row["sxx"].value)


@pytest.fixture(scope="module")
def drifted(tmp_path_factory):
    """A pair through optics with 5 nm of aberrations, blurred by 0.9 arcsec."""
    smallsat, rng = load_instrument("smallsat"), np.random.default_rng(3)
    aberrations = rng.normal(0, 5.0, (1, len(smallsat.aberrations)))
    scene = Binary(10.0, 30.0, 1.0, -2.0, smallsat.flux, 3.0)
    (one,) = simulate_sequence(
        smallsat, scene, Linear.of(0.9, 35.0), 1, aberrations=aberrations, rng=rng, detector=False
    )
    path = tmp_path_factory.mktemp("drifted") / "drifted.fits"
    return write_fits(path, one.raw.data, header=fits_header(one, smallsat))


def test_a_pair_with_aberrations_is_described_by_its_template(drifted):
    (row,) = estimate_files([drifted], BinaryMeasurer(Processor(load_instrument("smallsat"))))
    assert (row["status"], row["message"]) == ("ok", "")


def test_a_frame_that_no_binary_describes_is_a_poor_fit_that_names_its_scale_and_the_other_ways(tmp_path):
    # one star of 3 pixels rms where two of the instrument's resolution are expected
    y, x = np.indices((128, 128))
    star = 2e4 * np.exp(-((x - 70) ** 2 + (y - 60) ** 2) / 18.0)
    star = np.random.default_rng(4).poisson(star + 1.0).astype(float)
    smallsat = load_instrument("smallsat")
    header = {"BUNIT": "electron", "PIXSCALE": 1.3 * smallsat.plate_scale}
    write_fits(tmp_path / "one.fits", star, header=header)
    kept = []
    (row,) = estimate_files([tmp_path / "one.fits"], BinaryMeasurer(Processor(smallsat)), keep=kept.append)
    assert row["status"] == "poor_fit"
    assert np.isnan(row["sxx"].value)
    assert kept == []
    assert row["message"].count("is not the instrument's") == 1
    assert "give --stars, --reference or --blind" in row["message"]


class _Blind(Processor):
    """Finds the pair, and no blur."""

    def estimate(self, frame):
        found, start = super().estimate(frame)
        return replace(found, moments=np.zeros(3), locus=None), start


def test_an_estimate_that_misses_the_blur_of_a_pair_is_said_to_and_the_pair_is_not_doubted(drifted):
    (row,) = estimate_files([drifted], BinaryMeasurer(_Blind(load_instrument("smallsat"))))
    assert row["status"] == "ok"
    assert "with everything fitted" in row["message"]


class _Same:
    """A measurer that has the same to say of every frame."""

    name = "same"

    def __init__(self, measured):
        self.measured = measured

    def measure(self, raw):
        return self.measured(raw)


@pytest.mark.parametrize("breakage", ["estimate", "picture"])
def test_a_frame_that_breaks_down_takes_no_row_with_it(folder, breakage):
    scenes = SceneMeasurer(stars=True)

    def measured(raw):
        found = scenes.measure(raw)
        odd = replace(found.estimate, covariance=np.zeros((3, 3)))
        return replace(found, estimate=odd) if breakage == "estimate" else found

    def keep(one):
        if breakage == "picture":
            raise np.linalg.LinAlgError("Singular matrix")

    files = [folder / "field.fits", folder / "sharpfield.fits"]
    table = estimate_files(files, _Same(measured), keep=keep)
    assert list(table["status"]) == ["ok", "ok"]
    if breakage == "picture":
        assert table["message"][0].endswith("Singular matrix")
    else:
        assert np.all(np.isnan(table["significance"]))


def test_two_frames_of_one_name_do_not_replace_each_others_products(folder, tmp_path):
    other = tmp_path / "other"
    other.mkdir()
    (other / "field.fits").write_bytes((folder / "field.fits").read_bytes())
    products = Products(kernels=tmp_path / "kernels")
    table = estimate_files(
        [folder / "field.fits", other / "field.fits"], SceneMeasurer(stars=True), keep=products.write
    )
    assert list(table["status"]) == ["ok", "ok"]
    assert "another frame of the name field" in table["message"][1]
    assert "another frame" not in table["message"][0]


def test_a_second_frame_of_one_stem_has_products_of_its_file_s_full_name(folder, tmp_path):
    (tmp_path / "field.fit").write_bytes((folder / "field.fits").read_bytes())
    products = Products(kernels=tmp_path / "kernels")
    files = [tmp_path / "field.fit", folder / "field.fits"]
    table = estimate_files(files, SceneMeasurer(stars=True), keep=products.write)
    assert not any("another frame" in message for message in table["message"])
    assert (tmp_path / "kernels/field.kernel.fits").exists()
    assert read_kernel(tmp_path / "kernels/field.fits.kernel.fits").cards["SOURCE"] == "field.fits"


@pytest.mark.parametrize(("size", "told"), [(0.5, True), (5.0, False)])
def test_undetected_jitter_is_called_so_in_its_row_and_its_file(folder, tmp_path, size, told):
    def measured(raw):
        found = SceneMeasurer(stars=True).measure(raw)
        # chi-squared of one moment of size standard errors: 0.25 and 25, of three one in 1000 is beyond 16.3
        noise = replace(found.estimate, moments=size * np.array([1e-3, 0, 0]), covariance=np.eye(3) * 1e-6)
        return replace(found, estimate=replace(noise, locus=None))

    (row,) = estimate_files([folder / "field.fits"], _Same(measured), keep=Products(kernels=tmp_path).write)
    cards = read_kernel(tmp_path / "field.kernel.fits").cards
    assert ("Jitter is undetected (chi-squared 0.2" in row["message"]) == told
    assert ("undetected" in str(cards.get("COMMENT", ""))) == told


@pytest.mark.parametrize(("spread", "remarked"), [(0.01, True), (0.03, False)])
def test_a_kernel_on_pixels_with_other_moments_than_the_table_is_remarked(folder, spread, remarked):
    def measured(raw):
        found = SceneMeasurer(stars=True).measure(raw)
        kernel = np.outer([0, 1, 0], [0.25, 0.5, 0.25])  # a variance of half a pixel² along x, none along y
        moments = np.array([0.1, 0.0, 0.0])  # at 0.5 arcsec a pixel the kernel has 0.125
        pixels = replace(found.estimate, kernel=kernel, locus=None, moments=moments)
        return replace(found, estimate=replace(pixels, covariance=np.eye(3) * spread**2))

    (row,) = estimate_files([folder / "field.fits"], _Same(measured))
    assert ("other moments than the table: sxx 0.125, " in row["message"]) == remarked
