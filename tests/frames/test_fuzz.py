"""Files that nobody would write end in frames or a sentence: seeded damage, and what hypothesis thinks of.

``scripts/fuzz_frames`` does the same with real files, by the thousand and with limits on time and memory.
"""

import re
import warnings

import numpy as np
import pytest
import tifffile
from fuzz_mutations import bomb, mutated
from fuzz_reading import REFUSALS
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from jitterkit.errors import FrameError
from jitterkit.frames import is_whole, open_frames, write_fits

STACK = np.random.default_rng(0).integers(0, 4000, (2, 6, 8)).astype(np.uint16)
QUICK = settings(
    max_examples=60,
    derandomize=True,
    deadline=None,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],  # each example overwrites the file
)


def outcome(path):
    """Read everything; None where that works, else the sentence. Any other exception, or a warning, fails."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        try:
            with open_frames(path) as file:
                assert all(isinstance(cell, str) for row in file.describe() for cell in row)
                for index in {0, len(file) - 1}:
                    frame = file[index]
                    assert frame.data.shape == frame.mask.shape
                    assert np.isfinite(frame.data).all()
                    assert all(text.isprintable() for text in frame.metadata.warnings)
        except FrameError as error:
            code, sentence = error.code, str(error)
        else:
            return None
    assert code in REFUSALS
    assert re.fullmatch(rf"{re.escape(str(path))}: \S.*; .+\.", sentence)
    assert sentence.isprintable()
    assert not is_whole(path)
    return sentence


def tiff(path, **options):
    tifffile.imwrite(path, STACK, **options)
    return path.read_bytes()


MAKERS = {
    "a.fits": lambda path: write_fits(path, STACK, header={"EXPTIME": 1.0, "EGAIN": 2.0}).read_bytes(),
    "a.fits.gz": lambda path: write_fits(path, STACK).read_bytes(),
    "a.fits.fz": lambda path: write_fits(path, STACK).read_bytes(),
    "plain.tif": lambda path: tiff(path, metadata=None),
    "imagej.tif": lambda path: tiff(path, imagej=True, metadata={"axes": "TYX"}),
    "tiled.tif": lambda path: tiff(path, bigtiff=True, tile=(16, 16), compression="zlib", predictor=2),
}


@pytest.mark.parametrize("name", MAKERS)
def test_aimed_and_blind_damage_ends_in_frames_or_a_sentence(tmp_path, name):
    whole = MAKERS[name](tmp_path / name)
    ends = []
    for seed in range(25 if name.endswith(".fz") else 60):  # decompressing is slow
        (tmp_path / name).write_bytes(mutated(whole, np.random.default_rng(seed)))
        ends.append(outcome(tmp_path / name))
    assert None in ends  # or the damage is too blunt to reach the pixels
    assert any(ends)


@pytest.mark.parametrize(("kind", "name"), [("fits", "a.fits.gz"), ("tiff", "a.tif")])
def test_a_bomb_is_defused(tmp_path, kind, name):
    for seed in range(4):
        (tmp_path / name).write_bytes(bomb(kind, np.random.default_rng(seed)))
        outcome(tmp_path / name)


def card(keyword, value):
    return f"{keyword:8}= {value:>20}".ljust(80)[:80].encode("latin-1")


KEYWORDS = st.sampled_from(
    [
        "SIMPLE",
        "BITPIX",
        "NAXIS",
        "NAXIS1",
        "NAXIS2",
        "NAXIS3",
        "PCOUNT",
        "GCOUNT",
        "GROUPS",
        "TFIELDS",
        "ZIMAGE",
        "BSCALE",
        "BZERO",
        "BLANK",
        "EXPTIME",
        "EGAIN",
        "GAIN",
        "DATE-OBS",
        "MJD-OBS",
        "BUNIT",
        "SATURATE",
        "PIXSCALE",
        "FOCALLEN",
        "XPIXSZ",
        "CTYPE1",
        "CTYPE2",
        "CD1_1",
        "CD2_2",
        "CRVAL1",
    ]
)
VALUES = st.one_of(
    st.integers(-(2**70), 2**70).map(str),
    st.floats().map(repr),
    st.text(st.characters(max_codepoint=255, blacklist_categories=["Cc"]), max_size=12).map(repr),
    st.sampled_from(
        ["T", "F", "", "'unclosed", "1e400", "(1,2)", "'RA---TAN'", "'DEC--TAN'", "'2027-03-01'"]
    ),
)


@QUICK
@given(st.lists(st.tuples(KEYWORDS, VALUES), min_size=1, max_size=4))
def test_no_card_of_a_header_does_harm(tmp_path, cards):
    given_cards = {"SIMPLE": "T", "BITPIX": "16", "NAXIS": "2", "NAXIS1": "8", "NAXIS2": "6"}
    lines = [card(*item) for item in (given_cards | dict(cards)).items()] + [
        card(*item) for item in cards[:1]
    ]
    header = (b"".join(lines) + b"END".ljust(80)).ljust(2880)
    (tmp_path / "a.fits").write_bytes(header + STACK[0].astype(">i2").tobytes().ljust(2880, b"\0"))
    outcome(tmp_path / "a.fits")


TAGS = [
    254,
    256,
    257,
    258,
    259,
    262,
    270,
    273,
    274,
    277,
    278,
    279,
    284,
    317,
    320,
    322,
    323,
    324,
    325,
    330,
    339,
]


@QUICK
@given(
    st.lists(
        st.tuples(st.sampled_from(TAGS), st.integers(1, 18), st.integers(0, 2**32 - 1)),
        min_size=1,
        max_size=3,
    )
)
def test_no_tag_of_a_tiff_does_harm(tmp_path, entries):
    pixels = STACK[0].tobytes()
    tags = {256: (4, 8), 257: (4, 6), 258: (3, 16), 259: (3, 1), 262: (3, 1), 273: (4, 400), 277: (3, 1)}
    tags |= {278: (4, 6), 279: (4, len(pixels))} | {tag: (kind, value) for tag, kind, value in entries}
    directory = b"".join(
        tag.to_bytes(2, "little")
        + kind.to_bytes(2, "little")
        + bytes([1, 0, 0, 0])
        + value.to_bytes(4, "little")
        for tag, (kind, value) in sorted(tags.items())
    )
    start = b"II*\0" + (8).to_bytes(4, "little") + len(tags).to_bytes(2, "little") + directory + bytes(4)
    (tmp_path / "a.tif").write_bytes(start.ljust(400, b"\0") + pixels)
    outcome(tmp_path / "a.tif")


@QUICK
@given(
    st.binary(max_size=400),
    st.sampled_from([b"SIMPLE  =                    T", b"II*\0\x08\0\0\0", b"MM\0+", b""]),
)
def test_no_bytes_do_harm(tmp_path, content, start):
    (tmp_path / "a").write_bytes(start + content)
    assert outcome(tmp_path / "a") is not None
