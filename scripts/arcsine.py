"""How long a vibration lingers where: the arcsine law of simple harmonic motion.

The paper's appendix B: of ``x = A sin t`` at random times the density is ``1 / (pi sqrt(A² - x²))``, and its
integral ``arcsin(x/A) / pi`` has a closed form, so that a cell's share of the time needs no sampling.
"""

from __future__ import annotations

import numpy as np

from jitterkit.errors import positive


def arcsine_density(x, amplitude: float) -> np.ndarray:
    """Density of simple harmonic motion over whole cycles.

    Parameters
    ----------
    x : array
        Offsets from the middle, in any unit.
    amplitude : float
        Zero to peak, in the same unit.

    Returns
    -------
    density : array
        Per unit; infinite at both ends (integrably), zero beyond.

    >>> float(arcsine_density(0.0, 2.0) * 2 * np.pi)
    1.0
    """
    x, amplitude = np.asarray(x, float), positive("amplitude", amplitude)
    inside = np.abs(x) <= amplitude
    with np.errstate(divide="ignore"):
        return np.where(inside, 1 / (np.pi * np.sqrt(np.where(inside, amplitude**2 - x**2, 1.0))), 0.0)


def arcsine_shares(edges, amplitude: float) -> np.ndarray:
    """Return the share of the time in each cell, exactly.

    Parameters
    ----------
    edges : (n + 1,) array
        Of the cells, ascending.
    amplitude : float

    Returns
    -------
    shares : (n,) array
        Sum to one where the cells hold the whole motion.

    >>> arcsine_shares([-1.0, -0.5, 0.5, 1.0], 1.0)
    array([0.33333333, 0.33333333, 0.33333333])
    """
    ends = np.clip(np.asarray(edges, float) / positive("amplitude", amplitude), -1, 1)
    return np.diff(np.arcsin(ends)) / np.pi
