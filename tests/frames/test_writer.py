"""Files appear whole or not at all."""

import numpy as np
import pytest
import tifffile
from astropy.io import fits
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError, JitterkitError
from jitterkit.frames import Frame, RawFrame, read_frames, write_fits, write_tiff

IMAGE = np.arange(20, dtype=np.uint16).reshape(4, 5)
WRITERS = {"a.fits": write_fits, "a.fits.gz": write_fits, "a.tif": write_tiff}


@pytest.mark.parametrize("name", WRITERS)
def test_another_file_is_not_replaced_unasked(tmp_path, name):
    path = WRITERS[name](tmp_path / name, IMAGE)
    with refused(ErrorCode.EXISTS, path, error=FrameError):
        WRITERS[name](path, IMAGE + 1)
    WRITERS[name](path, IMAGE + 1, overwrite=True)
    assert next(read_frames(path)).data[0, 0] == 1


@pytest.mark.parametrize("name", WRITERS)
def test_a_failed_write_leaves_nothing_and_harms_nothing(tmp_path, name, monkeypatch):
    path = WRITERS[name](tmp_path / name, IMAGE)
    before = path.read_bytes()

    def full(*_, **__):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(fits.HDUList, "writeto", full)
    monkeypatch.setattr(tifffile.TiffWriter, "write", full)
    with refused(ErrorCode.NOT_WRITABLE, path, "No space left on device", error=FrameError):
        WRITERS[name](path, IMAGE, overwrite=True)
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_replaced_file_is_a_new_one_so_that_who_reads_the_old_keeps_it(tmp_path):
    path = write_fits(tmp_path / "a.fits", IMAGE)
    (tmp_path / "link.fits").hardlink_to(path)
    write_fits(path, IMAGE + 1, overwrite=True)
    assert next(read_frames(tmp_path / "link.fits")).data[0, 0] == 0


def test_a_directory_that_is_not_there_is_said_to_be_so(tmp_path):
    path = tmp_path / "no" / "a.fits"
    with refused(ErrorCode.NOT_WRITABLE, path, "No such file or directory", error=FrameError):
        write_fits(path, IMAGE)


def test_an_existing_sidecar_protects_the_image_too(tmp_path):
    (tmp_path / "a.toml").write_text("gain = 2.0\n")
    with refused(ErrorCode.EXISTS, tmp_path / "a.toml", error=FrameError):
        write_tiff(tmp_path / "a.tif", IMAGE, metadata={"gain": 3.0})
    assert not (tmp_path / "a.tif").exists()


@pytest.mark.parametrize(
    ("array", "code"),
    [
        (IMAGE[0], ErrorCode.WRONG_SHAPE),
        (np.zeros((2, 2, 2, 2)), ErrorCode.WRONG_SHAPE),
        (np.zeros((0, 3)), ErrorCode.WRONG_SHAPE),
        (IMAGE * 1j, ErrorCode.WRONG_TYPE),
    ],
)
def test_what_is_no_image_is_refused(tmp_path, array, code):
    with refused(code, array.shape, array.dtype, error=JitterkitError):
        write_fits(tmp_path / "a.fits", array)
    with refused(code, array.shape, array.dtype, error=JitterkitError):
        write_tiff(tmp_path / "a.tif", array)


def test_unsigned_integers_stay_so_in_both_formats(tmp_path):
    image = np.array([[0, 65535], [32768, 1]], np.uint16)
    for path in (write_fits(tmp_path / "a.fits", image), write_tiff(tmp_path / "a.tif", image)):
        np.testing.assert_array_equal(next(read_frames(path)).data, image)
    assert fits.getheader(tmp_path / "a.fits")["BZERO"] == 32768
    assert tifffile.imread(tmp_path / "a.tif").dtype == np.uint16


def test_big_endian_arrays_are_written_right(tmp_path):
    for path in (
        write_fits(tmp_path / "a.fits", IMAGE.astype(">f4")),
        write_tiff(tmp_path / "a.tif", IMAGE.astype(">f4")),
    ):
        np.testing.assert_array_equal(next(read_frames(path)).data, IMAGE)


def test_frames_and_lists_of_frames_are_written_as_their_pixels(tmp_path):
    raw, frame = RawFrame.from_array(IMAGE), Frame(IMAGE, 1.0)
    for number, given in enumerate((raw, frame)):
        assert next(read_frames(write_fits(tmp_path / f"{number}.fits", given))).data[3, 4] == 19
    assert len(list(read_frames(write_fits(tmp_path / "list.fits", [raw, raw, raw])))) == 3


def test_masks_are_written_as_bytes(tmp_path):
    assert fits.getdata(write_fits(tmp_path / "a.fits", IMAGE > 3)).dtype == np.uint8


def test_header_cards_of_every_kind_are_written(tmp_path):
    header = {
        "EXPTIME": (0.5, "[s] exposure"), "SHORT": np.float32(0.25), "COUNT": np.int64(3),
        "FLAG": True, "NOTHING": None,
        "NOTANUM": float("nan"), "jitter_position_angle": (12.5, "a comment that is far too long " * 4),
        "TEXT": "µas and\nmore " * 10, "PATHLIKE": tmp_path,
    }  # fmt: skip
    read = fits.getheader(write_fits(tmp_path / "a.fits", IMAGE, header=header))
    assert (read["EXPTIME"], read.comments["EXPTIME"]) == (0.5, "[s] exposure")
    assert (read["SHORT"], read["COUNT"], read["FLAG"]) == (0.25, 3, True)
    assert read["JITTER_POSITION_ANGLE"] == 12.5
    assert (
        read.cards["NOTHING"].image.split("=")[1].strip()
        == read.cards["NOTANUM"].image.split("=")[1].strip()
        == ""
    )
    assert read["TEXT"].startswith("?as and more ")
    assert read["PATHLIKE"] == str(tmp_path)


def test_what_is_written_in_the_header_is_known_when_read(tmp_path):
    header = {
        "EXPTIME": 0.5,
        "EGAIN": 3.7,
        "RDNOISE": 2.4,
        "SATURATE": 4095,
        "BIASLVL": 100,
        "PIXSCALE": 0.375,
    }
    header |= {"DATE-OBS": "2026-11-21T03:00:00", "BUNIT": "adu"}
    metadata = next(read_frames(write_fits(tmp_path / "a.fits", IMAGE, header=header))).metadata
    assert [known.value for known in metadata.known().values()] == [
        0.5, 3.7, 2.4, 4095, 100, 0.375, "2026-11-21T03:00:00", "adu"
    ]  # fmt: skip
    assert metadata.warnings == ()
