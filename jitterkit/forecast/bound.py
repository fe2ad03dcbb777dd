"""What a frame will tell, before it is taken: expected Fisher information and the Cramér-Rao bound.

Reach for :func:`forecast`.  It asks the likelihood of the refit itself, at the image that the model expects
and with the noise and the saturated pixels of the detector, so that a fit without priors has exactly these
errors on average.  :func:`sweep` asks it over a range of settings.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import jax
import numpy as np

from jitterkit.conventions import axis_angle
from jitterkit.detectors import Detector
from jitterkit.errors import ConfigurationError, ErrorCode, positive
from jitterkit.forward import Parameters, expected_image, free_parameters, to_vector
from jitterkit.frames.frame import RawFrame
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import axis_variances, covariance_on_axis
from jitterkit.loci.base import moments_of
from jitterkit.metric import invert_information
from jitterkit.optics.otf import OTF
from jitterkit.refit import FitOptions

_LINE = 1e-6
"""Of the major variance's error, below which that of the minor is rounding: the locus is a line."""


@dataclass(frozen=True)
class Forecast:
    """Information of one frame about its parameters.

    Attributes
    ----------
    parameters : Parameters
        What the frame is expected to show.
    names : tuple of str
        Of the free parameters.
    information : (p, p) array
        Expected Fisher information of the frame alone.
    covariance : (p, p) array
        The Cramér-Rao bound: inverse of the information, that of the priors added.  NaN where the frame does
        not determine its parameters.
    values : (p,) array
        Of the free parameters.
    masked : int
        Pixels that saturate, or are bad, and tell nothing.
    """

    parameters: Parameters
    names: tuple[str, ...]
    information: np.ndarray
    covariance: np.ndarray
    values: np.ndarray
    masked: int = 0

    def error(self, name: str) -> float:
        """Return the least standard error of a free parameter.

        Raises
        ------
        ConfigurationError
            If it is not among the free ones.
        """
        i = self._slot(name)
        return float(np.sqrt(self.covariance[i, i]))

    def inflation(self, name: str) -> float:
        """Times by which not knowing the other parameters widens the error of one; 1 if it stands alone.

        Less where a prior tells more than the frame.
        """
        i = self._slot(name)
        return self.error(name) * float(np.sqrt(self.information[i, i]))

    def frames(self, target: float, name: str = "separation") -> float:
        """Frames like this one whose mean has a given standard error: ``(error / target)²``, not rounded.

        Parameters
        ----------
        target : float
            In the parameter's own unit.
        name : str

        Raises
        ------
        ConfigurationError
            If the target is not positive.
        """
        return (self.error(name) / positive(f"target of {name}", target)) ** 2

    @property
    def correlation(self) -> np.ndarray:
        """Correlations (p, p) of the errors."""
        sigma = np.sqrt(np.diag(self.covariance))
        return self.covariance / np.outer(sigma, sigma)

    def jitter(self) -> dict[str, tuple[float, float]]:
        """Return the size and axis of the jitter with their errors, by name: arcsec, and degrees.

        Returns
        -------
        sizes : dict of name to (value, error)
            ``jitter_major`` and ``jitter_minor``, one sigma along the principal axes; ``jitter_angle`` of the
            major one, and ``length`` where the locus has one.  Errors by first-order propagation, which means
            nothing where they are as large as the value; infinite where a size is zero that need not be, or
            is not all free.
        """
        locus = self.parameters.locus
        if not locus.names:
            return {}
        moments, covariance = moments_of(locus, self.names, self.covariance, order=1)
        major, minor, angle = axis_variances(moments)
        errors = np.sqrt(np.diag(covariance_on_axis(covariance, angle)).clip(0))  # rounding about a line
        sizes = {
            "jitter_major": _root(major, float(errors[0])),
            "jitter_minor": _root(minor, float(errors[2]) if errors[2] > _LINE * errors[0] else 0.0),
            "jitter_angle": (axis_angle(angle), math.degrees(_quotient(float(errors[1]), major - minor))),
        }
        if "length" in locus.describe():
            sizes["length"] = self._length()
        return sizes

    def _length(self) -> tuple[float, float]:
        """Return the length of the locus, with its error by differences over a thousandth of each error."""
        locus = self.parameters.locus
        length = locus.describe()["length"]
        indices = [self.names.index(name) for name in locus.names if name in self.names]
        if length == 0 or len(indices) < len(locus.names):
            return length, math.inf
        covariance = self.covariance[np.ix_(indices, indices)]
        steps = 1e-3 * np.sqrt(np.diag(covariance)) * np.eye(len(indices))
        ends = [
            [locus.at(locus.coords + sign * step).describe()["length"] for sign in (1, -1)] for step in steps
        ]
        slope = (np.array(ends) @ [1, -1]) / (2 * np.diag(steps))
        return length, float(np.sqrt(slope @ covariance @ slope))

    def _slot(self, name: str) -> int:
        if name not in self.names:
            problem = f"{name!r} is not among the free parameters {', '.join(self.names)}."
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, problem)
        return self.names.index(name)


