"""The shape of a blur: tested by one scoring step, fitted by a few, and believed by one rule.

:func:`measure_shape` tests whether an image that a normal describes wants an excess kurtosis,
:func:`fit_shape` fits one, :func:`fit_known_shape` a blur whose kurtosis is known.  The excess kurtosis
enters an image by the square of the blur: while the blur is small it is unknown and does little harm; once
the frame tells it, leaving it out biases the moments.  :func:`is_decisive` draws the border by the error of
the kurtosis, not by its value, so that no frame is picked by its noise; below it :func:`doubted` adds to
the errors what the shape might do.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters, free_parameters
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Shaped
from jitterkit.optics.otf import OTF
from jitterkit.scoring import climb_a_little, invert_information

__all__ = [
    "Shape",
    "ShapedBlur",
    "doubted",
    "fit_known_shape",
    "fit_shape",
    "is_decisive",
    "measure_shape",
]

_DECISIVE = 1.2
"""Error of the excess kurtosis that equals a drift's own: there the bias of the moments with the shape
held at a normal's is what their variance grows by with the shape free, and beyond it is more."""

_STEPS = 20
"""At most: of a drift of 3 arcsec on TOLIMAN, three times the resolution, four are still 3 % off."""

_KURTOSIS = Shaped.names[-1]


class Shape(NamedTuple):
    """What one scoring step from a normal says about the shape of a blur.

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
    locus : Shaped
    covariance : (4, 4) or (3, 3) array
        Of its moments and kurtosis; of its moments, if the kurtosis was known.
    """

    locus: Shaped
    covariance: np.ndarray

    @property
    def kurtosis(self) -> float:
        """Excess kurtosis."""
        return float(self.locus.coords[3])

    @property
    def kurtosis_err(self) -> float:
        """Its standard error; zero if it was known."""
        return float(np.sqrt(self.covariance[3, 3])) if len(self.covariance) > 3 else 0.0


def measure_shape(normal: Parameters, otf: OTF, data: Data, hold: Collection[str] = ()) -> Shape:
    """Excess kurtosis of a blur, by one scoring step from the normal that fits, everything free beside it.

    Parameters
    ----------
    normal : Parameters
        Where a fit with a normal locus ended.
    otf : OTF
        Expanded near there.
    data : Data
    hold : collection of str
        What the fit held.
    """
    shaped = normal.with_locus(Shaped.near(normal.locus.moments()))
    names, free = free_parameters(shaped, otf, hold)
    equations = normal_equations(shaped, otf, data, free, exact=False)
    covariance, _ = invert_information(equations.information)
    slot = names.index(_KURTOSIS)
    mine = covariance[slot]
    # what is fitted beside it follows the kurtosis by the regression that the covariance describes
    response = dict(zip(names, map(float, -mine / mine[slot]), strict=True))
    return Shape(float(mine @ np.asarray(equations.score)), float(np.sqrt(mine[slot])), response)


def fit_shape(normal: Parameters, otf: OTF, data: Data, hold: Collection[str] = ()) -> ShapedBlur | None:
    """Fit a blur's moments and excess kurtosis, from the normal that fits.

    Parameters
    ----------
    normal, otf, data, hold
        As for :func:`measure_shape`.

    Returns
    -------
    blur : ShapedBlur or None
        None where no such blur fits (the climb does not settle), or the frame does not determine it.
    """
    return _settle(normal, 0.0, otf, data, hold)


def fit_known_shape(
    normal: Parameters, kurtosis: float, otf: OTF, data: Data, hold: Collection[str] = ()
) -> ShapedBlur | None:
    """As :func:`fit_shape`, with the excess kurtosis held."""
    return _settle(normal, kurtosis, otf, data, {*hold, _KURTOSIS})


def _settle(
    normal: Parameters, kurtosis: float, otf: OTF, data: Data, hold: Collection[str]
) -> ShapedBlur | None:
    start = Shaped(jnp.append(normal.locus.moments(), kurtosis))
    end, covariance = climb_a_little(normal.with_locus(start), otf, data, hold, _STEPS)
    settled = bool(end.converged) and np.all(np.isfinite(covariance))
    return ShapedBlur(start.at(end.parameters.locus.coords), covariance) if settled else None


def doubted(covariance: np.ndarray, response: np.ndarray) -> np.ndarray:
    """Covariance (3, 3) of moments fitted with a normal's shape, with what another shape would do to them.

    Parameters
    ----------
    covariance : (3, 3) array
    response : (3,) array
        Change of the moments for a unit of kurtosis; NaN, where it is not determined, counts as none.

    Returns
    -------
    covariance : (3, 3) array
        As if the kurtosis were known to be zero within 1.2: no doubt where it has no say.
    """
    known = np.nan_to_num(response)
    return covariance + _DECISIVE**2 * np.outer(known, known)


def is_decisive(shape_err):
    """Whether a shape is known so well, by its error, that the moments must not be taken for a normal's."""
    return shape_err < _DECISIVE
