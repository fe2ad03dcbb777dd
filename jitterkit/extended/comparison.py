"""Two frames of one scene, the second blurred and moved: how well a blur explains it, and the best of a kind.

The sharp frame is blurred and moved, and compared with the other where the blur does not reach over the
frame's borders: what moves through them is in neither frame.  Residuals are weighed by frequency, since the
noise of the sharp frame is blurred too.
"""

from __future__ import annotations

from collections.abc import Callable
from copy import copy
from dataclasses import dataclass, replace

import numpy as np
from scipy import fft, ndimage
from scipy.optimize import least_squares
from scipy.signal.windows import hann

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.vision import box_mean

Slopes = Callable[[], list[np.ndarray]]
"""Computes the derivatives of a transfer function by its parameters."""

Transfer = Callable[[np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, Slopes]]
"""The transfer function of parameters at frequencies (x, y) [cycles/pixel], and its derivatives."""

_BAND = 0.45
"""Cycles/pixel; beyond, frames alias."""

_NEAR = 7
"""Frequencies along the side of a neighbourhood, at least; otherwise a twelfth of the frame's.

With 7 in a frame of 300 pixels, at a S/N of 3, chosen noise makes the variance of no blur 0.05 pixel²; with
25, 0.003.
"""

_EDGE = 0.47
"""Cycles/pixel, from which a frame's power is taken for noise."""

_STRIPES = 0.05
"""Cycles/pixel; below, a scene may have few strong frequencies, and blurs of pixels hardly show."""

_ABOVE_NOISE = 4.0
"""Power of the sharp frame, in units of its noise, from which a frequency is compared."""

_GRIDS = fft.fftfreq, fft.rfftfreq
"""Of the frequencies along y and x."""

_ROUNDING = 1e-12
"""Share of the mean power that counts as noise, where frames have none."""

_STEPS = 30
"""Of a fit, at most: those that find a blur take 3 to 17, and the others find none in hundreds."""

_LEAST_GAIN = 1e-3
"""Ratio of two frames' fluxes."""

_MOST_GAIN = 300.0
"""Its logarithm where it counts as endless, as of frames that have no blur in common: squares are finite."""

_REGULARISED = 10.0
"""Noise added to the denominator of the ratio of two transforms, in units of both frames' noise."""

_LEAST_WINDOW = 16
"""Pixels that a blur must leave free of the borders, on each axis."""


def _factor(p: np.ndarray) -> float:
    """Return the ratio of fluxes of some parameters."""
    return float(np.exp(min(p[0], _MOST_GAIN)))


@dataclass(frozen=True, eq=False)
class Fit:
    """A blur and a shift fitted to two frames.

    Attributes
    ----------
    transfer : function
        One of those in :mod:`jitterkit.extended.blur_fit`.
    p : (k,) array
        ``(log gain, x, y, *q)``: the shift [pixels], and the parameters ``q`` of the transfer function.
    covariance : (k, k) array
        Of ``p``; what the model does not describe counts as noise.
    cost : float
        Half of chi-squared.
    """

    transfer: Transfer
    p: np.ndarray
    covariance: np.ndarray
    cost: float


