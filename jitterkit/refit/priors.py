"""What is known before the frame is looked at.

A prior comes from *other* data: telemetry, a catalogue, the other frames of a sequence.  A frame's own
kernel estimate is none: it is a summary of the very photons that the likelihood will count, and to
use it again would count them twice.  :func:`kernel_prior` makes nothing of it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np

from jitterkit.errors import ConfigurationError
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import LOCI, Mvn
from jitterkit.scoring import Prior

__all__ = ["Priors", "kernel_prior"]


@dataclass(frozen=True)
class Priors:
    """Normal priors by parameter name.

    Attributes
    ----------
    terms : mapping of name to (mean, sigma)
        Independent priors, in the parameter's own unit: ``{"noll4": (0.0, 5.0)}``.
    moments : (mean, covariance) or None
        Joint prior on the second moments of a normal locus, from :func:`kernel_prior`; it says nothing
        about the other loci, which are then not tried.
    """

    terms: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    moments: tuple[np.ndarray, np.ndarray] | None = None

    def __post_init__(self) -> None:
        for name, (mean, sigma) in self.terms.items():
            if not (np.isfinite(mean) and sigma > 0):
                raise ConfigurationError(
                    f"The prior on {name} needs a finite mean and a positive sigma, got {mean} and {sigma}."
                )

    def on_locus(self) -> bool:
        """Whether anything is known about the jitter, in the coordinates of one locus."""
        coordinates = {name for locus in LOCI.values() for name in locus.names}
        return self.moments is not None or bool(coordinates & set(self.terms))

    def over(self, names: tuple[str, ...]) -> Prior:
        """The prior on free parameters of the given names.

        Raises
        ------
        ConfigurationError
            If a term names no parameter at all; the message lists those there are.
        """
        mean, precision = np.zeros(len(names)), np.zeros((len(names), len(names)))
        for name, (centre, sigma) in self.terms.items():
            if name not in names:
                raise ConfigurationError(
                    f"There is no free parameter {name!r} to put a prior on; there are {', '.join(names)}."
                )
            i = names.index(name)
            mean[i], precision[i, i] = centre, sigma**-2
        if self.moments is not None and set(Mvn.names) <= set(names):
            slots = [names.index(name) for name in Mvn.names]
            mean[slots] = self.moments[0]
            precision[np.ix_(slots, slots)] += np.linalg.inv(self.moments[1])
        return Prior(jnp.asarray(mean), jnp.asarray(precision))


def kernel_prior(estimate: KernelEstimate, frame: str) -> Priors:
    """A prior on the jitter from an estimate made of other data.

    Parameters
    ----------
    estimate : KernelEstimate
    frame : str
        Source of the frame to be fitted.

    Returns
    -------
    priors : Priors
        Empty if the estimate was made from that very frame: it may start the fit, but it holds no
        information that the frame's photons do not.

    Raises
    ------
    ConfigurationError
        If the estimate does not say what it was made from.
    """
    if not estimate.source:
        raise ConfigurationError(
            "This kernel estimate does not say which data it was made from; set its source before using it "
            "as a prior, or the frame's photons may be counted twice."
        )
    if estimate.source == frame:
        return Priors()
    return Priors(moments=(np.asarray(estimate.moments), np.asarray(estimate.covariance)))
