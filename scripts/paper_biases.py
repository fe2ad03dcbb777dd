"""What wrong models do to the separation: the paper's cross-fits without noise, and its pixels."""

from __future__ import annotations

from unittest.mock import patch

import numpy as np
import paper_numbers as paper
from paper_numerics import PUBLIC_LOCI, SAMPLES, SAMPLES_OF_NORMAL, SampledOptics, normal_of_shear
from paper_study import AS_PUBLISHED, MICRO, Part, Study

from jitterkit.conventions import FWHM_PER_SIGMA
from jitterkit.errors import JitterkitError
from jitterkit.forecast import CrossFit, forecast, noise_free_fit
from jitterkit.likelihood import Data
from jitterkit.loci import LOCI, Linear, Locus, Mvn, Shm
from jitterkit.refit import fit_locus
from jitterkit.report.words import number

FWHM = 0.225
"""arcsec, 0.6 pixel: the largest normal that the paper fits."""

LENGTHS = (0.075, 0.225, 0.375, 0.75)
"""arcsec: 0.2, 0.6, 1 and 2 pixels."""

TOO_COARSE = (SAMPLES, SAMPLES_OF_NORMAL, 8)
"""Points along the side of a pixel."""

SHORT = 0.01
"""arcsec: a streak of which one frame tells next to nothing."""

_WHERE = "sec. 3.4, fig. 5"


def cross_fits(study: Study) -> Part:
    """Biases of wrong loci, without noise."""
    part, exact = Part(), {}
    sigma = FWHM / FWHM_PER_SIGMA
    fitted = [("stable", paper.SHEARS[0]), ("linear", paper.SHEARS[0]), ("linear", paper.SHEARS[1])]
    for model, shear in fitted:
        for angle in (0.0,) if study.coarse else (0.0, 45.0, 90.0):
            what = f"mvn η {shear:g}, FWHM {FWHM:g} arcsec, φ {angle:g}° fitted as {model}"
            both = normal_of_shear(sigma, shear, angle), Mvn.sheared(sigma, shear, angle)
            exact["mvn", shear, angle, model] = _add_bias(study, part, what, both, model)
    others = {"linear": ("mvn", "shm"), "shm": ("mvn", "linear")}
    for name, kind in (("linear", Linear), ("shm", Shm)):
        for model in others[name]:
            for length in LENGTHS[1:2] if study.coarse else LENGTHS:
                both = PUBLIC_LOCI[name].of(length), kind.of(length)
                what = f"{name} {length:g} arcsec fitted as {model}"
                exact[name, length, model] = _add_bias(study, part, what, both, model)
    if not study.coarse:
        part.slips[10] = _advice(exact)
    return part


def _advice(exact: dict[tuple, float]) -> str:
    """What the biases say of the paper's advice to fit a normal."""
    first, second = (
        [number(exact["mvn", shear, angle, "linear"], 3) for angle in (0.0, 90.0)] for shear in paper.SHEARS
    )
    rising = [[number(exact[name, size, "mvn"], 3) for size in LENGTHS[1:]] for name in ("linear", "shm")]
    sizes = ", ".join(f"{size:g}" for size in LENGTHS[1:])
    return (
        "Streaks fitted to normals do not only underestimate the separation: the bias is "
        f"{first[0]} µas along the pair and {first[1]} across it (η {paper.SHEARS[0]:g}), "
        f"{second[0]} and {second[1]} (η {paper.SHEARS[1]:g}). Nor is a normal always safe: fitted to "
        f"streaks of {sizes} arcsec it is biased by {', '.join(rising[0])} µas (linear) and "
        f"{', '.join(rising[1])} µas (harmonic): beyond 0.2 arcsec fit the shape, or choose the locus."
    )


def _add_bias(study: Study, part: Part, what: str, both: tuple[Locus, Locus], model: str) -> float:
    """Add a row, and return the exact bias in µas; NaN where the fit does not settle."""
    with patch.dict(LOCI, PUBLIC_LOCI):
        public = _bias(study, both[0], model, study.sampled)
    exact = _bias(study, both[1], model, study.exact)
    spread = np.sqrt(2 * np.prod(study.exact.grid.shape))
    remark = "not settled" if exact is None else _goodness(exact.misfit, float(spread))
    values = [None if one is None else MICRO * one.bias for one in (public, exact)]
    part.add(f"bias: {what}", "µas", _WHERE, *values, remark=remark)
    return np.nan if values[1] is None else values[1]


def _bias(study: Study, truth: Locus, model: str, optics) -> CrossFit | None:
    try:
        return noise_free_fit(
            study.parameters(truth), model, optics, otf=optics.nominal, options=AS_PUBLISHED
        )
    except JitterkitError:
        return None


def _goodness(misfit: float, spread: float) -> str:
    """What chi-squared says of the wrong locus."""
    sigmas = misfit / spread
    return f"adds {number(misfit, 3)} to χ²" + (
        f", {sigmas:.0f} times its noise: refused" if sigmas > 5 else ""
    )


def pixels(study: Study) -> Part:
    """Points for pixels, how few draws tell a microarcsecond, and streaks that cannot be determined."""
    part = Part()
    frame, scene = Data(study.images()[1]), study.parameters()
    biases = {}
    for samples in TOO_COARSE:
        optics = SampledOptics(study.exact.pupil, study.exact.spectrum, study.exact.grid, samples=samples)
        fits = [
            fit_locus(model, frame, optics, scene, np.zeros(3), optics.nominal, AS_PUBLISHED)
            for model in ("stable", "mvn")
        ]
        still, free = (MICRO * (fit.of_scene("separation") - paper.SEPARATION) for fit in fits)
        biases[samples] = still
        what = f"bias: exact frame fitted with {samples} x {samples} points a pixel, no jitter"
        words = f"a free normal makes up for the missing variance: {free:+.2f} µas"
        part.add(what, "µas", "sec. 3.2" if samples == SAMPLES_OF_NORMAL else "", still, 0.0, remark=words)
    part.slips[4] = (
        "Points are not pixels: n x n of them lack p²/(12 n²) of variance. Frames of true pixels fitted so "
        "without jitter are biased by "
        + ", ".join(f"{number(bias, 3)} µas (n = {n})" for n, bias in biases.items())
        + "; a locus whose variances are free takes it up."
    )
    sampled = forecast(study.parameters(), study.sampled.nominal, options=AS_PUBLISHED)
    error = MICRO * sampled.error("separation")
    standard = error / np.sqrt(paper.DRAWS.value)
    draws = f"{paper.DRAWS.value:,.0f} draws"
    words = f"of 1 µas after {error**2:,.0f} draws; a fit without noise needs none"
    part.add(f"standard error of the mean of {draws}", "µas", paper.DRAWS.where, standard, None, remark=words)
    part.slips[5] = (
        f"{draws} have a standard error of {standard:.1f} µas, too coarse for a systematic error of one "
        "microarcsecond: “without introducing any significant systematic biases” could not be found wrong. "
        "Fits of the expected frame, without noise, give the biases of the table exactly."
    )
    found = forecast(
        study.parameters(Linear.of(SHORT), study.photons), study.exact.nominal, options=AS_PUBLISHED
    )
    angle = found.jitter()["jitter_angle"][1]
    part.add(f"σ(angle) of a streak of {SHORT:g} arcsec", "°", "sec. 3.1", None, angle)
    part.slips[6] = (
        f"Length and angle are singular at zero length: at {SHORT:g} arcsec the bound of the angle is "
        f"{angle:.0f}°, and at zero its row of the Fisher matrix vanishes. Second moments stay regular."
    )
    return part
