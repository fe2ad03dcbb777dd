"""The committed sample frames: small, readable, true, and made by the script that says so."""

import runpy
import sys
from pathlib import Path

import numpy as np
import pytest

from jitterkit.frames import find_files, open_frames
from jitterkit.instruments import load_instrument, resolve

ROOT = Path(__file__).resolve().parents[2]
SAMPLES = ROOT / "sample_frames"
FILES = find_files([SAMPLES])


def test_they_are_small():
    assert sum(path.stat().st_size for path in SAMPLES.rglob("*") if path.is_file()) < 3_000_000


def test_the_readme_speaks_of_every_file():
    text = (SAMPLES / "README.md").read_text(encoding="utf-8")
    assert [path.name for path in FILES if path.name not in text] == []


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.name)
def test_every_frame_says_its_numbers_itself(path):
    toliman = load_instrument("toliman")
    with open_frames(path) as file:
        for raw in file:
            frame = toliman.detector.calibrate(resolve(raw, toliman))
            assert frame.shape == (128, 128)
            assert set(frame.flags) <= {"saturated"}
            assert frame.metadata.gain.source.startswith(("header", "sidecar"))
            # 90 % of 9.53e6 photons fall inside; blur and saturated pixels take 1 % at most
            assert frame.electrons.sum() == pytest.approx(0.89 * 9.53e6, rel=0.02)


def test_the_script_makes_the_same_frames_again(tmp_path, monkeypatch):
    pytest.importorskip("dLuxToliman")
    monkeypatch.setattr(sys, "argv", ["make_sample_frames", str(tmp_path)])
    runpy.run_path(str(ROOT / "scripts" / "make_sample_frames"), run_name="__main__")
    assert [path.name for path in find_files([tmp_path])] == [path.name for path in FILES]
    for path in FILES:
        with open_frames(path) as kept, open_frames(tmp_path / path.name) as made:
            assert len(kept) == len(made)
            for one, other in zip(kept, made, strict=True):
                # rounding of the model, 1e-13, moves a draw across an integer about once in 1e9 pixels
                assert np.count_nonzero(one.data != other.data) == 0
