"""Whether a fitted locus describes an image's blur, by one scoring step and no other fit.

Multiply its transfer function by ``exp(sum kappa_n (-2 pi i f)^n / n!)`` over third and fourth cumulants.  At
zero they change nothing; the score in their directions, everything that was fitted free beside them,
says whether the image wants them.
"""

from __future__ import annotations

from typing import NamedTuple, Self

import jax.numpy as jnp
import numpy as np
import scipy.stats
from jaxtyping import Array, Float

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forward import parameter_names
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Locus
from jitterkit.optics.otf import OTF
from jitterkit.refit.result import FitResult

__all__ = ["LackOfFit", "WithCumulants", "lack_of_fit"]

_CUMULANTS = tuple(f"cumulant{n}{k}" for n in (3, 4) for k in range(n + 1))
"""``xxx, xxy, xyy, yyy, xxxx, ...``"""


class LackOfFit(NamedTuple):
    """What is left in an image of its blur's higher cumulants.

    Attributes
    ----------
    chance : float
        That a frame of this locus would show as much: uniform in [0, 1] if the locus is right, tiny
        where the blur is lopsided or of another shape.
    chi2 : float
        What a scoring step in the cumulants would take off chi-squared.
    """

    chance: float
    chi2: float


class WithCumulants(Locus):
    """A locus whose third and fourth cumulants are off by the last nine coordinates.

    To first order in them: it need not be a density, so only what a scoring step asks for differs
    from the locus itself.
    """

    coords: Float[Array, " k"]
    locus: Locus

    def __init__(self, locus: Locus, cumulants=None) -> None:
        own = jnp.zeros(len(_CUMULANTS)) if cumulants is None else jnp.asarray(cumulants)
        self.coords = jnp.concatenate([locus.coords, own])
        self.locus = locus

    @property
    def names(self) -> tuple[str, ...]:  # type: ignore[override]
        """Those of the locus, then the cumulants'."""
        return (*self.locus.names, *_CUMULANTS)

    @property
    def inner(self) -> Locus:
        """The locus at its present size."""
        return self.locus.at(self.coords[: -len(_CUMULANTS)])

    @classmethod
    def near(cls, moments) -> Self:
        raise ConfigurationError(
            ErrorCode.UNSUPPORTED, "Cumulants do not follow from second moments; put them on a locus."
        )

    def transfer(self, fx, fy):
        x, y, c = 2 * jnp.pi * fx, 2 * jnp.pi * fy, self.coords[-len(_CUMULANTS) :]
        odd = c[0] * x**3 + 3 * c[1] * x**2 * y + 3 * c[2] * x * y**2 + c[3] * y**3
        even = c[4] * x**4 + 4 * c[5] * x**3 * y + 6 * c[6] * x**2 * y**2 + 4 * c[7] * x * y**3 + c[8] * y**4
        return self.inner.transfer(fx, fy) * jnp.exp(1j * odd / 6 + even / 24)

    def moments(self):
        return self.inner.moments()

    def describe(self) -> dict[str, float]:
        cumulants = map(float, self.coords[-len(_CUMULANTS) :])
        return self.inner.describe() | dict(zip(_CUMULANTS, cumulants, strict=True))

    def points(self, n: int) -> np.ndarray:
        return self.inner.points(n)

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        return self.inner.trace(n, rng)


def lack_of_fit(fit: FitResult, otf: OTF, data: Data) -> LackOfFit:
    """Test whether a frame wants higher cumulants than a fitted locus has.

    Parameters
    ----------
    fit : FitResult
    otf : OTF
        Expanded near where the fit ended.
    data : Data

    Returns
    -------
    lack : LackOfFit

    Raises
    ------
    numpy.linalg.LinAlgError
        If the image does not show all of them.

    Notes
    -----
    Chi-squared of the score in nine directions.  Sharper than chi-squared over all pixels, which a wrong
    shape of 9 sigma raises by half its own scatter.
    """
    assert fit.parameters is not None
    wider = fit.parameters.with_locus(WithCumulants(fit.parameters.locus))
    every = parameter_names(wider, otf.names)
    free = tuple(i for i, name in enumerate(every) if name in fit.names or name in _CUMULANTS)
    equations = normal_equations(wider, otf, data, free, exact=False)
    score, information = np.asarray(equations.score), np.asarray(equations.information)
    asked = np.array([every[i] in _CUMULANTS for i in free])
    beside = np.linalg.solve(information[np.ix_(~asked, ~asked)], information[np.ix_(~asked, asked)])
    told = information[np.ix_(asked, asked)] - information[np.ix_(asked, ~asked)] @ beside
    slope = score[asked] - beside.T @ score[~asked]
    chi2 = float(np.sum(np.linalg.solve(np.linalg.cholesky(told), slope) ** 2))
    return LackOfFit(float(scipy.stats.chi2.sf(chi2, len(slope))), chi2)
