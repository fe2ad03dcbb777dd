"""The sharp frame that others are compared with: found, known again, and refused where it is of no use.

Reach for :func:`sharpest` to find one in a set, :func:`check_reference` before a long run.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError, FrameError, UndeterminedError
from jitterkit.frames import Frame, RawFrame, find_files, open_frames
from jitterkit.kernels import fill_masked
from jitterkit.starfield import field_psf, roundest

__all__ = ["OwnReferenceError", "check_reference", "is_same", "sharpest"]

_CHANCE = 5.0
"""Standard errors by which the pixels of a scene are more like their neighbours than those of noise."""


class OwnReferenceError(UndeterminedError):
    """A frame that is the reference itself: against itself no frame is blurred."""


def check_reference(sharp: Frame, stars: bool, paths: Sequence[str | Path], hdu: int | None = None) -> None:
    """Refuse a reference that cannot serve any frame.

    Parameters
    ----------
    sharp : Frame
    stars : bool
        Whether it is to be taken for a star field, which need not have the size of the others.
    paths : sequence of str or Path
        Files to be measured, or directories of them; no more is read than the sizes of their frames.
    hdu : int, optional

    Raises
    ------
    ConfigurationError
        If the reference shows nothing, has another size than every file, or is the only frame.
    """
    problem = _fault(sharp, stars) or ("" if stars else _misfit(sharp, _sizes(paths, hdu)))
    if problem:
        raise ConfigurationError(
            f"{sharp.name} cannot serve as reference: {problem}; give another sharp frame."
        )
    alone = sharp.path is not None and not sharp.several
    if alone and {path.resolve() for path in find_files(paths)} == {Path(sharp.path).resolve()}:  # type: ignore[arg-type]
        raise ConfigurationError(
            f"{sharp.name} is the reference and the only frame; give frames to compare with it."
        )


def is_same(raw: RawFrame, reference: RawFrame) -> bool:
    """Whether a frame is the reference itself, by whatever name its file was given."""
    if raw.path is None or reference.path is None:
        return raw is reference
    same = (raw.index, raw.hdu) == (reference.index, reference.hdu)
    return same and raw.path.resolve() == reference.path.resolve()


def sharpest(paths: Sequence[str | Path], hdu: int | None = None) -> RawFrame:
    """The frame of a set of star fields whose stars are sharpest: the others' reference.

    Parameters
    ----------
    paths : sequence of str or Path
        Files, or directories of them; every frame that can be read is looked at.
    hdu : int, optional

    Raises
    ------
    UndeterminedError
        If no frame has three isolated stars.
    """
    frames: list[RawFrame] = []
    for path in find_files(paths):
        with suppress(FrameError), open_frames(path, hdu=hdu) as file:  # its row will say what is wrong
            frames += list(file)
    return frames[roundest([Detector().calibrate(raw) for raw in frames])]


def _fault(sharp: Frame, stars: bool) -> str:
    """What is wrong with a reference whatever it is compared with, or nothing."""
    if sharp.mask.all():
        return "it has no usable pixel"
    if not stars:
        shows = _shows_something(fill_masked(sharp.electrons, ~sharp.mask))
        return "" if shows else "it shows nothing but noise"
    try:
        field_psf(sharp)
    except UndeterminedError as error:
        return f"it shows no stars ({str(error).rstrip('.')})"
    return ""


def _shows_something(image: np.ndarray) -> bool:
    """Whether neighbouring pixels have anything in common; those of white noise have not."""
    off = image - image.mean()
    products = np.mean(off[:, 1:] * off[:, :-1]), np.mean(off[1:] * off[:-1])
    return bool(max(products) > _CHANCE * np.mean(off**2) / np.sqrt(off.size))


def _sizes(paths: Sequence[str | Path], hdu: int | None) -> Iterator[tuple[str, tuple[int, int]]]:
    """Name and size of the frames of every file that can be read."""
    for path in find_files(paths):
        with suppress(FrameError), open_frames(path, hdu=hdu) as file:
            yield path.name, file.shape


def _misfit(sharp: Frame, sizes: Iterable[tuple[str, tuple[int, int]]]) -> str:
    """Nothing if a file has frames of the reference's size, or none can be read."""
    others = []
    for name, size in sizes:
        if size == sharp.shape:
            return ""
        others.append(f"{name} {size[1]} x {size[0]}")
    return f"it has {sharp.shape[1]} x {sharp.shape[0]} pixels, {others[0]}" if others else ""
