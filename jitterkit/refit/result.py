"""What a refit returns."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field

import jax
import numpy as np

from jitterkit.forward import Parameters
from jitterkit.kernel_estimate import KernelEstimate

__all__ = ["Candidate", "FitResult", "Status"]


class Status(enum.Enum):
    """How a frame ended; the value is the sentence that a table shows."""

    OK = "fitted"
    NOT_CONVERGED = "the fit did not settle within its iterations"
    POOR_FIT = "the model does not describe the frame"
    NO_STAR = "nothing rises above the noise"
    NO_PAIR = "only one star is seen"
    NO_DATA = "no usable pixel"
    UNREADABLE = "the file cannot be read"
    MISMATCH = "the frame does not suit this instrument"
    FAILED = "the fit broke down"

    @property
    def usable(self) -> bool:
        """Whether the numbers mean anything."""
        return self is Status.OK


@dataclass(frozen=True)
class Candidate:
    """One locus that was tried.

    Attributes
    ----------
    locus : str
    objective : float
        Deviance plus the priors' quadratic form at the best fit.
    weight : float
        Akaike weight, 0 to 1: relative support among the loci tried.
    separation : float
        arcsec, as fitted with this locus.
    """

    locus: str
    objective: float
    weight: float
    separation: float


@dataclass(frozen=True)
class FitResult:
    """A fitted frame.

    Attributes
    ----------
    status : Status
    message : str
        One sentence: the status, with the numbers behind it.
    flags : tuple of str
        Remarks that do not invalidate the numbers, such as ``saturated`` or ``jitter_undetected``.
    locus : str
        Name of the locus fitted (``""`` where the fit never started).
    parameters : Parameters or None
    names : tuple of str
        Names of the free parameters, in the order of ``covariance``.
    covariance : (p, p) array
        Of the free parameters: inverse of the expected Fisher information, plus that of the priors.
    crlb : (p,) array
        Cramér-Rao bound of each free parameter from this frame alone (no priors), 1 sigma.
    chi2, dof : float, int
        Pearson's chi-squared over the used pixels and its degrees of freedom.
    objective : float
        Deviance plus the priors' quadratic form, at its minimum; differences compare loci.
    image : (ny, nx) array or None
        Expected electrons at the best fit.
    residual : (ny, nx) array or None
        ``(data - image)/sigma``; NaN where masked.
    estimate : KernelEstimate or None
        The image-domain estimate the fit started from.
    candidates : tuple of Candidate
    iterations : int
    seconds : float
    """

    status: Status
    message: str
    flags: tuple[str, ...] = ()
    locus: str = ""
    parameters: Parameters | None = None
    names: tuple[str, ...] = ()
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    crlb: np.ndarray = field(default_factory=lambda: np.zeros(0))
    chi2: float = float("nan")
    dof: int = 0
    objective: float = float("nan")
    image: np.ndarray | None = None
    residual: np.ndarray | None = None
    estimate: KernelEstimate | None = None
    candidates: tuple[Candidate, ...] = ()
    iterations: int = 0
    seconds: float = 0.0

    def error(self, name: str) -> float:
        """Standard error of a parameter; NaN where it was not fitted."""
        if name not in self.names:
            return float("nan")
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))

    @property
    def chi2_dof(self) -> float:
        """Chi-squared per degree of freedom; NaN where nothing was fitted."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Second moments ``(Sxx, Sxy, Syy)`` [arcsec²] of the fitted locus and their covariance."""
        if self.parameters is None:
            return np.full(3, np.nan), np.full((3, 3), np.nan)
        locus = self.parameters.locus
        slots = [self.names.index(n) for n in locus.names if n in self.names]
        if len(slots) < len(locus.names) or not slots:
            return np.asarray(locus.moments()), np.zeros((3, 3))
        slope = np.asarray(jax.jacfwd(lambda c: locus.at(c).moments())(locus.coords))
        return np.asarray(locus.moments()), slope @ self.covariance[np.ix_(slots, slots)] @ slope.T
