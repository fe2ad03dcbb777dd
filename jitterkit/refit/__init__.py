"""The refit: from starting values to parameters, errors and a verdict.

Reach for :func:`fit_best_locus` first; :func:`fit_locus` fits a locus of your choice, and
:func:`fit_frame` is what both call.
"""

from jitterkit.refit.choose import fit_best_locus, fit_locus
from jitterkit.refit.fit import FitOptions, fit_frame
from jitterkit.refit.priors import Priors, kernel_prior
from jitterkit.refit.result import Candidate, FitResult, Status

__all__ = [
    "Candidate",
    "FitOptions",
    "FitResult",
    "Priors",
    "Status",
    "fit_best_locus",
    "fit_frame",
    "fit_locus",
    "kernel_prior",
]
