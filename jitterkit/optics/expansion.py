"""From a pupil to its exact transfer function and derivatives (:mod:`~jitterkit.optics.focal`)."""

from __future__ import annotations

from dataclasses import replace
from functools import partial

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from jitterkit.conventions import ARCSEC
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.colours import WAVELENGTH, Colours, wavenumber_offsets
from jitterkit.optics.focal import focal_field
from jitterkit.optics.further import Further, with_further
from jitterkit.optics.grid import DEFAULT_PAD, Grid
from jitterkit.optics.otf import OTF
from jitterkit.optics.pupil import Pupil
from jitterkit.optics.spectrum import Spectrum
from jitterkit.precision import single, to_parts

_MOST_SAMPLES = 4096
"""A pupil that needs more takes gigabytes, and has its diameter in another unit."""

_DEPENDENT = 1e-10
"""Eigenvalue, of the largest, below which products of modes count as sums of others: errors of 1e-5."""

_SHIFT = {64: (0.005, 0.025), 32: (0.5, 0.5)}
"""Change of the scale of an image, for differences of transfer functions and of their derivatives, in fine
samples along its side, by the bits of a number; derivatives have 32.  Of the largest, in 64 bits, differences
of transfer functions are right to 5e-7, second ones to 1.4e-6 and those of derivatives to 6e-4 (TOLIMAN, a
small telescope, 18 hexagons); in 32 bits to 4e-4, second ones to 4 % (the small telescope)."""


