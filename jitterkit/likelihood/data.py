"""What the likelihood needs of a frame, and which of its pixels count under a model."""

from __future__ import annotations

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from jitterkit.frames.frame import Frame
from jitterkit.precision import array_module

_FLOOR = 1e-6
"""Smallest expected count, as a share of the frame's mean: ringing must not make it negative."""

_CLEAR = 4.0
"""Sigmas below its ceiling from which a pixel counts: what is trimmed of its noise there is 3e-5 of it."""

_NO_CEILING = 1e15
"""Electrons that no pixel holds: the distance from an infinite ceiling has no slope."""

_NEAR = 10.0
"""Sigmas below the ceiling within which some reading lies if any pixel can be expected to reach it."""


class Data(eqx.Module):
    """Hold the data of a frame for the likelihood: NumPy arrays, until a program moves them to its device.

    Attributes
    ----------
    electrons : (ny, nx) array
        Pixels that are not used hold zero.
    read_variance : (ny, nx) array
        What the scene does not make, electrons² before any division by the response.
    used : (ny, nx) bool array
    response : (ny, nx) array or None
        The flat that the electrons were divided by; None for one.
    ceiling : (ny, nx) array or None
        Level from which on a pixel is full; None where nothing comes near it.
    full : (ny, nx) bool array or None
        Pixels that count as having reached the ceiling; None to leave out what comes near it.
    model_variance : (ny, nx) array or None
        Variance of a pixel by errors of the model, electrons² before any division; None without any.
    model_area : () array or None
        Pixels whose model errors are alike: the likelihood takes so many times ``model_variance``, since
        together they say no more than one.
    """

    electrons: Float[Array | np.ndarray, "ny nx"]
    read_variance: Float[Array | np.ndarray, "ny nx"]
    used: Bool[Array | np.ndarray, "ny nx"]
    response: Float[Array | np.ndarray, "ny nx"] | None
    ceiling: Float[Array | np.ndarray, "ny nx"] | None
    full: Bool[Array | np.ndarray, "ny nx"] | None
    model_variance: Float[Array | np.ndarray, "ny nx"] | None
    model_area: Float[Array | np.ndarray, ""] | None

    def __init__(
        self,
        electrons,
        read_variance=0.0,
        used=None,
        *,
        response=None,
        ceiling=None,
        full=None,
        model_variance=None,
        model_area=1.0,
    ) -> None:
        electrons = np.asarray(electrons, float)
        used = np.ones(electrons.shape, bool) if used is None else np.asarray(used, bool)
        used = used & np.isfinite(electrons)
        self.electrons = np.where(used, electrons, 0.0)
        self.read_variance = _spread(np.asarray(read_variance, float), electrons.shape)
        self.used = used
        response = None if response is None else np.asarray(response, float)
        self.response = None if response is None else _spread(response, electrons.shape)
        ceiling = None if ceiling is None else np.minimum(np.asarray(ceiling, float), _NO_CEILING)
        self.ceiling = None if ceiling is None else _spread(ceiling, electrons.shape)
        self.full = None if full is None else np.asarray(full, bool)
        allowed = None if model_variance is None else np.asarray(model_variance, float)
        self.model_variance = None if allowed is None else _spread(allowed, electrons.shape)
        self.model_area = None if allowed is None else np.asarray(model_area, float)

    @classmethod
    def of(cls, frame: Frame, *, censored: bool = False) -> Data:
        """Take the data of a calibrated frame.

        Parameters
        ----------
        frame : Frame
        censored : bool
            Whether full pixels count with the probability of being full, or are left out together with
            those that :meth:`clear` finds too near.  To leave them out costs their information
            (a tenth of the separation's error, at 700 full pixels of TOLIMAN's brightest); to count them
            asks that the response is linear up to the ceiling.
        """
        flat = None if np.all(frame.response == 1) else frame.response
        used = ~frame.mask
        near = np.any(frame.full) or _comes_near(frame, used)
        return cls(
            frame.electrons,
            frame.read_variance,
            used,
            response=flat,
            ceiling=frame.ceiling if near else None,
            full=frame.full if censored and near else None,
        )

    @property
    def trims(self) -> bool:
        """Return whether a reading comes near a ceiling and is to be left out."""
        return self.ceiling is not None and self.full is None

    def clear(self, image) -> Data:
        """Leave out what an expected image (ny, nx) brings near the ceiling.

        Returns
        -------
        data : Data
            Without a ceiling; the same where there is none, or where full pixels count.
        """
        if not self.trims:
            return self
        with np.errstate(divide="ignore", invalid="ignore"):  # no pixel is clear of a ceiling of none
            keep = self.used & clears(mean_counts(np.asarray(image), self), self)
        return Data(
            self.electrons,
            self.read_variance,
            keep,
            response=self.response,
            model_variance=self.model_variance,
            model_area=self.model_area,
        )

    @property
    def for_likelihood(self) -> Data:
        """The same without the ceiling, where full pixels are left out: the likelihood then asks for none."""
        return eqx.tree_at(lambda d: d.ceiling, self, None) if self.trims else self

    def without(self, pixels: np.ndarray) -> Data:
        """The same without some pixels (ny, nx), which are marked true."""
        used = np.asarray(self.used) & ~pixels
        return eqx.tree_at(lambda d: (d.electrons, d.used), self, (np.where(used, self.electrons, 0.0), used))

    def allowing(self, variance, area=1.0) -> Data:
        """Return the same with a variance of model errors (ny, nx) and their area [pixels]; None for none."""
        return Data(
            self.electrons,
            self.read_variance,
            self.used,
            response=self.response,
            ceiling=self.ceiling,
            full=self.full,
            model_variance=variance,
            model_area=area,
        )

    @property
    def offset(self) -> Float[Array | np.ndarray, "ny nx"]:
        """Return the array that is added to electrons and image to make both of them Poisson."""
        alike = self.alike_variance
        variance = self.read_variance if alike is None else self.read_variance + alike
        return variance if self.response is None else variance / self.response

    @property
    def alike_variance(self) -> Float[Array | np.ndarray, "ny nx"] | None:
        """Variance of model errors in the likelihood: of a pixel, times the pixels that have the same."""
        if self.model_variance is None or self.model_area is None:
            return None
        return self.model_area * self.model_variance

    @property
    def weight(self):
        """Counts before the division by the response, of an electron after it."""
        return 1.0 if self.response is None else self.response