class Comparison:
    """Two frames of one scene, the second blurred and moved.

    Parameters
    ----------
    one, two : (ny, nx) arrays
        The sharp frame and the other, without bad pixels, in the same unit up to a factor and an offset.
    noise : (float, float), optional
        Variance of a pixel of each; without it, the power at the highest frequencies, of the sharp frame that
        of the other if it is less.

    Attributes
    ----------
    frequencies : int
        Number of those that are compared: where the sharp frame rises above its noise, without stripes.
    """

    def __init__(self, one: np.ndarray, two: np.ndarray, noise: tuple[float, float] | None = None) -> None:
        cut = tuple(slice(_fast_length(n)) for n in one.shape)
        one, two = one[cut], two[cut]
        self.one, self.two = one - one.mean(), two - two.mean()
        axes = (f(n) for f, n in zip(_GRIDS, one.shape, strict=True))
        self._fy, self._fx = np.meshgrid(*axes, indexing="ij")
        self._spectrum = fft.rfft2(self.one)
        window = np.outer(*(hann(n + 2)[1:-1] for n in one.shape))
        self._pair = [self._transform(frame, window) for frame in (one, two)]
        radius, powers = np.hypot(self._fx, self._fy), [np.abs(transform) ** 2 for transform in self._pair]
        # the median of an exponential law: stripes that reach so far are few frequencies
        first, second = (float(np.median(power[radius > _EDGE])) / np.log(2) for power in powers)
        # the scene may reach there too, of the sharp frame more
        self.noise, self._most = noise or (min(first, second), second), None if noise else (first, second)
        # chosen by the power of a wide neighbourhood: by its own, a frequency would be chosen for its noise
        near = max(_NEAR, min(one.shape) // 12 // 2 * 2 + 1)
        above_noise = box_mean(powers[0], near) > _ABOVE_NOISE * self.noise[0]
        stripes = ndimage.binary_dilation(striped(powers[0], radius), np.ones((3, 3))) & (radius > _STRIPES)
        self._band = (radius > 0) & (radius < _BAND) & above_noise & ~stripes
        self.frequencies = int(self._band.sum())
        self._rounding = _ROUNDING * float(powers[1].mean())

    def part(self, side: int) -> Comparison:
        """Return the comparison of the part, at most ``side`` pixels wide, that has the most structure."""
        shape = [min(side, n) for n in self.one.shape]
        size = [n - 1 + n % 2 for n in shape]
        inside = tuple(slice(n // 2, m - (n - 1) // 2) for n, m in zip(shape, self.one.shape, strict=True))
        structure = box_mean(self.one**2, (size[0], size[1]))[inside]
        corner = np.unravel_index(np.argmax(structure), structure.shape)
        cut = tuple(slice(c, c + n) for c, n in zip(corner, shape, strict=True))
        return Comparison(self.one[cut], self.two[cut], self.noise if self._most is None else None)

    def holds(self, *extents: np.ndarray) -> bool:
        """Return whether enough of the frames is farther from the borders than every extent (x, y)."""
        return bool(np.all(np.array(self.one.shape[::-1]) - 2 * np.max(extents, axis=0) >= _LEAST_WINDOW + 2))

    def window(self, *extents: np.ndarray) -> np.ndarray:
        """Return a window (ny, nx) that is zero within every extent (x, y) of the borders."""
        borders = np.ceil(np.max(extents, axis=0)).astype(int)[::-1]
        sides = zip(self.one.shape, borders, strict=True)
        return np.outer(*(np.pad(hann(n - 2 * border + 2)[1:-1], border) for n, border in sides))

    def fit(self, transfer: Transfer, start: np.ndarray, window: np.ndarray) -> Fit:
        """Fit a blur from a start that may be far away.

        Both frames have noise.  With the scene behind them free at every frequency, residuals have the noise
        of the second frame and of the blurred first (total least squares).  To hold that noise fixed would
        make blurs too large: a blur also smooths the first frame's noise.
        """

        def residuals(p: np.ndarray) -> np.ndarray:
            return _parts(self._left(transfer, p, window) * self._weights(transfer, p))

        def slopes(p: np.ndarray) -> np.ndarray:
            columns, gains = self._slopes(transfer, p)
            gain, weights = self._gain(transfer, p), self._weights(transfer, p)
            # of the noise, by a parameter: twice the first frame's, times the gain and its derivative
            shrunk = self._left(transfer, p, window) * self.noise[0] * gain * weights**2 / 2
            spectra = [self._transform(self._image(column), window)[self._band] for column in columns]
            return -np.stack(
                [_parts((a + shrunk * b) * weights) for a, b in zip(spectra, gains, strict=True)], -1
            )

        found = least_squares(
            residuals, start, jac=slopes, x_scale="jac", xtol=1e-6, ftol=1e-6, max_nfev=_STEPS
        )
        ties = window.size * (window**4).sum() / (window**2).sum() ** 2  # of neighbouring frequencies
        misfit = 2 * found.cost / (len(found.fun) - len(found.x))
        rounding = float(np.mean(self._rounding * self._weights(transfer, found.x) ** 2)) / 2
        scale = ties * max(misfit, rounding if self._most else 1.0)  # two copies of a frame have no noise
        # a motion along a line that is found to be none has no slopes
        sizes = np.maximum(np.linalg.norm(found.jac, axis=0), 1e-100)
        inverse = np.linalg.pinv((found.jac / sizes).T @ (found.jac / sizes), hermitian=True)
        return Fit(transfer, found.x, scale * inverse / np.outer(sizes, sizes), found.cost / ties)

    def with_error_of_noise(self, fit: Fit, window: np.ndarray) -> Fit:
        """Return a fit whose covariance has its change if all power at the highest frequencies is noise."""
        if self._most is None or self._most == self.noise:
            return fit
        noisier = copy(self)
        noisier.noise = self._most
        change = noisier.fit(fit.transfer, fit.p, window).p - fit.p
        return replace(fit, covariance=fit.covariance + np.outer(change, change))

    def exchanged(self) -> Comparison:
        """Return the comparison of the second frame, taken as the sharp one, with the first."""
        return Comparison(self.two, self.one, self.noise[::-1] if self._most is None else None)

    def unexplained(self, transfer: Transfer, p: np.ndarray, window: np.ndarray) -> tuple[float, float]:
        """Return the share of the second frame's power that a blur leaves, and the log of the best gain.

        Raises
        ------
        UndeterminedError
            If a frame shows nothing but its borders.
        """
        data, image = (
            self._transform(a, window)[self._band]
            for a in (self.two, self._image(self._response(transfer, p)))
        )
        if not (data.any() and image.any()):
            problem = f"A part of {' x '.join(map(str, self.one.shape[::-1]))} pixels shows only its borders"
            message = f"{problem}; give frames that show more in the middle."
            raise UndeterminedError(ErrorCode.NO_SIGNAL, message)
        gain = max(float(np.vdot(image, data).real / np.vdot(image, image).real), _LEAST_GAIN)
        rest, total = (float(np.sum(np.abs(a) ** 2)) for a in (data - gain * image, data))
        return rest / total, p[0] + float(np.log(gain))

    def noise_share(self, fit: Fit, window: np.ndarray) -> float:
        """Return the share of the second frame's power that the noise of a blur's residuals has."""
        power = np.abs(self._transform(self.two, window)[self._band]) ** 2
        return float(np.sum(2 / self._weights(fit.transfer, fit.p) ** 2) / power.sum())

    def _weights(self, transfer: Transfer, p: np.ndarray) -> np.ndarray:
        first, second = self.noise
        return np.sqrt(2 / (second + self._gain(transfer, p) ** 2 * first + self._rounding))

    def _left(self, transfer: Transfer, p: np.ndarray, window: np.ndarray) -> np.ndarray:
        return self._transform(self.two - self._image(self._response(transfer, p)), window)[self._band]

    def _response(self, transfer: Transfer, p: np.ndarray) -> np.ndarray:
        return transfer(p[3:], self._fx, self._fy)[0] * self._moved(p)

    def _moved(self, p: np.ndarray) -> np.ndarray:
        return _factor(p) * np.exp(-2j * np.pi * (p[1] * self._fx + p[2] * self._fy))

    def _slopes(self, transfer: Transfer, p: np.ndarray) -> tuple[list[np.ndarray], list[np.ndarray | float]]:
        """Return the derivatives by the parameters: of the response, and of the gain where it is used."""
        (blur, slopes), moved = transfer(p[3:], self._fx, self._fy), self._moved(p)
        by_q, turn = slopes(), -2j * np.pi * blur * moved
        columns = [blur * moved, self._fx * turn, self._fy * turn, *(slope * moved for slope in by_q)]
        of_q = (_factor(p) * slope[self._band] for slope in by_q)
        return columns, [self._gain(transfer, p), 0.0, 0.0, *of_q]

    def _image(self, response: np.ndarray) -> np.ndarray:
        return fft.irfft2(self._spectrum * response, self.one.shape)

    def _transform(self, image: np.ndarray, window: np.ndarray) -> np.ndarray:
        windowed = (image - np.average(image, weights=window)) * window
        return fft.rfft2(windowed) / np.sqrt((window**2).sum())

    def _gain(self, transfer: Transfer, p: np.ndarray) -> np.ndarray:
        return _factor(p) * transfer(p[3:], self._fx[self._band], self._fy[self._band])[0]

    def kernel(self, x: float, y: float, side: int) -> np.ndarray:
        """Return the kernel (side, side) about a shift: the regularised ratio of the transforms, sum one."""
        one, two = self._pair
        ratio = two * one.conj() / (np.abs(one) ** 2 + _REGULARISED * sum(self.noise))
        whole = fft.irfft2(ratio * np.exp(2j * np.pi * (x * self._fx + y * self._fy)), self.one.shape)
        cut = np.roll(whole, (side // 2, side // 2), axis=(0, 1))[:side, :side]
        return cut / cut.sum()

    @property
    def widest(self) -> float:
        """Return the variance [pixel²] of a normal that leaves the scene a third of its amplitudes."""
        square, power = (self._fx**2 + self._fy**2)[self._band], np.abs(self._pair[0])[self._band] ** 2
        return 1 / float(2 * np.pi**2 * np.average(square, weights=power))


def _fast_length(n: int) -> int:
    """Return the largest length up to ``n`` whose transform is fast."""
    return next(k for k in range(n, 0, -1) if fft.next_fast_len(k, real=True) == k)


def _parts(spectrum: np.ndarray) -> np.ndarray:
    return np.concatenate([spectrum.real, spectrum.imag])


_RINGS, _FEW_FREQUENCIES = 64, 60.0
"""Rings to a cycle/pixel; power over a ring's median of which no frequency of a scene has more by chance."""


def striped(power: np.ndarray, radius: np.ndarray) -> np.ndarray:
    """Return near which frequencies stripes such as columns or fringes have power, and no scene has so much.

    Parameters
    ----------
    power, radius : arrays of one shape
        Of each frequency; the radius in cycles/pixel.

    Returns
    -------
    striped : bool array
    """
    rings = (radius * _RINGS).astype(int)
    level = ndimage.median(power, rings, np.arange(rings.max() + 1))[rings]
    return ndimage.binary_dilation(power > _FEW_FREQUENCIES * level, np.ones((3, 3)))
