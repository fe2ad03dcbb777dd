"""Frames that speak for a run: spread over its files, and fitted."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from jitterkit.batch import FrameProcessor
from jitterkit.batch.plan import FrameReader, count_frames
from jitterkit.errors import ConfigurationError, ErrorCode, JitterkitError
from jitterkit.trade.predict import Example

_LOOKED_AT, _TRIED = 3, 12
"""Frames that a plan is made for, spread over the run, and those that are tried to find as many."""


def examples_of(
    files: Sequence[Path], processor: FrameProcessor, hdu: int | None = None
) -> tuple[list[Example], int]:
    """Fit frames spread over the files of a run, until there are enough.

    Parameters
    ----------
    files : sequence of Path
        At least one.
    processor : FrameProcessor
    hdu : int, optional
        Of FITS files.

    Returns
    -------
    examples : list of Example
        Of the frames that can be fitted, at least one.
    frames : int
        In the run, by those in the files that were looked at.

    Raises
    ------
    ConfigurationError
        If none of them can be fitted.
    """
    stride = _TRIED // _LOOKED_AT
    shares = np.linspace(0, 1, _TRIED)
    shares = np.concatenate([shares[start::stride] for start in range(stride)])  # the first are far apart
    chosen = [files[round(share * (len(files) - 1))] for share in shares]
    counts = {file: count_frames(file, hdu) for file in dict.fromkeys(chosen)}
    items = [(file, round(share * (counts[file] - 1))) for file, share in zip(chosen, shares, strict=True)]
    spread = list(dict.fromkeys(items))
    examples: list[Example] = []
    with FrameReader(hdu) as reader:
        for _, _, raw in reader.read(spread):
            example = None if isinstance(raw, JitterkitError) else Example.of(raw, processor)
            examples += [] if example is None else [example]
            if len(examples) == _LOOKED_AT:
                break
    if not examples:
        raise ConfigurationError(
            ErrorCode.TOO_FEW,
            f"None of {len(spread)} frames that were looked at can be fitted, so there is nothing to "
            "plan for; see what 'jitterkit process' without --tolerance and --budget says about them.",
        )
    return examples, round(len(files) * float(np.mean(list(counts.values()))))
