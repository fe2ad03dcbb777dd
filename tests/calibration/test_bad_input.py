"""What cannot be calibration frames is refused in one sentence: file, value, remedy."""

import re

import numpy as np
import pytest
from astropy.io import fits
from refusals import refused

from jitterkit.calibration import Settings, Stack, calibrate, open_stacks
from jitterkit.calibration.dark_frames import DarkSlope
from jitterkit.calibration.master import combine
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import write_fits


def frames(rng, level, count=3, shape=(32, 32)):
    return np.rint(rng.normal(level, 2.0, (count, *shape))).astype(np.uint16)


def numbers(caught):
    """Numbers that a message names behind its file."""
    _, told = str(caught.value).split(": ", 1)
    return [float(number) for number in re.findall(r"\d+(?:\.\d+)?", told)]


def test_nothing_at_all():
    with refused(ErrorCode.MISSING_VALUE):
        calibrate()


def test_shapes_that_differ(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100))
    write_fits(tmp_path / "b.fits", frames(rng, 100, shape=(30, 32)))
    with refused(ErrorCode.WRONG_SHAPE, tmp_path / "b.fits", "32 x 30", "bias", "32 x 32", error=FrameError):
        open_stacks("bias", [tmp_path])
    bias, dark = (
        Stack.of(kind, frames(rng, 100, shape=(ny, 32)), t)
        for kind, ny, t in (("bias", 32, None), ("dark", 30, 1.0))
    )
    with refused(ErrorCode.WRONG_SHAPE, "dark[0]", "32 x 30", "bias", "32 x 32"):
        calibrate(bias, [dark], gain=1.0)


def test_one_frame(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100, 1)[0])
    with refused(ErrorCode.TOO_FEW, tmp_path / "a.fits", "bias"):
        open_stacks("bias", [tmp_path])
    with refused(ErrorCode.TOO_FEW, "dark, 2 s"):
        calibrate(None, [Stack.of("dark", frames(rng, 100, 1), 2.0)], gain=1.0)


def test_a_missing_exposure(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100))
    with refused(ErrorCode.MISSING_VALUE, tmp_path / "a.fits", "dark", "--exposure"):
        open_stacks("dark", [tmp_path])


def test_flats_that_say_an_exposure_of_zero(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 1000), header={"EXPTIME": 0.0})
    with refused(ErrorCode.OUT_OF_RANGE, tmp_path / "a.fits", "flat", "0 s", "--exposure"):
        open_stacks("flat", [tmp_path])


@pytest.mark.parametrize("kind", ["bias", "dark", "flat"])
def test_copies(kind, rng, tmp_path):
    """A copy has no noise of its own: gains from pairs of flats and copies would be anything."""
    planes = frames(rng, 1000)
    write_fits(tmp_path / "a.fits", planes, header={"EXPTIME": 1.0})
    write_fits(tmp_path / "copy of a.fits", planes[1].astype(np.float32), header={"EXPTIME": 1.0})
    with refused(
        ErrorCode.DUPLICATE, tmp_path / "copy of a.fits", tmp_path / "a.fits", kind, error=FrameError
    ):
        open_stacks(kind, [tmp_path])


def test_a_copy_in_a_cube_is_named_by_its_place(rng, tmp_path):
    plane = frames(rng, 1000, 1)[0]
    write_fits(tmp_path / "a.fits", np.stack([plane + 1, plane, plane]))
    with refused(ErrorCode.DUPLICATE, tmp_path / "a.fits[2]", tmp_path / "a.fits[1]", error=FrameError):
        open_stacks("bias", [tmp_path])


def test_saturated_flats_are_no_copies(tmp_path):
    """All pixels are full but a dead one."""
    full = np.full((3, 32, 32), 65535, np.uint16)
    full[:, 5, 5] = 0
    write_fits(tmp_path / "a.fits", full, header={"EXPTIME": 1.0})
    (stack,) = open_stacks("flat", [tmp_path])
    assert all(shot.saturated for shot in stack.shots)


def test_electrons(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100), header={"BUNIT": "electron"})
    with refused(ErrorCode.UNKNOWN_UNIT, tmp_path / "a.fits", "electron", "flat", "ADU", error=FrameError):
        open_stacks("flat", [tmp_path])


def test_a_flat_among_the_biases(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100, 5))
    write_fits(tmp_path / "b.fits", frames(rng, 900, 1)[0])
    (stack,) = open_stacks("bias", [tmp_path])
    with refused(ErrorCode.WRONG_INSTRUMENT, tmp_path / "b.fits", "bias") as caught:
        calibrate(stack, gain=1.0)
    assert numbers(caught) == pytest.approx([900, 100, 2], abs=1)


def test_a_bias_among_the_flats(rng):
    bias = Stack.of("bias", frames(rng, 100, 4))
    for level, code, told in (
        (100, ErrorCode.NO_SIGNAL, [100, 100]),
        (500, ErrorCode.TOO_FEW, [1, 500, 900]),  # of 1 s
    ):
        flats = Stack.of("flat", np.concatenate([frames(rng, 900, 2), frames(rng, level, 1)]), 1.0)
        with refused(code, "flat[2]") as caught:
            calibrate(bias, (), [flats])
        assert numbers(caught) == pytest.approx(told, abs=1)


def test_darks_below_the_bias(rng):
    with refused(ErrorCode.WRONG_INSTRUMENT, "dark[0]", "dark, 1 s") as caught:
        calibrate(Stack.of("bias", frames(rng, 100)), [Stack.of("dark", frames(rng, 50), 1.0)], gain=1.0)
    assert numbers(caught) == pytest.approx([1, 50, 100], abs=1)


