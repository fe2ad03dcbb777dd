"""The paper's numbers without jitter: errors, photons, detector; its matrices and example frames."""

from __future__ import annotations

import math

import numpy as np
import paper_numbers as paper
from matplotlib.figure import Figure
from paper_numerics import PUBLIC_LOCI, area_of_diameters_as_radii, normal_of_shear
from paper_study import AS_PUBLISHED, MICRO, PLATE_SCALE, TARGET, Part, Study
from study_plots import plot_arcsine

from jitterkit.detectors import Detector
from jitterkit.forecast import forecast
from jitterkit.loci import Linear, Mvn, Shm
from jitterkit.photons import Throughput, blackbody, count_photons, flat_curve
from jitterkit.photons.stars import MAGNITUDES, TEMPERATURES
from jitterkit.report.forecast_plots import plot_matrices
from jitterkit.report.forecast_table import observing_time
from jitterkit.report.photon_plots import plot_photons
from jitterkit.report.plots import plot_image, stretch
from jitterkit.report.words import number

READ_NOISE = (2.4, 3.0, 10.0)
"""e-."""

_FINE = 0.01
"""e-/ADU: so fine that the rounding adds nothing."""

FULL_WELL = 15.0
"""ke-, of an IMX183: about."""

EXAGGERATED = 6.0
"""arcsec, 16 pixels: length of the streaks in the example frames."""

SHEAR, ANGLE = 0.5, 30.0
"""Of the normal in the example frames, and of every jitter there, degrees."""


def still(study: Study) -> Part:
    """Errors without jitter, and how long they take to the target."""
    part = Part()
    public, exact = study.errors()
    part.add(
        "σ(separation), no jitter",
        "µas",
        paper.SIGMA.where,
        public,
        exact,
        paper=paper.SIGMA.value,
        remark="3.811 × 10⁷ photons; the public model's points for pixels make it too good",
    )
    part.add(
        "frames to 1 µas",
        "",
        paper.FRAMES.where,
        public**2,
        exact**2,
        paper=paper.FRAMES.value,
        remark=f"241² is {paper.SIGMA.value**2:,.0f}",
    )
    part.add(
        "time to 1 µas",
        "min",
        paper.MINUTES.where,
        _minutes(public),
        _minutes(exact),
        paper=paper.MINUTES.value,
    )
    slow = study.errors(flux=study.photons)
    what = f"σ(separation), {number(study.photons, 3)} photons"
    part.add(what, "µas", "", *slow, remark="by the true area")
    part.add("frames to 1 µas, by the true area", "", "", *(e**2 for e in slow))
    part.add("time to 1 µas, by the true area", "h", "", *(_minutes(e) / 60 for e in slow))
    part.slips[9] = (
        f"“60000 frames” is 241² = {paper.SIGMA.value**2:,.0f}; exact pixels make it {exact**2:,.0f}, and "
        f"the true area {slow[1] ** 2:,.0f} ({_minutes(slow[1]) / 60:.1f} h, not 97 min). The undisclosed "
        "Gaussian priors make the paper's fits maximum a posteriori, not maximum likelihood; here are none."
    )
    return part


def _minutes(error: float) -> float:
    return 60 * observing_time(error / MICRO, TARGET, paper.EXPOSURE.value)


def photons(study: Study) -> Part:
    """Area, photons, and the paper's figure of spectra."""
    part = Part()
    slip = area_of_diameters_as_radii(paper.DIAMETER, paper.OBSCURATION)
    stars = tuple(blackbody(*star) for star in zip(TEMPERATURES, MAGNITUDES, strict=True))
    budget = count_photons(
        stars, Throughput(flat_curve(530.0, 640.0)), area=study.area, exposure=paper.EXPOSURE.value
    )
    by_slip = paper.RATE.value * slip * paper.EXPOSURE.value
    part.add(
        "photon rate",
        "1/s/cm²",
        paper.RATE.where,
        None,
        budget.rate,
        paper=paper.RATE.value,
        remark="blackbodies and a flat filter for Phoenix atmospheres and the flight filter: good to 3 %",
    )
    part.add(
        "collecting area",
        "cm²",
        paper.AREA.where,
        slip,
        study.area,
        paper=paper.AREA.value,
        remark="diameters for radii",
    )
    part.add(
        "photons per frame",
        "",
        paper.PHOTONS.where,
        by_slip,
        study.photons,
        paper=paper.PHOTONS.value,
        remark=f"by the paper's rate; by that above {number(budget.photons, 3)}",
    )
    part.slips[1] = (
        f"The area of {slip:.1f} cm² takes diameters for radii. The true one is {study.area:.2f} cm², a "
        f"frame has {number(study.photons)} photons and not {number(by_slip)}, and every error is "
        "twice the paper's."
    )
    words = "Starlight, throughput and detected photons (the paper's fig. 6), blackbodies for atmospheres."
    part.pictures["photons"] = (plot_photons(budget)[0].get_figure(root=True), words)
    return part


