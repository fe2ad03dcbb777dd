"""What a TIFF cannot say about itself: a TOML beside the image.

``image.toml`` beside ``image.tif`` holds for that file, ``frames.toml`` for every TIFF of its
directory that has nothing better::

    exposure = 0.5        # s
    gain = 3.7            # e-/ADU
    read_noise = 2.4      # e-
    saturation = 4095     # ADU
    bias = 100            # ADU
    plate_scale = 0.375   # arcsec/pixel
    plate_scale_err = 1e-5    # relative
    va_factor = 1.00007   # velocity aberration
    orbit_change = 0.0021 # arcsec, since the reference epoch
    line_time = 15e-6     # s, from one stored row to the next
    time = "2026-11-21T03:00:00"
    unit = "adu"

The keys stand at the top or in a table ``[frame]``.  A table ``[truth]`` is for simulations and is
not read.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Mapping
from datetime import date, datetime
from pathlib import Path
from typing import Any

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.frames.files import damage_code
from jitterkit.frames.metadata import FIELDS, Metadata

FOLDER_FILE = "frames.toml"
NOT_READ = "truth"


def sidecar_path(path: Path) -> Path:
    """Return where the TOML of an image lies: the same stem, ``.toml``."""
    return path.with_suffix(".toml")


def read_sidecars(path: Path) -> Metadata:
    """Read the TOML beside an image and the one of its directory; the former wins key by key.

    Raises
    ------
    ConfigurationError
        If one is not TOML, or has an unknown key or an unbelievable value; the message names the
        file, the key and the keys allowed.
    """
    metadata = Metadata()
    for file in (sidecar_path(path), path.with_name(FOLDER_FILE)):
        if file.is_file():
            metadata = metadata.fill(f"sidecar {file.name}", **_read(file))
    return metadata


def sidecar_text(metadata: Mapping[str, Any]) -> str:
    """Return the TOML of a sidecar; None values are left out.

    Raises
    ------
    ConfigurationError
        If a key is unknown or a value unbelievable.
    """
    values = {k: v for k, v in metadata.items() if v is not None and k != NOT_READ}
    _refuse_unknown("the metadata", values)
    Metadata().override("sidecar", **values)
    lines = [f"{key} = {_toml(value)}" for key, value in values.items()]
    truth = {json.dumps(str(k)): v for k, v in (metadata.get(NOT_READ) or {}).items() if v is not None}
    return "\n".join([*lines, toml_text({NOT_READ: truth} if truth else {})])


def toml_text(tables: Mapping[str, Mapping[str, Any]], *comments: str) -> str:
    """Return comments and tables as TOML: texts, numbers, and lists of them."""
    lines = [f"# {comment}" for comment in comments]
    for name, values in tables.items():
        lines += ["", f"[{name}]", *(f"{key} = {_toml(value)}" for key, value in values.items())]
    return "\n".join(lines) + "\n"


def _read(file: Path) -> dict[str, Any]:
    try:
        table = tomllib.loads(file.read_text(encoding="utf-8-sig"))
    except (tomllib.TOMLDecodeError, UnicodeDecodeError, OSError) as error:
        code = damage_code(error, file) if isinstance(error, OSError) else ErrorCode.MALFORMED
        raise ConfigurationError(code, f"{file}: is not readable as TOML ({error}); correct it.") from error
    table.pop(NOT_READ, None)
    frame = table.pop("frame", {})
    values = {**table, **(frame if isinstance(frame, dict) else {"frame": frame})}
    _refuse_unknown(str(file), values)
    values = {k: v.isoformat() if isinstance(v, date | datetime) else v for k, v in values.items()}
    try:
        Metadata().override("sidecar", **values)
    except ConfigurationError as error:
        raise ConfigurationError(error.code, f"{file}: {error}") from None
    return values


def _refuse_unknown(where: str, values: Mapping[str, Any]) -> None:
    for key in values:
        if key not in FIELDS:
            problem = f"{where}: the key {key!r} is unknown"
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, f"{problem}; use {', '.join(FIELDS)}.")


def _toml(value: Any) -> str:
    value = value.item() if hasattr(value, "item") else value
    if isinstance(value, float):
        return repr(value)
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(_toml, value))}]"
    return json.dumps(value if isinstance(value, int) else str(value), ensure_ascii=False)