def _spread(values: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Values over an image; it takes ten times as long to ask NumPy to where there is nothing to do."""
    return values if values.shape == shape else np.broadcast_to(values, shape)


def _comes_near(frame: Frame, used: np.ndarray) -> bool:
    """Return whether some reading lies so near its ceiling that a pixel's expectation may reach it."""
    counts = np.where(used, frame.electrons * frame.response + frame.read_variance, 0.0)
    level = np.where(used, frame.response * frame.ceiling + frame.read_variance, np.inf)
    # of most frames not even the brightest is near the lowest; a map may lack a pixel's ceiling
    if not _near(np.max(counts), np.fmin.reduce(level, axis=None)):
        return False
    return bool(np.any(_near(counts, level)))


def _near(counts, level):
    # a root's error is 1/2
    return np.sqrt(np.maximum(counts, 0.0)) + _NEAR / 2 > np.sqrt(np.maximum(level, 0.0))


def clears(mean, data: Data):
    """Return whether an expected count stays clear of its ceiling, by its :func:`ceiling_distance`."""
    level = _level(data)
    root = 1 - 1 / (9 * level) - _CLEAR / (3 * array_module(level).sqrt(level))
    return data.weight * mean < level * root**3  # cubed here, where a cube root of the count takes longer


def _floor(image, data: Data):
    xp = array_module(image)
    count = xp.maximum(xp.sum(data.used), 1)
    typical = xp.sum(xp.where(data.used, xp.abs(image + data.offset), 0.0)) / count
    return _FLOOR * typical + np.finfo(image.dtype).tiny


def mean_counts(image, data: Data):
    return array_module(image).maximum(image + data.offset, _floor(image, data))


def pixel_variance(mean, data: Data):
    """Variance of a pixel's electrons by itself, where the likelihood expects a mean count."""
    alike, own = data.alike_variance, data.model_variance
    if alike is None or own is None:
        return mean / data.weight
    return (mean - (alike - own) / data.weight) / data.weight


def telling(image, data: Data):
    """Pixels that count: used or full, and not held up by the floor, where the model says nothing."""
    counting = data.used if data.full is None else data.used | data.full
    return counting & (image + data.offset > _floor(image, data))


def relative_residual(mean, data: Data):
    """Derivative of a pixel's log-likelihood by its mean count: the excess as a share of the mean."""
    return (data.electrons + data.offset - mean) / mean


def ceiling_distance(mean, data: Data):
    """Sigmas by which an expected count lies above its ceiling, and their slope by the count.

    Wilson and Hilferty's cube root makes a Poisson law normal (Proc. Natl. Acad. Sci. 17, 684, 1931): the
    chance of reaching the ceiling is right to 6e-4 at ten counts, 5e-6 at a thousand and 4e-7 at 15,000.
    """
    count, level = data.weight * mean, _level(data)
    root = jnp.cbrt(count / level)
    steep = 3 * jnp.sqrt(level)
    return steep * (root - 1 + 1 / (9 * level)), steep * root / (3 * count)


def _level(data: Data):
    assert data.ceiling is not None
    return data.weight * (data.ceiling + data.offset) + 0.5
