"""Stars in stamps of their own, and their second moments, weighted by a normal that adapts to each star.

Plain second moments of a star diverge: its wings and the noise under them weigh more the farther out
they lie.  Weighted by the elliptical normal that matches the star itself, they are finite, and a normal
star gives its own covariance (Bernstein & Jarvis, AJ 123, 583, 2002; Hirata & Seljak, MNRAS 343,
459, 2003).  It is the covariance of the normal that fits the star best in least squares, pixel included.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy import ndimage

_PASSES, _CONVERGED = 60, 1e-10
"""Of the fixed point, each of which about halves what is left [pixels²]."""

_START = 2.0
"""Variance of the first weight [pixels²]: a FWHM of 3.3 pixels."""

_STEP = 1e-4
"""Half a step of the numerical derivative: 1e-8 of its value is lost."""

_EDGE = 0.4
"""Sigma of a sound star, at most, in units of half its stamp."""


class Moments(NamedTuple):
    """Adaptive moments of n stars.

    Attributes
    ----------
    centre : (n, 2) array
        ``(x, y)`` from the middle pixel of the stamp [pixels].
    moments : (n, 3) array
        ``(Sxx, Sxy, Syy)``, the pixel's own 1/12 included [pixels²].
    covariance : (n, 3, 3) array
        Of the moments, from photon and sky noise [pixels⁴].
    flux : (n,) array
        Light of the matched normal [electrons].
    sound : (n,) bool array
        False where the iteration ran away or filled the stamp; such rows mean nothing.
    """

    centre: np.ndarray
    moments: np.ndarray
    covariance: np.ndarray
    flux: np.ndarray
    sound: np.ndarray

    def chosen(self, which: np.ndarray) -> Moments:
        """Return the moments of some of the stars, by index or boolean array."""
        return Moments(*(array[which] for array in self))


def adaptive_moments(stars: Stars) -> Moments:
    """Measure the adaptive second moments of stars.

    Parameters
    ----------
    stars : Stars

    Returns
    -------
    moments : Moments
        A normal star gives its own covariance; a convolution adds its own to it, to first order in
        its size.

    Notes
    -----
    At the fixed point the moments ``C`` under the weight ``W`` of covariance ``M`` obey ``C = M/2``.
    The errors are those of the equations that hold there, ``sum I W g = 0`` over pixels:
    ``J^-1 (sum var (W g)²) J^-T``.  They ask nothing of the shape of the star.

    *Assumes* a flat, subtracted background; pixels that are not used lie outside the core, and count as
    background.  *Fails when* the star's sigma is below about 0.9 pixels (sums over pixels are then no
    integrals: 1 %) or it is faint: the bias is of the order of the squared relative error.
    """
    filled = np.where(stars.used, stars.electrons, 0.0)
    with np.errstate(all="ignore"):  # what runs away is no star, and flagged
        values = _fixed_point(filled)
        covariance, flux = _covariance(values, filled, stars.variance)
    limit = _EDGE * (filled.shape[-1] // 2)
    trace, det = values[:, 2] + values[:, 4], values[:, 2] * values[:, 4] - values[:, 3] ** 2
    with np.errstate(invalid="ignore"):
        sound = (trace > 0) & (det > 0) & (trace < 2 * limit**2) & (np.abs(values[:, :2]).max(1) < limit)
        sound &= np.isfinite(values).all(1) & np.isfinite(covariance).all((1, 2)) & (flux > 0)
    return Moments(values[:, :2], values[:, 2:], covariance, flux, sound)


def _fixed_point(images: np.ndarray) -> np.ndarray:
    """Return the centre and moments ``(x, y, Sxx, Sxy, Syy)`` of each star (n, 5)."""
    state = np.tile([0.0, 0.0, _START, 0.0, _START], (len(images), 1))
    for _ in range(_PASSES):
        weight, dx, dy = _weight(state, images.shape[-1])
        mx, my, xx, xy, yy = (_sums(weight * images, dx, dy) / _light(weight * images)).T
        centre = state[:, :2] + 2 * np.stack([mx, my], axis=1)
        moments = 2 * np.stack([xx - mx**2, xy - mx * my, yy - my**2], axis=1)
        before, state = state, np.concatenate([centre, moments], axis=1)
        if np.nanmax(np.abs(state - before), initial=0.0) < _CONVERGED:
            break
    return state


def _weight(state: np.ndarray, side: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return the matched normals (n, s, s), and the offsets (n, s) from their centres in x and y."""
    grid = np.arange(side) - side // 2
    cx, cy, sxx, sxy, syy = state.T[:, :, None]
    dx, dy = grid - cx, grid - cy
    det = sxx * syy - sxy**2
    along, across = (-0.5 * syy / det * dx**2)[:, None, :], (-0.5 * sxx / det * dy**2)[:, :, None]
    return np.exp(along + across + (sxy / det * dy)[:, :, None] * dx[:, None, :]), dx, dy


def _light(images: np.ndarray) -> np.ndarray:
    return images.sum((1, 2))[:, None]


