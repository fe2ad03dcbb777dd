"""How well a locus explains a frame, its freedom counted: Laplace's approximation of the evidence.

    ln Z = -objective/2 + ln sqrt(det 2 pi C) + ln (prior density of the jitter's coordinates)

over all free parameters, with covariance C at the best fit.  Scene and optics have the same flat priors
under every locus, which cancel; the jitter's are proper and stated here.  Every locus has the same prior
on its size, flat in the logarithm of ``T = Sxx + Syy``, whose range cancels too; directions are
equally probable; what else a locus has is spread over all it can be.

*Assumes* that jitter has been detected: at no size Laplace's approximation fails, and so does this prior.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Callable
from typing import Literal, NamedTuple

import numpy as np
from scipy.special import log_ndtr

from jitterkit.loci import Linear, Locus, Path, Shm
from jitterkit.refit.boundary import at_zero_length, minor_variance, regularizing_priors, step_of_path
from jitterkit.refit.result import FitResult

_LEAST = 1e-12
"""arcsec²: floor of a variance inside a logarithm, a millionth of an arcsec squared."""


@functools.cache
def _density_of_paths(knots: int) -> float:
    """Return the density in ``ln T``, at that T, of paths whose steps have their regularizing prior.

    T is a sum of exponentials: each of the ways to step along an axis adds ``v (a² + b²)``, of mean
    ``m = 2 v sigma²``, where v are the variances of steps of rms one.  The sum has the density
    ``sum_j exp(-T/m_j)/m_j prod_(k != j) m_j/(m_j - m_k)``; with sigma in proportion to sqrt(T), T times it
    is a number.
    """
    means = 2 * Path.variances(knots) * step_of_path(knots) ** 2
    ratios = means[:, None] / (means[:, None] - means + np.diag(np.inf * np.ones(len(means))))
    np.fill_diagonal(ratios, 1.0)
    return float(np.sum(np.exp(-1 / means) / means * np.prod(ratios, axis=1)))


def log_evidence(fit: FitResult) -> float:
    """Logarithm of the evidence for the locus of a fit, up to a constant common to all loci.

    Parameters
    ----------
    fit : FitResult

    Returns
    -------
    evidence : float
        Minus infinity for a fit that broke down, or a locus without a stated prior.

    Notes
    -----
    Elliptical loci (``mvn``, ``ellipse``, ``shaped``): the anisotropy ``(Sxx - Syy, 2 Sxy)/T`` is uniform in
    the unit disc; what part of the posterior lies outside it, at negative variances, counts for nothing.
    A normal is as likely to be a straight line as not, so that random motion in one plane is not taken
    for a vibration because it is straight.

    A locus of several parts of which one cannot be distinguished from nothing has no evidence: a simpler one
    is the same.

    A path's steps have a regularizing prior, a normal density N of a width in proportion to its rms.  Over
    paths drawn from N, T has a density q in ln T: ``N/q`` is flat in ln T, and has at each T the shapes that
    N has there. Its quadratic form is in the objective with the width of the start, the rest taken with that
    of the end; their T agree to 6 %, since ``Path.near`` has the moments that it is given, which is worth
    0.04 in ln Z. Importance sampling agreed with Laplace to 0.4 where a path is bent; *fails when* it is all
    but straight: its evidence is then 2 or 3 too high.
    """
    choice = CHOICES.get(fit.locus)
    if fit.parameters is None or choice is None or not np.all(np.isfinite(fit.covariance)):
        return -math.inf
    if at_zero_length(fit.parameters.locus, fit.names, fit.covariance):
        return -math.inf
    return log_volume(fit) + choice.log_prior(fit, fit.parameters.locus)


def log_volume(fit: FitResult) -> float:
    """Logarithm of the evidence of a fit whose parameters have a prior density of one.

    Minus infinity where the fit has no volume: something of it is not determined.
    """
    if not np.all(np.isfinite(fit.covariance)):
        return -math.inf
    sign, size = np.linalg.slogdet(2 * np.pi * fit.covariance)
    return float(-fit.objective / 2 + size / 2) if sign > 0 else -math.inf


def _total(locus: Locus) -> float:
    sxx, _, syy = np.asarray(locus.moments())
    return max(float(sxx + syy), _LEAST)


def _streak(variance: float) -> Callable[[FitResult, Locus], float]:
    """``T = v L²``, and the double angle uniform: ``v²/(2 pi T²)``."""
    return lambda fit, locus: math.log(variance**2 / (2 * math.pi)) - 2 * math.log(_total(locus))


def _elliptic(fit: FitResult, locus: Locus) -> float:
    """``4/(pi T³)`` inside the disc of anisotropies."""
    minor, error = minor_variance(*fit.moments())
    return math.log(4 / math.pi) - 3 * math.log(_total(locus)) + float(log_ndtr(minor / error))


def _normal(fit: FitResult, locus: Locus) -> float:
    """Half of it elliptical, half of it straight: the posterior cut at no minor variance, with a prior
    ``1/(pi T)`` in T and angle.
    """
    minor, error = minor_variance(*fit.moments())
    total = _total(locus)
    free = _elliptic(fit, locus)
    line = math.log(4 / math.pi) - 3 * math.log(total) - 0.5 * (minor / error) ** 2
    line += math.log(total / (4 * math.sqrt(2 * math.pi) * error))
    return float(np.logaddexp(free, line)) - math.log(2)


def _shaped(fit: FitResult, locus: Locus) -> float:
    return _elliptic(fit, locus) + _regularizing_norm(locus)


def _partial(fit: FitResult, locus: Locus) -> float:
    """The rms as a vector: ``1/(pi T)``; two sets of coordinates are the same motion."""
    return math.log(2 / math.pi) - math.log(_total(locus)) + _regularizing_norm(locus)


def _path(fit: FitResult, locus: Locus) -> float:
    """Return the log-density of the steps: of their shape by the regularizing prior, flat in ln T.

    A path and the same run backwards are the same image.
    """
    density = _density_of_paths(locus.knots)  # type: ignore[attr-defined]
    return math.log(2) + _regularizing_norm(locus) - math.log(density)


def _tones(fit: FitResult, locus: Locus) -> float:
    """The share of the first uniform, both directions free; which is the first does not matter."""
    first, second = (_total(part) for part in locus.factors())  # type: ignore[attr-defined]
    total = first + second
    density = 2 * Shm.variance**4 / ((2 * math.pi) ** 2 * first * second)
    return math.log(density) - 2 * math.log(total)


def _smear(fit: FitResult, locus: Locus) -> float:
    """The smear's share uniform, its direction free; the rest, if there is one, as an elliptical locus."""
    smear, rest = locus.factors()  # type: ignore[attr-defined]
    indices = [fit.names.index(name) for name in locus.names[2:]]
    covariance = fit.covariance[np.ix_(indices, indices)]
    error = math.sqrt(covariance[0, 0] + covariance[2, 2] + 2 * covariance[0, 2])
    if _total(rest) < 3 * error:
        return -math.inf
    density = 4 * Linear.variance**2 / (2 * math.pi**2 * _total(smear) * _total(rest) ** 2)
    minor, spread = minor_variance(rest.moments(), covariance)
    return math.log(density) - 2 * math.log(_total(smear) + _total(rest)) + float(log_ndtr(minor / spread))


