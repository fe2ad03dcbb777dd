"""The fit of a blur and a shift between two frames of one scene.

The sharp frame is blurred and moved, and compared with the other where the blur does not reach over the
frame's borders: what moves through them is in neither frame.  Residuals are weighed by frequency, since the
noise of the sharp frame is blurred too.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import fft, ndimage
from scipy.optimize import least_squares, nnls
from scipy.signal.windows import hann

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.extended.blurs import Transfer, drift, normal, streak, vibration
from jitterkit.extended.registration import striped
from jitterkit.loci.base import axis_variances, principal_axes
from jitterkit.vision import box_mean

_BAND = 0.45
"""Cycles/pixel; beyond, frames alias."""

_EDGE = 0.47
"""Cycles/pixel, from which a frame's power is taken for noise."""

_STRIPES = 0.05
"""Cycles/pixel; below, a scene may have few strong frequencies, and blurs of pixels hardly show."""

_ABOVE_NOISE = 4.0
"""Power of the sharp frame, in units of its noise, from which a frequency is compared."""

_LEAST_FREQUENCIES = 50
"""That must rise above the noise in the sharp frame."""

_GRIDS = fft.fftfreq, fft.rfftfreq
"""Of the frequencies along y and x."""

_ROUNDING = 1e-12
"""Share of the mean power that counts as noise, where frames have none."""

_STEPS = 30
"""Of a fit, at most: those that find a blur take 3 to 17, and the others find none in hundreds."""

_LEAST_GAIN = 1e-3
"""Ratio of two frames' fluxes."""

_REGULARISED = 10.0
"""Noise added to the denominator of the ratio of two transforms, in units of both frames' noise."""

_SEARCHED = 256
"""Side of the part in which starts are sought [pixels]; the winners are fitted to the whole frames."""

_LENGTHS, _REFINED = np.geomspace(0.3, 150.0, 60), 3
"""Streaks [pixels] that are compared, a tenth apart, and how many of the best are refined: every null of the
transfer function makes a maximum of its own, and a tenth is less than half the distance of two."""

_STARTS = -0.3, 0.05, 0.3, 1.0, 4.0
"""Moments to start from, in units of the widest normal that the data show: nulls make local minima, and those
of a blurrier reference hide behind a positive one."""

_LEAST_WINDOW = 16
"""Pixels that a blur must leave free of the borders, on each axis."""

_SIGMAS = 3.0
"""Extent of a normal."""

_SEARCH_BORDER = 0.125
"""Share of a side that is left out while the blur's extent is unknown."""


