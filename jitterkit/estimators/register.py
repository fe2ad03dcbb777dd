"""Where the pair of a frame is, by the first one: a cut-out about it, moved onto the first one's.

For use within a compiled program.
"""

from __future__ import annotations

from functools import partial

import jax
import jax.numpy as jnp
import numpy as np

from jitterkit.estimators.first import First
from jitterkit.likelihood import Data
from jitterkit.precision import single

__all__ = ["at_first", "cut_out"]

_AROUND = 1.5
"""Pixels, 1 sigma, of what stands in for pixels that are not used, to find the pair by."""


def cut_out(first: First, data: Data):
    """Cut a frame out about its pair.

    Parameters
    ----------
    first : First
    data : Data
        Of a whole frame (ny, nx), in 32 bits.

    Returns
    -------
    cut : Data
        (my, mx), of the size of the first frame's cut-out.
    near : (my, mx) array
        The first frame's image [e-], moved by whole pixels to where the pair is.
    corner : (2,) int array
        First pixel ``(y, x)`` of the cut-out.
    shift : (2,) array
        How far ``(y, x)`` [pixels] the pair is in it from where the first frame has it, to about a tenth.
    """
    whole = jax.lax.cond(jnp.all(data.used), lambda data: data.electrons, _without_holes, data)
    match = jnp.fft.irfft2(jnp.fft.rfft2(whole) * first.matched, s=whole.shape)
    row = jnp.argmax(jnp.max(match, axis=1))  # and then within it: a fourth of the time of both at once
    column = jnp.argmax(match[row])
    shift = jnp.stack([_peak(match[:, column], row), _peak(match[row], column)])
    steps, shape = jnp.round(shift).astype(int), first.otf.grid.shape
    corner = jnp.clip(first.corner + steps, 0, np.subtract(match.shape, shape))
    cut = partial(jax.lax.dynamic_slice, start_indices=corner, slice_sizes=shape)
    near = cut(jnp.roll(first.whole, steps, (0, 1)))
    return jax.tree.map(cut, data), near, corner, shift - (corner - first.corner)


def _without_holes(data: Data):
    """Electrons, and where pixels are not used a mean of those around: a star with a full core has a core."""
    fy, fx = np.fft.fftfreq(data.used.shape[0])[:, None], np.fft.rfftfreq(data.used.shape[1])[None]
    soft = single(np.exp(-2 * (np.pi * _AROUND) ** 2 * (fy**2 + fx**2)))
    both = jnp.stack([jnp.where(data.used, data.electrons, 0.0), data.used.astype(data.electrons.dtype)])
    light, share = jnp.fft.irfft2(jnp.fft.rfft2(both) * soft, s=data.used.shape)
    return jnp.where(data.used, data.electrons, light / jnp.maximum(share, 1e-3))


def _peak(values, place):
    """Where a periodic row is highest, by a parabola through three values; negative in its far half."""
    size = len(values)
    left, middle, right = (values[(place + step) % size] for step in (-1, 0, 1))
    bend = left - 2 * middle + right
    vertex = jnp.where(bend < 0, 0.5 * (left - right) / bend, 0.0)
    return (place + size // 2) % size - size // 2 + jnp.clip(vertex, -0.5, 0.5)


def at_first(data: Data, near, shift):
    """Move a cut-out onto the first frame's.

    Parameters
    ----------
    data : Data
    near : (my, mx) array
        Stands in for pixels that are not used.
    shift : (2,) array
        ``(y, x)`` [pixels]; these three as :func:`cut_out` gives them.

    Returns
    -------
    seen : (my, mx) array
        With the pair where the first frame has it, and as much light; in 32 bits.
    light : float
        How many times as much light it had.
    """
    light = jnp.sum(jnp.where(data.used, data.electrons, 0.0)) / jnp.sum(jnp.where(data.used, near, 0.0))
    counts = jnp.where(data.used, data.electrons, light * near)
    fy, fx = np.fft.fftfreq(counts.shape[0])[:, None], np.fft.rfftfreq(counts.shape[1])[None]
    turn = single(jnp.exp(2j * np.pi * fy * shift[0]) @ jnp.exp(2j * np.pi * fx * shift[1]))
    return jnp.fft.irfft2(jnp.fft.rfft2(single(counts / light)) * turn, s=counts.shape), light
