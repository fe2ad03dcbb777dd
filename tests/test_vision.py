"""The door to OpenCV."""

import numpy as np
import pytest
from refusals import refused
from scipy import ndimage

from jitterkit.errors import ErrorCode, JitterkitError
from jitterkit.vision import bin_mean, box_mean, components, median_filter, native

IMAGE = np.random.default_rng(5).integers(0, 200, (40, 31))
TYPES = [
    "u1",
    "<u2",
    ">u2",
    "<i2",
    ">i2",
    "<i4",
    ">i4",
    "<u4",
    ">u4",
    "<i8",
    ">i8",
    "<f4",
    ">f4",
    "<f8",
    ">f8",
    "f2",
    "i1",
]


@pytest.mark.parametrize("dtype", TYPES)
def test_numbers_of_every_type_and_byte_order_pass_unchanged(dtype):
    image = (IMAGE % 100).astype(dtype)
    safe = native(image)
    np.testing.assert_array_equal(safe, image)
    assert safe.dtype.isnative
    assert safe.flags.c_contiguous


def test_views_are_made_contiguous_and_good_arrays_are_not_copied():
    image = IMAGE.astype(np.float64)
    assert native(image) is image
    np.testing.assert_array_equal(native(image[::-2, ::3]), image[::-2, ::3])


@pytest.mark.parametrize(
    ("image", "code"),
    [
        (IMAGE[0], ErrorCode.WRONG_SHAPE),
        (IMAGE[None], ErrorCode.WRONG_SHAPE),
        (np.zeros((0, 3)), ErrorCode.WRONG_SHAPE),
        (IMAGE * 1j, ErrorCode.WRONG_TYPE),
        (np.array([["a"]]), ErrorCode.WRONG_TYPE),
    ],
)
def test_what_is_no_image_is_refused(image, code):
    with refused(code, image.shape, image.dtype, error=JitterkitError):
        native(image)


@pytest.mark.parametrize("dtype", [">f8", "<u2", ">u2", "u1", ">i4"])
@pytest.mark.parametrize("size", [3, 5])
def test_the_median_is_scipys(dtype, size):
    expected = ndimage.median_filter(IMAGE, size, mode="nearest")
    np.testing.assert_array_equal(median_filter(IMAGE.astype(dtype), size), expected)


def test_other_sizes_of_median_are_refused():
    with refused(ErrorCode.OUT_OF_RANGE, "4 x 4", "3 or 5", error=JitterkitError):
        median_filter(IMAGE, 4)


@pytest.mark.parametrize("size", [1, 4, 5])
@pytest.mark.parametrize("dtype", [">f8", "<u2"])
def test_the_box_mean_is_the_mean_of_the_box(size, dtype):
    means = box_mean(IMAGE.astype(dtype), size)
    y, x, low = 20, 11, size // 2
    box = IMAGE[y - low : y - low + size, x - low : x - low + size]
    # rounding of a running sum of at most 40 x 31 numbers below 200
    assert means[y, x] == pytest.approx(box.mean(), abs=1e-9)


def test_a_box_may_be_taller_than_it_is_wide():
    means, image = box_mean(IMAGE.astype(float), (7, 3)), IMAGE.astype(float)
    # rounding of a running sum, as above
    assert means[20, 11] == pytest.approx(image[17:24, 10:13].mean(), abs=1e-9)


def test_bins_are_means_of_blocks_and_the_rest_is_left_out():
    binned = bin_mean(IMAGE.astype(">i4"), 4)
    assert binned.shape == (10, 7)
    np.testing.assert_allclose(binned, IMAGE[:40, :28].reshape(10, 4, 7, 4).mean(axis=(1, 3)), rtol=1e-12)


def test_components_hang_together_by_corners_too():
    mask = np.zeros((6, 9), bool)
    mask[1, 1] = mask[2, 2] = mask[3, 3] = True
    mask[4, 6:9] = True
    parts = components(mask)
    assert parts.area.tolist() == [3, 3]
    assert parts.box.tolist() == [[1, 1, 3, 3], [6, 4, 3, 1]]
    np.testing.assert_allclose(parts.centroid, [[2, 2], [7, 4]])
    assert parts.labels[2, 2] == 1
    assert parts.labels[4, 7] == 2
    assert parts.labels[0, 0] == 0


def test_an_empty_mask_has_no_components():
    assert components(np.zeros((4, 4), bool)).area.size == 0