def grid_for(
    pupil: Pupil,
    spectrum: Spectrum,
    shape: tuple[int, int],
    plate_scale: float,
    pad: int | None = None,
) -> Grid:
    """Return the coarsest grid that carries a pupil's image without aliasing.

    Parameters
    ----------
    pupil : Pupil
    spectrum : Spectrum
    shape : (int, int)
        Frame, ``(ny, nx)``.
    plate_scale : float
        arcsec per pixel.
    pad : int, optional
        Pixels of padding on each side; by default :data:`~jitterkit.optics.DEFAULT_PAD` fine samples, or half
        of the frame (no star's light wraps around then) up to as many pixels.

    Returns
    -------
    grid : Grid
        Refined by one where the detector samples the optics (TOLIMAN: cutoff 1.14, Nyquist 1.33
        cycles/arcsec), by an integer where it undersamples them.

    Raises
    ------
    ConfigurationError
        If the padded frame is wider than the pupil's own sampling allows: beyond
        ``wavelength / pitch`` the image of a sampled pupil repeats itself.
    """
    shortest = min(spectrum.wavelengths) * 1e-9
    cutoff = pupil.cutoff_diameter / shortest * ARCSEC  # cycles/arcsec that reach the image
    refine = max(1, int(np.ceil(2 * plate_scale * cutoff)))
    pad = max(-(-DEFAULT_PAD // refine), min(DEFAULT_PAD, -(-max(shape) // 2))) if pad is None else pad
    grid = Grid((shape[0], shape[1]), plate_scale, pad, refine)
    period = shortest / pupil.pitch / ARCSEC
    width = max(grid.fine_shape) * grid.pitch
    if width > period:
        samples = int(np.ceil(len(pupil.transmission) * width / period))
        remedy = (
            f"give the pupil at least {samples} samples ([telescope] samples of an instrument file)"
            if samples <= _MOST_SAMPLES
            else f"check units (its diameter is {pupil.diameter:g} m, a pixel {plate_scale:g} arcsec)"
        )
        problem = f"The padded frame is {width:.4g} arcsec wide but the image of a pupil sampled "
        problem += f"{pupil.pitch:.3g} m apart repeats every {period:.4g} arcsec"
        remedy += ", or give a smaller frame ([instrument] shape)"
        raise ConfigurationError(ErrorCode.SAMPLING, f"{problem}; {remedy}.")
    return grid


def expand(
    pupil: Pupil,
    spectrum: Spectrum,
    grid: Grid,
    aberrations=None,
    *,
    derivatives: bool = True,
    colours: Colours | None = None,
    further: Further | None = None,
) -> OTF:
    """Compute a transfer function and its derivatives about a state of the aberrations.

    Parameters
    ----------
    pupil : Pupil
    spectrum : Spectrum
    grid : Grid
        From :func:`grid_for`.
    aberrations : (k,) array, optional
        nm; zero if omitted.  What follows the modes of the pupil may be left out.  Shifts of wavelength and
        plate scale count for nothing: about them an image is always expanded at zero.
    derivatives : bool
        Whether to compute them; without, the aberrations stay as given.
    colours : Colours, optional
        What is known of the sources' spectra; without, all have the instrument's.
    further : Further, optional
        What else may vary.

    Returns
    -------
    otf : OTF
        Exact at ``aberrations``: its PSF equals the Fraunhofer integral at every fine sample.  Derivatives by
        anything but the colour are right to 1e-6 of the largest.
    """
    further = further or Further(len(pupil.shading))
    every = np.zeros(len(pupil.basis)) if aberrations is None else aberrations
    state, beside = map(jnp.asarray, further.split(every, len(pupil.names)))
    order, tinted = 1 if derivatives else 0, colours is not None
    value, slopes, tints = _split(derivatives_at(pupil, spectrum, grid, state, order=order, chromatic=tinted))
    otf = OTF(
        value,
        slopes,
        state if derivatives else state[:0],
        grid,
        pupil.names if derivatives else (),
        tints=tints,
        colours=colours,
        sigmas=further.sigmas[: further.shadings] if derivatives else (),
    )
    if not further.names:
        return otf
    of_b = None
    if further.of_b:
        there = state.at[np.array([pupil.names.index(name) for name in further.of_b])].add(beside)
        of_b = derivatives_at(pupil, spectrum, grid, there, order=0)[0, 0]
    if not derivatives:
        return otf if of_b is None else replace(otf, difference=of_b - otf.value)
    pairs = shifted(pupil, spectrum, grid, state, further, order=0, chromatic=tinted)
    slopes, bends = _differences(pairs, otf.value, 1 + tinted)
    bend = bends[0] if WAVELENGTH in further.names else None
    return with_further(otf, further, slopes, bend, beside, of_b)


@jax.jit
def _split(spectra):
    """Return the value of :func:`derivatives_at`, and the parts of its derivatives by modes and by colour."""
    return spectra[0, 0], to_parts(spectra[0, 1:]), to_parts(spectra[1]) if len(spectra) > 1 else None


@partial(jax.jit, static_argnums=2)
def _differences(pairs, value, count):
    """Return first derivatives (count, s, 2, m) by the shifts, and second ones (m) of the value."""
    slopes = [to_parts((ahead - behind)[:, 0] / (2 * step)) for ahead, behind, step in pairs]
    bends = [(ahead[0, 0] - 2 * value + behind[0, 0]) / step**2 for ahead, behind, step in pairs]
    none = jnp.zeros((count, 0, 2, *value.shape), value.real.dtype)
    return jnp.stack(slopes, axis=1) if slopes else none, bends


def shifted(
    pupil: Pupil,
    spectrum: Spectrum,
    grid: Grid,
    state,
    further: Further,
    *,
    order: int,
    chromatic: bool = False,
) -> list[tuple[Array, Array, np.ndarray]]:
    """Return what :func:`derivatives_at` has, a step ahead and a step behind along each shift there is.

    Differences take two fifths of the time of derivatives by the chain rule.

    Parameters
    ----------
    pupil, spectrum, grid, state, order, chromatic
        As for :func:`derivatives_at`.
    further : Further
        Which of the shifts of wavelength and plate scale there are.

    Returns
    -------
    pairs : list of (array, array, float)
        Spectra ahead and behind, of the shape that :func:`derivatives_at` returns, and the step: nm, or a
        share.
    """
    pairs = []
    for longer, wider in further.directions:
        size = _SHIFT[np.finfo(jnp.result_type(float)).bits][order] / max(grid.fine_shape)
        step = np.asarray(size * (spectrum.mean if longer else 1.0))
        ahead, behind = (
            derivatives_at(pupil, spectrum, grid, state, order=order, chromatic=chromatic, shifts=shifts)
            for shifts in ((step * longer, step * wider), (-step * longer, -step * wider))
        )
        pairs.append((ahead, behind, step))
    return pairs


def derivatives_at(
    pupil: Pupil,
    spectrum: Spectrum,
    grid: Grid,
    state,
    *,
    order: int,
    chromatic: bool = False,
    shifts: tuple[float | np.ndarray, float | np.ndarray] = (0.0, 0.0),
) -> Complex[Array, "c p my mx"]:
    """Return a transfer function at a state of the aberrations [nm], and its derivatives up to an order of 2.

    All wavelengths may be shifted [nm], and the pitch of the grid by a share.

    Returns
    -------
    spectra : (1 or 2, 1 + k + k (k + 1)/2, My, Mx//2 + 1) complex array
        Value; first derivatives, per nm; second derivatives of the pairs (i, j >= i) in order, per nm²: as
        many as the order asks for.  Then, if it is chromatic, the derivatives of these by the spectral index.
    """
    products = _products_of_modes(pupil) if order > 1 else None
    lines, stretch = np.asarray(spectrum.wavelengths) + shifts[0], np.asarray(1.0 + shifts[1])
    weights = np.asarray(spectrum.weights)[None]
    if chromatic:  # and their derivatives by a spectral index
        weights = np.concatenate([weights, weights * wavenumber_offsets(spectrum)])
    return _derivatives(pupil, lines, weights, state, grid, order, stretch, products)


def _products_of_modes(pupil: Pupil) -> tuple[np.ndarray, dict[int, np.ndarray]]:
    """Products of all pairs of modes by the few that are independent: of Zernike modes about a third.

    Returns
    -------
    products : (q, n, n) array
    shares : dict of (p, q) array
        Of the products in each pair (i, j >= i), by how many of the two are modes of the phase: zero in the
        rows of other pairs.
    """
    modes, count = np.concatenate([pupil.basis, pupil.shading]), len(pupil.basis)
    i, j = np.triu_indices(len(modes))
    lit = np.asarray(pupil.transmission) > 0
    flat = modes[:, lit][i] * modes[:, lit][j]
    sizes = np.linalg.norm(flat, axis=1)
    flat /= np.where(sizes > 0, sizes, 1.0)[:, None]  # modes of two segments have no product
    values, vectors = np.linalg.eigh(flat @ flat.T)
    kept = vectors[:, values > _DEPENDENT * values.max(initial=0.0)]
    products = np.zeros((kept.shape[1], *lit.shape))
    products[:, lit] = kept.T @ flat
    of_phase = (i < count).astype(int) + (j < count)
    rows = {power: np.where(of_phase == power, sizes, 0.0)[:, None] for power in np.unique(of_phase).tolist()}
    return products, {power: size * kept for power, size in rows.items()}


@eqx.filter_jit
def _derivatives(pupil, wavelengths, weights, state, grid, order, stretch, products):
    count, kind = len(pupil.basis), pupil.opd.dtype
    opd = pupil.opd + jnp.tensordot(state[:count], pupil.basis, 1)
    light = pupil.transmission * jnp.exp(jnp.tensordot(state[count:], pupil.shading, 1))
    phases = (2 * jnp.pi / wavelengths)[:, None, None] * opd
    # Outside the loop, or the compiler evaluates sine and cosine again for every derivative.
    fields = (light * jnp.stack([jnp.cos(phases), jnp.sin(phases)], axis=1)).astype(kind)
    modes = len(state) if order else 0
    products, shares = products or (None, {})
    pairs = modes * (modes + 1) // 2 if shares else 0
    bent = len(shares) * len(products) if shares else 0

    def add(total, line):
        wavelength, weight, field = line
        parts = _monochromatic(field, pupil, modes, products, shares, grid, wavelength, stretch)
        weight = weight[:, None, None, None]
        return [
            light + (weight * part).astype(light.dtype) for light, part in zip(total, parts, strict=True)
        ], None

    sizes = (1, kind), (modes, jnp.float32), (pairs, jnp.float32), (bent, jnp.float32)
    start = [jnp.zeros((len(weights), size, *grid.fine_shape), dtype) for size, dtype in sizes]
    (value, first, crossed, bends), _ = jax.lax.scan(add, start, (wavelengths, weights.T, fields))
    for share, bend in zip(shares.values(), jnp.split(bends, max(len(shares), 1), axis=1), strict=False):
        crossed += jnp.einsum("pq,cqyx->cpyx", share.astype(jnp.float32), bend, precision="highest")
    totals = value, first, crossed
    spectra = jnp.concatenate([jnp.fft.rfft2(total) for total in totals], axis=1)
    return spectra * grid.centring / pupil.light


def _monochromatic(field, pupil, modes, products, shares, grid, wavelength, stretch):
    """PSF of a pupil field (2, n, n) at a wavelength [nm], and parts of its derivatives: (n, My, Mx) each.

    First derivatives by modes; of the second ones by pairs of modes, the part ``2 Re(E_i* E_j)``; and what
    their other part, ``2 Re(E* E_ij)``, sums up with the shares of a pair in each product of modes.  These
    are in 32 bits.  A whole plane sums to the light in the pupil.  The pitch of the grid is stretched.
    """
    wavenumber = 2 * np.pi / wavelength
    phase_step = wavenumber * 1e9 * pupil.pitch * grid.pitch * ARCSEC * stretch
    focal = focal_field(field[:, None], phase_step, grid.fine_shape)
    psf = focal[0] ** 2 + focal[1] ** 2
    # derivatives of the logarithm of the field by every mode: real and imaginary parts (2, k, n, n)
    phases, light = jnp.zeros_like(pupil.basis), jnp.zeros_like(pupil.shading)
    slopes = jnp.stack(
        [jnp.concatenate([phases, pupil.shading]), jnp.concatenate([wavenumber * pupil.basis, light])]
    )
    slopes, field, focal, products = single((slopes[:, :modes], field, focal, products))
    real = slopes[0] * field[0] - slopes[1] * field[1]
    imaginary = slopes[0] * field[1] + slopes[1] * field[0]
    changed = focal_field(jnp.stack([real, imaginary]), phase_step, grid.fine_shape)
    parts = [psf, 2 * (focal[0] * changed[0] + focal[1] * changed[1])]
    i, j = np.triu_indices(modes if shares else 0)
    parts.append(2 * sum(changed[c, i] * changed[c, j] for c in (0, 1)))
    bends = [jnp.zeros((0, *psf.shape[-2:]))]
    if shares:
        twice = focal_field(products * field[:, None], phase_step, grid.fine_shape)
        real = 2 * (focal[0] * twice[0] + focal[1] * twice[1])
        turned = 2 * (focal[1] * twice[0] - focal[0] * twice[1])  # by a quarter, for one mode of the phase
        by_power = {0: real, 1: wavenumber * turned, 2: -(wavenumber**2) * real}
        bends = [by_power[power] for power in shares]
    scale = (phase_step / (2 * np.pi)) ** 2
    return [scale * part for part in (*parts, jnp.concatenate(bends))]
