"""Numbers in 32 bits, where they serve: derivatives, which decide how to get there and not where."""

from __future__ import annotations

from typing import Any

import jax
import numpy as np

__all__ = ["in_single", "single"]

_SINGLE = {np.dtype("float64"): np.float32, np.dtype("complex128"): np.complex64}


def single(tree):
    """The numbers of a tree of arrays in 32 bits."""
    return jax.tree.map(lambda a: a.astype(in_single(a)), tree)


def in_single(array) -> Any:
    """The type of an array's numbers in 32 bits; what is no number stays as it is."""
    return _SINGLE.get(array.dtype, array.dtype)
