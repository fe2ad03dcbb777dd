"""What a refit returns."""

from __future__ import annotations

import enum
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from jitterkit.errors import ErrorCode, code_of
from jitterkit.forward import Parameters
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci.base import moments_of


class Status(enum.Enum):
    """Name the outcome of a frame; the value is the sentence in a table."""

    OK = "fitted"
    NOT_CONVERGED = "the fit did not settle within its iterations"
    POOR_FIT = "the model does not describe the frame"
    NO_STAR = "nothing rises above the noise"
    NO_PAIR = "only one star is seen"
    NO_DATA = "no usable pixel"
    UNREADABLE = "the file cannot be read"
    MISMATCH = "the frame does not suit this instrument"
    UNDETERMINED = "the image does not constrain the blur, or what scene it shows"
    REFERENCE = "the frame is the reference that others are compared with"
    DUPLICATE = "the frame has the pixels of another one of the run, and is not counted again"
    FAILED = "the fit broke down"

    @property
    def usable(self) -> bool:
        """True if the numbers mean anything."""
        return self is Status.OK


_CODES = {
    Status.NOT_CONVERGED: ErrorCode.NOT_CONVERGED,
    Status.POOR_FIT: ErrorCode.MODEL_MISMATCH,
    Status.NO_STAR: ErrorCode.NO_STAR,
    Status.NO_PAIR: ErrorCode.NO_PAIR,
    Status.NO_DATA: ErrorCode.NO_DATA,
    Status.MISMATCH: ErrorCode.WRONG_INSTRUMENT,
    Status.UNDETERMINED: ErrorCode.NOT_CONSTRAINED,
    Status.REFERENCE: ErrorCode.IS_REFERENCE,
    Status.DUPLICATE: ErrorCode.DUPLICATE,
}
"""Code of a status for which no error was raised; any other status without one is internal."""


STRAIGHT = {"linear": -1.2, "shm": -1.5}
"""Excess kurtosis of a drift and of a vibration, along their axis: their moments differ by it."""

TOLD, _POSSIBLE = 0.075, 0.05
"""Error of a kurtosis from which a frame may take one for the other, a quarter of their difference: two in a
hundred do, and move the mean of all moments by a tenth of an error.  Weight of both together from which a
blur may be straight: which of them has more does not matter, because frames that are sure by chance belong
to the mean too.  Below that weight other loci add nothing to the errors: they differ mostly by kurtosis."""


class StraightBlur(NamedTuple):
    """Hold what a frame shows of the kurtosis of a straight blur.

    Attributes
    ----------
    kurtosis, error : float
        Excess kurtosis along the axis.
    slope : (3,) array
        Change of the moments ``(Sxx, Sxy, Syy)`` [arcsec²] by it.
    """

    kurtosis: float
    error: float
    slope: np.ndarray


@dataclass(frozen=True)
class Candidate:
    """One locus that was compared.

    Attributes
    ----------
    locus : str
    objective : float
        Deviance plus the priors' quadratic form at the best fit; what it would be where none was needed.
    weight : float
        Probability, 0 to 1, if the loci compared are all there are and none is favoured beforehand; zero
        for one that could not be fitted or does not fit.
    separation, separation_err : float
        arcsec, with this locus.
    evidence : float
        Logarithm of the evidence (:mod:`jitterkit.refit.evidence`), up to a constant common to the loci of a
        frame; differences add up over frames.
    moments : (float, float, float)
        ``(Sxx, Sxy, Syy)`` with this locus, arcsec².
    """

    locus: str
    objective: float
    weight: float
    separation: float
    separation_err: float = float("nan")
    evidence: float = float("nan")
    moments: tuple[float, float, float] = (float("nan"),) * 3


