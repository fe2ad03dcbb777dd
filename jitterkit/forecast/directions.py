"""Combinations of parameters that a frame tells badly: reach for :func:`degenerate_directions`."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from jitterkit.forecast.bound import Forecast

_SHARE = 0.35
"""Of the largest weight, above which a parameter is named."""


class Direction(NamedTuple):
    """A combination of parameters that a frame tells badly.

    Attributes
    ----------
    stretch : float
        Its error over that which it would have if its parameters looked nothing like each other.
    weights : dict of name to float
        Change of each parameter along it, in errors it would have if all others were known; the squares of
        all weights sum to one, and the largest comes first.
    share : float
        Of the variance of the separation (or of the first parameter) that the direction makes up.

    Reach for :func:`degenerate_directions`, and print its elements.  Each parameter is measured in its own
    unit of knowledge, the error it would have if all others were known; a direction whose parameters do not
    resemble each other then has a stretch of one, and a confused one more.
    """

    stretch: float
    weights: dict[str, float]
    share: float

    def __str__(self) -> str:
        largest = max(abs(weight) for weight in self.weights.values())
        named = {name: w for name, w in self.weights.items() if abs(w) >= _SHARE * largest}
        sign = np.sign(next(iter(named.values())))
        up = [name for name, weight in named.items() if weight * sign > 0]
        down = [name for name, weight in named.items() if weight * sign < 0]
        words = f"{listed(up)} up" + (f" and {listed(down)} down" if down else "")
        return f"{words} change the image {self.stretch:.1f} times less than each alone"


def degenerate_directions(forecast: Forecast, least: float = 1.5) -> list[Direction]:
    """Combinations of parameters that the frame tells worse than their parts.

    Parameters
    ----------
    forecast : Forecast
    least : float
        Stretch from which a direction is worth telling.

    Returns
    -------
    directions : list of Direction
        The worst first: eigenvectors of the information in units that make its diagonal one, with
        ``stretch = eigenvalue**-0.5``.  Priors do not count.  None where the frame does not determine its
        parameters at all.
    """
    if not np.all(np.isfinite(forecast.covariance)):
        return []
    scale = np.sqrt(np.diag(forecast.information))
    values, vectors = np.linalg.eigh(forecast.information / np.outer(scale, scale))
    parts = (vectors[0] ** 2) / values
    directions = []
    for value, vector, part in zip(values, vectors.T, parts, strict=True):
        order = np.argsort(-np.abs(vector))
        weights = {forecast.names[i]: float(vector[i]) for i in order}
        directions.append(Direction(float(value**-0.5), weights, float(part / parts.sum())))
    return [direction for direction in directions if direction.stretch >= least]


def listed(names: list[str]) -> str:
    """Write a list of names: a, b and c."""
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
