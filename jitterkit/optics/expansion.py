"""From a pupil to its transfer function and its exact derivatives, by the Fraunhofer integral."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex

from jitterkit.conventions import ARCSEC
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.optics.colours import Colours, wavenumber_offsets
from jitterkit.optics.focal import focal_field
from jitterkit.optics.grid import DEFAULT_PAD, Grid
from jitterkit.optics.otf import OTF, with_shift
from jitterkit.optics.pupil import Pupil
from jitterkit.optics.spectrum import Spectrum

__all__ = ["centring", "derivatives_at", "expand", "grid_for", "wavelength_slopes"]


def grid_for(
    pupil: Pupil,
    spectrum: Spectrum,
    shape: tuple[int, int],
    plate_scale: float,
    pad: int = DEFAULT_PAD,
) -> Grid:
    """The coarsest grid that carries a pupil's image without aliasing.

    Parameters
    ----------
    pupil : Pupil
    spectrum : Spectrum
    shape : (int, int)
        Frame, ``(ny, nx)``.
    plate_scale : float
        arcsec per pixel.
    pad : int
        Pixels of padding on each side.

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
    cutoff = _cutoff(pupil, spectrum)
    refine = max(1, int(np.ceil(2 * plate_scale * cutoff)))
    grid = Grid((shape[0], shape[1]), plate_scale, pad, refine)
    period = min(spectrum.wavelengths) * 1e-9 / pupil.pitch / ARCSEC
    width = max(grid.fine_shape) * grid.pitch
    if width > period:
        raise ConfigurationError(
            ErrorCode.SAMPLING,
            f"The padded frame is {width:.4g} arcsec wide but the image of a pupil sampled "
            f"{pupil.pitch:.3g} m apart repeats every {period:.4g} arcsec; give the pupil at least "
            f"{int(np.ceil(len(pupil.transmission) * width / period))} samples ([telescope] samples of an "
            "instrument file), or a smaller frame ([instrument] shape).",
        )
    return grid


def _cutoff(pupil: Pupil, spectrum: Spectrum) -> float:
    """Highest frequency that reaches the image, cycles/arcsec."""
    return pupil.cutoff_diameter / (min(spectrum.wavelengths) * 1e-9) * ARCSEC


def expand(
    pupil: Pupil,
    spectrum: Spectrum,
    grid: Grid,
    aberrations=None,
    *,
    derivatives: bool = True,
    colours: Colours | None = None,
) -> OTF:
    """Compute a transfer function and its derivatives about a state of the aberrations.

    Parameters
    ----------
    pupil : Pupil
    spectrum : Spectrum
    grid : Grid
        From :func:`grid_for`.
    aberrations : (k,) array, optional
        nm; zero if omitted.  What follows them, a shift of the wavelength, counts for nothing: about it an
        image is always expanded at zero.
    derivatives : bool
        Whether to compute them; without, the aberrations stay as given.
    colours : Colours, optional
        What is known of the sources' spectra; without, all have the instrument's.

    Returns
    -------
    otf : OTF
        Exact at ``aberrations``: its PSF equals the Fraunhofer integral at every fine sample.
    """
    state = jnp.zeros(len(pupil.names)) if aberrations is None else jnp.asarray(aberrations, float)
    shifts = colours is not None and colours.wavelength_err > 0
    state = state[: len(pupil.names)] if shifts else state
    if state.shape != (len(pupil.names),):
        raise ConfigurationError(
            ErrorCode.WRONG_SHAPE, f"Expected {len(pupil.names)} aberrations, got shape {state.shape}."
        )
    order, tinted = 1 if derivatives else 0, colours is not None
    spectra = derivatives_at(pupil, spectrum, grid, state, order=order, chromatic=tinted)
    otf = OTF(
        spectra[0][0],
        spectra[0][1:],
        state if derivatives else state[:0],
        grid,
        pupil.names if derivatives else (),
        chromatic=spectra[1] if tinted else None,
        colours=colours,
    )
    if not (shifts and derivatives):
        return otf
    return with_shift(otf, wavelength_slopes(pupil, spectrum, grid, state, order=0)[0], spectrum.mean)


def wavelength_slopes(
    pupil: Pupil, spectrum: Spectrum, grid: Grid, state, *, order: int
) -> Complex[Array, "p my mx"]:
    """Derivatives by a shift of the mean wavelength, per nm, of what :func:`derivatives_at` has to an order.

    Parameters
    ----------
    pupil, spectrum, grid, state
        As for :func:`derivatives_at`.
    order : int
        0 or 1.
    """
    wavelengths, weights = jnp.asarray(spectrum.wavelengths), jnp.asarray([spectrum.weights])

    def stretched(by):
        return _derivatives(pupil, wavelengths * (1 + by), weights, state, grid, order)[0]

    return jax.jvp(stretched, (0.0,), (1 / spectrum.mean,))[1]


