"""The blur of extended scenes, of trails, and the drift between frames.

A photograph, a planet or the ground has no star to measure.  From one image alone reach for
:func:`estimate_blind`; with a sharp frame of the same scene for :func:`estimate_from_reference`; where
points of light have drawn lines for :func:`estimate_trail`; for the motion between frames
for :func:`register`.  All of them would rather refuse (:class:`~jitterkit.errors.UndeterminedError`)
than guess.

To add a blind method, write one function and add one line to the registry;
``tests/extended/test_contract.py`` then holds it to the laws.
"""

from collections.abc import Callable

from jitterkit.extended.blind import estimate_blind
from jitterkit.extended.reference import estimate_from_reference
from jitterkit.extended.registration import Drift, drifts, register
from jitterkit.extended.textbook import estimate_autocorrelation, estimate_cepstrum, estimate_radon
from jitterkit.extended.trail import Trail, estimate_trail, find_trails
from jitterkit.kernel_estimate import KernelEstimate

BLIND: dict[str, Callable[..., KernelEstimate]] = {
    "blind": estimate_blind,
    "cepstrum": estimate_cepstrum,
    "radon": estimate_radon,
    "autocorrelation": estimate_autocorrelation,
}
"""Every method that needs nothing but the image, by name."""
