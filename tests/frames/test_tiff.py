"""What only TIFF files do."""

import gzip
import re
import struct
import subprocess
import sys

import numpy as np
import pytest
import tifffile
from headers import assert_warned
from refusals import refused

from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import open_frames, read_frames, write_tiff

IMAGE = (np.arange(20).reshape(4, 5) * 100).astype(np.uint16)


def only(path):
    (frame,) = read_frames(path)
    return frame


def test_the_top_row_of_the_file_is_our_last_row(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", IMAGE)
    np.testing.assert_array_equal(only(tmp_path / "a.tif").data, IMAGE[::-1])


def test_the_writer_puts_the_top_row_first(tmp_path):
    write_tiff(tmp_path / "a.tif", IMAGE)
    np.testing.assert_array_equal(tifffile.imread(tmp_path / "a.tif"), IMAGE[::-1])


# Where the stored first row and first column lie in the picture, from the TIFF 6.0 specification
SIDES = {
    1: ("top", "left"), 2: ("top", "right"), 3: ("bottom", "right"), 4: ("bottom", "left"),
    5: ("left", "top"), 6: ("right", "top"), 7: ("right", "bottom"), 8: ("left", "bottom"),
}  # fmt: skip


@pytest.mark.parametrize("orientation", SIDES)
def test_every_orientation_is_honoured(tmp_path, orientation):
    tag = [(274, "H", 1, orientation, True)]
    tifffile.imwrite(tmp_path / "a.tif", IMAGE, extratags=tag, metadata=None)
    data = only(tmp_path / "a.tif").data
    edges = {"top": data[-1], "bottom": data[0], "left": data[:, 0], "right": data[:, -1]}
    row, column = SIDES[orientation]
    assert sorted(edges[row]) == sorted(IMAGE[0])
    assert sorted(edges[column]) == sorted(IMAGE[:, 0])
    with open_frames(tmp_path / "a.tif") as file:
        assert file.shape == data.shape


def test_an_orientation_that_does_not_exist_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", IMAGE, extratags=[(274, "H", 1, 9, True)], metadata=None)
    with refused(ErrorCode.UNSUPPORTED_ENCODING, tmp_path / "a.tif", "Orientation 9", error=FrameError):
        open_frames(tmp_path / "a.tif")


@pytest.mark.parametrize(
    ("options", "channels", "names"),
    [
        ({"photometric": "rgb"}, 3, "(red, green, blue)"),
        ({"photometric": "rgb", "extrasamples": ["unassalpha"]}, 4, "(red, green, blue, alpha)"),
        ({"photometric": "minisblack", "extrasamples": ["unassalpha"], "planarconfig": "contig"}, 2,
         "(grey, alpha)"),
    ],
)  # fmt: skip
def test_colour_is_refused_by_its_channels(tmp_path, options, channels, names):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((6, 8, channels), np.uint8), **options)
    with refused(ErrorCode.COLOUR, tmp_path / "a.tif", f"{channels} channels", names, error=FrameError):
        open_frames(tmp_path / "a.tif")


def test_planar_colour_is_refused(tmp_path):
    tifffile.imwrite(
        tmp_path / "a.tif", np.zeros((3, 6, 8), np.uint8), photometric="rgb", planarconfig="separate"
    )
    with refused(ErrorCode.COLOUR, tmp_path / "a.tif", "3 channels", error=FrameError):
        open_frames(tmp_path / "a.tif")


def test_a_palette_is_refused(tmp_path):
    colormap = np.zeros((3, 256), np.uint16)
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((6, 8), np.uint8), photometric="palette", colormap=colormap)
    with refused(ErrorCode.COLOUR, tmp_path / "a.tif", error=FrameError):
        open_frames(tmp_path / "a.tif")


def test_black_and_white_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((6, 8), bool), photometric="minisblack")
    with refused(ErrorCode.UNSUPPORTED_ENCODING, tmp_path / "a.tif", "1 bits", error=FrameError):
        open_frames(tmp_path / "a.tif")