def forecast(
    parameters: Parameters,
    otf: OTF,
    detector: Detector | None = None,
    options: FitOptions | None = None,
    *,
    exposure: float = 0.0,
    censored: bool = False,
) -> Forecast:
    """Forecast what a frame tells about its parameters.

    Parameters
    ----------
    parameters : Parameters
        What the frame shows; the locus it carries is the one that is fitted.
    otf : OTF
        Expanded at the parameters' aberrations.
    detector : Detector, optional
        Adds read-out noise and rounding, and takes away saturated and bad pixels; by default one that counts
        electrons without noise.
    options : FitOptions, optional
        What a fit holds and what it knows beforehand.
    exposure : float
        s, for the detector's dark current.
    censored : bool
        Whether full pixels count with the probability of being full, as in
        :meth:`jitterkit.likelihood.Data.of`.

    Returns
    -------
    forecast : Forecast

    Raises
    ------
    ConfigurationError
        If an option names a parameter that there is not.

    Notes
    -----
    *Assumes* that the errors are small enough for the model to be linear: at a streak of zero length, where
    it is a cone, the bound is that along the cone's axis, which no estimator attains.
    """
    options = FitOptions() if options is None else options
    parameters = parameters.completed(otf)
    names, free = free_parameters(parameters, otf, options.hold)
    data = expected_data(parameters, otf, detector, exposure=exposure, censored=censored)
    prior = options.priors.over(names, parameters.locus)
    information = np.asarray(normal_equations(parameters, otf, data, free).information)
    vector, unravel = to_vector(parameters)
    slope = jax.jacfwd(lambda v: unravel(v).locus.moments())(vector)[:, np.array(free, int)]
    masked = int(np.sum(~np.asarray(data.used)))
    covariance, _ = invert_information(information + np.asarray(prior.stiffness(slope)))
    return Forecast(parameters, names, information, covariance, np.asarray(vector)[list(free)], masked)


def expected_data(
    parameters: Parameters,
    otf: OTF,
    detector: Detector | None = None,
    *,
    exposure: float = 0.0,
    censored: bool = False,
) -> Data:
    """Return a frame as it is expected, without noise, and how far a detector's pixels are to be trusted.

    Parameters
    ----------
    parameters, otf, detector, exposure, censored
        As for :func:`forecast`.

    Returns
    -------
    data : Data
        Of the expected electrons, read out by the detector and calibrated.  What comes near its ceiling is
        left out as in a fit, or counts as far as it tells anything.
    """
    image = np.asarray(expected_image(parameters, otf))
    if detector is None:
        return Data(image)
    readings = detector.expose(image, exposure=exposure)
    frame = detector.calibrate(RawFrame.from_array(readings, exposure=exposure))
    return Data.of(replace(frame, electrons=image), censored=censored).clear(image)


def _root(variance: float, error: float) -> tuple[float, float]:
    """Return a standard deviation and its error from a variance and its own; zero of a negative one."""
    root = math.sqrt(max(variance, 0.0))
    return (root, _quotient(error, 2 * root)) if error > 0 else (root, 0.0)


def _quotient(top: float, bottom: float) -> float:
    return top / bottom if bottom > 0 else math.inf


@dataclass(frozen=True)
class Sweep:
    """Forecasts on a grid.

    Attributes
    ----------
    axes : dict of name to (n,) array
        The settings that vary, in the order of the grid's dimensions.
    forecasts : (n, m, ...) array of Forecast
    """

    axes: dict[str, np.ndarray]
    forecasts: np.ndarray

    def error(self, name: str = "separation") -> np.ndarray:
        """Return the least error of a parameter at every point of the grid."""
        every = np.array([one.error(name) for one in self.forecasts.ravel()])
        return every.reshape(self.forecasts.shape)

    def points(self) -> dict[str, np.ndarray]:
        """Return each setting at every point of the grid, in the order of ``forecasts.ravel()``."""
        grids = np.meshgrid(*self.axes.values(), indexing="ij")
        return {name: grid.ravel() for name, grid in zip(self.axes, grids, strict=True)}


def sweep(point: Callable[..., Forecast], axes: Mapping[str, Sequence[float]]) -> Sweep:
    """Forecast every combination of settings.

    Parameters
    ----------
    point : callable
        Makes the forecast of one combination, given by name.
    axes : mapping of name to values

    Examples
    --------
    >>> grid = sweep(lambda length, angle: length * angle, {"length": [1.0, 2.0], "angle": [3.0, 4.0, 5.0]})
    >>> grid.forecasts.shape
    (2, 3)
    """
    ranges = {name: np.asarray(values) for name, values in axes.items()}
    forecasts = np.empty([len(values) for values in ranges.values()], object)
    for index in itertools.product(*(range(n) for n in forecasts.shape)):
        setting = {name: values[i] for i, (name, values) in zip(index, ranges.items(), strict=True)}
        forecasts[index] = point(**setting)
    return Sweep(ranges, forecasts)
