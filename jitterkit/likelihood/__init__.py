"""How well an expected image explains a frame, and what the frame says about its parameters.

The likelihood is Poisson.  Read noise of variance σ² enters as the shifted Poisson law: ``d + σ²`` is
treated as Poisson with mean ``μ + σ²``, which has the right mean and variance at every pixel and
tends to a normal law where σ² dominates (Snyder et al., J. Opt. Soc. Am. A 12, 272, 1995).  Electrons
that were divided by a flat field count as what they were before: ``r d + σ²``, of mean ``r μ + σ²``.

A pixel at its ceiling is known to hold at least so much.  It is left out, together with all that the
*model* expects near the ceiling (to choose pixels by their data would trim their noise), or it counts with
the probability of reaching the ceiling; see :meth:`Data.of`.

Information is always the expected Fisher information, which is positive by construction; a Hessian at
the data need not be.
"""

from jitterkit.likelihood.data import Data
from jitterkit.likelihood.equations import (
    NormalEquations,
    WavefrontSlopes,
    deviance,
    deviance_and_score,
    equations_of,
    information_at,
    known_information,
    normal_equations,
    single_slopes,
    slope_products,
)
from jitterkit.likelihood.misfit import MISFIT, POOR, Misfit, pearson

__all__ = [
    "MISFIT",
    "POOR",
    "Data",
    "Misfit",
    "NormalEquations",
    "WavefrontSlopes",
    "deviance",
    "deviance_and_score",
    "equations_of",
    "information_at",
    "known_information",
    "normal_equations",
    "pearson",
    "single_slopes",
    "slope_products",
]
