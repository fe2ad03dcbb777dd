"""The sharp frame that others are compared with: found, known again, and refused where it is of no use.

Reach for :func:`sharpest` to find one in a set, :func:`check_reference` before a long run.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path

import numpy as np

from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError, ErrorCode, FrameError
from jitterkit.frames import Frame, RawFrame, find_files, open_frames
from jitterkit.kernels import fill_masked
from jitterkit.starfield import roundest

_CHANCE = 5.0
"""Standard errors by which the pixels of a scene are more like their neighbours than those of noise."""


def check_reference(
    sharp: Frame, starless: str | None, paths: Sequence[str | Path], hdu: int | None = None
) -> None:
    """Refuse a reference that cannot serve any frame.

    Parameters
    ----------
    sharp : Frame
    starless : str or None
        Of a star field, which need not have the size of the others: why no stars are seen in it, or nothing.
        None if it is a view of something else.
    paths : sequence of str or Path
        Files to be measured, or directories of them; no more is read than the sizes of their frames.
    hdu : int, optional

    Raises
    ------
    ConfigurationError
        If the reference shows nothing, has another size than every file, or is the only frame.
    """
    if sharp.mask.all():
        raise _refusal(ErrorCode.NO_DATA, sharp, "it has no usable pixel")
    if starless:
        raise _refusal(ErrorCode.NO_STAR, sharp, f"it shows no stars ({starless.rstrip('.')})")
    if starless is None:
        _check_view(sharp, _sizes(paths, hdu))
    alone = sharp.path is not None and not sharp.several
    if alone and {path.resolve() for path in find_files(paths)} == {Path(sharp.path).resolve()}:  # type: ignore[arg-type]
        problem = f"{sharp.name} is the reference and the only frame; give frames to compare with it."
        raise ConfigurationError(ErrorCode.BAD_REFERENCE, problem)


def check_size(sharp: Frame, name: str, size: tuple[int, int]) -> None:
    """Refuse a reference of another size ``(ny, nx)`` than a frame that shows the same view.

    Raises
    ------
    ConfigurationError
    """
    if size != sharp.shape:
        own, other = (f"{nx} x {ny}" for ny, nx in (sharp.shape, size))
        raise _refusal(ErrorCode.WRONG_SHAPE, sharp, f"it has {own} pixels, {name} {other}")


def is_same(raw: RawFrame, reference: RawFrame) -> bool:
    """Return whether a frame is the reference itself, whatever the name of its file."""
    if raw.path is None or reference.path is None:
        return raw is reference
    same = (raw.index, raw.hdu) == (reference.index, reference.hdu)
    return same and raw.path.resolve() == reference.path.resolve()


def sharpest(paths: Sequence[str | Path], hdu: int | None = None) -> RawFrame:
    """Return the frame of a set of star fields whose stars are sharpest: the others' reference.

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
    frames: list[Frame] = []
    positions: list[tuple[Path, int]] = []
    for path in find_files(paths):
        with suppress(FrameError), open_frames(path, hdu=hdu) as file:  # its row will say what is wrong
            for raw in file:
                frames.append(Detector().calibrate(raw))
                positions.append((path, raw.index))
    path, index = positions[roundest(frames)]
    with open_frames(path, hdu=hdu) as file:
        return file[index]


def _refusal(code: ErrorCode, sharp: Frame, problem: str) -> ConfigurationError:
    message = f"{sharp.name} cannot serve as reference: {problem}; give another sharp frame."
    return ConfigurationError(code, message)


def _check_view(sharp: Frame, sizes: Iterator[tuple[str, tuple[int, int]]]) -> None:
    """Refuse a view of nothing, and one of another size than every file that can be read."""
    if not _shows_something(fill_masked(sharp.electrons, ~sharp.mask)):
        raise _refusal(ErrorCode.NO_SIGNAL, sharp, "it shows nothing but noise")
    others = []
    for name, size in sizes:
        if size == sharp.shape:
            return
        others.append((name, size))
    if others:
        check_size(sharp, *others[0])


def _shows_something(image: np.ndarray) -> bool:
    """Return whether neighbouring pixels are correlated; those of white noise are not."""
    off = image - image.mean()
    products = np.mean(off[:, 1:] * off[:, :-1]), np.mean(off[1:] * off[:-1])
    return bool(max(products) > _CHANCE * np.mean(off**2) / np.sqrt(off.size))


def _sizes(paths: Sequence[str | Path], hdu: int | None) -> Iterator[tuple[str, tuple[int, int]]]:
    """Name and size of the frames of every file that can be read."""
    for path in find_files(paths):
        with suppress(FrameError), open_frames(path, hdu=hdu) as file:
            yield path.name, file.shape
