"""Numbers of arrays, in 32 bits where those serve: for derivatives, which decide how to get there."""

from __future__ import annotations

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

_SINGLE = {np.dtype("float64"): np.float32, np.dtype("complex128"): np.complex64}


def real(value):
    """Return an array of real numbers.

    An array of JAX's stays one; anything else becomes one of NumPy's, with which small sums are fast.
    """
    return value.astype(float) if isinstance(value, jax.Array) else np.asarray(value, float)


def array_module(*values):
    """Return the module whose functions suit some arrays: JAX's if one is of JAX, else NumPy's."""
    return jnp if any(isinstance(value, jax.Array) for value in values) else np


def single(tree):
    """Return the numbers of a tree of arrays in 32 bits; what is no number stays as it is."""
    return jax.tree.map(lambda a: a.astype(_SINGLE.get(a.dtype, a.dtype)), tree)


def to_parts(spectra: Complex[Array, "*n my mx"]) -> Float[Array, "*n 2 my mx"]:
    """Split spectra into their real and their imaginary parts."""
    return jnp.stack([spectra.real, spectra.imag], axis=-3)


def from_parts(parts: Float[Array, "*n 2 my mx"]) -> Complex[Array, "*n my mx"]:
    """Join real and imaginary parts to spectra."""
    return jax.lax.complex(parts[..., 0, :, :], parts[..., 1, :, :])
