"""Masks of files that hide a star: said in a warning, and refused where nothing of it is left."""

import numpy as np
import pytest
from astropy.io import fits
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import read_frames
from jitterkit.instruments import load_instrument, resolve

SKY, NOISE = 30.0, 0.7
Y, X = np.mgrid[:64, :64]
STAR = 2000 * np.exp(-((X - 30) ** 2 + (Y - 34) ** 2) / (2 * 1.8**2))
DATA = (SKY + STAR + np.random.default_rng(4).normal(0, NOISE, STAR.shape)).round().astype(np.int16)
DETECTED = STAR > 3 * NOISE
BAD = np.zeros(STAR.shape, bool)
BAD[:, 7] = BAD[50:53, 50:53] = True
SMALLSAT = load_instrument("smallsat")


def frame(tmp_path, mask, name="MASK", data=DATA, primary=None, **planes):
    """The frame of a file whose mask has planes of given names, at given bits."""
    header = fits.Header([(f"HIERARCH MP_{plane}", bit) for plane, bit in planes.items()])
    hdus = [fits.PrimaryHDU(data, primary), fits.ImageHDU(mask.astype(np.int32), header, name=name)]
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    (read,) = read_frames(tmp_path / "a.fits")
    return read


def named(raw, *words):
    return [text for text in raw.metadata.warnings if all(word in text for word in words)]


@pytest.mark.parametrize(
    ("mask", "name", "planes", "hiding", "left"),
    [
        (32 * DETECTED, "MASK", {}, 32, 0),
        (32 * DETECTED + BAD, "DQ", {}, 32, 1),
        (32 * DETECTED + BAD, "MASK", {"BAD": 0, "FOO": 5}, 32, 1),
        # saturated pixels lie within the star, and are faults
        (8 * DETECTED + 2 * (STAR > 1500) + BAD, "DQ", {}, 8, 3),
        # numbers of a segmentation are no bits: 3 has two of them
        (3 * DETECTED, "MASK", {}, 3, 0),
    ],
)
def test_a_mask_of_what_was_detected_is_named_with_its_bits_and_refused(
    tmp_path, mask, name, planes, hiding, left
):
    raw = frame(tmp_path, mask, name, **planes)
    assert named(raw, f"{name} (HDU 1)", f"bits {hiding} ", f"--bad-bits {left}")
    with refused(ErrorCode.NO_STAR, "a.fits", hiding, left, hiding + left, error=FrameError):
        resolve(raw, SMALLSAT)


def test_who_says_which_bits_are_bad_is_obeyed_without_a_warning(tmp_path):
    raw = frame(tmp_path, 32 * DETECTED + BAD)
    used = resolve(raw, SMALLSAT, {"bad_bits": 1})
    np.testing.assert_array_equal(used.mask, BAD)
    assert not named(used, "--bad-bits")
    np.testing.assert_array_equal(resolve(raw, SMALLSAT, {"bad_bits": 33}).mask, BAD | DETECTED)


@pytest.mark.parametrize("name", ["STARS", "DETECTION", "SOURCE", "HSC_OBJECTS", "SEGMENTATION"])
def test_planes_that_say_what_a_pixel_shows_are_known_by_their_words(tmp_path, name):
    raw = frame(tmp_path, 32 * DETECTED + BAD, BAD=0, **{name: 5})
    np.testing.assert_array_equal(raw.mask, BAD)
    assert raw.metadata.value("bad_bits") == 1
    assert not raw.metadata.warnings


@pytest.mark.parametrize("name", ["SAT_STAR", "BAD_OBJECT", "STARTRACKER", "CR", "RESOURCE", "DETECTOR_EDGE"])
def test_planes_of_faults_are_not_taken_for_those(tmp_path, name):
    assert frame(tmp_path, 4 * BAD, **{name: 2}).metadata.value("bad_bits") == 4


def test_a_mask_of_most_of_the_light_is_warned_of_and_not_refused(tmp_path):
    core = STAR > 300
    light = STAR[core].sum() / STAR.sum()
    raw = frame(tmp_path, core, "DQ")
    said = named(raw, "DQ (HDU 1)", "of the light")
    assert 0.5 < light < 0.95
    assert int(said[0].partition("%")[0]) / 100 == pytest.approx(light, abs=0.1)  # of a smoothed star
    assert resolve(raw, SMALLSAT).mask.sum() == core.sum()


HOT = np.zeros(STAR.shape, bool)
HOT[::9, ::7] = True


@pytest.mark.parametrize(
    ("mask", "data", "primary"),
    [
        (BAD, DATA, {}),
        (STAR > 1700, DATA, {}),
        (HOT, np.where(HOT, 30000, DATA).astype(np.int16), {}),  # brighter than the star
        (BAD, np.where(X == 7, 32767, DATA).astype(np.int16), {}),
        (np.random.default_rng(1).random(STAR.shape) < 0.3, DATA, {}),
        (4096 * DETECTED, DATA, {"TELESCOP": "HST"}),  # a mission whose bits are faults
        (DETECTED, np.full_like(DATA, 30), {}),  # nothing is bright
    ],
)
def test_masks_of_faults_are_not_warned_of(tmp_path, mask, data, primary):
    raw = frame(tmp_path, mask, data=data, primary=fits.Header(primary))
    assert not named(raw, "of the light")
    assert resolve(raw, SMALLSAT).mask.any()


def test_missing_variances_of_a_star_are_warned_of(tmp_path):
    variance = fits.ImageHDU(np.where(DETECTED, 0, 1.0).astype("f4"), name="VARIANCE")
    fits.HDUList([fits.PrimaryHDU(DATA), variance]).writeto(tmp_path / "a.fits")
    (raw,) = read_frames(tmp_path / "a.fits")
    assert named(raw, "VARIANCE (HDU 1)", "100% of the light")


def test_each_plane_of_a_cube_has_its_own_warning(tmp_path):
    mask = np.stack([32 * DETECTED, BAD]).astype(np.int32)
    hdus = [fits.PrimaryHDU(np.stack([DATA, DATA])), fits.ImageHDU(mask, name="DQ")]
    fits.HDUList(hdus).writeto(tmp_path / "a.fits")
    raws = list(read_frames(tmp_path / "a.fits"))
    assert [bool(named(raw, "of the light")) for raw in raws] == [True, False]
