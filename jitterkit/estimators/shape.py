"""The shape of a blur: tested by one scoring step, fitted by a few, and believed by one rule.

:class:`CumulantStep` tests whether an image that a locus describes wants other cumulants, and which excess
kurtosis one wants that a normal describes.  :func:`fit_shape` fits that kurtosis, or a
blur whose kurtosis is known.  The excess kurtosis enters an image by the square of the blur: while the blur
is small it is unknown and does little harm; once the frame tells it, leaving it out biases the moments.
``DECISIVE`` draws the border by the error of the kurtosis, not by its value, so that no frame is
picked by its noise; below it :func:`inflate_covariance` adds the possible effect of the shape to the errors.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from itertools import chain
from typing import NamedTuple

import numpy as np
import scipy.stats

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.forward import Parameters, parameter_names
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Locus, Mvn, Shaped
from jitterkit.loci.cumulants import CUMULANTS, WithCumulants, cumulant_names, form_cumulants
from jitterkit.metric import invert_information
from jitterkit.optics.otf import OTF
from jitterkit.scoring import fisher_scoring_without_prior

DECISIVE = 1.2
"""Error of the excess kurtosis that equals a drift's own: there the bias of the moments with the shape
held at a normal's is what their variance grows by with the shape free, and beyond it is more."""

_STEPS = 20
"""At most: of a drift of 3 arcsec on TOLIMAN, three times the resolution, four are still 3 % off."""

KURTOSIS = Shaped.names[-1]


class Shape(NamedTuple):
    """Hold the shape of a blur by one scoring step from a normal.

    Attributes
    ----------
    kurtosis, error : float
        Excess kurtosis, the same along every axis: linear -1.2, SHM -1.5.  One step: too small a
        number where the blur is as large as the resolution and far from normal.  NaN where the frame does
        not determine it.
    response : dict
        Change of everything else that is fitted, by name, for a unit of kurtosis that the locus leaves out;
        the moments have the names of ``Shaped``.
    """

    kurtosis: float
    error: float
    response: dict[str, float]


class ShapedBlur(NamedTuple):
    """A blur fitted with a shape.

    Attributes
    ----------
    parameters : Parameters
        All that was fitted, with a locus ``Shaped``.
    covariance : (4, 4) or (3, 3) array
        Of its moments and kurtosis; of its moments, if the kurtosis was known.
    """

    parameters: Parameters
    covariance: np.ndarray

    @property
    def locus(self) -> Locus:
        """Return the blur itself."""
        return self.parameters.locus

    @property
    def kurtosis(self) -> float:
        """Return the excess kurtosis."""
        return float(self.locus.coords[3])

    @property
    def kurtosis_err(self) -> float:
        """Return the standard error of the kurtosis; zero if it was known."""
        return float(np.sqrt(self.covariance[3, 3])) if len(self.covariance) > 3 else 0.0


