"""The trail that all stars share: measured against a sharp PSF, or inferred from the stars alone.

:func:`trail_against` fits a line to every star at once.  :func:`trail_alone` has only the stars' own shapes,
and must assume what they would be without the trail: round.
"""

from __future__ import annotations

from dataclasses import dataclass

import equinox as eqx
import numpy as np

from jitterkit.kernel_estimate import is_detected, refuse_blurrier
from jitterkit.loci import (
    Linear,
    Locus,
    Mvn,
    Shm,
    Streak,
    axis_variances,
    covariance_on_axis,
    moments_on_axis,
)
from jitterkit.optics import OTF, empirical_otf
from jitterkit.starfield import certainty
from jitterkit.starfield.core import centred, fit_round_core, length_model_error, misfit_under
from jitterkit.starfield.joint import JointFit, PsfNoise, fit_joint, left_of
from jitterkit.starfield.moments import Moments, Stars
from jitterkit.starfield.psf import Common, Psf, stack_psf

_PAD = 12
"""Pixels of padding about a stamp in the joint fit, at least: two lengths of a trail of 6."""

_WIDER = 5.0
"""Sigma of the variance across a trail from which a change of seeing is believed."""

_CHANGED = {"wider": 0.1, "narrower": 0.5}
"""Share of a change of seeing that the line may have taken for its own variance: 0.05 of Moffat stars of
FWHM 3.6 pixels against 3.0, 0.3 to 0.4 of 2.5 against 3.0 and of 1.6 against 2.8."""

_CLEARLY = 9.0
"""Deviance by which a vibration must fit better than a uniform line, to be taken for one: three sigma."""

_CONDITION = "The length holds if stars are round without the trail; a sharp reference frame would show it."


@dataclass(frozen=True, eq=False)
class Trail:
    """A trail, in pixels.

    Attributes
    ----------
    locus : Locus or None
        The line, a vibration along it, or a normal where that fits better; None where there is no blur to be
        seen.
    moments, covariance : (3,) and (3, 3) array
        Of the pointing [pixels², pixels⁴].
    length, length_err, angle, angle_err : float
        Of a uniform line [pixels, deg]; no length where there is no blur to be seen.
    used : (n,) bool array
        Stars that it rests on.
    variation : (float, int)
        Chi-squared and degrees of freedom of one blur for all of them.
    remarks : tuple of str
    undetermined : str
        Why it is no trail, in a sentence; empty where it is one.
    """

    locus: Locus | None
    moments: np.ndarray
    covariance: np.ndarray
    length: float
    length_err: float
    angle: float
    angle_err: float
    used: np.ndarray
    variation: tuple[float, int]
    remarks: tuple[str, ...]
    undetermined: str = ""


def trail_alone(stars: Stars, moments: Moments, common: Common) -> Trail:
    """Infer the trail on the condition that the core is round.

    Parameters
    ----------
    stars : Stars
    moments : Moments
        Theirs.
    common : Common
        What these have in common: their axis is the trail's.

    Returns
    -------
    trail : Trail

    Raises
    ------
    UndeterminedError
        If no round core under a line looks like the mean star.

    Notes
    -----
    The length is that of :func:`~jitterkit.starfield.core.fit_round_core` on the mean star, its error that
    of the common moments; where the fit is poor, half its distance to the length by moments is added.
    """
    psf = stack_psf(stars, moments)
    core = fit_round_core(psf, common.moments)
    major, minor, axis = axis_variances(common.moments)
    noise = certainty.elongation_errors(common.covariance, axis)
    length = core.line.describe()["length"]
    words = "A round Moffat core under a line"
    model_error, remarks = length_model_error(core.misfit, words, length, major - minor)
    line = Linear.of(length, axis)
    coarse, coarsely = certainty.coarse_sampling(minor)
    along = 12 * (noise[0] + coarse)
    why = certainty.compatible_with_zero(length, 12 * noise[0], 12 * coarse, model_error)
    return Trail(
        line,
        np.asarray(line.moments()),
        _widened(common.covariance, line, common.moments, poor=bool(remarks)),
        length,
        float(np.hypot(certainty.root_error(length**2, along), model_error)),
        axis,
        _axis_error(major - minor, noise[1] + 2 * coarse),
        common.used,
        (common.chi2, common.dof),
        (_CONDITION, *remarks, *coarsely),
        why or certainty.disagreement(common),
    )


