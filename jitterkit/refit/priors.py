"""What is known before the frame is looked at.

A prior comes from *other* data: telemetry, a catalogue, the other frames of a sequence.  A frame's own
kernel estimate is none: it is a summary of the very photons that the likelihood will count, and to
use it again would count them twice.  :func:`kernel_prior` and :func:`sequence_prior` make nothing of it.

Reach for :func:`sequence_prior` with the other frames of a run, :func:`trace_prior` with telemetry,
:func:`kernel_prior` with one estimate; :mod:`jitterkit.refit.prior_file` reads any of them from a file.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.loci import LOCI, Locus, Trace
from jitterkit.metric import Prior
from jitterkit.refit.boundary import regularizing_priors

OTHERS = 6
"""Frames that a scatter of three moments can be learnt from: with fewer its variance is infinite."""

_ROUNDING = 1e-12
"""Share of a trace's largest number below which its rms is rounding, not motion."""


@dataclass(frozen=True)
class Priors:
    """Normal priors.

    Attributes
    ----------
    terms : mapping of name to (mean, sigma)
        Independent priors, in the parameter's own unit: ``{"noll4": (0.0, 5.0)}``.
    moments : (mean, covariance) or None
        Joint prior on the second moments ``(Sxx, Sxy, Syy)`` of the pointing, arcsec² and arcsec⁴.  It holds
        for every locus, by the moments that the locus has.
    if_free : mapping of name to (mean, sigma)
        Terms that hold where a frame's fit varies the parameter, and are none where it does not.
    """

    terms: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    moments: tuple[np.ndarray, np.ndarray] | None = None
    if_free: Mapping[str, tuple[float, float]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        for name, (mean, sigma) in {**self.if_free, **self.terms}.items():
            if not (np.isfinite(mean) and sigma > 0):
                problem = f"The prior on {name} needs a finite mean and a positive sigma"
                raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}, got {mean} and {sigma}.")

    @classmethod
    def alike(cls, names: Iterable[str], sigma: float | None) -> Priors:
        """The same on each of some parameters that is free: zero within ``sigma``; none at all without it."""
        return cls(if_free={} if sigma is None else dict.fromkeys(names, (0.0, sigma)))

    def on(self, names: Collection[str]) -> dict[str, tuple[float, float]]:
        """Terms on free parameters of these names, and those on others that there have to be."""
        return {name: term for name, term in self.if_free.items() if name in names} | dict(self.terms)

    def joined(self, other: Priors) -> Priors:
        """Both together: the other's terms stand before these, and moments are combined by their information.

        *Assumes* that the two were learnt from different data.
        """
        known = [priors.moments for priors in (self, other) if priors.moments is not None]
        precisions = [np.linalg.inv(covariance) for _, covariance in known]
        moments = known[0] if known else None
        if len(known) == 2:
            covariance = np.linalg.inv(precisions[0] + precisions[1])
            moments = covariance @ (precisions[0] @ known[0][0] + precisions[1] @ known[1][0]), covariance
        return Priors({**self.terms, **other.terms}, moments, {**self.if_free, **other.if_free})

    def on_coordinates(self) -> bool:
        """Return whether there is a prior in the coordinates of one locus, and so of no other."""
        coordinates = {name for kind in LOCI.values() for name in getattr(kind, "names", ())}
        return bool(coordinates & set(self.terms))

    def on_jitter(self) -> bool:
        """Return whether there is a prior on the jitter, of one locus or of all."""
        return self.moments is not None or self.on_coordinates()

    def over(self, names: tuple[str, ...], locus: Locus | None = None) -> Prior:
        """The prior on free parameters of the given names.

        Parameters
        ----------
        names : tuple of str
        locus : Locus, optional
            What the fit starts from: its :func:`~jitterkit.refit.boundary.regularizing_priors` are added,
            where no term says better.

        Raises
        ------
        ConfigurationError
            If a term names no parameter at all; the message lists those there are.
        """
        mean, precision = np.zeros(len(names)), np.zeros((len(names), len(names)))
        weak = {} if locus is None else regularizing_priors(locus)
        known = {name: term for name, term in weak.items() if name in names} | self.on(names)
        for name, (centre, sigma) in known.items():
            if name not in names:
                problem = f"There is no free parameter {name!r} to put a prior on"
                remedy = f"there are {', '.join(names)}"
                raise ConfigurationError(ErrorCode.UNKNOWN_NAME, f"{problem}; {remedy}.")
            i = names.index(name)
            mean[i], precision[i, i] = centre, sigma**-2
        moments, covariance = (np.zeros(3), None) if self.moments is None else self.moments
        moments_precision = np.zeros((3, 3)) if covariance is None else np.linalg.inv(covariance)
        return Prior(mean, precision, moments, moments_precision)


def moments_prior(mean, covariance) -> Priors:
    """A prior on the second moments of the pointing.

    Parameters
    ----------
    mean : (3,) array
        ``(Sxx, Sxy, Syy)``, arcsec².
    covariance : (3, 3) array
        arcsec⁴.

    Raises
    ------
    ConfigurationError
        If the covariance is not positive definite, or anything is not finite.
    """
    mean, covariance = np.asarray(mean, float), np.asarray(covariance, float)
    finite = bool(np.all(np.isfinite(mean)) and np.all(np.isfinite(covariance)))
    if not (finite and np.linalg.eigvalsh(covariance)[0] > 0):
        problem = "A prior on the jitter needs finite moments and a positive definite covariance"
        found = f"got {mean.tolist()} and {covariance.tolist()}"
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{problem}; {found}.")
    return Priors(moments=(mean, covariance))