class LackOfFit(NamedTuple):
    """Hold the test of the higher cumulants that a blur lacks.

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


@dataclass(frozen=True)
class CumulantStep:
    """A scoring step from a fitted locus in all that was fitted and in higher cumulants.

    Build it with :meth:`of`.

    Attributes
    ----------
    parameters : Parameters
        Where the fit ended.
    names : tuple of str
        What was fitted.
    score, information : (p + c,), (p + c, p + c) array
        Of what was fitted, then of the third, the fourth and what other cumulants were asked for.
    """

    parameters: Parameters
    names: tuple[str, ...]
    score: np.ndarray
    information: np.ndarray

    @classmethod
    def of(
        cls,
        parameters: Parameters,
        names: tuple[str, ...],
        otf: OTF,
        data: Data,
        orders: tuple[int, ...] = (3, 4),
    ) -> CumulantStep:
        """Take the step from the end of a fit of some parameters, with the optics expanded near it."""
        wider = parameters.with_locus(WithCumulants(parameters.locus, orders))
        every, asked = parameter_names(wider, otf.names), map(cumulant_names, orders)
        order = [every.index(name) for name in chain(names, *asked)]
        free = tuple(sorted(order))
        equations = normal_equations(wider, otf, data, free, exact=False)
        back = [free.index(index) for index in order]
        return cls(
            parameters,
            names,
            np.asarray(equations.score)[back],
            np.asarray(equations.information)[np.ix_(back, back)],
        )

    def covariance(self) -> np.ndarray:
        """Return the covariance (3, 3) of the moments of a normal that was fitted, arcsec⁴."""
        size, indices = len(self.names), [self.names.index(name) for name in Mvn.names]
        return invert_information(self.information[:size, :size])[0][np.ix_(indices, indices)]

    def shape(self) -> Shape:
        """Return the excess kurtosis of a blur that was fitted with a normal, everything free beside it.

        Its fourth cumulants are the kurtosis times what the second moments make of them.

        Raises
        ------
        ConfigurationError
            If the locus is no normal, or one of its moments was held.
        """
        index, turn = self._to_shaped()
        covariance, _ = invert_information(self.information_of_shaped())
        mine, called = covariance[index], dict(zip(Mvn.names, Shaped.names, strict=False))
        names = [called.get(name, name) for name in self.names]
        names.insert(index, KURTOSIS)
        # what is fitted beside it follows the kurtosis by the regression that the covariance describes
        response = dict(zip(names, map(float, -mine / mine[index]), strict=True))
        return Shape(float(mine @ (turn @ self.score)), float(np.sqrt(mine[index])), response)

    def unknown_shape(
        self, covariance: np.ndarray, mean: float, spread: float
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the corrections to a fitted normal for a kurtosis that is better known beforehand.

        Parameters
        ----------
        covariance : (p, p) array
            Of what was fitted, at the maximum of its posterior, in the units of the parameters.
        mean, spread : float
            Of the excess kurtosis, known before the frame.

        Returns
        -------
        change : (p,) array
            To add to what was fitted.
        variance : (p, p) array
            To add to its covariance.

        Notes
        -----
        A Gaussian prior on the kurtosis joins what the frame says of it, and all else follows by regression.
        """
        index, turn = self._to_shaped()
        slope = turn[index] @ self.information
        response, own = covariance @ slope[: len(self.names)], slope @ turn[index]
        # below zero if the covariance is of another curvature
        certainty = max(own - slope[: len(self.names)] @ response, 0.0) + spread**-2
        kurtosis = (turn[index] @ self.score + mean * spread**-2) / certainty
        return -kurtosis * response, np.outer(response, response) / certainty

    def information_of_shaped(self) -> np.ndarray:
        """Information about what was fitted and the excess kurtosis, in the order of ``Shaped``."""
        _, turn = self._to_shaped()
        return turn @ self.information @ turn.T

    def _to_shaped(self) -> tuple[int, np.ndarray]:
        """Return the index of the kurtosis in a fit with ``Shaped``, and the changes by all, by rows."""
        held = [name for name in Mvn.names if name not in self.names]
        if held:
            problem = (
                f"The shape of a blur is fitted together with its second moments: do not hold {held[0]!r}."
            )
            raise ConfigurationError(ErrorCode.NOT_CONSTRAINED, problem)
        size, index = len(self.names), 1 + max(self.names.index(name) for name in Mvn.names)
        turn = np.insert(np.eye(size, len(self.score)), index, 0.0, axis=0)
        turn[index, size + 4 : size + 9], _ = form_cumulants(self.parameters.locus.moments(), 2)
        return index, turn

    def lack_of_fit(self) -> LackOfFit:
        """Test whether the frame wants higher cumulants than the fitted locus has.

        Raises
        ------
        numpy.linalg.LinAlgError
            If the image does not show all of them.

        Notes
        -----
        Chi-squared of the score in nine directions.  Sharper than chi-squared over all pixels, which a wrong
        shape of 9 sigma raises by half its own scatter.
        """
        size = len(self.names)
        kept, asked = slice(size), slice(size, size + len(CUMULANTS))
        beside = np.linalg.solve(self.information[kept, kept], self.information[kept, asked])
        remaining = self.information[asked, asked] - self.information[asked, kept] @ beside
        slope = self.score[asked] - beside.T @ self.score[kept]
        chi2 = float(np.sum(np.linalg.solve(np.linalg.cholesky(remaining), slope) ** 2))
        return LackOfFit(float(scipy.stats.chi2.sf(chi2, len(slope))), chi2)


def fit_shape(
    normal: Parameters,
    kurtosis: float,
    otf: OTF,
    data: Data,
    hold: Collection[str],
    known: np.ndarray | None = None,
) -> ShapedBlur | None:
    """Fit a blur's moments and excess kurtosis, from the normal that fits.

    Parameters
    ----------
    normal : Parameters
        That fit.
    kurtosis : float
        Excess kurtosis to begin with.
    otf : OTF
        Expanded near there.
    data : Data
    hold : collection of str
        What the fit held; with :data:`KURTOSIS`, the excess kurtosis too.
    known : (n, n) array, optional
        Information there, if it has been computed.

    Returns
    -------
    blur : ShapedBlur or None
        None where no such blur fits (the iteration does not converge), or the frame does not determine it.
    """
    start = Shaped(np.append(np.asarray(normal.locus.moments()), kurtosis))
    end, covariance = fisher_scoring_without_prior(normal.with_locus(start), otf, data, hold, _STEPS, known)
    settled = bool(end.converged) and np.all(np.isfinite(covariance))
    return ShapedBlur(end.parameters, covariance) if settled else None


def inflate_covariance(covariance: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Inflate the covariance (3, 3) of moments fitted with a normal's shape by the effect of another shape.

    Parameters
    ----------
    covariance : (3, 3) array
    response : (3,) array
        Change of the moments for a unit of kurtosis; NaN, where it is not determined, counts as none.

    Returns
    -------
    covariance : (3, 3) array
        As if the kurtosis were known to be zero within 1.2: unchanged where it has no effect.
    """
    known = np.nan_to_num(response)
    return covariance + DECISIVE**2 * np.outer(known, known)
