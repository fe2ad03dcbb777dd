"""The shape of a blur: tested by one scoring step, fitted by a few, and believed by one rule.

:func:`measure_shape` tests whether an image that a normal describes wants an excess kurtosis,
:func:`fit_shape` fits one.  The excess
kurtosis enters an image by the square of the blur: while the blur is small it is unknown and does no
harm; once the frame tells it, leaving it out biases the moments.  Both borders, :func:`is_detected` and
:func:`is_decisive`, are set by errors, not by the value found, so that no frame is picked by its noise.
"""

from __future__ import annotations

from collections.abc import Collection
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from scipy.stats import chi2

from jitterkit.forward import Parameters, free_parameters
from jitterkit.kernel_estimate import significance
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Shaped
from jitterkit.optics.otf import OTF
from jitterkit.scoring import climb_a_little, invert_information

__all__ = ["Shape", "fit_shape", "is_decisive", "is_detected", "measure_shape"]

_DETECTED = float(chi2.isf(1e-3, 3))
"""Chi-squared of three moments that no jitter at all exceeds in one frame of a thousand."""

_DECISIVE = 1.2
"""Error of the excess kurtosis that equals a drift's own: there the bias of the moments with the shape
held at a normal's is what their variance grows by with the shape free, and beyond it is more."""

_STEPS = 20
"""At most: of a drift of 3 arcsec on TOLIMAN, three times the resolution, four are still 3 % off."""

_equations = eqx.filter_jit(normal_equations)


class Shape(NamedTuple):
    """What one scoring step from a normal says about the shape of a blur.

    Attributes
    ----------
    kurtosis, error : float
        Excess kurtosis, the same along every axis: linear -1.2, SHM -1.5.  One step: too small a
        number where the blur is as large as the resolution and far from normal.  NaN where the frame does
        not determine it.
    response : float
        Change of the fitted separation for a unit of kurtosis that the locus leaves out, arcsec; zero
        where no separation is fitted.
    """

    kurtosis: float
    error: float
    response: float


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
    equations = _equations(shaped, otf, data, free)
    covariance, _ = invert_information(equations.information)
    slot = names.index(Shaped.names[-1])
    mine = covariance[slot]
    # what is fitted beside it follows the kurtosis by the regression that the covariance describes
    response = -mine[names.index("separation")] / mine[slot] if "separation" in names else 0.0
    return Shape(float(mine @ np.asarray(equations.score)), float(np.sqrt(mine[slot])), float(response))


def fit_shape(
    normal: Parameters, otf: OTF, data: Data, hold: Collection[str] = (), known: float | None = None
) -> tuple[Parameters, np.ndarray]:
    """Fit a blur's moments and excess kurtosis, from the normal that fits.

    Parameters
    ----------
    normal, otf, data, hold
        As for :func:`measure_shape`.
    known : float, optional
        The kurtosis, if it is not to be fitted.

    Returns
    -------
    end : Parameters
        With a locus of kind ``Shaped``.
    covariance : (4, 4) or (3, 3) array
        Of the moments and the kurtosis, or of the moments; NaN where the frame does not determine them, or
        no such blur fits: the climb does not settle.
    """
    coords = np.append(normal.locus.moments(), 0.0 if known is None else known)
    held = hold if known is None else {*hold, Shaped.names[-1]}
    end, covariance = climb_a_little(normal.with_locus(Shaped(jnp.asarray(coords))), otf, data, held, _STEPS)
    return end.parameters, covariance if bool(end.converged) else np.full_like(covariance, np.nan)


def is_detected(moments: np.ndarray, covariance: np.ndarray) -> bool:
    """Whether moments (3,) with their covariance (3, 3) are beyond what no jitter would give."""
    return significance(moments, covariance) > _DETECTED


def is_decisive(shape_err: float) -> bool:
    """Whether a shape is known so well that the moments must not be taken for a normal's."""
    return bool(shape_err < _DECISIVE)
