"""Kernel estimators: from a frame to what the pointing did, in milliseconds.

Each takes the frame's :class:`~jitterkit.likelihood.Data`, a template (scene and aberrations) and an
OTF, and returns a :class:`~jitterkit.kernel_estimate.KernelEstimate`.  Reach for ``score``: it is
efficient, knows about aberrations, and tests the shape.  ``mtf`` is the quick look that needs no starting
value.  ``nnls`` and ``richardson-lucy`` know no model of the motion: for blurs wider than the optics'
resolution, and for a kernel to look at.  ``moments`` is a second opinion.

To add an estimator, write one file with one function and add one line to the registry.
"""

from collections.abc import Callable

from jitterkit.errors import one_of
from jitterkit.estimators.kernel_problem import estimate_nnls, estimate_richardson_lucy
from jitterkit.estimators.moments import estimate_moments
from jitterkit.estimators.mtf_ratio import estimate_mtf_ratio
from jitterkit.estimators.score import estimate_score
from jitterkit.kernel_estimate import KernelEstimate

__all__ = [
    "ESTIMATORS",
    "KernelEstimate",
    "estimate_moments",
    "estimate_mtf_ratio",
    "estimate_nnls",
    "estimate_richardson_lucy",
    "estimate_score",
    "estimator",
]

ESTIMATORS: dict[str, Callable[..., KernelEstimate]] = {
    "mtf": estimate_mtf_ratio,
    "score": estimate_score,
    "moments": estimate_moments,
    "richardson-lucy": estimate_richardson_lucy,
    "nnls": estimate_nnls,
}
"""Every estimator by name."""


def estimator(name: str) -> Callable[..., KernelEstimate]:
    """Look an estimator up by name.

    Raises
    ------
    ConfigurationError
        If there is none of that name; the message lists those there are.
    """
    return ESTIMATORS[one_of("kernel estimator", name, ESTIMATORS)]
