"""The kernel that fits best of all that are nowhere negative."""

from __future__ import annotations

from collections.abc import Collection

from jitterkit.estimators.kernel_problem import best_shares, solve_kernel
from jitterkit.forward import Parameters
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.likelihood import Data
from jitterkit.optics.otf import OTF


def estimate_nnls(
    data: Data, template: Parameters, otf: OTF, *, hold: Collection[str] = ()
) -> KernelEstimate:
    """Estimate the kernel by non-negative least squares with the weights of photon and read noise.

    Parameters
    ----------
    data : Data
    template : Parameters
        Scene and aberrations; its locus is ignored.  Its position and flux need not be exact.
    otf : OTF
    hold : collection of str
        For the sake of a common signature: everything but the kernel is held at the template's values.

    Returns
    -------
    estimate : KernelEstimate
        The moments of any motion, drift or vibration, without a model of it.

    Raises
    ------
    UndeterminedError
        If the kernel does not fit: a blur of several pixels, or a frame too faint.

    Notes
    -----
    A kernel that cannot be negative has no negative moments: with no blur in the frame, the mean of the
    estimates lies above zero by about their error.  The kernel itself is a few spikes: it draws a smooth
    motion as dots that the frame does not distinguish from it (:func:`estimate_richardson_lucy` draws it
    smooth).
    """
    return solve_kernel(data, template, otf, best_shares, "nnls")