@dataclass(frozen=True)
class FitResult:
    """A fitted frame.

    Attributes
    ----------
    status : Status
    message : str
        One sentence: the status, with the numbers behind it.
    flags : tuple of str
        Remarks such as ``saturated``, ``jitter_undetected`` or ``prior_contradicted``; what they mean stands
        in :mod:`jitterkit.report.flags`.
    locus : str
        Name of the locus fitted (``""`` where the fit never started).
    parameters : Parameters or None
    names : tuple of str
        Names of the free parameters, in the order of ``covariance``.
    aberrations : tuple of str
        Names of ``parameters.aberrations``.
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
        The loci compared, best first; one alone where nothing more than moments can be determined.
    shape, shape_err : float
        Excess kurtosis of the blur along its axes and its error, by one scoring step from the normal, or by
        a fit where it is known well; NaN
        where no jitter was detected or the locus was not to be chosen.
    straight : StraightBlur or None
        None unless both a drift and a vibration were compared.
    tried : tuple of str
        Loci that were fitted or evaluated, those too of a frame that none of them describes.
    off_maximum : ((p,) array, (p, p) array) or None
        What an unknown shape of the blur adds to the values at the maximum, and to their covariance.
    further_limit : float
        Electrons of a further star that would have been found, by
        :meth:`~jitterkit.locate.Residual.hidden`; NaN where none was looked for.
    model_error : float
        What was allowed for as an error of the model: rms share of the light, by its square.
    model_covariance : (p, p) array
        What it adds to the covariance: the same in frames with the same optics.  Empty where there is none.
    iterations : int
    seconds : float
    code : ErrorCode or None
        Why the frame is not usable, where the status alone does not say; :attr:`reason` is always known.
    """

    status: Status
    message: str
    flags: tuple[str, ...] = ()
    locus: str = ""
    parameters: Parameters | None = None
    names: tuple[str, ...] = ()
    aberrations: tuple[str, ...] = ()
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    crlb: np.ndarray = field(default_factory=lambda: np.zeros(0))
    chi2: float = float("nan")
    dof: int = 0
    objective: float = float("nan")
    image: np.ndarray | None = None
    residual: np.ndarray | None = None
    estimate: KernelEstimate | None = None
    candidates: tuple[Candidate, ...] = ()
    shape: float = float("nan")
    shape_err: float = float("nan")
    straight: StraightBlur | None = None
    tried: tuple[str, ...] = ()
    off_maximum: tuple[np.ndarray, np.ndarray] | None = None
    further_limit: float = float("nan")
    model_error: float = 0.0
    model_covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    iterations: int = 0
    seconds: float = 0.0
    code: ErrorCode | None = None

    @classmethod
    def from_error(cls, status: Status, error: Exception, message: str | None = None) -> FitResult:
        """Make the result of a frame that an error stopped.

        Parameters
        ----------
        status : Status
        error : Exception
            Its code becomes that of the result.
        message : str, optional
            In place of the error's own.
        """
        return cls(status, str(error) if message is None else message, code=code_of(error))

    @classmethod
    def duplicate_of(cls, name: str) -> FitResult:
        """Make the result of a frame with the same pixels as another one, which counts in its place."""
        return cls(Status.DUPLICATE, f"{Status.DUPLICATE.value}: see {name}.")

    def remarked(self, sentence: str, flag: str) -> FitResult:
        """Return the result with a sentence more, and its flag; without a sentence the result as it is."""
        if not sentence:
            return self
        message = f"{self.message or self.status.value} {sentence}"
        return replace(self, message=message, flags=tuple(dict.fromkeys((*self.flags, flag))))

    def moved(self, parameters: Parameters, covariance: np.ndarray) -> FitResult:
        """Return the result with other values and errors; its candidates' moments move as its own do."""
        assert self.parameters is not None
        step = np.asarray(parameters.locus.moments()) - np.asarray(self.parameters.locus.moments())
        there = [tuple((np.asarray(one.moments) + step).tolist()) for one in self.candidates]
        candidates = tuple(replace(c, moments=m) for c, m in zip(self.candidates, there, strict=True))
        return replace(self, parameters=parameters, covariance=covariance, candidates=candidates)

    @property
    def reason(self) -> str:
        """Value of the error code that says why the frame is not usable; empty for a usable one."""
        if self.status.usable:
            return ""
        return (self.code or _CODES.get(self.status, ErrorCode.INTERNAL)).value

    def error(self, name: str) -> float:
        """Standard error of a parameter; NaN where it was not fitted."""
        if name not in self.names:
            return float("nan")
        i = self.names.index(name)
        return float(np.sqrt(self.covariance[i, i]))

    def model_part(self, name: str) -> float:
        """Return the part of a parameter's standard error that errors of the model make; NaN without any.

        It is common to frames of the same optics, and does not average out.
        """
        if name not in self.names or len(self.model_covariance) != len(self.names):
            return float("nan")
        i = self.names.index(name)
        return float(np.sqrt(max(self.model_covariance[i, i], 0.0)))

    def of_scene(self, name: str) -> float:
        """A number of the fitted scene; NaN where it has none."""
        return float("nan") if self.parameters is None else self.parameters.scene.values.get(name, np.nan)

    @property
    def chi2_dof(self) -> float:
        """Chi-squared per degree of freedom; NaN where nothing was fitted."""
        return self.chi2 / self.dof if self.dof > 0 else float("nan")

    @property
    def locus_weight(self) -> float:
        """Weight of the locus fitted among those compared; NaN where none was compared."""
        several = len(self.candidates) > 1
        return next((c.weight for c in self.candidates if several and c.locus == self.locus), float("nan"))

    @property
    def separation_spread(self) -> float:
        """Weighted rms of the separation over the candidates [arcsec]: what not knowing the locus adds.

        The same way in every frame of a sequence, so it does not average out.  NaN where none was compared.
        """
        if len(self.candidates) < 2:
            return float("nan")
        weights = np.array([c.weight for c in self.candidates])
        separations = np.array([c.separation for c in self.candidates]) - self.candidates[0].separation
        separations = np.where(weights > 0, separations, 0.0)
        mean = weights @ separations
        return float(np.sqrt(weights @ (separations - mean) ** 2))

    def moments(self) -> tuple[np.ndarray, np.ndarray]:
        """Second moments ``(Sxx, Sxy, Syy)`` [arcsec²] of the blur and their covariance.

        Those of the fitted locus; the covariance holds what not knowing the locus adds: the weighted mean
        square by which the moments of the candidates differ from those of the fitted one.  Where a frame may
        take a drift for a vibration, or for a normal blur, those that go with the kurtosis that it shows: the
        mean of frames of a drift would else be that of some of the others too.
        """
        if self.parameters is None:
            return np.full(3, np.nan), np.full((3, 3), np.nan)
        moments, covariance = moments_of(self.parameters.locus, self.names, self.covariance)
        likely = {c.locus: c for c in self.candidates if c.weight > 0 and np.all(np.isfinite(c.moments))}
        weights = [c.weight for name, c in likely.items() if name in STRAIGHT]
        possible = len(weights) == len(STRAIGHT) and sum(weights) > _POSSIBLE
        own, shown = (STRAIGHT | {"mvn": 0.0}).get(self.locus), self.straight
        if possible and own is not None and shown is not None and shown.error > TOLD:
            moments = moments + (shown.kurtosis - own) * shown.slope
            covariance = covariance + shown.error**2 * np.outer(shown.slope, shown.slope)
            likely = {name: c for name, c in likely.items() if name not in (*STRAIGHT, "mvn")}
            likely = likely if sum(c.weight for c in likely.values()) > _POSSIBLE else {}
        off = np.reshape([np.asarray(c.moments) - moments for c in likely.values()], (-1, 3))
        return moments, covariance + np.einsum("c,ci,cj->ij", [c.weight for c in likely.values()], off, off)