def derivatives_at(
    pupil: Pupil, spectrum: Spectrum, grid: Grid, state, *, order: int, chromatic: bool = False
) -> Complex[Array, "c p my mx"]:
    """A transfer function at a state of the aberrations [nm], and its derivatives up to an order of 2.

    Returns
    -------
    spectra : (1 or 2, 1 + k + k (k + 1)/2, My, Mx//2 + 1) complex array
        Value; first derivatives, per nm; second derivatives of the pairs (i, j >= i) in order, per nm²: as
        many as the order asks for.  Then, if it is chromatic, the derivatives of these by the spectral index.
    """
    wavelengths, weights = np.asarray(spectrum.wavelengths), np.asarray(spectrum.weights)
    rows = [weights, weights * wavenumber_offsets(spectrum)] if chromatic else [weights]
    return _derivatives(pupil, jnp.asarray(wavelengths), jnp.asarray(rows), state, grid, order)


@eqx.filter_jit
def _derivatives(pupil, wavelengths, weights, state, grid, order):
    opd = pupil.opd + jnp.tensordot(state, pupil.basis, 1)
    phases = (2 * jnp.pi / wavelengths)[:, None, None] * opd
    # Outside the loop, or the compiler evaluates sine and cosine anew for every derivative.
    fields = pupil.transmission * jnp.stack([jnp.cos(phases), jnp.sin(phases)], axis=1)
    basis = pupil.basis if order else pupil.basis[:0]
    pairs = np.triu_indices(len(basis)) if order > 1 else np.triu_indices(0)

    def add(total, line):
        wavelength, weight, field = line
        parts = _monochromatic(field, basis, pairs, pupil.pitch, grid, wavelength)
        weight = weight[:, None, None, None]
        return [
            light + (weight * part).astype(light.dtype) for light, part in zip(total, parts, strict=True)
        ], None

    start = [
        jnp.zeros((len(weights), 1 + len(basis), *grid.fine_shape), opd.dtype),
        jnp.zeros((len(weights), len(pairs[0]), *grid.fine_shape), jnp.float32),
    ]
    lines = wavelengths, weights.T, fields
    total = jnp.concatenate(jax.lax.scan(add, start, lines)[0], axis=1)
    return jnp.fft.rfft2(total) * centring(grid) / jnp.sum(jnp.abs(pupil.transmission) ** 2)


def centring(grid: Grid) -> np.ndarray:
    """What makes a spectrum one about the optical axis: the PSF's samples are symmetric about it."""
    fy, fx = grid.frequencies
    cy, cx = ((n - 1) / 2 * grid.pitch for n in grid.fine_shape)
    return np.exp(2j * np.pi * fy * cy) * np.exp(2j * np.pi * fx * cx)


def _monochromatic(field, basis, pairs, pupil_pitch, grid, wavelength):
    """PSF of a pupil field (2, n, n) at one wavelength [nm] and its derivatives per nm: (1 + k + p, My, Mx).

    The first ones are by a basis (k, n, n) of modes, the second ones by p pairs of these.  A whole plane sums
    to the light in the pupil.
    """
    wavenumber = 2 * np.pi / wavelength
    real, imaginary = field
    slope = wavenumber * basis  # the derivative of a field is the field times i slope
    fields = jnp.stack(
        [
            jnp.concatenate([real[None], -slope * imaginary]),
            jnp.concatenate([imaginary[None], slope * real]),
        ]
    )
    phase_step = wavenumber * 1e9 * pupil_pitch * grid.pitch * ARCSEC
    focal = focal_field(fields, phase_step, grid.fine_shape)
    overlap = focal[0, :1] * focal[0] + focal[1, :1] * focal[1]
    scale = (phase_step / (2 * np.pi)) ** 2
    psf = scale * jnp.concatenate([overlap[:1], 2 * overlap[1:]])
    return psf, scale * _curvature(field, slope, pairs, focal, phase_step, grid)


def _curvature(field, slope, pairs, focal, phase_step, grid):
    """Second derivatives of the light ``|E|²`` by pairs of modes: ``2 Re(E* E_ij + E_i* E_j)``.

    In 32 bits: they count by the square of a change, a thousandth.
    """
    i, j = pairs
    slope, field, focal = (array.astype(jnp.float32) for array in (slope, field, focal))
    twice = focal_field(-slope[i] * slope[j] * field[:, None], phase_step, grid.fine_shape)
    together = sum(focal[c, :1] * twice[c] + focal[c, 1 + i] * focal[c, 1 + j] for c in (0, 1))
    return 2 * together
