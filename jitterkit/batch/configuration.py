"""What a run's rows depend on, in words and numbers: kept with it, and compared when it is resumed."""

from __future__ import annotations

import enum
import hashlib
import os
import platform
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, is_dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from jitterkit.batch.processor import FrameProcessor
from jitterkit.batch.resume import FILES, VERSIONS
from jitterkit.instruments import Instrument

_PACKAGES = ("jitterkit", "jax", "jaxlib", "numpy", "scipy", "astropy", "tifffile")
_SHORT = 32
"""Numbers of an array that are given one by one; of a longer one the digest."""


def settings(processor: FrameProcessor, files: Sequence[Path], **more: Any) -> dict[str, Any]:
    """Return all that the rows of a run depend on.

    Parameters
    ----------
    processor : FrameProcessor
    files : sequence of Path
    more
        Whatever else there is, by name.

    Returns
    -------
    settings : dict
        As JSON knows it; equal for two runs whose rows are equal to the last digit on one machine.
    """
    described = _fields(processor, skip=("known",))
    zero = jnp.zeros(())
    (device,) = zero.devices()
    flags = os.environ.get("XLA_FLAGS") or None
    computed = {"device": device.platform, "numbers": str(zero.dtype), "XLA_FLAGS": flags}
    names = [str(file.absolute()) for file in files]
    return {**described, **computed, **describe(more), VERSIONS: versions(), FILES: names}


def versions() -> dict[str, str]:
    """Return the versions of what computes."""
    known = {"python": platform.python_version()}
    for name in _PACKAGES:
        with suppress(PackageNotFoundError):
            known[name] = version(name)
    return known


def describe(value: Any) -> Any:
    """Return a value as JSON knows it: records by their fields, long arrays by their digest."""
    if value is None or isinstance(value, bool | int | float | str):
        return value
    if isinstance(value, Instrument):  # its pupil and PSF may be functions that make them
        optics = {"pupil": describe(value.pupil), "psf": describe(value.psf)}
        return _fields(value, skip=("pupil_from", "psf_from")) | optics
    if isinstance(value, enum.Enum):
        return value.name
    if is_dataclass(value):
        return _fields(value)
    if isinstance(value, Mapping):
        return {str(key): describe(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [describe(item) for item in value]
    if isinstance(value, set | frozenset):
        return sorted(map(describe, value), key=str)
    if isinstance(value, np.ndarray | np.generic | jax.Array):
        array = np.asarray(value)
        if array.size <= _SHORT:
            return array.tolist()
        digest = hashlib.sha256(np.ascontiguousarray(array).tobytes()).hexdigest()[:16]
        return f"{array.dtype} {list(array.shape)} {digest}"
    return str(value)


def _fields(value: Any, skip: Sequence[str] = ()) -> dict[str, Any]:
    names = (f.name for f in fields(value) if not f.name.startswith("_") and f.name not in skip)
    return {name: describe(getattr(value, name)) for name in names}
