"""What a frame shows of its blur beyond the second moments: two tests, one scoring step each.

Multiply a fitted locus by ``exp(sum kappa_n (-2 pi i f)^n / n!)`` over its third and fourth cumulants; at
zero they change nothing, and the score in their directions, everything else free beside them, says
whether the image wants them.  :func:`measure_shape` turns that into the excess kurtosis of a normal,
:func:`lack_of_fit` into the chance that a locus fits.  Neither fits anything anew.
"""

from __future__ import annotations

from typing import ClassVar, NamedTuple, Self

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import scipy.stats

from jitterkit.forward import Parameters, parameter_names
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Locus, Product
from jitterkit.optics.otf import OTF
from jitterkit.refit.result import FitResult

__all__ = ["Cumulants", "LackOfFit", "Shape", "lack_of_fit", "measure_shape"]

_BLIND = 1e-8
"""Share of the strongest direction's information below which a direction is not seen at all."""


class Shape(NamedTuple):
    """What one scoring step from a normal says about the shape of a blur.

    Attributes
    ----------
    kurtosis, error : float
        Excess kurtosis, the same along every axis: linear -1.2, SHM -1.5.  One step: too small a
        number where the blur is as large as the resolution and far from normal.
    response : float
        Change of the fitted separation for a unit of kurtosis that the locus leaves out, arcsec.
    """

    kurtosis: float
    error: float
    response: float


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


class Cumulants(Locus):
    """Third and fourth cumulants to multiply on a locus: ``xxx, xxy, xyy, yyy, xxxx, ...``."""

    names: ClassVar[tuple[str, ...]] = tuple(f"cumulant{n}{k}" for n in (3, 4) for k in range(n + 1))

    @classmethod
    def near(cls, moments) -> Self:
        return cls(jnp.zeros(9))

    def transfer(self, fx, fy):
        x, y, c = 2 * jnp.pi * fx, 2 * jnp.pi * fy, self.coords
        odd = c[0] * x**3 + 3 * c[1] * x**2 * y + 3 * c[2] * x * y**2 + c[3] * y**3
        even = c[4] * x**4 + 4 * c[5] * x**3 * y + 6 * c[6] * x**2 * y**2 + 4 * c[7] * x * y**3 + c[8] * y**4
        return jnp.exp(1j * odd / 6 + even / 24)

    def moments(self):
        return jnp.zeros(3)

    def describe(self) -> dict[str, float]:
        return dict(zip(self.names, map(float, self.coords), strict=True))

    def points(self, n: int) -> np.ndarray:
        raise NotImplementedError("Cumulants alone are no density.")

    def trace(self, n: int, rng: np.random.Generator) -> np.ndarray:
        raise NotImplementedError("Cumulants alone are no density.")


def measure_shape(normal: FitResult, otf: OTF, data: Data) -> Shape:
    """Excess kurtosis of a blur, by one scoring step from a fitted normal.

    Parameters
    ----------
    normal : FitResult
        With locus ``mvn``.
    otf : OTF
        Expanded where the fit ended.
    data : Data

    Returns
    -------
    shape : Shape
        NaN where the frame does not determine it.
    """
    score, information, names = _score(normal, otf, data)
    own = len(normal.names)
    sxx, sxy, syy = np.asarray(normal.moments()[0])
    cross = (2 * sxy**2 + sxx * syy) / 3
    fourth = np.array(
        [0, 0, 0, 0, sxx**2, sxx * sxy, cross, sxy * syy, syy**2]
    )  # of a unit kurtosis: Σ ⊗ Σ, symmetric
    turn = np.vstack([np.eye(own, len(names)), np.concatenate([np.zeros(own), fourth])])
    score, information = turn @ score, turn @ information @ turn.T
    beside = np.linalg.solve(information[:own, :own], information[:own, own])
    told = information[own, own] - information[own, :own] @ beside
    if not told > 0:
        return Shape(np.nan, np.nan, np.nan)
    kurtosis = (score[own] - beside @ score[:own]) / told
    response = beside[names.index("separation")] if "separation" in normal.names else 0.0
    return Shape(float(kurtosis), float(told**-0.5), float(response))


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

    Notes
    -----
    Chi-squared of the score in the directions that the image shows, nine at most.  Sharper than
    chi-squared over all pixels, which a wrong shape of 9 sigma raises by half its own scatter.
    """
    score, information, _ = _score(fit, otf, data)
    own = len(fit.names)
    beside = np.linalg.solve(information[:own, :own], information[:own, own:])
    told = information[own:, own:] - information[own:, :own] @ beside
    slope = score[own:] - beside.T @ score[:own]
    scale = np.sqrt(np.diag(information)[own:])
    values, vectors = np.linalg.eigh(told / np.outer(scale, scale))
    seen = values > _BLIND * values[-1]
    along = vectors[:, seen].T @ (slope / scale)
    chi2 = float(np.sum(along**2 / values[seen]))
    return LackOfFit(float(scipy.stats.chi2.sf(chi2, seen.sum())), chi2)


def _score(fit: FitResult, otf: OTF, data: Data):
    """Score, information and names of a fit's free parameters, followed by the cumulants'."""
    assert fit.parameters is not None
    here = fit.parameters
    locus = Product(here.locus, Cumulants.near(None))
    wider = Parameters(here.scene, locus, here.aberrations, here.background)
    every = parameter_names(wider, otf.names)
    free = tuple(i for i, name in enumerate(every) if name in fit.names or name in Cumulants.names)
    names = [every[i] for i in free]
    order = [i for i, n in enumerate(names) if n in fit.names] + [
        i for i, n in enumerate(names) if n not in fit.names
    ]
    equations = _equations(wider, otf, data, free)
    score, information = np.asarray(equations.score), np.asarray(equations.information)
    return score[order], information[np.ix_(order, order)], [names[i] for i in order]


_equations = eqx.filter_jit(normal_equations)