def test_white_is_zero_is_taken_as_stored_with_a_warning(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", IMAGE, photometric="miniswhite")
    frame = only(tmp_path / "a.tif")
    np.testing.assert_array_equal(frame.data, IMAGE[::-1])
    assert "white" in frame.metadata.warnings[0]


def test_a_thumbnail_is_no_frame(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as tiff:
        tiff.write(IMAGE[::2, ::2], subfiletype=1, metadata=None)
        tiff.write(IMAGE, metadata=None)
    np.testing.assert_array_equal(only(tmp_path / "a.tif").data, IMAGE[::-1])


def test_pages_of_several_sizes_are_frames_of_several_sizes(tmp_path):
    with tifffile.TiffWriter(tmp_path / "a.tif") as tiff:
        tiff.write(IMAGE, metadata=None)
        tiff.write(IMAGE[:2], metadata=None)
    assert [frame.shape for frame in read_frames(tmp_path / "a.tif")] == [(4, 5), (2, 5)]


def test_packed_twelve_bits_are_unpacked(tmp_path):
    # two pixels in three bytes, most significant bits first
    data = np.array([[0xABC, 0x123], [0xFFF, 0x001]], np.uint16)
    packed = b"".join(bytes([a >> 4, (a & 15) << 4 | b >> 8, b & 255]) for a, b in data.tolist())
    entries = [
        (256, 2),
        (257, 2),
        (258, 12),
        (259, 1),
        (262, 1),
        (273, 8),
        (277, 1),
        (278, 2),
        (279, len(packed)),
    ]
    ifd = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", t, 4, 1, v) for t, v in entries)
    path = tmp_path / "a.tif"
    path.write_bytes(b"II*\0" + struct.pack("<I", 14) + packed + ifd + struct.pack("<I", 0))
    np.testing.assert_array_equal(only(path).data, data[::-1])


def test_without_imagecodecs_the_refusal_says_what_to_install(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", IMAGE, compression="lzw")
    np.testing.assert_array_equal(only(tmp_path / "a.tif").data, IMAGE[::-1])
    code = "import sys; sys.modules['imagecodecs'] = None\nfrom jitterkit.frames import read_frames\n"
    code += "try: list(read_frames(sys.argv[1]))\nexcept ValueError as error: print(error.code, error)"
    run = [sys.executable, "-c", code, str(tmp_path / "a.tif")]
    out = subprocess.run(run, capture_output=True, text=True, check=True).stdout
    code, told = out.split(maxsplit=1)
    assert code == ErrorCode.MISSING_PACKAGE
    assert all(value in told for value in (str(tmp_path / "a.tif"), "lzw", "pip install imagecodecs"))


@pytest.mark.parametrize(("compression", "name"), [(34676, "sgilog"), (9999, "9999")])
def test_a_compression_that_is_not_read_is_refused_by_name(tmp_path, compression, name):
    path = chain(tmp_path / "a.tif", 0)
    tag, other = (struct.pack("<HHII", 259, 4, 1, number) for number in (1, compression))
    path.write_bytes(path.read_bytes().replace(tag, other))
    with refused(ErrorCode.UNSUPPORTED_ENCODING, path, name, error=FrameError):
        list(read_frames(path))


def test_a_gzipped_tiff_is_refused_as_such(tmp_path):
    content = write_tiff(tmp_path / "a.tif", IMAGE).read_bytes()
    (tmp_path / "a.tif.gz").write_bytes(gzip.compress(content))
    with refused(ErrorCode.UNSUPPORTED_ENCODING, tmp_path / "a.tif.gz", error=FrameError):
        open_frames(tmp_path / "a.tif.gz")


def chain(path, following, size=200):
    """Write a one-page TIFF whose directory points on to ``following``."""
    entries = [(256, 2), (257, 2), (258, 8), (259, 1), (262, 1), (273, 8), (277, 1), (278, 2), (279, 4)]
    ifd = struct.pack("<H", len(entries)) + b"".join(struct.pack("<HHII", t, 4, 1, v) for t, v in entries)
    path.write_bytes(
        (b"II*\0" + struct.pack("<I", 12) + bytes(4) + ifd + struct.pack("<I", following)).ljust(size)
    )
    return path


@pytest.mark.parametrize(
    ("following", "code"),
    [
        (12, ErrorCode.DAMAGED),  # back to the first page
        (10**6, ErrorCode.TRUNCATED),  # beyond the end of the file
        (199, ErrorCode.TRUNCATED),  # the file ends within the number of entries
        (150, ErrorCode.TRUNCATED),  # the file ends within the entries
        (8, ErrorCode.DAMAGED),  # no entries
    ],
)
def test_a_broken_chain_of_pages_is_refused(tmp_path, following, code):
    path = chain(tmp_path / "a.tif", following)
    with refused(code, path, "page 1", error=FrameError):
        open_frames(path)


def test_a_file_without_pages_is_refused(tmp_path):
    for start in (b"II*\0" + bytes(4), b"MM\0+\0\x08" + bytes(10)):
        (tmp_path / "a.tif").write_bytes(start)
        with refused(ErrorCode.NO_IMAGE, tmp_path / "a.tif", error=FrameError):
            open_frames(tmp_path / "a.tif")
        (tmp_path / "a.tif").write_bytes(start[:-1])
        with refused(ErrorCode.TRUNCATED, tmp_path / "a.tif", len(start) - 1, error=FrameError):
            open_frames(tmp_path / "a.tif")


@pytest.mark.parametrize("compression", [None, "zlib"])
@pytest.mark.parametrize("keep", [0.9, 0.3])
def test_a_truncated_file_is_refused(tmp_path, compression, keep):
    path = tmp_path / "a.tif"
    noise = np.random.default_rng(3).integers(0, 60000, (200, 200)).astype(np.uint16)
    tifffile.imwrite(path, noise, compression=compression, rowsperstrip=20)
    path.write_bytes(path.read_bytes()[: int(keep * path.stat().st_size)])
    with refused(ErrorCode.TRUNCATED, path, error=FrameError):
        list(read_frames(path))


def test_a_page_that_declares_more_than_there_is_allocates_nothing(tmp_path):
    path = chain(tmp_path / "a.tif", 0)
    content = path.read_bytes().replace(
        struct.pack("<HHII", 256, 4, 1, 2), struct.pack("<HHII", 256, 4, 1, 10**9)
    )
    path.write_bytes(content)
    with refused(ErrorCode.DAMAGED, path, "page 0", 2000000000, 200, error=FrameError):
        list(read_frames(path))


@pytest.mark.parametrize(
    "kind", [{"imagej": True, "metadata": {"axes": "TYX"}}, {"photometric": "minisblack"}]
)
def test_a_stack_too_short_for_its_planes_is_refused(tmp_path, kind):
    path = tmp_path / "a.tif"
    tifffile.imwrite(path, np.zeros((9, 50, 50), np.uint16), truncate=True, **kind)
    path.write_bytes(path.read_bytes()[:20000])
    with refused(ErrorCode.TRUNCATED, path, "9 frames", error=FrameError) as caught:
        open_frames(path)
    assert re.search("[13]$", caught.value.problem)  # as many as there are


def test_an_hdu_of_a_tiff_is_refused(tmp_path):
    write_tiff(tmp_path / "a.tif", IMAGE)
    with refused(ErrorCode.NO_IMAGE, tmp_path / "a.tif", "HDU 1", error=FrameError):
        open_frames(tmp_path / "a.tif", hdu=1)


def test_the_exposure_is_read_from_ome(tmp_path):
    path = tmp_path / "a.ome.tif"
    plane = {"ExposureTime": [250.0, 250.0], "ExposureTimeUnit": ["ms", "ms"]}
    tifffile.imwrite(path, np.stack([IMAGE, IMAGE]), ome=True, metadata={"axes": "TYX", "Plane": plane})
    with open_frames(path) as file:
        assert (file.metadata.exposure.value, file.metadata.exposure.source) == (
            0.25,
            "header OME ExposureTime",
        )


@pytest.mark.parametrize("orientation", SIDES)
def test_what_became_of_the_stored_rows_is_reported(tmp_path, orientation):
    tag = [(274, "H", 1, orientation, True)]
    tifffile.imwrite(tmp_path / "a.tif", IMAGE, extratags=tag, metadata=None)
    # the first stored row at the top: our rows, upwards, are the stored ones from the last to the first
    wanted = {"top": -1, "bottom": 1}.get(SIDES[orientation][0], 0)
    assert only(tmp_path / "a.tif").metadata.row_order == wanted


def test_a_line_time_beside_a_tiff_is_of_its_stored_rows(tmp_path):
    write_tiff(tmp_path / "a.tif", IMAGE, metadata={"line_time": 2e-5})
    known = only(tmp_path / "a.tif").metadata.line_time
    assert (known.value, known.unit, known.source) == (-2e-5, "s", "sidecar a.toml")
    tag = [(274, "H", 1, 6, True)]
    tifffile.imwrite(tmp_path / "a.tif", IMAGE, extratags=tag, metadata=None)
    turned = only(tmp_path / "a.tif").metadata
    assert turned.value("line_time") == 0.0
    assert any("line_time" in text for text in turned.warnings)


@pytest.mark.parametrize(
    ("labels", "warned"),
    [
        (["science", "error", "mask"], "'error', 'mask'"),
        (["frame 1", "frame 2", "frame 3"], ""),
        (["dark", "dark", "dark"], ""),
        (["t = 0 s", "t = 1 s", "background"], "'background'"),
    ],
)
@pytest.mark.parametrize("imagej", [True, False])
def test_planes_that_are_no_images_by_their_labels_are_warned_of(tmp_path, labels, warned, imagej):
    stack = np.arange(60, dtype=np.uint16).reshape(3, 4, 5)
    with tifffile.TiffWriter(tmp_path / "a.tif", imagej=imagej) as writer:
        if imagej:
            writer.write(stack, metadata={"Labels": labels, "axes": "ZYX"})
        for plane, label in zip(stack, labels, strict=True) if not imagej else ():
            writer.write(plane, extratags=[(285, "s", 0, label, False)], metadata=None, contiguous=False)
    frames = list(read_frames(tmp_path / "a.tif"))
    assert len(frames) == 3
    said = [text for text in frames[0].metadata.warnings if "labels" in text]
    assert said == [] if not warned else warned in said[0]


@pytest.mark.parametrize(
    ("description", "tags", "said"),
    [
        ("Exposure Time: 20 ms\nGain: 1.2", [], "Exposure Time: 20 ms"),
        ("[Camera]\nIntegrationTime=0.02\n", [], "IntegrationTime=0.02"),
        (None, [(51123, 2, 0, '{"Exposure-ms": 20.0}', True)], "Exposure-ms': 20.0"),
        ("no exposure given, 3 frames", [], ""),
    ],
)
def test_an_exposure_in_a_text_is_warned_of(tmp_path, description, tags, said):
    options = {"description": description, "extratags": tags, "metadata": None}
    tifffile.imwrite(tmp_path / "a.tif", np.ones((4, 5), np.uint16), **options)
    (frame,) = read_frames(tmp_path / "a.tif")
    assert frame.metadata.exposure is None
    assert_warned(frame.metadata.warnings, said)
