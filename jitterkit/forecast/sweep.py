"""A forecast over a range of settings: the curves that an engineer reads a requirement from."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from jitterkit.forecast.bound import Forecast


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
