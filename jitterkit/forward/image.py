"""The expected image of a frame, and its derivatives by what may be fitted."""

from __future__ import annotations

import equinox as eqx
import jax
import jax.flatten_util
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from jitterkit.conventions import offsets
from jitterkit.forward.parameters import Parameters
from jitterkit.loci.elliptic import Mvn
from jitterkit.loci.simple import AnySimple
from jitterkit.optics.grid import Grid
from jitterkit.optics.otf import OTF, PLATE_SCALE
from jitterkit.scene import Binary, Scene


def expected_image(parameters: Parameters, otf: OTF) -> Float[Array, "ny nx"]:
    """Expected electrons in every pixel of a frame.

    Parameters
    ----------
    parameters : Parameters
    otf : OTF
        From :func:`jitterkit.optics.expand` or :func:`jitterkit.optics.empirical_otf`.

    Returns
    -------
    image : (ny, nx) array
        Its sum is the flux times the share of the light that falls inside the frame.

    Notes
    -----
    Assumes one transfer function over the frame (isoplanatic), linear in the spectral index of a source.
    Aberrations away from ``otf.state`` enter to first order, and so does what differs between B and A
    beside its colour; a plate scale shifts positions and stars' images, not the jitter.  Fails softly when
    the padding is smaller than the jitter: light then wraps around.
    """
    simple = AnySimple.instead_of(parameters.locus)
    return _expected_image(parameters if simple is None else parameters.with_locus(simple), otf)


@eqx.filter_jit
def _expected_image(parameters: Parameters, otf: OTF):
    blur, optics, stars = _factors(parameters, otf)
    spectrum = blur * _light(optics, stars)
    return _to_pixels(spectrum, otf.grid, parameters.shutter) + background_of(parameters, otf.grid)


@eqx.filter_jit
def displacement_effect(parameters: Parameters, otf: OTF, dx, dy) -> Float[Array, "ny nx"]:
    """Change of the expected image where pixels are not where the grid has them.

    Parameters
    ----------
    parameters : Parameters
    otf : OTF
    dx, dy : (ny, nx) array
        From where the grid has each pixel to where it is, arcsec.

    Returns
    -------
    change : (ny, nx) array
        Electrons, to second order: what it lacks at the Nyquist frequency is 5e-3 of the light for a tenth of
        a pixel, 5e-9 for a thousandth.
    """
    blur, optics, stars = _factors(parameters, otf)
    spectrum = blur * _light(optics, stars)
    x, y = (2j * np.pi * frequencies for frequencies in _fx_fy(otf))
    moves = [(x, dx), (y, dy), (x * x, dx * dx / 2), (x * y, dx * dy), (y * y, dy * dy / 2)]
    factors = jnp.stack(jnp.broadcast_arrays(*(factor for factor, _ in moves)))
    slopes = _to_pixels(spectrum * factors, otf.grid, parameters.shutter)
    return jnp.sum(slopes * jnp.stack([by for _, by in moves]), axis=0)


def _factors(parameters: Parameters, otf: OTF):
    """The factors of the spectrum: jitter and pixel; the optics; and the stars that each of these images."""
    blur = parameters.locus.transfer(*_fx_fy(otf)) * _pixel(otf, parameters.diffusion)
    state = parameters.aberrations
    optics = otf.at(state), otf.chromatic_at(state), otf.difference_at(state)
    return blur, optics, _point_sources(parameters.scene, otf, otf.plate_scale_shift(state))


def _light(optics, stars):
    """Sum over the parts of the optics: by the instrument's spectrum; by the spectral index; of B alone."""
    pairs = zip(optics, stars, strict=True)
    return sum(part * sources for part, sources in pairs if part is not None and sources is not None)


def _fx_fy(otf: OTF):
    fy, fx = (f.astype(otf.value.real.dtype) for f in otf.grid.frequencies)
    return fx, fy


def _pixel(otf: OTF, diffusion):
    """Transfer function of a square pixel, unless the optics' already holds it, and of diffused charge."""
    fx, fy = _fx_fy(otf)
    p = otf.grid.plate_scale
    pixel = 1.0 if otf.pixel_included else np.sinc(p * fx) * np.sinc(p * fy)
    return pixel if diffusion is None else pixel * _round(diffusion).transfer(fx, fy)


def background_of(parameters: Parameters, grid: Grid) -> Float[Array, "ny nx"]:
    """Electrons per pixel that are not the light of stars."""
    y, x = _axes(parameters, grid)
    along_x, along_y = parameters.gradient
    return parameters.background + along_x * x + along_y * y


def _axes(parameters: Parameters, grid: Grid):
    """Offsets ``y, x`` of the pixels from the centre, arcsec."""
    ny, nx = grid.shape
    y, x = (offsets(n, grid.plate_scale).astype(parameters.background.dtype) for n in (ny, nx))
    return y[:, None], x


def _round(variance):
    """A normal blur of one variance along both axes [arcsec²]."""
    variance = jnp.asarray(variance)
    return Mvn(variance * jnp.array([1.0, 0.0, 1.0], variance.dtype))


def _to_pixels(spectrum, grid, shutter):
    """The frame's pixels from spectra (..., My, Mx//2 + 1); rows one after the other where they are."""
    if shutter is None:
        return grid.refine**2 * grid.crop(jnp.fft.irfft2(spectrum, s=grid.fine_shape))
    (fy, fx), ny = grid.frequencies, grid.shape[0]

    def add(image, window):
        share, transfer = window
        return image + share[:, None] * _to_pixels(spectrum * transfer, grid, None), None

    kind = spectrum.real.dtype
    dark = jnp.zeros((*spectrum.shape[:-2], *grid.shape), kind)
    windows = jnp.asarray(shutter.blend(ny), kind), shutter.transfers(fx, fy, ny).astype(spectrum.dtype)
    return jax.lax.scan(add, dark, windows)[0]