def trail_against(psf: Psf, stars: Stars, moments: Moments, common: Common) -> Trail:
    """Measure the trail that makes a sharp PSF into these stars.

    Parameters
    ----------
    psf : Psf
        On the same pixels.
    stars : Stars
    moments : Moments
        Theirs: where the fit starts.
    common : Common
        What these have in common; stars that disagree are left out.

    Returns
    -------
    trail : Trail
        Errors contain those of the PSF's own moments.

    Raises
    ------
    UndeterminedError
        If the PSF is blurrier than the stars, or no line over it looks like them.

    Notes
    -----
    Whether there is a blur at all is asked of the difference of the moments.  Where there is none, it is
    all that is returned.
    """
    excess, shared = common.moments - psf.moments, common.covariance + psf.covariance
    refuse_blurrier(excess, shared, tolerated=certainty.TOLERATED)
    own: tuple[str, ...] = ()
    if (found := certainty.elongation(psf)) is not None:
        size_of_own = f"{found[0]:.1f} pixels along {found[1]:.0f} degrees"
        own = (f"The reference's own stars are elongated by {size_of_own}: blurs are relative to that.",)
    if not is_detected(excess, shared):
        return _sharp(excess, shared, common, own)
    which = np.flatnonzero(common.used)
    some, theirs = stars.chosen(which), moments.chosen(which)
    pad = max(_PAD, some.electrons.shape[-1] // 4)
    middle = (psf.stamp.shape[1] - 1) / 2, (psf.stamp.shape[0] - 1) / 2
    otf = empirical_otf(psf.stamp, 1.0, some.electrons.shape[1:], centre=middle, pad=pad)
    noise = PsfNoise(centred(psf.error, some.electrons.shape[-1]), np.ones(otf.value.shape), 1.0)
    blur: Locus = Mvn.near(excess)
    for _ in range(2):  # the excess of moments overstates the blur
        noise = noise._replace(left=float(left_of(blur, otf)))
        normal = fit_joint(some, theirs, otf, blur, noise)
        blur = normal.locus
    line, otf, changed, changes = _line(some, theirs, otf, normal, psf, noise)
    assert isinstance(line.locus, Streak)
    size, ratio = line.locus.describe(), 12 * line.locus.variance
    length, axis = size["length"] * np.sqrt(ratio), size["angle"]
    to_line = np.array([[12.0, 0.0, -12.0], [0.0, 24.0, 0.0]])
    covariance = ratio**2 * line.covariance + to_line @ psf.covariance @ to_line.T
    c, s = np.cos(np.radians(2 * axis)), np.sin(np.radians(2 * axis))
    along, across = (np.sqrt(v @ covariance @ v) for v in (np.array([c, s]), np.array([-s, c])))
    major, minor, _ = axis_variances(excess)
    poor = misfit_under(stack_psf(some.chosen(line.used), theirs.chosen(line.used)), psf, otf, line.locus)
    shape = "line" if isinstance(line.locus, Linear) else "vibration along a line"
    words = f"A {shape} over the reference's stars"
    model_error, remarks = length_model_error(poor, words, length, major - minor)
    if not isinstance(line.locus, Linear):
        drawn = f"a vibration of {size['length']:.3g} pixels peak to peak"
        own = (
            *own,
            f"The stars are drawn out by {drawn}; the length is a uniform line's of its variance.",
        )
    fits = not remarks and not changes  # then even one star is the reference's, drawn along a line
    best = normal if normal.fits_better(line) else line
    coarse, coarsely = certainty.coarse_sampling(axis_variances(psf.moments)[1])
    systematic = 12 * (changed + coarse)
    # galaxies scatter more than the line shows
    scatter = 12 * certainty.elongation_errors(common.covariance, axis)[0]
    why = certainty.compatible_with_zero(length, max(along, scatter), systematic, model_error)
    why = why or ("" if fits else certainty.disagreement(common))
    used = np.zeros(len(stars), bool)
    used[which[best.used]] = True
    return Trail(
        best.locus,
        np.asarray(best.locus.moments()),
        _widened(normal.covariance + psf.covariance, best.locus, excess, poor=bool(remarks)),
        length,
        float(np.hypot(certainty.root_error(length**2, along + systematic), model_error)),
        axis,
        _axis_error(length**2, across + 24 * coarse),
        used,
        (best.chi2, best.dof),
        (*own, *changes, *remarks, *coarsely),
        why,
    )


def _widened(covariance: np.ndarray, locus: Locus, moments: np.ndarray, *, poor: bool) -> np.ndarray:
    """Return the covariance of a locus's moments; of a poor fit with half the distance to the stars' own.

    The distance is that of the elongations, along the axis: the stars' size may be that of the seeing.
    """
    if not poor:
        return covariance
    (wide, narrow, axis), own = axis_variances(moments), axis_variances(locus.moments())
    error = moments_on_axis([(wide - narrow - own[0] + own[1]) / 2, 0.0, 0.0], -axis)
    return covariance + np.outer(error, error)


def _sharp(excess: np.ndarray, covariance: np.ndarray, common: Common, remarks: tuple[str, ...]) -> Trail:
    """No trail: what the moments differ by, with their errors."""
    _, _, axis = axis_variances(excess)
    guess, used = _axis_error(0.0, 1.0), common.used
    variation = common.chi2, common.dof
    return Trail(None, excess, covariance, np.nan, np.nan, axis, guess, used, variation, remarks)


def _line(
    stars: Stars, moments: Moments, otf: OTF, normal: JointFit, psf: Psf, noise: PsfNoise
) -> tuple[JointFit, OTF, float, tuple[str, ...]]:
    """Fit a line or a vibration; where stars are wider across it than the PSF, after that has been widened.

    With the optics that the line lies over, the variance that it may owe to a change of seeing [pixels²], and
    a remark on that.
    """
    blur = np.asarray(normal.locus.moments())

    def best_over(otf: OTF, noise: PsfNoise) -> JointFit:
        line, vibration = (fit_joint(stars, moments, otf, kind.near(blur), noise) for kind in (Linear, Shm))
        return vibration if vibration.fits_better(line, _CLEARLY) else line

    line = best_over(otf, noise)
    _, minor, axis = axis_variances(blur)
    error = float(np.sqrt(covariance_on_axis(normal.covariance + psf.covariance, axis)[2, 2]))
    if abs(minor) < _WIDER * error:
        return line, otf, 0.0, ()
    fy, fx = otf.grid.frequencies
    widening = np.exp(-2 * np.pi**2 * minor * (fx**2 + fy**2))
    changed = eqx.tree_at(lambda o: o.value, otf, otf.value * widening)
    other = best_over(changed, noise._replace(power=widening**2))
    if line.fits_better(other):
        return line, otf, 0.0, ()  # a normal locus is narrower across than the long line it stands for
    how = "wider" if minor > 0 else "narrower"
    remark = (
        f"The stars are {how} than the reference's across the trail too, by {abs(minor):.3f} pixel² of "
        "variance; seeing or focus changed, and the length holds if they did so all round."
    )
    wide, narrow, _ = axis_variances(psf.moments)
    share = _CHANGED[how] + (wide - narrow) / narrow  # a long star that grows may grow longer
    return other, changed, share * abs(minor), (remark,)


def _axis_error(size: float, across: float) -> float:
    """Error of an axis [deg] from that of the elongation at 45 degrees to it; at most that of a guess."""
    return float(min(np.degrees(across / max(size, 1e-300)) / 2, 90 / np.sqrt(3)))