def test_gains_that_differ(rng, tmp_path):
    for i, gain in enumerate((1.5, 1.5, 3.0)):
        write_fits(tmp_path / f"{i}.fits", frames(rng, 100, 1)[0], header={"EGAIN": gain})
    with refused(
        ErrorCode.WRONG_INSTRUMENT, f"{tmp_path / '2.fits'}: ", "3 e-/ADU", tmp_path / "0.fits", "1.5"
    ):
        calibrate(open_stacks("bias", [tmp_path])[0])


def test_flats_without_a_bias_and_darks_of_one_exposure(rng):
    with refused(ErrorCode.MISSING_VALUE, "--bias", "--bias-level"):
        calibrate(None, (), [Stack.of("flat", frames(rng, 900), 1.0)])
    with refused(ErrorCode.TOO_FEW, "1.5 s", "--bias"):
        calibrate(None, [Stack.of("dark", frames(rng, 100), 1.5)], gain=1.0)


@pytest.mark.parametrize("bias", [100.0, None])
def test_darks_that_were_not_exposed(rng, bias):
    slope = DarkSlope(combine(Stack.of("bias", frames(rng, 100))) if bias is None else bias)
    slope.add(combine(Stack.of("dark", frames(rng, 100), 0.0)))
    with refused(ErrorCode.OUT_OF_RANGE, "0 s", "--exposure"):
        slope.rate()


def test_electrons_without_a_gain(rng):
    with refused(ErrorCode.MISSING_VALUE, "--gain"):
        calibrate(Stack.of("bias", frames(rng, 100)))


@pytest.mark.parametrize(
    ("name", "value", "limit"), [("clip", 2.0, "3"), ("hot", 1.0, "3"), ("dead", 1.5, "0 to 1")]
)
def test_settings_out_of_range(name, value, limit):
    with refused(ErrorCode.OUT_OF_RANGE, f"{name} = {value:g}", limit):
        Settings(**{name: value})


def test_arrays_that_are_no_stacks():
    with refused(ErrorCode.WRONG_SHAPE, "bias", "(8, 8)", "(n, ny, nx)"):
        Stack.of("bias", np.zeros((8, 8)))


@pytest.mark.parametrize(
    ("kind", "card"),
    [
        ("dark", ("IMAGETYP", "Flat Field")),
        ("dark", ("OBSTYPE", "ZERO")),
        ("bias", ("FRAME", "Dark")),
        ("flat", ("IMAGETYP", "FLATDARK")),
    ],
)
def test_frames_that_are_of_another_kind_by_their_header(kind, card, rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100), header={"EXPTIME": 30.0, card[0]: card[1]})
    with refused(ErrorCode.WRONG_INSTRUMENT, tmp_path / "a.fits", kind, *card, error=FrameError):
        open_stacks(kind, [tmp_path])


@pytest.mark.parametrize(
    ("kind", "said"),
    [("dark", "Dark Frame"), ("dark", "DARKFLAT"), ("bias", "Zero"), ("bias", "DARK"), ("flat", "FLAT,SKY")],
)
def test_frames_whose_header_agrees(kind, said, rng, tmp_path):
    """A dark of no exposure is what cameras without a bias mode take."""
    write_fits(tmp_path / "a.fits", frames(rng, 100), header={"EXPTIME": 0.001, "IMAGETYP": said})
    (stack,) = open_stacks(kind, [tmp_path])
    assert stack.shots[0].warnings == ()


def test_frames_that_a_header_calls_light_are_warned_of(rng, tmp_path):
    write_fits(tmp_path / "a.fits", frames(rng, 100), header={"EXPTIME": 3.0, "IMAGETYP": "LIGHT"})
    (stack,) = open_stacks("dark", [tmp_path])
    assert any("IMAGETYP" in text and "dark" in text for text in stack.shots[0].warnings)


@pytest.mark.parametrize(
    ("card", "here", "there"),
    [
        ("XBINNING", 1, 2),
        ("GAIN", 100, 300),
        ("READOUTM", "High Gain", "Low Gain"),
        ("INSTRUME", "A", "B"),
        ("XORGSUBF", 1000, 1001),
    ],
)
def test_settings_that_differ(card, here, there, rng, tmp_path):
    for name, value in (("bias", here), ("dark", there)):
        write_fits(tmp_path / f"{name}.fits", frames(rng, 100), header={"EXPTIME": 1.0, card: value})
    bias, dark = (open_stacks(kind, [tmp_path / f"{kind}.fits"]) for kind in ("bias", "dark"))
    with refused(ErrorCode.WRONG_INSTRUMENT, tmp_path / "dark.fits", card, str(there), str(here)):
        calibrate(bias[0], dark, gain=1.0)


def test_settings_that_are_written_otherwise(rng, tmp_path):
    for name, value in (("a", "1 1"), ("b", "1x1")):
        write_fits(tmp_path / f"{name}.fits", frames(rng, 100), header={"CCDSUM": value, "XBINNING": 1})
    assert calibrate(open_stacks("bias", [tmp_path])[0], gain=1.0).bias.number == pytest.approx(100, abs=0.1)


def test_images_of_several_detectors(rng, tmp_path):
    images = [fits.ImageHDU(frames(rng, 100, 1)[0], name="SCI", ver=k) for k in (1, 2)]
    fits.HDUList([fits.PrimaryHDU(), *images]).writeto(tmp_path / "a.fits")
    with refused(ErrorCode.UNSUPPORTED, tmp_path / "a.fits", "HDU 1", "HDU 2", error=FrameError):
        open_stacks("bias", [tmp_path])