def _point_sources(scene: Scene, otf: OTF, scale):
    """Spectra of the stars, about the first fine sample, that the parts of the optics image.

    That of all stars; where colours matter, of all by their indices; and where its wavefront differs, of B.
    Places in arcsec shrink where the plate scale is larger by a share.
    """
    fy, fx = otf.grid.frequencies
    cy, cx = otf.grid.centre
    x, y, flux = scene.sources()
    x, y = (x, y) if scale is None else (x / (1 + scale), y / (1 + scale))
    indices = None if otf.tints is None else scene.source_indices()
    fy, fx = fy.astype(x.dtype), fx.astype(x.dtype)
    along_x = jnp.exp(-2j * jnp.pi * fx[0] * (x + cx)[:, None])
    along_y = flux[:, None] * jnp.exp(-2j * jnp.pi * fy[:, 0] * (y + cy)[:, None])
    # once along each axis, not again for every sample of the spectra
    along_x, along_y = jax.lax.optimization_barrier((along_x, along_y))
    tinted = None if indices is None else (indices[:, None] * along_y).T @ along_x
    differs = otf.difference is not None and isinstance(scene, Binary)
    return along_y.T @ along_x, tinted, jnp.outer(along_y[1], along_x[1]) if differs else None


@eqx.filter_jit
def image_and_jacobian(parameters: Parameters, otf: OTF, free: tuple[int, ...]):
    """Expected image and its derivatives.

    Parameters
    ----------
    parameters : Parameters
    otf : OTF
    free : tuple of int
        Positions in the vector of :func:`to_vector` to differentiate by, ascending.

    Returns
    -------
    image : (ny, nx) array
    jacobian : (len(free), ny, nx) array
        Exact where the aberrations are the OTF's state.
    """
    vector, unravel = jax.flatten_util.ravel_pytree(parameters.scene)
    coords, state = parameters.locus.coords, parameters.aberrations
    scale = otf.plate_scale_shift(state)
    stars, scene = _linearized(lambda v: _point_sources(unravel(v), otf, scale), vector)
    transfer, locus = _linearized(lambda c: parameters.locus.at(c).transfer(*_fx_fy(otf)), coords)
    optics = otf.at(state), otf.chromatic_at(state), otf.difference_at(state)
    pixel = _pixel(otf, parameters.diffusion)
    blur, light = transfer * pixel, _light(optics, stars)
    blocks = [  # the product rule, one block a factor: no derivative is pushed where it is known to be zero
        (scene, lambda parts: blur * _light(optics, parts)),
        (locus, lambda part: light * pixel * part),
        (lambda rows: _aberration_slopes(parameters, otf, optics, stars, rows), lambda part: blur * part),
    ]
    sizes = [len(vector), len(coords), len(parameters.aberrations)]
    jacobian, first, shutter = [], 0, parameters.shutter
    for (derivative, complete), size in zip(blocks, sizes, strict=True):
        rows = np.array([i - first for i in free if first <= i < first + size], int)
        if rows.size:
            jacobian.append(_to_pixels(complete(derivative(rows)), otf.grid, shutter))
        first += size
    spectrum = blur * light
    image = _to_pixels(spectrum, otf.grid, shutter)
    planes = (1.0, *_axes(parameters, otf.grid)[::-1])  # of the background
    flat = [jnp.broadcast_to(plane, image.shape) for i, plane in enumerate(planes) if first + i in free]
    if flat:
        jacobian.append(jnp.stack(flat).astype(image.dtype))
    if first + len(planes) in free:  # diffusion: the logarithm of its factor is linear in it
        fx, fy = _fx_fy(otf)
        jacobian.append(_to_pixels(-2 * np.pi**2 * (fx**2 + fy**2) * spectrum, otf.grid, shutter)[None])
    return image + background_of(parameters, otf.grid), jnp.concatenate(jacobian)


def _aberration_slopes(parameters: Parameters, otf: OTF, optics, stars, rows: np.ndarray):
    """Derivatives of the light by chosen aberrations, ascending."""
    common, beside = rows[rows < otf.rows], rows[rows >= otf.rows] - len(otf.names)
    if not otf.names:
        return jnp.zeros((len(rows), *otf.value.shape))
    every = len(common) == otf.rows
    jacobian, chromatic = otf.jacobian, None if otf.chromatic is None else otf.chromatic[1:]
    if not every:  # what is chosen is copied
        jacobian, chromatic = jacobian[common], None if chromatic is None else chromatic[common]
    slopes = [_light((jacobian, chromatic, None), stars)]
    if beside.size:
        slopes.append(_light((None, None, otf.jacobian[np.array(otf.of_b)[beside]]), stars))
    if PLATE_SCALE in otf.names and (index := otf.names.index(PLATE_SCALE)) in rows:
        at = jnp.asarray(otf.plate_scale_shift(parameters.aberrations))
        _, moved = _linearized(lambda s: _point_sources(parameters.scene, otf, s[0]), at[None])
        slopes[0] = slopes[0].at[common.tolist().index(index)].add(_light(optics, moved(np.array([0])))[0])
    return jnp.concatenate(slopes)


def _linearized(function, vector):
    """A function of one part of the parameters there, and its derivatives for chosen elements of it."""
    value, push = jax.linearize(function, vector)
    return value, lambda rows: jax.vmap(push)(np.eye(vector.size, dtype=vector.dtype)[rows])
