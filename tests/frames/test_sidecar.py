"""The TOML beside a TIFF."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames import open_frames, write_tiff
from jitterkit.frames.sidecar import read_sidecars, sidecar_text

IMAGE = np.ones((4, 5), np.uint16)
ALL = {
    "exposure": 0.5, "gain": 3.7, "read_noise": 2.4, "saturation": 4095, "bias": 100, "plate_scale": 0.375,
    "time": "2026-11-21T03:00:00", "unit": "adu",
}  # fmt: skip


def metadata_of(path):
    with open_frames(path) as file:
        return file.metadata


def test_what_is_written_beside_an_image_is_read_back(tmp_path):
    path = write_tiff(
        tmp_path / "a.tif", IMAGE, metadata={**ALL, "truth": {"separation": 10.0, "locus": "shm"}}
    )
    known = metadata_of(path).known()
    assert {name: value.value for name, value in known.items()} == ALL
    assert {value.source for value in known.values()} == {"sidecar a.toml"}


def test_the_keys_may_stand_in_a_table(tmp_path):
    path = write_tiff(tmp_path / "a.tif", IMAGE)
    (tmp_path / "a.toml").write_text("[frame]\ngain = 2\ntime = 2026-11-21T03:00:00\n")
    metadata = metadata_of(path)
    assert metadata.gain.value == 2.0
    assert metadata.time.value == "2026-11-21T03:00:00"


def test_it_may_begin_with_a_byte_order_mark(tmp_path):
    path = write_tiff(tmp_path / "a.tif", IMAGE)
    (tmp_path / "a.toml").write_text("gain = 2\n", encoding="utf-8-sig")
    assert metadata_of(path).gain.value == 2.0


def test_the_file_of_the_directory_fills_what_the_files_own_leaves_open(tmp_path):
    path = write_tiff(tmp_path / "a.tif", IMAGE, metadata={"gain": 2.0})
    (tmp_path / "frames.toml").write_text("gain = 3.0\nbias = 100\n")
    metadata = metadata_of(path)
    assert (metadata.gain.value, metadata.gain.source) == (2.0, "sidecar a.toml")
    assert (metadata.bias.value, metadata.bias.source) == (100.0, "sidecar frames.toml")


def test_without_any_nothing_is_known(tmp_path):
    assert metadata_of(write_tiff(tmp_path / "a.tif", IMAGE)).known() == {}


@pytest.mark.parametrize(
    ("text", "code", "values"),
    [
        ("gian = 2", ErrorCode.UNKNOWN_NAME, ["'gian'", "exposure, gain, read_noise"]),
        ("[frame]\ncolour = 2", ErrorCode.UNKNOWN_NAME, ["'colour'"]),
        ("frame = 3", ErrorCode.UNKNOWN_NAME, ["'frame'"]),
        ("gain = -2", ErrorCode.OUT_OF_RANGE, ["gain = -2", "0 to 100000 e-/ADU"]),
        ("gain = 'high'", ErrorCode.WRONG_TYPE, ["gain = 'high'"]),
        ("unit = 'Jy'", ErrorCode.UNKNOWN_UNIT, ["unit = 'Jy'"]),
        ("gain = = 2", ErrorCode.MALFORMED, ["line 1"]),
        ("gain = '\udcff'", ErrorCode.MALFORMED, ["0xff"]),  # no UTF-8
    ],
)
def test_a_mistake_in_it_is_said_with_the_file_and_the_key(tmp_path, text, code, values):
    (tmp_path / "a.toml").write_bytes(text.encode(errors="surrogateescape"))
    with refused(code, tmp_path / "a.toml", *values, error=ConfigurationError):
        read_sidecars(tmp_path / "a.tif")
    write_tiff(tmp_path / "a.tif", IMAGE)
    with refused(code, tmp_path / "a.toml", *values, error=ConfigurationError):
        open_frames(tmp_path / "a.tif")


def test_one_that_may_not_be_read_is_said_to_be_so(tmp_path, monkeypatch):
    (tmp_path / "a.toml").write_text("gain = 2.0\n")

    def forbid(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr(type(tmp_path), "read_text", forbid)
    with refused(ErrorCode.NOT_READABLE, tmp_path / "a.toml", error=ConfigurationError):
        read_sidecars(tmp_path / "a.tif")


def test_the_text_survives_quotes_numpy_numbers_and_what_is_not_finite(tmp_path):
    truth = {
        "note": 'a "quoted" \\ line\n',
        "x": np.float64(1e-7),
        "n": np.int64(3),
        "nan": np.nan,
        "l": [1, 2.5],
    }
    (tmp_path / "a.toml").write_text(sidecar_text({"gain": np.float32(2), "bias": None, "truth": truth}))
    assert list(read_sidecars(tmp_path / "a.tif").known()) == ["gain"]


def test_an_unknown_key_is_refused_before_anything_is_written(tmp_path):
    with refused(ErrorCode.UNKNOWN_NAME, "'gian'", error=ConfigurationError):
        write_tiff(tmp_path / "a.tif", IMAGE, metadata={"gian": 2})
    assert list(tmp_path.iterdir()) == []
