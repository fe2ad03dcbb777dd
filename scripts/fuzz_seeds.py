"""The files that ``scripts/fuzz_frames`` damages: real ones, and a few of kinds that are rare among them."""

from __future__ import annotations

import tempfile
from pathlib import Path

import numpy as np
from fuzz_mutations import bomb, mutated

__all__ = ["ROOT", "damaged", "seeds"]

ROOT = Path(__file__).resolve().parent.parent
ENDINGS = (".fits", ".fits.gz", ".fits.fz", ".fz", ".tif", ".tiff")
BOMBS = 0.01  # of all files


def seeds(kind: str, real: Path) -> list[tuple[str, bytes]]:
    """Name ending and content of every file to damage, in a fixed order."""
    from jitterkit.frames import is_whole

    folders = [ROOT / "sample_frames", real]
    paths = [p for folder in folders for p in sorted(folder.rglob("*")) if p.name.endswith(ENDINGS)]
    whole = [(_ending(p), p.read_bytes()) for p in paths if is_whole(p)] + _made()
    refused = [(_ending(p), p.read_bytes()) for p in paths if not is_whole(p)]
    found = 3 * whole + refused  # what is refused when healthy has fewer ways to go wrong
    return [(e, c) for e, c in found if kind in ("both", "tiff" if e.startswith(".tif") else "fits")]


def _ending(path: Path) -> str:
    return max((e for e in ENDINGS if path.name.endswith(e)), key=len)


def _made() -> list[tuple[str, bytes]]:
    """Small files of kinds that are rare among real ones."""
    import tifffile

    from jitterkit.frames import write_fits

    rng = np.random.default_rng(0)
    stack = rng.integers(0, 4000, (3, 40, 50)).astype(np.uint16)
    tiffs = [
        {"imagej": True, "metadata": {"axes": "TYX"}},
        {"imagej": True, "truncate": True, "metadata": {"axes": "TYX"}},
        {"ome": True, "metadata": {"axes": "TYX", "Plane": {"ExposureTime": [0.1] * 3}}},
        {"shaped": True, "truncate": True},
        {"bigtiff": True, "tile": (16, 16), "compression": "zlib", "predictor": 2},
        {"byteorder": ">", "compression": "lzw", "predictor": 2, "metadata": None, "rowsperstrip": 7},
        {"compression": "packbits", "metadata": None},
        {"compression": "zstd", "metadata": None, "rowsperstrip": 5},
    ]
    found = []
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "a.tif")
        for options in tiffs:
            tifffile.imwrite(path, stack, photometric="minisblack", **options)
            found.append((".tif", path.read_bytes()))
        with tifffile.TiffWriter(path) as tiff:
            tiff.write(stack[0], subifds=1, metadata=None)
            tiff.write(stack[0, ::2, ::2], subfiletype=1, metadata=None)
        found.append((".tif", path.read_bytes()))
        for ending in (".fits", ".fits.gz", ".fits.fz"):
            for array in (stack, stack[0].astype(np.float32), stack[0].astype(np.int32)):
                path = write_fits(Path(folder, f"a{ending}"), array, header={"EXPTIME": 1.0}, overwrite=True)
                found.append((ending, path.read_bytes()))
    return found


def damaged(number: int, seed: int, kind: str, sources: list[tuple[str, bytes]]) -> tuple[str, bytes]:
    """The file of a number: name ending and content, the same whoever makes it."""
    rng = np.random.default_rng([seed, number])
    if rng.random() < BOMBS:
        packed = "tiff" if kind == "tiff" or (kind == "both" and rng.random() < 0.5) else "fits"
        return (".tif" if packed == "tiff" else ".fits.gz"), bomb(packed, rng)
    ending, content = sources[int(rng.integers(len(sources)))]
    return ending, mutated(content, rng)
