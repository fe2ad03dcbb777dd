"""The blur from Fisher-scoring steps in all parameters, started from no jitter at all.

At zero jitter the signed moments ``(Sxx, Sxy, Syy)`` are regular parameters, so one step from there,
with everything else free beside them, is an efficient estimate of a small blur (Le Cam's one-step
estimator); up to four steps remove what the first leaves at larger ones.  One step more, from the normal
that fits, tests its shape.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import jax.numpy as jnp
import numpy as np

from jitterkit.errors import UndeterminedError
from jitterkit.estimators.shape import fit_shape, is_decisive, is_detected, measure_shape
from jitterkit.forward import Parameters
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data
from jitterkit.loci import Mvn
from jitterkit.optics.otf import OTF
from jitterkit.scoring import climb_a_little

__all__ = ["estimate_score"]


def estimate_score(
    data: Data,
    template: Parameters,
    otf: OTF,
    *,
    steps: int = 4,
    hold: Collection[str] = ("background",),
    shape: float | None = None,
) -> KernelEstimate:
    """Estimate second moments by Fisher scoring from zero jitter, and test the shape of the blur.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations to start from; its locus is ignored.
    otf : OTF
        About the template's aberrations.
    steps : int
        Scoring steps for a normal, rejected ones included.
    hold : collection of str
        Parameters to keep at the template's values.
    shape : float, optional
        Excess kurtosis, where the kind of motion is known: -1.2 of a drift, -1.5 of a vibration, 0 of
        random motion.  By default it is measured.

    Returns
    -------
    estimate : KernelEstimate
        At the Cramér-Rao bound.  With a shape given, its ``locus`` has that shape.  Otherwise ``shape`` is
        NaN where no blur is detected; while it says little (an error above 1.2, a linear smear below 0.35
        arcsec on TOLIMAN), the moments are those of the normal with the closest image; beyond, those of a
        blur whose shape is fitted with them, which then is its ``locus``, and their errors contain that.

    Raises
    ------
    UndeterminedError
        If the information is singular: the frame does not determine the parameters.  Or if no blur of the
        shape given fits.

    Notes
    -----
    *Fails when* the blur is wider than the optics' resolution and not of this family of shapes: lopsided, or
    two tones.
    """
    start = template.with_locus(Mvn.near(jnp.zeros(3)))
    (normal, *_), covariance = climb_a_little(start, otf, data, hold, steps)
    _insist(covariance)
    if shape is not None:
        end, covariance = fit_shape(normal, otf, data, hold, shape)
        _insist(covariance)
        return KernelEstimate(np.asarray(end.locus.moments()), covariance, "score", locus=end.locus)
    moments = np.asarray(normal.locus.moments())
    estimate = KernelEstimate(moments, covariance, "score")
    if not is_detected(moments, covariance):
        return estimate
    told = measure_shape(normal, otf, data, hold)
    estimate = replace(estimate, shape=told.kurtosis, shape_err=told.error)
    if not is_decisive(told.error):
        return estimate
    end, covariance = fit_shape(normal, otf, data, hold)
    if not np.all(np.isfinite(covariance)):
        return estimate
    coords, error = np.asarray(end.locus.coords), float(np.sqrt(covariance[3, 3]))
    return KernelEstimate(
        coords[:3], covariance[:3, :3], "score", shape=float(coords[3]), shape_err=error, locus=end.locus
    )


def _insist(covariance: np.ndarray) -> None:
    if not np.all(np.isfinite(covariance)):
        raise UndeterminedError("The frame does not determine its parameters; hold some, or mask less of it.")