@dataclass(frozen=True, eq=False)
class Fit:
    """A blur and a shift fitted to two frames.

    Attributes
    ----------
    transfer : function
        :func:`normal` or :func:`streak`.
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
        Variance of a pixel of each; without it, the power at the highest frequencies.

    Attributes
    ----------
    frequencies : int
        Number of those that are compared: where the sharp frame rises above its noise, without stripes.
    """

    def __init__(self, one: np.ndarray, two: np.ndarray, noise: tuple[float, float] | None = None) -> None:
        self.one, self.two = one - one.mean(), two - two.mean()
        self._fy, self._fx = np.meshgrid(
            *(f(n) for f, n in zip(_GRIDS, one.shape, strict=True)), indexing="ij"
        )
        self._spectrum = fft.rfft2(self.one)
        window = np.outer(*(hann(n + 2)[1:-1] for n in one.shape))
        self._pair = [self._transform(frame, window) for frame in (one, two)]
        radius, powers = np.hypot(self._fx, self._fy), [np.abs(transform) ** 2 for transform in self._pair]
        # the median of an exponential law: stripes that reach so far are few frequencies
        first, second = (float(np.median(power[radius > _EDGE])) / np.log(2) for power in powers)
        self.noise, self._noise_is_measured = noise or (first, second), noise is None
        # chosen by the neighbourhood's power: by its own, a frequency would be chosen for its noise
        self._band = (radius > 0) & (radius < _BAND) & (box_mean(powers[0], 7) > _ABOVE_NOISE * self.noise[0])
        stripes = ndimage.binary_dilation(striped(powers[0], radius), np.ones((3, 3)))
        self._band &= ~(stripes & (radius > _STRIPES))
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
        return Comparison(self.one[cut], self.two[cut], self.noise)

    def holds(self, *extents: np.ndarray) -> bool:
        """Return whether enough of the frames is farther from the borders than every extent (x, y)."""
        return bool(np.all(np.array(self.one.shape[::-1]) - 2 * np.max(extents, axis=0) >= _LEAST_WINDOW + 2))

    def window(self, *extents: np.ndarray) -> np.ndarray:
        """Return a window (ny, nx) that is zero within every extent (x, y) of the borders."""
        borders = np.ceil(np.max(extents, axis=0)).astype(int)[::-1]
        sides = zip(self.one.shape, borders, strict=True)
        return np.outer(*(np.pad(hann(n - 2 * border + 2)[1:-1], border) for n, border in sides))

    def fit(self, transfer: Transfer, start: np.ndarray, window: np.ndarray, weights: np.ndarray) -> Fit:
        """Fit a blur from a start that may be far away; weights as :meth:`weights` has them."""

        def residuals(p: np.ndarray) -> np.ndarray:
            return self._weighed(self.two - self._image(self._response(transfer, p)), window, weights)

        def slopes(p: np.ndarray) -> np.ndarray:
            columns = [self._image(response) for response in self._slopes(transfer, p)]
            return -np.stack([self._weighed(image, window, weights) for image in columns], -1)

        found = least_squares(
            residuals, start, jac=slopes, x_scale="jac", xtol=1e-6, ftol=1e-8, max_nfev=_STEPS
        )
        ties = window.size * (window**4).sum() / (window**2).sum() ** 2  # of neighbouring frequencies
        misfit = 2 * found.cost / (len(found.fun) - len(found.x))
        scale = ties * (misfit if self._noise_is_measured else max(misfit, 1.0))
        # a motion along a line that is found to be none has no slopes
        sizes = np.maximum(np.linalg.norm(found.jac, axis=0), 1e-100)
        inverse = np.linalg.pinv((found.jac / sizes).T @ (found.jac / sizes), hermitian=True)
        return Fit(transfer, found.x, scale * inverse / np.outer(sizes, sizes), found.cost / ties)

    def noise_left(self, fit: Fit, window: np.ndarray) -> tuple[float, float]:
        """Return the variances of a pixel's noise in both frames that a fit's residuals have."""
        if not self._noise_is_measured:
            return self.noise
        rest = self.two - self._image(self._response(fit.transfer, fit.p))
        power = np.abs(self._transform(rest, window)[self._band]) ** 2
        blurred = self._gain(fit.transfer, fit.p) ** 2
        first, second = nnls(np.stack([blurred, np.ones_like(blurred)], -1), power)[0]
        return float(first), float(second)

    def unexplained(self, transfer: Transfer, p: np.ndarray, window: np.ndarray) -> tuple[float, float]:
        """Return the share of the second frame's power that a blur leaves with the best gain, and its log."""
        data, image = (
            self._transform(a, window)[self._band]
            for a in (self.two, self._image(self._response(transfer, p)))
        )
        gain = max(float(np.vdot(image, data).real / np.vdot(image, image).real), _LEAST_GAIN)
        rest, total = (float(np.sum(np.abs(a) ** 2)) for a in (data - gain * image, data))
        return rest / total, p[0] + float(np.log(gain))

    def surprise(self, fit: Fit, window: np.ndarray) -> float:
        """Return minus the log likelihood of a fit, up to a constant."""
        rest = self.two - self._image(self._response(fit.transfer, fit.p))
        weights = self.weights(fit.transfer, fit.p)
        return float(
            np.sum(np.abs(self._transform(rest, window)[self._band] * weights) ** 2 / 2 - 2 * np.log(weights))
        )

    def noise_share(self, fit: Fit, window: np.ndarray) -> float:
        """Return the share of the second frame's power that the noise of a blur's residuals has."""
        power = np.abs(self._transform(self.two, window)[self._band]) ** 2
        return float(np.sum(2 / self.weights(fit.transfer, fit.p) ** 2) / power.sum())

    def weights(
        self, transfer: Transfer, p: np.ndarray, noise: tuple[float, float] | None = None
    ) -> np.ndarray:
        """Return the weight of each frequency: the noise of the sharp frame is blurred by ``p``."""
        first, second = noise or self.noise
        return np.sqrt(2 / (second + self._gain(transfer, p) ** 2 * first + self._rounding))

    def _response(self, transfer: Transfer, p: np.ndarray) -> np.ndarray:
        return transfer(p[3:], self._fx, self._fy)[0] * self._moved(p)

    def _moved(self, p: np.ndarray) -> np.ndarray:
        return np.exp(p[0] - 2j * np.pi * (p[1] * self._fx + p[2] * self._fy))

    def _slopes(self, transfer: Transfer, p: np.ndarray) -> list[np.ndarray]:
        """Return the derivatives of the response by the parameters."""
        (blur, slopes), moved = transfer(p[3:], self._fx, self._fy), self._moved(p)
        turn = -2j * np.pi * blur * moved
        return [blur * moved, self._fx * turn, self._fy * turn, *(slope * moved for slope in slopes())]

    def _image(self, response: np.ndarray) -> np.ndarray:
        return fft.irfft2(self._spectrum * response, self.one.shape)

    def _transform(self, image: np.ndarray, window: np.ndarray) -> np.ndarray:
        windowed = (image - np.average(image, weights=window)) * window
        return fft.rfft2(windowed) / np.sqrt((window**2).sum())

    def _weighed(self, image: np.ndarray, window: np.ndarray, weights: np.ndarray) -> np.ndarray:
        spectrum = self._transform(image, window)[self._band] * weights
        return np.concatenate([spectrum.real, spectrum.imag])

    def _gain(self, transfer: Transfer, p: np.ndarray) -> np.ndarray:
        return np.exp(p[0]) * transfer(p[3:], self._fx[self._band], self._fy[self._band])[0]

    def kernel(self, x: float, y: float, side: int) -> np.ndarray:
        """Return the kernel (side, side) about a shift: the regularised ratio of the transforms, sum one."""
        one, two = self._pair
        ratio = two * one.conj() / (np.abs(one) ** 2 + _REGULARISED * sum(self.noise))
        whole = fft.irfft2(ratio * np.exp(2j * np.pi * (x * self._fx + y * self._fy)), self.one.shape)
        cut = np.roll(whole, (side // 2, side // 2), axis=(0, 1))[:side, :side]
        return cut / cut.sum()

    @property
    def widest(self) -> float:
        """Variance [pixel²] of a normal that leaves the scene's frequencies a third of their power."""
        square, power = (self._fx**2 + self._fy**2)[self._band], np.abs(self._pair[0])[self._band] ** 2
        return 1 / float(2 * np.pi**2 * np.average(square, weights=power))


@dataclass(frozen=True, eq=False)
class Blur:
    """What was found of a blur.

    Attributes
    ----------
    best : Fit
        The one that describes the frames best.
    normal : Fit
    left : float
        Share of the difference of the aligned frames that the best one leaves; 0 where noise may be all.
    """

    best: Fit
    normal: Fit
    left: float


_PENALTIES: dict[Transfer, float] = {normal: 2.0, streak: 0.0, drift: 10.0, vibration: 10.0}
"""Half of chi-squared that a blur must fit better by: a streak has one parameter less than a normal."""

_NOTICED = 0.5
"""Share of the noise (it was measured at the highest frequencies) from which an excess of power is none."""


def fit_blur(frames: Comparison, shift: tuple[float, float]) -> Blur:
    """Fit a normal, a streak, and a streak and a sine under a normal.

    Parameters
    ----------
    frames : Comparison
    shift : (float, float)
        Start of the shift (x, y) [pixels].

    Raises
    ------
    UndeterminedError
        If the sharp frame does not rise above its noise, or the blur reaches over the frames.
    """
    if frames.frequencies < _LEAST_FREQUENCIES:
        found = f"Only {frames.frequencies} frequencies of the sharp frame rise above its noise"
        raise UndeterminedError(ErrorCode.NO_SIGNAL, f"{found}; the fit needs {_LEAST_FREQUENCIES}.")
    part = frames.part(_SEARCHED)
    broad = _broadest(part, shift)
    angle = np.radians(principal_axes(broad[3:])[2])
    axis = np.array([np.cos(angle), np.sin(angle)])
    ranked = _compared(part, [np.array([*broad[:3], *(length * axis)]) for length in _LENGTHS])
    refined = [part.fit(streak, p, window, part.weights(streak, p)).p for _, p, window in ranked[:_REFINED]]
    compared = _compared(part, refined)
    if not compared:
        raise UndeterminedError(ErrorCode.TOO_FEW, _reaching_over(frames))
    line = compared[0][1]
    extents = [_extent(streak, line), _extent(normal, broad)]
    window = part.window(*(extents if part.holds(*extents) else extents[:1]))
    weights = part.weights(streak, line)
    fits = [part.fit(transfer, p, window, weights) for transfer, p in _starts(line, broad, axis)]
    best = min(fits, key=lambda fit: fit.cost + _PENALTIES[fit.transfer])
    if not frames.holds(_extent(best.transfer, best.p)):
        raise UndeterminedError(ErrorCode.TOO_FEW, _reaching_over(frames))
    window = frames.window(_extent(best.transfer, best.p))
    for noise in (frames.noise, None):
        noise = noise or frames.noise_left(best, window)
        best = frames.fit(best.transfer, best.p, window, frames.weights(best.transfer, best.p, noise))
    rest, noise_share = frames.unexplained(best.transfer, best.p, window)[0], frames.noise_share(best, window)
    sharp = frames.unexplained(normal, np.array([*best.p[:3], 0.0, 0.0, 0.0]), window)[0]
    excess = rest - noise_share
    return Blur(best, fits[0], excess / sharp if excess > _NOTICED * noise_share else 0.0)


def _reaching_over(frames: Comparison) -> str:
    sides = " x ".join(map(str, frames.one.shape[::-1]))
    return f"The blur and the shift reach over the frames of {sides} pixels; give larger frames."


def _starts(line: np.ndarray, broad: np.ndarray, axis: np.ndarray) -> list[tuple[Transfer, np.ndarray]]:
    """Return every kind of blur, from the best streak and the best normal."""
    x, y = line[3:]
    thin = np.array([x * x, x * y, y * y]) / 12
    major, minor, _ = axis_variances(broad[3:])
    wide = np.sqrt(12 * max(major - minor, 1e-4)) * axis
    return [
        (normal, broad),
        (streak, line),
        (drift, np.array([*line[:3], *thin, *(0.9 * line[3:])])),
        (drift, np.array([*broad, *(0.7 * wide)])),
        (vibration, np.array([*line[:3], *thin, *(0.8 * line[3:])])),
        (vibration, np.array([*broad, *(0.6 * wide)])),
    ]


def _broadest(frames: Comparison, shift: tuple[float, float]) -> np.ndarray:
    """Return the parameters of the best normal."""
    window = frames.window(_SEARCH_BORDER * np.array(frames.one.shape[::-1]))
    starts = [np.array([0.0, *shift, moment, 0.0, moment]) for moment in np.multiply(_STARTS, frames.widest)]
    for start in starts:
        start[0] = frames.unexplained(normal, start, window)[1]
    fits = [frames.fit(normal, start, window, frames.weights(normal, start)) for start in starts]
    return min(fits, key=lambda fit: frames.surprise(fit, window)).p


def _compared(frames: Comparison, lines: list[np.ndarray]) -> list[tuple[float, np.ndarray, np.ndarray]]:
    """Return what streaks that fit in leave unexplained, their parameters and windows, best first."""
    compared = []
    for p in lines:
        if frames.holds(_extent(streak, p)):
            window = frames.window(_extent(streak, p))
            rest, gain = frames.unexplained(streak, p, window)
            compared.append((rest, np.array([gain, *p[1:]]), window))
    return sorted(compared, key=lambda found: found[0])


def _extent(transfer: Transfer, p: np.ndarray) -> np.ndarray:
    """How far (x, y) a blur and a shift carry light [pixels]."""
    half = np.abs(p[3:]) / 2 if transfer is streak else _SIGMAS * np.sqrt(np.maximum(p[[3, 5]], 0))
    return half + np.abs(p[1:3]) + 1
