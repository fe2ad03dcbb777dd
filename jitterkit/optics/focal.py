"""The Fraunhofer integral from a pupil to the focal plane, as matrix products."""

from __future__ import annotations

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.conventions import offsets


def focal_field(
    pupil: Float[Array, "2 k ny nx"], phase_step: float | Float[Array, ""], shape: tuple[int, int]
) -> Float[Array, "2 k my mx"]:
    """Fraunhofer field of pupil fields on a symmetric grid of focal-plane samples.

    Parameters
    ----------
    pupil : (2, k, ny, nx) array
        Real and imaginary part of pupil fields on a grid symmetric about the optical axis.
    phase_step : float
        ``2 pi dx dt / wavelength``: pupil pitch times focal pitch [rad] in radians of phase.
    shape : (int, int)
        ``(my, mx)`` of the focal plane.

    Returns
    -------
    field : (2, k, my, mx) array
        Real and imaginary part of ``sum P exp(-i phase_step jx jt)``, without normalisation; a uniform
        pupil gives its number of samples on the axis.

    Notes
    -----
    The sign makes a wavefront tilt of ``+a x`` (OPD growing with x) move the image towards +x.

    The field at the angle t is ``E(t) = sum_x P(x) exp(-2 pi i x t / wavelength)``.  Both grids are
    symmetric about zero, so that the transform never mixes the even and the odd part of P along an
    axis: four real products of half the size replace one complex product, at a quarter of the cost
    and with the rounding of an ordinary sum.  Real and imaginary parts are kept apart throughout, because
    compilers are slow at complex numbers.
    """
    along_y = _fold(pupil, -2)
    blocks = [[_fold(half, -1)[b] for b in (0, 1)] for half in along_y]
    # cosine and sine matrices ((m+1)//2, (n+1)//2) over the first halves of both axes
    phases = [
        phase_step * np.outer(offsets(m, 1.0)[: (m + 1) // 2], offsets(n, 1.0)[: (n + 1) // 2])
        for n, m in zip(pupil.shape[-2:], shape, strict=True)
    ]
    left, right = ([of(phase).astype(pupil.dtype) for of in (jnp.cos, jnp.sin)] for phase in phases)
    # exp(-i a) exp(-i b) = (ca - i sa)(cb - i sb): the odd parts carry a factor -i each.
    even_even, even_odd, odd_even, odd_odd = (
        jnp.einsum("mj,cajk,nk->camn", left[a], blocks[a][b], right[b], precision="highest")
        for a in (0, 1)
        for b in (0, 1)  # a GPU would take half the digits
    )
    even_x = _unfold(even_even, _times_minus_i(odd_even), -2, shape[0])
    odd_x = _unfold(_times_minus_i(even_odd), -odd_odd, -2, shape[0])
    return _unfold(even_x, odd_x, -1, shape[1])


def _times_minus_i(parts):
    return jnp.stack([parts[1], -parts[0]])


def _fold(array, axis):
    """Even and odd part of an axis, on its first half (centre sample included, counted once)."""
    n = array.shape[axis]
    mirrored = jnp.flip(array, axis)
    half = [slice(None)] * array.ndim
    half[axis] = slice(0, (n + 1) // 2)
    even, odd = (array + mirrored)[tuple(half)], (array - mirrored)[tuple(half)]
    if n % 2:
        middle = list(half)
        middle[axis] = slice(n // 2, n // 2 + 1)
        even = even.at[tuple(middle)].multiply(0.5)
    return even, odd


def _unfold(even, odd, axis, n):
    """Undo the folding on the output side: the first half is even + odd, the second even - odd."""
    first, second = even + odd, jnp.flip(even - odd, axis)
    if n % 2:  # the centre sample is already in the first half
        keep = [slice(None)] * second.ndim
        keep[axis] = slice(1, None)
        second = second[tuple(keep)]
    return jnp.concatenate([first, second], axis)
