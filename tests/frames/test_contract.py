"""What every frame format must do, whatever its file looks like inside."""

import numpy as np
import pytest
import tifffile
from astropy.io import fits

from jitterkit.frames import RawFrame, open_frames, read_frames, write_fits, write_tiff

# no symmetry, so that a flip, a transposition or a swapped byte shows
STACK = (np.arange(3)[:, None, None] * 1000 + np.arange(7)[:, None] * 100 + np.arange(5)).astype(np.uint16)


def fits_with(dtype):
    def write(path, stack):
        fits.writeto(path.with_suffix(".fits"), stack.astype(dtype))
        return path.with_suffix(".fits")

    return write


def fits_extension(path, stack):
    hdus = fits.HDUList([fits.PrimaryHDU(), fits.ImageHDU(stack.astype(">f4"))])
    hdus.writeto(path.with_suffix(".fit"))
    return path.with_suffix(".fit")


def fits_four_axes(path, stack):
    fits.writeto(path.with_suffix(".fts"), stack[:, None].astype(np.int32))
    return path.with_suffix(".fts")


def written_as(ending, dtype=np.uint16):
    def write(path, stack):
        return write_fits(path.with_name("frames" + ending), stack.astype(dtype))

    return write


def tiff_with(dtype, **options):
    def write(path, stack):
        with tifffile.TiffWriter(path.with_suffix(".tif"), **options) as tiff:
            for plane in stack[:, ::-1].astype(dtype):
                tiff.write(plane, photometric="minisblack", metadata=None, contiguous=False)
        return path.with_suffix(".tif")

    return write


def tiff_compressed(path, stack):
    tifffile.imwrite(path.with_suffix(".tif"), stack[:, ::-1], photometric="minisblack", compression="zlib")
    return path.with_suffix(".tif")


def tiff_tiled(path, stack):
    tifffile.imwrite(path.with_suffix(".tif"), stack[:, ::-1], photometric="minisblack", tile=(16, 16))
    return path.with_suffix(".tif")


def imagej(path, stack):
    tifffile.imwrite(path.with_suffix(".tif"), stack[:, ::-1], imagej=True, metadata={"axes": "TYX"})
    return path.with_suffix(".tif")


def one_page_for_all(path, stack):
    tifffile.imwrite(path.with_suffix(".tif"), stack[:, ::-1], photometric="minisblack", truncate=True)
    return path.with_suffix(".tif")


def imagej_one_page(path, stack):
    options = {"imagej": True, "metadata": {"axes": "TYX"}, "truncate": True}
    tifffile.imwrite(path.with_suffix(".tif"), stack[:, ::-1], **options)
    return path.with_suffix(".tif")


def ome(path, stack):
    tifffile.imwrite(path.with_suffix(".ome.tif"), stack[:, ::-1], ome=True, metadata={"axes": "TYX"})
    return path.with_suffix(".ome.tif")


FORMATS = {
    "FITS uint16 by BZERO": fits_with(np.uint16),
    "FITS int16": fits_with(np.int16),
    "FITS int32": fits_with(np.int32),
    "FITS int64": fits_with(np.int64),
    "FITS uint32 by BZERO": fits_with(np.uint32),
    "FITS float32": fits_with(np.float32),
    "FITS float64": fits_with(np.float64),
    "FITS extension": fits_extension,
    "FITS with a unit axis": fits_four_axes,
    "FITS written": written_as(".fits"),
    "FITS gzipped": written_as(".fits.gz"),
    "FITS compressed": written_as(".fits.fz"),
    "FITS compressed floats": written_as(".fits.fz", np.float64),
    "TIFF uint16": tiff_with(np.uint16),
    "TIFF big-endian": tiff_with(">u2", byteorder=">"),
    "TIFF big-endian float64": tiff_with(">f8", byteorder=">"),
    "TIFF BigTIFF": tiff_with(np.uint16, bigtiff=True),
    "TIFF BigTIFF big-endian": tiff_with(">u2", bigtiff=True, byteorder=">"),
    "TIFF int16": tiff_with(np.int16),
    "TIFF int32": tiff_with(np.int32),
    "TIFF uint32": tiff_with(np.uint32),
    "TIFF float32": tiff_with(np.float32),
    "TIFF deflated": tiff_compressed,
    "TIFF tiled": tiff_tiled,
    "TIFF ImageJ": imagej,
    "TIFF one page for all": one_page_for_all,
    "TIFF ImageJ one page for all": imagej_one_page,
    "TIFF OME": ome,
    "TIFF written": lambda path, stack: write_tiff(path.with_suffix(".tif"), stack),
}


@pytest.fixture(params=FORMATS, ids=lambda name: name.replace(" ", "-"))
def file_and_kind(request, tmp_path):
    return FORMATS[request.param](tmp_path / "frames", STACK), request.param.split()[0]


def test_every_number_comes_back_at_its_place(file_and_kind):
    frames = list(read_frames(file_and_kind[0]))
    np.testing.assert_array_equal([frame.data for frame in frames], STACK)


def test_arrays_are_native_contiguous_float64(file_and_kind):
    for frame in read_frames(file_and_kind[0]):
        assert frame.data.dtype == np.float64
        assert frame.data.dtype.isnative
        assert frame.data.flags.c_contiguous
        assert frame.data.flags.writeable
        assert frame.mask.dtype == bool
        assert not frame.mask.any()


def test_the_file_is_described_before_pixels_are_read(file_and_kind):
    path, kind = file_and_kind
    with open_frames(path) as file:
        assert (len(file), file.shape, file.kind) == (3, (7, 5), kind)
        assert file.dtype.isnative
        assert file.dtype.itemsize in (2, 4, 8)
        assert ("frames", "3") in [row[:2] for row in file.describe()]


def test_frames_are_found_by_index_and_know_their_place(file_and_kind):
    path, _ = file_and_kind
    with open_frames(path) as file:
        last = file[-1]
        np.testing.assert_array_equal(file[1].data, STACK[1])
        with pytest.raises(IndexError, match="out of range"):
            file[3]
    assert (last.name, last.index, last.path, last.origin) == (f"{path.name}[2]", 2, path, (0, 0))


def test_a_frame_outlives_its_file(file_and_kind):
    with open_frames(file_and_kind[0]) as file:
        frame = file[0]
    file.close()
    assert isinstance(frame, RawFrame)
    assert frame.data.sum() == STACK[0].sum()


def test_the_file_can_be_replaced_once_it_is_closed(file_and_kind):
    path, _ = file_and_kind
    list(read_frames(path))
    path.unlink()
    assert not path.exists()
