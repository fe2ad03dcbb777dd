"""Draws from the posterior of a frame, as :func:`~jitterkit.refit.sampling.sample_posterior` makes them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode


@dataclass(frozen=True)
class Posterior:
    """Draws from the posterior of a frame, and how far they can be trusted.

    Attributes
    ----------
    names : tuple of str
        Of the parameters, as in the fit.
    draws : (n, p) array
        In the units of the fit; one chain after the other.
    moments : (n, 3) array
        Second moments ``(Sxx, Sxy, Syy)`` of the pointing in each draw, arcsec².
    log_density : (n,) array
        Minus half of what a fit calls its objective.
    effective : (p,) array
        Independent draws that would tell the mean of each parameter as well.
    rhat : (p,) array
        Spread of the halves of all chains together over that of one (split, by ranks); above 1.01 the chains
        have not seen the same posterior.
    error_err : (p,) array
        What the finite number of draws leaves uncertain of each :meth:`error`, 1 sigma; for 6000 draws from
        normals, whose errors are known, pulls by it had a standard deviation of 0.98.
    divergences : int
        Draws whose path broke off, at the border of valid scenes or in a place too narrow for its steps;
        many of them mean a part of the posterior that was not reached.
    acceptance : float
        Mean over the paths.
    seconds : float
        Compilation and warm-up included.
    """

    names: tuple[str, ...]
    draws: np.ndarray
    moments: np.ndarray
    log_density: np.ndarray
    effective: np.ndarray
    rhat: np.ndarray
    error_err: np.ndarray
    divergences: int
    acceptance: float
    seconds: float

    def index(self, name: str) -> int:
        """Column of a parameter."""
        if name not in self.names:
            problem = f"There are no draws of {name!r}; there are of {', '.join(self.names)}."
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, problem)
        return self.names.index(name)

    def of(self, name: str) -> np.ndarray:
        """Draws (n,) of a parameter."""
        return self.draws[:, self.index(name)]

    def mean(self, name: str) -> float:
        """Mean of a parameter."""
        return float(self.of(name).mean())

    def error(self, name: str) -> float:
        """Standard deviation of a parameter: what a fit's ``error`` approximates."""
        return float(self.of(name).std(ddof=1))

    def quantile(self, name: str, q: float) -> float:
        """Value below which a share ``q`` of the posterior lies."""
        return float(np.quantile(self.of(name), q))