def kernel_prior(estimate: KernelEstimate, frame: str, digest: str = "") -> Priors:
    """A prior on the jitter from one estimate made of other data.

    Parameters
    ----------
    estimate : KernelEstimate
    frame : str
        Source of the frame to be fitted: ``Frame.name``.
    digest : str
        Of its pixels, ``Frame.digest``: where the estimate has one too, it decides in place of the name.

    Returns
    -------
    priors : Priors
        Empty if the estimate was made from that very frame: it may start the fit, but it holds no
        information that the frame's photons do not.

    Raises
    ------
    ConfigurationError
        If the estimate does not say what it was made from.

    Notes
    -----
    *Assumes* that the frame has the same jitter as the estimate's data.  *Fails when* the frame was cut,
    calibrated or otherwise changed after it was estimated: by its pixels it is then another one.
    """
    _describe_source(estimate)
    if same_frame(estimate, frame, digest):
        return Priors()
    return moments_prior(estimate.moments, estimate.covariance)


def sequence_prior(estimates: Sequence[KernelEstimate], frame: str, digest: str = "") -> Priors:
    """A prior on a frame's jitter from the other frames of its sequence.

    Parameters
    ----------
    estimates : sequence of KernelEstimate
        One a frame; the frame's own may be among them and is left out.
    frame : str
        Source of the frame to be fitted: ``Frame.name``.
    digest : str
        As for :func:`kernel_prior`.

    Returns
    -------
    priors : Priors
        About the mean of the others, weighted by the inverse of their covariances; as wide as one more
        of them would scatter about it, estimation included: of n others ``(n² - 1)/(n (n - 5))`` times the
        sample covariance, as the predictive t law has it.

    Raises
    ------
    ConfigurationError
        If an estimate does not say what it was made from, or fewer than six are of other frames.

    Notes
    -----
    *Assumes* that jitter comes and goes from frame to frame but its law stays.  Fits with such priors share
    photons: their errors are no longer independent, if only through the jitter.
    """
    for estimate in estimates:
        _describe_source(estimate)
    others = [estimate for estimate in estimates if not same_frame(estimate, frame, digest)]
    n = len(others)
    if n < OTHERS:
        problem = f"A prior from a sequence needs the estimates of {OTHERS} other frames or more, got {n}"
        raise ConfigurationError(ErrorCode.TOO_FEW, f"{problem}; fit without.")
    weights = np.array([np.linalg.inv(estimate.covariance) for estimate in others])
    moments = np.array([estimate.moments for estimate in others])
    mean = np.linalg.solve(weights.sum(axis=0), np.einsum("nij,nj->i", weights, moments))
    off = moments - mean
    return moments_prior(mean, off.T @ off * (1 + 1 / n) / (n - 5))


def trace_prior(t, x, y, uncertainty: float = 0.1, exposure: float | None = None) -> Priors:
    """A prior on the jitter from telemetry: the moments of a pointing trace.

    Parameters
    ----------
    t : (n,) array
        Seconds, ascending.
    x, y : (n,) array
        Pointing, arcsec.
    uncertainty : float
        Relative error of the trace's rms: what the sensor misses, and how it is calibrated.
    exposure : float, optional
        Seconds.  A trace of two exposures or more is cut into pieces of one: their mean is the prior's,
        and their scatter adds to its width.  By default the whole trace is one.

    Raises
    ------
    ConfigurationError
        If the trace does not move, is shorter than an exposure, has fewer than two samples in one, or the
        uncertainty is not positive.

    Notes
    -----
    The width is the same in every direction, ``2 u T`` in any variance for a trace with ``T = Sxx + Syy``, so
    that a straight trace does not forbid a round blur.
    """
    if not uncertainty > 0:
        problem = f"The uncertainty of a trace must be positive, got {uncertainty}."
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, problem)
    t = np.asarray(t, float)
    pieces = 1 if exposure is None else whole_exposures(t[-1] - t[0], exposure)
    starts = [t[0] + k * (exposure or 0.0) for k in range(pieces)]
    every = np.array([Trace.of(t, x, y, start, exposure).moments() for start in starts])
    mean = every.mean(axis=0)
    if mean[0] + mean[2] <= (_ROUNDING * max(np.abs(x).max(), np.abs(y).max())) ** 2:
        problem = "The trace does not move during the exposure, and has no information on the jitter"
        raise ConfigurationError(ErrorCode.NO_SIGNAL, f"{problem}; give one that does, or fit without.")
    width = (2 * uncertainty * (mean[0] + mean[2])) ** 2 * np.diag([1.0, 0.5, 1.0])
    return moments_prior(mean, width + (np.cov(every.T) if pieces > 1 else 0.0))


def whole_exposures(duration: float, exposure: float) -> int:
    """Count the whole exposures of a trace, whatever the rounding of its times; at least one."""
    return max(1, int(duration / exposure * (1 + 1e-9)))


def _describe_source(estimate: KernelEstimate) -> None:
    if not estimate.source:
        problem = "This kernel estimate does not say which data it was made from"
        remedy = "set its source before using it as a prior, or the frame's photons may be counted twice"
        raise ConfigurationError(ErrorCode.MISSING_VALUE, f"{problem}; {remedy}.")


def same_frame(estimate: KernelEstimate, frame: str, digest: str) -> bool:
    """Return whether an estimate is of a frame: by the pixels where both are known, else by the names.

    The only frame of a file is its first, packed or not.
    """
    if estimate.digest and digest:
        return estimate.digest == digest
    plain = (name.replace(".gz", "").replace(".fz", "") for name in (estimate.source, frame))
    first, second = (name if name.endswith("]") else f"{name}[0]" for name in plain)
    return first == second
