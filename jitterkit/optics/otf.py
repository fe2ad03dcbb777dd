"""The optics as the detector meets them: a polychromatic transfer function on the frame's grid.

The image of a point source is band-limited: no frequency above ``diameter / wavelength`` reaches
the focal plane.  Sampled at least twice as finely, its transfer function is therefore the whole
truth about the optics, and everything that follows (diffused charge, pixels, jitter, stars) multiplies it.

:func:`expand` computes an :class:`OTF` from a pupil, with its exact derivatives with respect to the
aberrations; :meth:`OTF.at` uses them for small changes.  A fit expands again where it has moved, so
that its fixed point is exact.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float

from jitterkit.conventions import ARCSEC
from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci.mvn import Mvn
from jitterkit.optics.colours import WAVELENGTH, Colours, tilts
from jitterkit.optics.focal import focal_field
from jitterkit.optics.grid import DEFAULT_PAD, Grid
from jitterkit.optics.pupil import Pupil
from jitterkit.optics.spectrum import Spectrum

if TYPE_CHECKING:
    from jitterkit.scene import Scene

__all__ = ["OTF", "centring", "derivatives_at", "expand", "grid_for", "wavelength_slopes", "with_shift"]


_BLIND = 1e-9
"""Change of the transfer function per nm up to which an aberration does not show."""


class OTF(eqx.Module):
    """A telescope's transfer function about one state of its aberrations.

    Attributes
    ----------
    value : (My, Mx//2 + 1) complex array
        Transfer function about the optical axis; at zero frequency, the share of the light that
        falls inside the padded grid.
    jacobian : (k, My, Mx//2 + 1) complex array
        Derivative with respect to each aberration, per nm.
    state : (k,) array
        The aberrations it was computed at, nm.
    grid : Grid
        Sampling.
    names : tuple of str
        Names of the aberrations; then that of the shift of the wavelength, if it may vary.
    pixel_included : bool
        True for an empirical PSF, which has already been integrated over the pixels.
    chromatic : (1 + k, My, Mx//2 + 1) complex array or None
        Derivative by the spectral index of a source, and its own derivatives with respect to the
        aberrations; None where the colour of a source does not matter.
    colours : Colours or None
        What is known of the indices.
    wavelength_sigma : float
        Standard deviation of the shift of the wavelength, nm.
    """

    value: Complex[Array, "my mx"]
    jacobian: Complex[Array, "k my mx"]
    state: Float[Array, " k"]
    grid: Grid = eqx.field(static=True)
    names: tuple[str, ...] = eqx.field(static=True)
    pixel_included: bool = eqx.field(static=True, default=False)
    chromatic: Complex[Array, "k1 my mx"] | None = None
    colours: Colours | None = eqx.field(static=True, default=None)
    wavelength_sigma: float = eqx.field(static=True, default=np.inf)

    @property
    def shifts(self) -> bool:
        """Whether the wavelength may vary: the last of the names, which a frame's parameters may lack."""
        return self.names[-1:] == (WAVELENGTH,)

    def at(self, aberrations: Float[Array, " k"]) -> Complex[Array, "my mx"]:
        """Transfer function at nearby aberrations [nm], to first order about ``state``.

        The error is second order: 5 nm from the state it shows in a bright frame, so expand anew.
        """
        if not self.names:
            return self.value
        n = len(aberrations)
        return self.value + jnp.tensordot(aberrations - self.state[:n], self.jacobian[:n], 1)

    def chromatic_at(self, aberrations: Float[Array, " k"]) -> Complex[Array, "my mx"]:
        """Derivative by the spectral index at nearby aberrations [nm], to first order about ``state``."""
        assert self.chromatic is not None
        if not self.names:
            return self.chromatic[0]
        n = len(aberrations)
        return self.chromatic[0] + jnp.tensordot(aberrations - self.state[:n], self.chromatic[1 : 1 + n], 1)

    def colour(self, scene: Scene) -> Scene:
        """The scene with the indices that are known beforehand, where colour matters and it has none."""
        if self.chromatic is None or self.colours is None or scene.indices is not None:
            return scene
        return scene.coloured(self.colours.of(len(scene.colours)))

    def multiplied(self, factor) -> OTF:
        """The same with another factor (My, Mx//2 + 1) in the transfer function of every source."""
        chromatic = None if self.chromatic is None else self.chromatic * factor
        return replace(self, value=self.value * factor, jacobian=self.jacobian * factor, chromatic=chromatic)

    def diffused(self, sigma: float) -> OTF:
        """The same with charge diffused in the detector: a round normal, ``sigma`` arcsec along each axis."""
        fy, fx = self.grid.frequencies
        return self.multiplied(Mvn.of(sigma).transfer(fx, fy))

    def blind(self) -> tuple[str, ...]:
        """Aberrations that do not change the image to first order: a micron of them would not show."""
        slopes = np.asarray(self.jacobian)
        if np.all(np.abs(slopes[:, :2]).max(axis=(1, 2), initial=0.0) > _BLIND):  # most show in any row
            return ()
        largest = np.abs(slopes).max(axis=(1, 2), initial=0.0)
        return tuple(name for name, slope in zip(self.names, largest, strict=True) if slope < _BLIND)

    def psf(self) -> Float[Array, "my mx"]:
        """Point spread function at the state, on the fine grid, centred as the frame is."""
        fy, fx = self.grid.frequencies
        cy, cx = self.grid.centre
        return jnp.fft.irfft2(
            self.value * np.exp(-2j * np.pi * fy * cy) * np.exp(-2j * np.pi * fx * cx), s=self.grid.fine_shape
        )


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


def with_shift(otf: OTF, slope: Complex[Array, "my mx"], mean: float) -> OTF:
    """The same optics whose wavelength may vary.

    Parameters
    ----------
    otf : OTF
    slope : (My, Mx//2 + 1) array
        Derivative by a shift of the wavelength, per nm.
    mean : float
        Mean wavelength, nm.
    """
    assert otf.colours is not None
    assert otf.chromatic is not None
    return replace(
        otf,
        jacobian=jnp.concatenate([otf.jacobian, slope[None]]),
        state=jnp.append(otf.state, 0.0),
        names=(*otf.names, WAVELENGTH),
        chromatic=jnp.concatenate([otf.chromatic, jnp.zeros_like(slope)[None]]),
        wavelength_sigma=otf.colours.wavelength_err * mean,
    )


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
    rows = [weights, weights * tilts(spectrum)] if chromatic else [weights]
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
