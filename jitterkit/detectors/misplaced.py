"""Whether the maps of a detector are of the pixels of a frame."""

from __future__ import annotations

from jitterkit.detectors.characteristics import Characteristics
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames.frame import RawFrame
from jitterkit.frames.window import beginning, contradiction, said


def misplaced(raw: RawFrame, detector: Characteristics) -> list[str]:
    """Return warnings of maps that may be of other pixels than those of a frame.

    Parameters
    ----------
    raw : RawFrame
        As it was read, with all its pixels.
    detector : Characteristics

    Returns
    -------
    warnings : list of str
        Of another size, of another row order, and of a window of which only one of the two headers speaks.

    Raises
    ------
    FrameError
        If both headers say which part of the detector they are, and these differ: its code is
        ``WRONG_INSTRUMENT``.
    """
    found, whole, own = [], detector.map_shape, raw.metadata.window
    for name, window in detector.map_windows.items():
        if key := contradiction(own, window):
            problem = f"is another part of the detector ({said(own, key)}) than the map {name}"
            remedy = "cut the maps to the window of the frame"
            problem += f" ({said(window, key)})"
            raise FrameError(ErrorCode.WRONG_INSTRUMENT, raw.path or raw.name, problem, remedy)
        for who, one, other in (("frame", own, window), ("map", window, own)):
            if not one.keys() & other.keys() and (key := beginning(one)):
                which = f"the {who} is a part of the detector ({said(one, key)})"
                silent = f"the map {name}" if who == "frame" else "the frame"
                found.append(f"{which} and {silent} does not say so: they are taken for the same part")
    if whole is not None and whole != raw.shape:
        sizes = [f"{nx} x {ny}" for ny, nx in (raw.shape, whole)]
        unlike = f"the frame has {sizes[0]} pixels and the maps of the detector {sizes[1]}: their first"
        remedy = "cut them to the window of the frames if it begins elsewhere"
        found.append(f"{unlike} column and row are taken for its own; {remedy}")
    if any(order != raw.metadata.row_order for order in detector.map_orders):
        turned = "of the frame and a map of the detector, one is from a file that begins with the top row"
        found.append(f"{turned}: write ROWORDER (BOTTOM-UP or TOP-DOWN) into the map, as FITS")
    return found
