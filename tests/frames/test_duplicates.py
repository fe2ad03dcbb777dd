"""Which frames are duplicates, by the digests of their pixels."""

import numpy as np

from jitterkit.frames import RawFrame
from jitterkit.frames.reader import Duplicates


def test_the_first_frame_of_its_pixels_counts():
    known = Duplicates()
    found = [known.original(digest, name) for digest, name in ("1a", "2b", "1c", "1d", "2e")]
    assert found == ["", "", "a", "a", "b"]


def test_a_frame_of_unknown_pixels_is_no_duplicate():
    known = Duplicates()
    assert [known.original("", name) for name in "ab"] == ["", ""]


def test_equal_values_have_one_digest_whatever_their_type():
    values = np.random.default_rng(1).integers(0, 1000, (5, 7))
    values[0, 0] = 0
    types = ["u2", ">i4", "<f4", ">f8"]
    digests = {RawFrame.from_array(values.astype(kind)).digest for kind in types}
    negative_zero = values.astype(float)
    negative_zero[0, 0] = -0.0
    assert {RawFrame.from_array(negative_zero).digest} == digests
    assert len(digests) == 1
    assert RawFrame.from_array(values.T).digest not in digests
    values[4, 6] += 1
    assert RawFrame.from_array(values).digest not in digests


def test_numbers_that_were_rounded_to_32_bits_have_the_digest_of_those_in_64():
    values = np.random.default_rng(1).normal(100, 3, (5, 7))
    assert RawFrame.from_array(values).digest == RawFrame.from_array(values.astype("f4")).digest