def detector(study: Study) -> Part:
    """What frame and detector do to a still pair, and how little jitter shows in one frame."""
    part = Part()
    images = study.images(flux=study.photons)
    part.add("light inside 128 x 128 pixels", "%", "", *(100 * i.sum() / study.photons for i in images))
    part.add("peak pixel, of all photons", "%", "", *(100 * i.max() / study.photons for i in images))
    for flux in (study.photons, paper.PHOTONS.value):
        peaks = (1e-3 * i.max() * flux / study.photons for i in images)
        part.add(
            f"peak pixel at {number(flux, 3)} photons", "ke-", "", *peaks, remark=f"full well: {FULL_WELL:g}"
        )
    scene = study.parameters(flux=study.photons)
    for noise in READ_NOISE:
        camera = Detector(gain=_FINE, read_noise=noise)
        optics = study.sampled.nominal, study.exact.nominal
        found = [forecast(scene, one, camera, AS_PUBLISHED).error("separation") for one in optics]
        what = f"σ(separation), read noise {noise:g} e-"
        part.add(what, "µas", "", *(MICRO * e for e in found), remark="by the true area")
    none = study.forecasts(Mvn.of(0.0), Mvn.of(0.0), flux=study.photons)
    variances = [found.error("mvn_xx") for found in none]
    lengths = [math.sqrt(12 * v) for v in variances]
    part.add("σ(Sxx) of one frame", "mas²", "", *(1e6 * v for v in variances), remark="by the true area")
    part.add("jitter at 1σ, rms", "mas", "", *(1e3 * math.sqrt(v) for v in variances))
    words = f"{lengths[1] / PLATE_SCALE:.3f} pixel"
    part.add("linear smear at 1σ, length", "mas", "", *(1e3 * x for x in lengths), remark=words)
    return part


def matrices(study: Study) -> Part:
    """The paper's figure 1."""
    part = Part()
    for name, words, found in zip(
        ("paper", "exact"), ("the paper's", "exact"), study.forecasts(), strict=True
    ):
        caption = f"Fisher matrix and covariance without jitter, {words} numerics (the paper's fig. 1)."
        figure = plot_matrices(found)
        figure.suptitle(f"{words} numerics")
        part.pictures[f"matrices_{name}"] = (figure, caption)
    return part


def frames(study: Study) -> Part:
    """The paper's figure 2: example frames of the four jitters."""
    sigma = EXAGGERATED / 8
    size = (EXAGGERATED, ANGLE)
    pairs = {
        "no jitter": (None, None),
        "linear": (PUBLIC_LOCI["linear"].of(*size), Linear.of(*size)),
        "harmonic": (PUBLIC_LOCI["shm"].of(*size), Shm.of(*size)),
        "normal": (normal_of_shear(sigma, SHEAR, ANGLE), Mvn.sheared(sigma, SHEAR, ANGLE)),
    }
    images = {name: study.images(*loci, flux=study.photons) for name, loci in pairs.items()}
    norm = stretch(images["no jitter"][1] / 1e3)
    figure = Figure(figsize=(13.6, 6.6), layout="constrained")
    for row, (numerics, axes) in enumerate(zip(("paper", "exact"), figure.subplots(2, 4), strict=True)):
        for ax, (name, both) in zip(axes, images.items(), strict=True):
            label, title = "ke- a pixel", f"{name}, {numerics}"
            plot_image(both[row] / 1e3, PLATE_SCALE, ax, norm=norm, label=label, title=title)
            ax.set(xlim=(-11, 11), ylim=(-11, 11))
            ax.label_outer()
    words = (
        f"Frames of the four jitters (the paper's fig. 2), streaks of {EXAGGERATED:g} arcsec and a normal of "
        f"σ {sigma:g} arcsec at {ANGLE:g}°. Above: five images a streak show as five; below: exact."
    )
    return Part(pictures={"frames": (figure, words)})


def histogram(study: Study) -> Part:
    """The paper's figure 7: a vibration at random times against its density."""
    ax = plot_arcsine(np.random.default_rng(study.seed))
    words = "A vibration at random times against the arcsine law (the paper's fig. 7)."
    return Part(pictures={"histogram": (ax.get_figure(root=True), words)})
