"""The blur from Fisher-scoring steps in all parameters, started from no jitter at all.

At zero jitter the signed moments ``(Sxx, Sxy, Syy)`` are regular parameters, so one step from there,
with everything else free beside them, is an efficient estimate of a small blur (Le Cam's one-step
estimator); up to four steps remove what the first leaves at larger ones.  One step more, from the normal
that fits, tests its shape.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import replace

import equinox as eqx
import jax.numpy as jnp
import numpy as np

from jitterkit.errors import UndeterminedError
from jitterkit.estimators.shape import is_decisive, is_detected
from jitterkit.forward import Parameters, free_parameters
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data, normal_equations
from jitterkit.loci import Locus
from jitterkit.loci.mvn import Mvn
from jitterkit.loci.shaped import Shaped
from jitterkit.optics.otf import OTF
from jitterkit.scoring import Prior, climb, invert_information

__all__ = ["estimate_score"]

_equations = eqx.filter_jit(normal_equations)


def estimate_score(
    data: Data, template: Parameters, otf: OTF, *, steps: int = 4, hold: Collection[str] = ("background",)
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
        Scoring steps for a normal, rejected ones included; as many again where the shape is free.
    hold : collection of str
        Parameters to keep at the template's values.

    Returns
    -------
    estimate : KernelEstimate
        At the Cramér-Rao bound.  ``shape`` is NaN where no blur is detected.  While it says little (an error
        above 1.2, a linear smear below 0.35 arcsec on TOLIMAN), the moments are those of the normal with
        the closest image; beyond, those of a blur whose shape is fitted with them, which then is its
        ``locus``, and their errors contain that.

    Raises
    ------
    UndeterminedError
        If the information is singular: the frame does not determine the parameters.

    Notes
    -----
    *Fails when* the blur is wider than the optics' resolution (a linear smear above 1 arcsec on TOLIMAN):
    a normal is then too far from the image for a few steps, and one number too few for a shape.
    """
    end, covariance = _climb(_with_locus(template, Mvn.near(jnp.zeros(3))), otf, data, hold, steps)
    if not np.all(np.isfinite(covariance)):
        raise UndeterminedError("The frame does not determine its parameters; hold some, or mask less of it.")
    moments = np.asarray(end.locus.coords)
    estimate = KernelEstimate(moments, covariance, "score")
    if not is_detected(moments, covariance):
        return estimate
    normal = _with_locus(end, Shaped.near(moments))
    shape, error = _test_shape(normal, otf, data, hold)
    estimate = replace(estimate, shape=shape, shape_err=error)
    if not is_decisive(error):
        return estimate
    end, covariance = _climb(normal, otf, data, hold, steps)
    if not np.all(np.isfinite(covariance)):
        return estimate
    coords, error = np.asarray(end.locus.coords), float(np.sqrt(covariance[3, 3]))
    return KernelEstimate(
        coords[:3], covariance[:3, :3], "score", shape=float(coords[3]), shape_err=error, locus=end.locus
    )


def _with_locus(parameters: Parameters, locus: Locus) -> Parameters:
    return Parameters(parameters.scene, locus, parameters.aberrations, parameters.background)


def _climb(start: Parameters, otf: OTF, data: Data, hold, steps: int) -> tuple[Parameters, np.ndarray]:
    """Where a few steps lead, and the covariance of the locus's coordinates there; NaN if undetermined."""
    names, free = free_parameters(start, otf, hold)
    end = climb(start, otf, data, free, Prior.none(len(free)), steps=steps)
    slots = [names.index(name) for name in start.locus.names]
    covariance, _ = invert_information(end.information)
    return end.parameters, covariance[np.ix_(slots, slots)]


def _test_shape(normal: Parameters, otf: OTF, data: Data, hold) -> tuple[float, float]:
    """Excess kurtosis and its error: one scoring step from the normal that fits, all parameters free."""
    names, free = free_parameters(normal, otf, hold)
    equations = _equations(normal, otf, data, free)
    covariance, _ = invert_information(equations.information)
    slot = names.index(Shaped.names[-1])
    return float(covariance[slot] @ np.asarray(equations.score)), float(np.sqrt(covariance[slot, slot]))