def _sums(light: np.ndarray, dx: np.ndarray, dy: np.ndarray) -> np.ndarray:
    """First and second moments (n, 5) of weighted images, not divided by their sums."""
    columns, rows = light.sum(1), light.sum(2)
    mixed = np.einsum("nyx,nx,ny->n", light, dx, dy, optimize=True)
    first = np.sum(columns * dx, 1), np.sum(rows * dy, 1)
    return np.stack([*first, np.sum(columns * dx**2, 1), mixed, np.sum(rows * dy**2, 1)], axis=1)


def _equations(state: np.ndarray, images: np.ndarray) -> np.ndarray:
    """Return what vanishes (n, 5) at the fixed point: the weighted moments less half the weight's."""
    weight, dx, dy = _weight(state, images.shape[-1])
    half = np.concatenate([np.zeros((len(state), 2)), state[:, 2:] / 2], axis=1)
    return _sums(weight * images, dx, dy) - half * _light(weight * images)


def _covariance(state: np.ndarray, images: np.ndarray, variance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return the covariance (n, 3, 3) of the moments, and the flux (n,) of the matched normal."""
    steps = _STEP * np.eye(5)
    slope = np.stack(
        [(_equations(state + h, images) - _equations(state - h, images)) / (2 * _STEP) for h in steps], axis=2
    )
    weight, dx, dy = _weight(state, images.shape[-1])
    x, y = np.broadcast_arrays(dx[:, None, :], dy[:, :, None])
    sxx, sxy, syy = state[:, 2:].T[:, :, None, None]
    terms = np.stack([x, y, x * x - sxx / 2, x * y - sxy / 2, y * y - syy / 2], axis=1)
    terms = (terms * weight[:, None]).reshape(len(state), 5, -1)
    noise = (terms * variance.reshape(len(state), 1, -1)) @ np.swapaxes(terms, 1, 2)
    sound = np.isfinite(slope).all((1, 2)) & (np.abs(np.linalg.det(slope)) > 0)
    inverse = np.linalg.inv(np.where(sound[:, None, None], slope, np.eye(5)))
    covariance = inverse @ noise @ np.swapaxes(inverse, 1, 2)
    covariance[~sound] = np.nan
    return covariance[:, 2:, 2:], 2 * _light(weight * images)[:, 0]


@dataclass(frozen=True, eq=False)
class Stars:
    """Isolated stars of one frame, each in a stamp of its own.

    Attributes
    ----------
    x, y : (n,) array
        Centres in the frame, pixels; centroids, good to a tenth.
    electrons : (n, s, s) array
        Background subtracted; s is odd, and the stamp's middle pixel the one nearest to the centre.
    sky_variance : (n, s, s) array
        Of sky and read-out [electrons²]; a star's own photon noise comes on top.
    response : (n, s, s) array
        What the electrons were divided by, as in :class:`~jitterkit.frames.frame.Frame`.
    used : (n, s, s) bool array
        False for pixels that are bad, beyond the frame or part of another star.
    frame_shape : (int, int)
        ``(ny, nx)`` of the frame.
    """

    x: np.ndarray
    y: np.ndarray
    electrons: np.ndarray
    sky_variance: np.ndarray
    response: np.ndarray
    used: np.ndarray
    frame_shape: tuple[int, int]

    def __len__(self) -> int:
        return len(self.x)

    @property
    def middle(self) -> np.ndarray:
        """Return the middle pixel ``(n, 2)`` of each stamp, columns x and y."""
        return np.stack([np.rint(self.x), np.rint(self.y)], axis=1).astype(int)

    @property
    def variance(self) -> np.ndarray:
        """Return the variance of ``electrons`` (n, s, s); of pixels not used without photon noise."""
        return self.sky_variance + np.where(self.used, np.clip(self.electrons, 0, None), 0.0) / self.response

    def chosen(self, which: np.ndarray) -> Stars:
        """Some of the stars, by index or boolean array."""
        arrays = {name: value[which] for name, value in vars(self).items() if name != "frame_shape"}
        return replace(self, **arrays)


def cut_out(image, variance, response, bad, labels, x, y, own, half: int) -> Stars:
    """Stamps about stars; what lies beyond the frame is not used."""
    shape = image.shape
    image, variance = (np.pad(a, half) for a in (image, variance))
    bad, response = np.pad(bad, half, constant_values=True), np.pad(response, half, constant_values=1.0)
    labels = np.pad(labels, half)
    grid = np.arange(2 * half + 1)
    rows = np.rint(y).astype(int)[:, None, None] + grid[:, None]
    columns = np.rint(x).astype(int)[:, None, None] + grid
    stamps = labels[rows, columns]
    others = (stamps > 0) & (stamps != own[:, None, None])
    others = ndimage.binary_dilation(others, np.ones((1, 3, 3), bool), iterations=2)
    used = ~bad[rows, columns] & ~others
    image, variance, response = (a[rows, columns] for a in (image, variance, response))
    return Stars(x, y, image, variance, response, used, shape)


def stand_alone(stars: Stars, radius: float) -> np.ndarray:
    """Return which stars have every pixel within a radius [pixels]."""
    half = stars.used.shape[-1] // 2
    grid = np.arange(-half, half + 1)
    core = np.hypot(*np.meshgrid(grid, grid)) < max(radius, 2.0)
    return np.all(stars.used | ~core, axis=(1, 2))
