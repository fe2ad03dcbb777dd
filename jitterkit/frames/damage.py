"""Refusals that FITS and TIFF share, and how much a file may claim to hold before it is asked for it.

A header of a few bytes can declare terabytes, and a compressed file can unpack to them.  What is stored
plainly is held against the size of the file by the readers themselves; here are the limits for the rest.
"""

from __future__ import annotations

from pathlib import Path

from jitterkit.errors import ErrorCode, FrameError

__all__ = ["damaged", "in_colour", "refuse_giant", "truncated", "unpacks_believably"]

#: A frame of more pixels (16384 x 16384) would take more than 2 GB as float64: no detector has as many.
MOST_PIXELS = 1 << 28
#: Packed files are believed up to so many bytes and pixels (an 8192 x 8192 frame, 0.5 GB as float64) ...
SMALL = 1 << 26
#: ... and beyond that up to so many times their size: noise does not pack better than 10 to 1.
LIKELY_PACKING = 20


def damaged(path: Path, problem: str) -> FrameError:
    """Return the exception for a file that contradicts itself."""
    remedy = "the file is damaged: copy it again or convert it"
    return FrameError(ErrorCode.DAMAGED, path, problem, remedy)


def truncated(path: Path, problem: str) -> FrameError:
    """Return the exception for a file that ends early."""
    return FrameError(ErrorCode.TRUNCATED, path, problem, "it is truncated: copy it again")


def in_colour(path: Path, channels: int, names: str) -> FrameError:
    """Return the exception for an image with several channels."""
    remedy = "it is a colour image: convert it to one channel"
    return FrameError(ErrorCode.COLOUR, path, f"has {channels} channels ({names})", remedy)


def refuse_giant(path: Path, where: str, nx: int, ny: int) -> None:
    """Raise FrameError for a frame that is larger than any detector's.

    Parameters
    ----------
    path : Path
        The file.
    where : str
        The part of it that says so: ``"HDU 1"``.
    nx, ny : int
        Columns and rows declared.
    """
    if nx * ny > MOST_PIXELS:
        problem = f"{where} declares a frame of {nx} x {ny} pixels, more than any detector has"
        raise FrameError(ErrorCode.TOO_LARGE, path, problem, "cut it into parts")


def unpacks_believably(declared: int, pixels: int, stored: int) -> bool:
    """Tell whether a compressed image may be what it says.

    Parameters
    ----------
    declared : int
        Bytes it is to unpack to.
    pixels : int
        Of one frame.
    stored : int
        Bytes it takes.
    """
    return max(declared, pixels) <= max(SMALL, LIKELY_PACKING * stored)