def _regularizing_norm(locus: Locus) -> float:
    """Return the norm of the regularizing priors, whose quadratic forms are in the objective."""
    return sum(-0.5 * math.log(2 * math.pi * sigma**2) for _, sigma in regularizing_priors(locus).values())


class Choice(NamedTuple):
    """Describe how ``--locus auto`` treats a locus.

    Attributes
    ----------
    tier : int
        When it is tried: 0 always, 1 if a shape can be seen, 2 and 3 if no locus of the tiers before fits.
        By freedom: loci of tier 1 have two or three coordinates, of tier 2 four or five, of tier 3 six.
    log_prior : callable
        Logarithm of the prior density of its coordinates at a fit; arguments are the fit and its locus.
    across : {"none", "some", "any"}
        Blur across the major axis.  A locus with ``none`` is tried only if the blur may be straight, one with
        ``some`` only if it is not straight or nothing else fits, one with ``any`` always.
    """

    tier: int
    log_prior: Callable[[FitResult, Locus], float]
    across: Literal["none", "some", "any"] = "any"

    @property
    def is_simple(self) -> bool:
        """Return whether it has at most three coordinates, which follow one step of scoring."""
        return self.tier < 2


CHOICES: dict[str, Choice] = {
    "mvn": Choice(0, _normal),
    "linear": Choice(1, _streak(Linear.variance), "none"),
    "shm": Choice(1, _streak(Shm.variance), "none"),
    "ellipse": Choice(1, _elliptic),
    "shaped": Choice(2, _shaped),
    "partial": Choice(2, _partial, "none"),
    "tones": Choice(2, _tones, "some"),
    "smear": Choice(2, _smear),
    "path": Choice(3, _path),
}
"""The loci among which ``--locus auto`` chooses.  To have it try another one, add an entry here."""


def is_intricate(locus: str) -> bool:
    """Return whether a locus, by its name, is one that is tried only if no simple one fits."""
    return locus in CHOICES and not CHOICES[locus].is_simple
