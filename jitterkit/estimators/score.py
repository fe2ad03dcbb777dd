"""The blur from Fisher-scoring steps in all parameters, started from no jitter at all.

At zero jitter the signed moments ``(Sxx, Sxy, Syy)`` are regular parameters, so one step from there,
with everything else free beside them, is an efficient estimate of a small blur (Le Cam's one-step
estimator); up to four steps remove what the first leaves at larger ones.
"""

from __future__ import annotations

from collections.abc import Collection

import jax.numpy as jnp
import numpy as np

from jitterkit.forward import Parameters, free_parameters
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data
from jitterkit.loci.mvn import Mvn
from jitterkit.optics.otf import OTF
from jitterkit.scoring import Prior, climb, invert_information

__all__ = ["estimate_score"]


def estimate_score(
    data: Data, template: Parameters, otf: OTF, *, steps: int = 4, hold: Collection[str] = ("background",)
) -> KernelEstimate:
    """Estimate second moments by Fisher scoring from zero jitter.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations to start from; its locus is ignored.
    otf : OTF
        About the template's aberrations.
    steps : int
        Scoring steps, rejected ones included.
    hold : collection of str
        Parameters to keep at the template's values.

    Returns
    -------
    estimate : KernelEstimate
        At the Cramér-Rao bound for a normal blur; for a streak, the normal with the closest image.

    Raises
    ------
    ValueError
        If the information is singular: the frame does not determine the parameters.
    """
    start = Parameters(template.scene, Mvn.near(jnp.zeros(3)), template.aberrations, template.background)
    names, free = free_parameters(start, otf, hold)
    end = climb(start, otf, data, free, Prior.none(len(free)), steps=steps)
    slots = [names.index(name) for name in Mvn.names]
    covariance, sound = invert_information(end.information)
    if not sound:
        raise ValueError("The frame does not determine its parameters; hold some, or mask less of it.")
    return KernelEstimate(np.asarray(end.parameters.locus.coords), covariance[np.ix_(slots, slots)], "score")
