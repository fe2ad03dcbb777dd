"""A pupil: what the telescope does to the wavefront before it forms an image; Zernike polynomials."""

from __future__ import annotations

import math
from collections.abc import Sequence

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from jitterkit.conventions import offsets
from jitterkit.errors import ConfigurationError, ErrorCode

_SHADINGS = {"x": lambda x, y: x, "y": lambda x, y: y, "r": lambda x, y: x**2 + y**2}
"""Modes of the transmission over a grid from -1 to 1, before they are made free of light and of unit rms."""


class Pupil(eqx.Module):
    """Amplitude, static wavefront error and the aberrations that may vary, on one square grid.

    Attributes
    ----------
    transmission : (n, n) array
        Amplitude transmission, 0 to 1.
    opd : (n, n) array
        Static optical path difference, nm.
    basis : (k, n, n) array
        Aberration modes; a coefficient of one is one nm of the mode.
    names : tuple of str
        One a mode, such as ``noll4``, those of the transmission last; they become parameter names.
    diameter : float
        Width of the grid, m (n samples of diameter/n, symmetric about the axis).
    shading : (a, n, n) array
        Modes of the logarithm of the transmission; a coefficient of 0.01 is 1 % of the mode.
    light : scalar array
        Power that passes, in that of a clear sample.
    """

    transmission: Float[Array, "n n"]
    opd: Float[Array, "n n"]
    basis: Float[Array, "k n n"]
    names: tuple[str, ...] = eqx.field(static=True)
    diameter: float = eqx.field(static=True)
    shading: Float[Array, "a n n"]
    light: Float[Array, ""]

    def __init__(
        self,
        transmission,
        diameter: float,
        opd=None,
        basis=None,
        names: Sequence[str] | None = None,
        shading=None,
        light: float | None = None,
    ) -> None:
        """Check shapes; ``opd``, ``basis`` and ``shading`` default to none.

        ``light`` defaults to the sum of the squared transmission.  A sample that a hard edge cuts has the
        mean amplitude of its parts but passes more, the mean of their squares: who drew the edge knows.

        Raises
        ------
        ConfigurationError
            If the arrays do not fit together, hold NaN, or the transmission passes no light.
        """
        transmission = np.asarray(transmission, dtype=float)
        opd = np.zeros_like(transmission) if opd is None else np.asarray(opd, dtype=float)
        basis = np.zeros((0, *transmission.shape)) if basis is None else np.asarray(basis, dtype=float)
        none = np.zeros((0, *transmission.shape))
        shading = none if shading is None else np.asarray(shading, dtype=float)
        if transmission.ndim != 2 or transmission.shape[0] != transmission.shape[1]:
            problem = f"A pupil must be square, got a transmission of {transmission.shape}."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
        modes = [planes.shape for planes in (basis, shading)]
        if opd.shape != transmission.shape or any(shape[1:] != opd.shape for shape in modes):
            raise ConfigurationError(
                ErrorCode.WRONG_SHAPE,
                f"The pupil's arrays differ in shape: transmission {transmission.shape}, opd {opd.shape}, "
                f"basis {modes[0]}, shading {modes[1]}; expected (n, n), (n, n), (k, n, n), (a, n, n).",
            )
        missing = sum(np.count_nonzero(~np.isfinite(a)) for a in (transmission, opd, basis, shading))
        if missing:
            problem = f"The pupil holds {missing} NaN or infinite values; set them to zero first."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        if not np.any(transmission):
            raise ConfigurationError(
                ErrorCode.OUT_OF_RANGE,
                f"The pupil passes no light: its transmission of {transmission.shape} is zero everywhere; "
                "give 1 where it is clear.",
            )
        if not diameter > 0:
            problem = f"The pupil's diameter must be positive, in m; got {diameter}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        count = len(basis) + len(shading)
        names = tuple(f"mode{k}" for k in range(count)) if names is None else tuple(names)
        if len(names) != count:
            problem = f"The pupil has {count} modes but {len(names)} names; give each mode one."
            raise ConfigurationError(ErrorCode.WRONG_SHAPE, problem)
        twice = [name for name in names if names.count(name) > 1]
        if twice:
            problem = f"Two modes of the pupil are called {twice[0]!r}; give each its own name."
            raise ConfigurationError(ErrorCode.DUPLICATE, problem)
        self.transmission, self.opd, self.basis, self.shading = transmission, opd, basis, shading
        self.names, self.diameter = names, float(diameter)
        light = float(np.sum(transmission**2) if light is None else light)
        if not (light > 0 and np.isfinite(light)):
            problem = f"The pupil's light must be positive, in samples; got {light}."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        self.light = np.full_like(transmission[0, 0], light)

    @property
    def pitch(self) -> float:
        """Sample pitch, m."""
        return self.diameter / self.transmission.shape[0]

    @property
    def cutoff_diameter(self) -> float:
        """Largest distance between two samples that pass light, along an axis [m]: it sets the cutoff."""
        lit = np.asarray(self.transmission) > 0
        extents = [np.flatnonzero(lit.any(axis=axis)) for axis in (0, 1)]
        return max(float(e[-1] - e[0] + 1) for e in extents) * self.pitch

    def binned(self, factor: int) -> Pupil:
        """Return the pupil on coarser samples, each the mean of ``factor`` x ``factor``.

        An edge between two wavefronts is a sample of their mean there, as an edge of the aperture is grey.

        Raises
        ------
        ConfigurationError
            If the factor does not divide the number of samples.
        """
        n = self.transmission.shape[0]
        if factor < 1 or n % factor:
            problem = f"A pupil of {n} samples cannot be binned by {factor}; give a divisor."
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
        if factor == 1:
            return self

        def coarser(planes):
            blocks = np.reshape(planes, (*np.shape(planes)[:-2], n // factor, factor, n // factor, factor))
            return blocks.mean(axis=(-3, -1))

        opd, basis, shading = map(coarser, (self.opd, self.basis, self.shading))
        light = float(self.light) / factor**2
        return Pupil(coarser(self.transmission), self.diameter, opd, basis, self.names, shading, light)

    def with_shading(self, kinds: Sequence[str]) -> Pupil:
        """Return the pupil with these modes of the transmission that may vary, and no others.

        They have unit rms over the lit pupil.

        Parameters
        ----------
        kinds : sequence of str
            ``"x"``, ``"y"`` for gradients, ``"r"`` for a change from the middle to the edge, by the square of
            the radius.  Their names are ``transmission_x`` and so on.

        Raises
        ------
        ConfigurationError
            If a kind is none of these, or given twice.
        """
        wrong = [kind for kind in kinds if kind not in _SHADINGS or list(kinds).count(kind) > 1]
        if wrong:
            problem = f"{wrong[0]!r} is no mode of the transmission, or stands twice"
            remedy = f"give some of {', '.join(_SHADINGS)}"
            raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {remedy}.")
        axis, light = offsets(len(self.opd), 2.0 / len(self.opd)), np.asarray(self.transmission) ** 2
        planes = []
        for kind in kinds:
            plane = _SHADINGS[kind](*np.meshgrid(axis, axis))
            plane = plane - np.average(plane, weights=light)  # the light in the pupil stays, to first order
            planes.append(plane / np.sqrt(np.average(plane**2, weights=light)))
        names = (*self.names[: len(self.basis)], *(f"transmission_{kind}" for kind in kinds))
        shading = np.array(planes).reshape(-1, *self.opd.shape)
        return Pupil(
            self.transmission, self.diameter, self.opd, self.basis, names, shading, float(self.light)
        )


def obstructed_circle(
    diameter: float,
    obscuration: float = 0.0,
    *,
    strut_width: float = 0.0,
    struts: int = 0,
    noll: Sequence[int] = (4, 5, 6, 7, 8, 9, 10),
    samples: int = 256,
) -> Pupil:
    """Return a circular telescope with a central obscuration and straight struts.

    Parameters
    ----------
    diameter : float
        Clear aperture, m.
    obscuration : float
        Diameter of the central obscuration, m.
    strut_width : float
        m; the struts run from the centre outwards, the first towards +x.
    struts : int
        Number of equally spaced struts.
    noll : sequence of int
        Zernike modes that may vary, unit rms over the clear disc.
    samples : int
        Grid size; edges are softened by averaging 8 x 8 points a sample.

    Returns
    -------
    pupil : Pupil
        Its PSF tends to the Airy pattern as ``obscuration`` goes to zero.
    """
    if not 0 <= obscuration < diameter:
        problem = f"The obscuration must lie between 0 and the diameter of {diameter} m"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, got {obscuration} m.")
    oversample = 8
    x = offsets(samples * oversample, diameter / (samples * oversample))

    def clear_shares(y: np.ndarray) -> np.ndarray:
        """Return the clear shares (samples,) of a row of samples, whose points have these heights."""
        radius = np.hypot(x, y)
        clear = (radius <= diameter / 2) & (radius >= obscuration / 2)
        for k in range(struts):
            azimuth = 2 * np.pi * k / struts
            along = x * np.cos(azimuth) + y * np.sin(azimuth)
            across = y * np.cos(azimuth) - x * np.sin(azimuth)
            clear &= ~((along > 0) & (np.abs(across) < strut_width / 2))
        return clear.reshape(oversample, samples, oversample).mean(axis=(0, 2))

    # row by row: to get the memory for all points at once takes half a second to a second
    transmission = np.array([clear_shares(y) for y in x.reshape(samples, oversample, 1)])
    return open_pupil(transmission, diameter, noll)


def open_pupil(transmission: np.ndarray, diameter: float, noll: Sequence[int]) -> Pupil:
    """Return a pupil of clear shares (n, n) of samples, with Zernike modes over the disc of its width [m]."""
    samples = len(transmission)
    axis = offsets(samples, 2.0 / samples)
    x, y = np.meshgrid(axis, axis)
    basis = np.array([zernike(j, x, y) for j in noll]).reshape(-1, samples, samples)
    names = [f"noll{j}" for j in noll]
    return Pupil(transmission, diameter, basis=basis, names=names, light=transmission.sum())


def noll_to_nm(index: int) -> tuple[int, int]:
    """Radial and azimuthal order of Noll's polynomial; ``m < 0`` marks the sine.

    >>> [noll_to_nm(j) for j in (1, 4, 7, 10)]
    [(0, 0), (2, 0), (3, -1), (3, 3)]
    """
    if index < 1:
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"Noll's indices start at 1, got {index}.")
    n = int((math.sqrt(8 * index - 7) - 1) / 2)
    rank = index - n * (n + 1) // 2 - 1
    m = 2 * ((rank + 1) // 2) if n % 2 == 0 else 2 * (rank // 2) + 1
    return n, m if index % 2 == 0 else -m


def zernike(index: int, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Noll's polynomial at points of the plane; it continues beyond the disc, where a pupil is dark.

    Parameters
    ----------
    index : int
        Noll index, from 1 (piston); 4 is defocus, 5-6 astigmatism, 7-8 coma, 9-10 trefoil.
    x, y : arrays
        Coordinates in units of the disc's radius; the azimuth runs counter-clockwise from +x.

    Returns
    -------
    values : array
        Unit rms over the disc.

    Noll, J. Opt. Soc. Am. 66, 207 (1976).
    """
    n, m = noll_to_nm(index)
    order = abs(m)
    rho, azimuth = np.hypot(x, y), np.arctan2(y, x)
    radial = sum(
        (-1) ** k
        * math.factorial(n - k)
        / (math.factorial(k) * math.factorial((n + order) // 2 - k) * math.factorial((n - order) // 2 - k))
        * rho ** (n - 2 * k)
        for k in range((n - order) // 2 + 1)
    )
    angular = np.cos(order * azimuth) if m >= 0 else np.sin(order * azimuth)
    scale = math.sqrt(n + 1) * (1.0 if m == 0 else math.sqrt(2.0))
    return scale * radial * angular
