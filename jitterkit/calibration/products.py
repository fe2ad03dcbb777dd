"""What a calibration leaves behind: maps, and an instrument file that names them.

Reach for :func:`write_calibration` within :func:`together`, so that a directory has all of it or nothing.
"""

from __future__ import annotations

import os
import shutil
import tomllib
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from tempfile import mkdtemp
from typing import Any

import numpy as np

from jitterkit.calibration.calibration import FLAGS, Calibration
from jitterkit.calibration.master import MeasuredMap
from jitterkit.errors import ErrorCode, FrameError
from jitterkit.frames import write_fits
from jitterkit.frames.sidecar import toml_text

BAD_PIXELS, DETECTOR = "bad_pixels.fits", "detector.toml"
FILES = ("bias.fits", "read_noise.fits", "dark_current.fits", "flat.fits", BAD_PIXELS, DETECTOR)
"""Names of what :func:`write_calibration` may write."""

_DIGITS = 7
"""Significant digits of a number in the instrument file: more than anything is known to."""

_ROWS = {"ROWORDER": ("BOTTOM-UP", "row index upwards, as frames are read")}

_FILE_KEYS = {"pupil", "file", "bias", "read_noise", "dark_current", "flat", "bad_pixels"}
"""Keys of an instrument file whose texts are names of files beside it."""


@contextmanager
def together(directory: Path) -> Iterator[Path]:
    """Give a hidden directory within ``directory``; what is in it moves out if the block succeeds.

    Files of the same names are replaced.  If the block fails, nothing is left behind.

    Raises
    ------
    FrameError
        If the directory cannot be written.
    """
    temporary = None
    try:
        directory.mkdir(parents=True, exist_ok=True)
        temporary = Path(mkdtemp(prefix=".calibration-", dir=directory))
        yield temporary
        for path in sorted(temporary.iterdir()):
            os.replace(path, directory / path.name)
    except OSError as error:
        problem = f"cannot be written ({error.strerror or error})"
        remedy = "check the directory and its permissions"
        raise FrameError(ErrorCode.NOT_WRITABLE, directory, problem, remedy) from error
    finally:
        if temporary is not None:
            shutil.rmtree(temporary, ignore_errors=True)


def write_calibration(
    calibration: Calibration,
    directory: Path,
    instrument: str,
    *,
    full_well: float | None = None,
    gain: float | None = None,
    cards: Mapping[str, str] | None = None,
) -> None:
    """Write maps as FITS and the instrument file that names them.

    Parameters
    ----------
    calibration : Calibration
    directory : Path
        That there is.
    instrument : str
        What the detector is set into: the name of a preset, which becomes the file's ``base``, or an
        instrument file, whose tables are copied.
    full_well : float, optional
        e-, of that instrument; a law of non-linearity must hold up to it, or only to the brightest level.
    gain : float, optional
        e-/ADU, of that instrument; another one, by which electrons were counted here, is written.
    cards : mapping, optional
        What the frames' headers say of the part of the detector that they are; the maps say it too.

    Notes
    -----
    A map that knows its pixels worse than they differ is written, but the instrument file takes the number.
    Errors of a typical pixel are in the headers.
    """
    placed = {**_ROWS, **(cards or {})}
    for measured in calibration.maps:
        path, header = directory / f"{measured.name}.fits", _cards(measured, calibration)
        write_fits(path, _pixels(measured), header={**header, **placed})
    bits = {name.upper(): (bit, f"bit of pixels that are {name}") for name, bit in FLAGS.items()}
    write_fits(directory / BAD_PIXELS, calibration.bad, header={**bits, **placed})
    tables = _tables(instrument)
    tables["detector"] = {**tables.get("detector", {}), **_detector(calibration, full_well, gain)}
    text = toml_text(tables, "Written by jitterkit calibrate; files are looked for beside this one.")
    (directory / DETECTOR).write_text(text, encoding="utf-8")


def _pixels(measured: MeasuredMap) -> np.ndarray:
    # no detector has less than no dark current, whatever noise says
    values = measured.values if measured.name == "bias" else np.maximum(measured.values, 0.0)
    return values.astype(np.float32)


def _cards(measured: MeasuredMap, calibration: Calibration) -> dict[str, Any]:
    unit = measured.unit or "relative"
    return {
        "QUANTITY": (measured.name, "what the pixels are"),
        "QUNIT": (unit, "unit of the pixels"),
        "NFRAMES": (measured.frames, "frames it was made of"),
        "MEAN": (measured.number, f"of the good pixels [{unit}]"),
        "MEANERR": (measured.number_error, f"standard error of MEAN [{unit}]"),
        "PIXERR": (measured.error, f"standard error of a typical pixel [{unit}]"),
        "SPREAD": (measured.true_spread, f"of the pixels, without the errors [{unit}]"),
        "GAINUSED": (calibration.gain, "e-/ADU"),
    }


def _detector(calibration: Calibration, full_well: float | None, gain: float | None) -> dict[str, Any]:
    """Return the table of the detector: what was measured, and the gain by which it was."""
    known = calibration.transfer is None and calibration.gain == gain
    found: dict[str, Any] = {} if known else {"gain": _short(calibration.gain)}
    for measured in calibration.maps:
        if measured.serves:
            found[measured.name] = f"{measured.name}.fits"
        elif measured.name != "flat":  # whose number is one
            number = measured.number
            found[measured.name] = _short(number if measured.name == "bias" else max(number, 0.0))
    found["bad_pixels"] = BAD_PIXELS
    transfer = calibration.transfer
    if transfer is None:
        return found
    if transfer.saturation is not None and calibration.bias is not None:
        found["saturation"] = float(np.floor(transfer.saturation + calibration.bias.number))
    if transfer.full_well is not None:
        found["full_well"] = _short(transfer.full_well)
    if transfer.coupling:
        found["coupling"] = _short(transfer.coupling)
    if transfer.linearity is not None and transfer.linearity.coefficients:
        found["nonlinearity"] = [_short(c) for c in transfer.linearity.in_electrons(transfer.gain)[0]]
        well = transfer.full_well or full_well
        if well is None or transfer.linearity.slope(well / transfer.gain) <= 0:
            found["full_well"] = _short(max(level.signal for level in transfer.used) * transfer.gain)
    return found


def _tables(instrument: str) -> dict[str, dict[str, Any]]:
    path = Path(instrument)
    if path.suffix.lower() != ".toml" and len(path.parts) == 1:
        return {"instrument": {"name": instrument, "base": instrument}}
    tables: dict[str, dict[str, Any]] = tomllib.loads(path.read_text(encoding="utf-8"))
    tables.setdefault("instrument", {}).setdefault("name", path.stem)
    beside = path.resolve().parent
    for table in tables.values():
        for key in _FILE_KEYS & set(table):
            if isinstance(table[key], str):
                table[key] = str(beside / table[key])
    return tables


def _short(value: float) -> float:
    return float(f"{value:.{_DIGITS}g}")
