"""What a FITS header says about the planes of an image: colours, a mosaic, and which row comes first."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from jitterkit.errors import ErrorCode, FrameError

__all__ = ["refuse_colour", "rows_from_the_top"]

_FROM_TOP = ("TOP-DOWN", "TOPDOWN", "TOP_DOWN", "TOP DOWN")
_FROM_BOTTOM = ("BOTTOM-UP", "BOTTOMUP", "BOTTOM_UP", "BOTTOM UP")
_MOSAIC = ("BAYERPAT", "COLORTYP")
_NO_MOSAIC = ("", "NONE", "MONO", "MONOCHROME", "GRAY", "GREY", "L")


def _text(key: str, *headers: Mapping[str, Any] | None) -> str:
    found = (header.get(key) for header in headers if header is not None)
    return next((str(value).strip().upper() for value in found if isinstance(value, str)), "")


def refuse_colour(
    path: Path, shape: tuple[int, ...], header: Mapping[str, Any], inherit: Mapping[str, Any] | None
) -> None:
    """Raise FrameError for an image in colour, as for a TIFF.

    Parameters
    ----------
    path : Path
        The file.
    shape : tuple of int
        Of the image, slowest axis first.
    header, inherit : mapping
        Of its HDU, and of the primary one.

    Notes
    -----
    *Fails when* nothing but three planes speaks for colours: they are taken for three frames.
    """
    for axis, side in enumerate(reversed(shape), 1):
        name = _text(f"CTYPE{axis}", header)
        if side in (3, 4) and name in ("RGB", "RGBA", "COLOR", "COLOUR"):
            raise _in_colour(path, side, f"CTYPE{axis} = {name!r}")
    if len(shape) < 3 or 3 not in (shape[0], shape[-1]):
        return
    space = _text("COLORSPC", header, inherit) or _text("COLORSPACE", header, inherit)
    if space in ("RGB", "SRGB"):
        raise _in_colour(path, 3, f"COLORSPC = {space!r}")
    mosaic = _text("BAYERPAT", header, inherit)
    if mosaic not in _NO_MOSAIC:
        raise _in_colour(path, 3, f"BAYERPAT = {mosaic!r}")


def _in_colour(path: Path, channels: int, said: str) -> FrameError:
    remedy = "it is a colour image: convert it to one channel"
    return FrameError(ErrorCode.COLOUR, path, f"has {channels} channels ({said})", remedy)


def rows_from_the_top(header: Mapping[str, Any], inherit: Mapping[str, Any] | None) -> tuple[bool, list[str]]:
    """Return whether the first stored row is the top one, and what is odd about the planes.

    Parameters
    ----------
    header, inherit : mapping
        Of the image's HDU, and of the primary one.
    """
    order, odd = _text("ROWORDER", header, inherit), []
    if order not in ("", *_FROM_TOP, *_FROM_BOTTOM):
        odd.append(f"ROWORDER = {order!r} is neither TOP-DOWN nor BOTTOM-UP and is ignored")
    if any(_text(key, header, inherit) not in _NO_MOSAIC for key in _MOSAIC):
        odd.append("the header says that its pixels lie behind a colour mosaic")
    return order in _FROM_TOP, odd
