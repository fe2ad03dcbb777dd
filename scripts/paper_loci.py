"""The paper's figures of error against jitter: streaks, normals, and what is said of them."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import paper_numbers as paper
from astropy.table import QTable
from matplotlib.figure import Figure
from paper_numerics import PUBLIC_LOCI, SAMPLES_OF_NORMAL, normal_of_construction, normal_of_shear
from paper_study import AS_PUBLISHED, MICRO, PLATE_SCALE, TARGET, Part, Study
from study_plots import plot_shears

from jitterkit.conventions import FWHM_PER_SIGMA
from jitterkit.forecast import Sweep, forecast, sweep
from jitterkit.loci import Linear, Locus, Mvn, Shm, principal_axes
from jitterkit.optics import OpticalSystem
from jitterkit.report.forecast_plots import plot_errors
from jitterkit.report.forecast_table import sweep_table

LONGEST, SIZES = 0.75, 30
"""arcsec, two pixels; how many sizes up to it."""

ANGLES = np.linspace(0, 90, 7)
"""Degrees from the pair."""

SHEARS = (0.1, 0.4, 0.7)
"""The paper does not name the three of its figure; the outer two are those it fits."""

GOAL, WORSE = paper.DRIFT.value, 3 * paper.DRIFT.value
"""arcsec: a smear at the goal of the pointing, and at "several times worse"."""

EQUAL_RMS = 0.2
"""arcsec, at which loci are compared: within the range of sizes for all of them."""


def streaks(study: Study) -> Part:
    """The paper's figure 3, and its words on linear and harmonic jitter."""
    part = Part()
    loci = {"linear": (PUBLIC_LOCI["linear"], Linear), "shm": (PUBLIC_LOCI["shm"], Shm)}
    axes = {"length": _sizes(study), "angle": _angles(study)}
    swept: dict[tuple[str, str], Sweep] = {}
    for numerics, optics, column in (("paper", study.sampled, 0), ("exact", study.exact, 1)):
        began = time.perf_counter()
        for name, both in loci.items():
            swept[name, numerics] = _swept(study, both[column].of, optics, axes)
        points = 2 * len(axes["length"]) * len(axes["angle"])
        part.timings.append(
            (f"both streaks, {numerics} numerics, {points} points", time.perf_counter() - began)
        )
    none = dict(zip(("paper", "exact"), study.errors(), strict=True))
    for (name, numerics), one in swept.items():
        part.tables[f"streaks_{name}_{numerics}"] = _table(one, none[numerics] / MICRO)
    part.pictures["streaks"] = (_draw_streaks(study, swept), _STREAKS)
    _compare_streaks(study, part, loci)
    return part


_STREAKS = (
    "Error against the size of linear and harmonic jitter at seven angles from the pair (the paper's fig. "
    "3): left with its numerics, right exact. Dotted: a drift of 1 arcsec/s."
)


_NUMERICS = {"paper": "the paper's numerics", "exact": "exact"}


def _table(swept: Sweep, still: float) -> QTable:
    return sweep_table(swept, still, TARGET, paper.EXPOSURE.value)


def _sizes(study: Study) -> np.ndarray:
    return np.linspace(LONGEST / SIZES, LONGEST, 3 if study.coarse else SIZES)


def _angles(study: Study) -> np.ndarray:
    return ANGLES[:: len(ANGLES) - 1] if study.coarse else ANGLES


def _swept(study: Study, locus: Callable[..., Locus], optics: OpticalSystem, axes) -> Sweep:
    return sweep(
        lambda **size: forecast(
            study.parameters(locus(*size.values())), optics.nominal, options=AS_PUBLISHED
        ),
        axes,
    )


def _draw_streaks(study: Study, swept: dict[tuple[str, str], Sweep]) -> Figure:
    figure = Figure(figsize=(11.4, 8.8), layout="constrained")
    axes = figure.subplots(2, 2)
    top = MICRO * max(float(one.error().max()) for one in swept.values())
    still = dict(zip(("paper", "exact"), study.errors(), strict=True))
    titles = {"linear": "linear", "shm": "harmonic, peak to peak"}
    for ax, ((name, numerics), one) in zip(axes.T.ravel(), _by_numerics(swept), strict=True):
        plot_errors(
            one,
            ax,
            still=still[numerics] / MICRO,
            plate_scale=PLATE_SCALE,
            exposure=paper.EXPOSURE.value,
            marks={"drift 100 mas": GOAL},
            limits=(0.9 * min(still.values()), 1.04 * top),
            title=f"{titles[name]}: {_NUMERICS[numerics]}",
        )
    return figure


def _by_numerics(swept):
    return sorted(swept.items(), key=lambda item: ["paper", "exact"].index(item[0][1]))


def _compare_streaks(study: Study, part: Part, loci) -> None:
    """Rows and a slip on what a streak costs."""
    where = "fig. 3"
    ends = {}
    for name, (public, exact) in loci.items():
        ends[name] = study.errors(public.of(LONGEST), exact.of(LONGEST), flux=study.photons)
        what = f"σ(separation), {name}, {LONGEST:g} arcsec, along the pair"
        part.add(what, "µas", where, *ends[name], remark="by the true area")
    ratios = [shm / linear for linear, shm in zip(ends["linear"], ends["shm"], strict=True)]
    words = "“extremely similar”, “almost identical”: so they are as five images"
    part.add(f"the same, shm over linear ({LONGEST:g} arcsec)", "", "sec. 3.2, 4", *ratios, remark=words)
    variances = {name: [12 * kind.variance for kind in both] for name, both in loci.items()}
    for name, both in variances.items():
        part.add(f"variance of {name}, in L²/12", "", "sec. 3.1, 3.2", *both)
    for name, (public, exact) in loci.items():
        along, across = (study.errors(public.of(LONGEST, a), exact.of(LONGEST, a)) for a in (0.0, 90.0))
        part.add(f"{name}, {LONGEST:g} arcsec: along the pair over across it", "", "sec. 4",
                 *(a / b for a, b in zip(along, across, strict=True)),
                 remark="“more destructive than perpendicular jitter”")  # fmt: skip
    none = study.errors()
    for length in (GOAL, WORSE):
        found = study.errors(loci["linear"][0].of(length), Linear.of(length))
        costs = [100 * ((e / n) ** 2 - 1) for e, n in zip(found, none, strict=True)]
        words = "“only has a moderate impact”"
        part.add(f"more time for a drift of {length:g} arcsec", "%", "sec. 4", *costs, remark=words)
    part.slips[3] = (
        "Five equal images with both end points have "
        f"{variances['linear'][0]:.2f} times the variance L²/12 of a streak, that of harmonic motion; the "
        f"half-cell weights give the latter {variances['shm'][0] / variances['shm'][1]:.2f} times its own. "
        f"“Almost identical” is largely this: at {LONGEST:g} arcsec along the pair harmonic motion costs "
        f"{ratios[0]:.2f} times the error of a linear one as five images and {ratios[1]:.2f} times in truth."
    )


def normals(study: Study) -> Part:
    """The paper's figure 4, and its words on the normal."""
    part = Part()
    axes = {"sigma_major": _sizes(study) / FWHM_PER_SIGMA, "angle": _angles(study)}
    finer = replace(study.sampled, samples=SAMPLES_OF_NORMAL)
    words = "the paper's numerics, σ_min² = σ_maj²(1 - η)", "exact"
    for name, title, optics, make in zip(
        ("paper", "exact"), words, (finer, study.exact), (normal_of_shear, Mvn.sheared), strict=True
    ):
        began = time.perf_counter()
        swept = {
            shear: _swept(study, lambda sigma, angle, s=shear, m=make: m(sigma, s, angle), optics, axes)
            for shear in SHEARS
        }
        points = len(SHEARS) * len(axes["sigma_major"]) * len(axes["angle"])
        part.timings.append((f"three normals, {name} numerics, {points} points", time.perf_counter() - began))
        still = forecast(study.parameters(), optics.nominal, options=AS_PUBLISHED).error("separation")
        for shear, one in swept.items():
            part.tables[f"normals_{shear:g}_{name}"] = _table(one, still)
        figure = plot_shears(
            swept,
            still=still,
            plate_scale=PLATE_SCALE,
            exposure=paper.EXPOSURE.value,
        )
        figure.suptitle(title)
        part.pictures[f"normals_{name}"] = (
            figure,
            f"Error under normal jitter (the paper's fig. 4), {title}.",
        )
    _compare_normals(study, part)
    return part


def _compare_normals(study: Study, part: Part) -> None:
    """Rows and slips on the construction of a normal, and how fast its error grows."""
    determinant, shear = 1e-5, paper.SHEARS[1]
    made = normal_of_construction(determinant, shear)
    major, minor, _ = principal_axes(made.moments())
    part.add(f"σ_min/σ_maj of a normal of η {shear:g}", "", "sec. 3.2, eq. 8", minor / major, 1 - shear)
    part.add(
        f"detΣ where {1e6 * determinant:g} is asked for, η {shear:g}",
        "10⁻⁶ arcsec⁴",
        "eq. 8",
        1e6 * (major * minor) ** 2,
        1e6 * determinant,
    )
    part.slips[2] = (
        f"σ_min² = σ_maj²(1 - η) contradicts η = 1 - σ_min/σ_maj: a shear of {shear:g} becomes "
        f"{1 - minor / major:.3f}, and with σ_maj² = √detΣ/(1 - η) the determinant "
        f"{(major * minor) ** 2 / determinant:.2f} times too large. (1 - η)² puts both right."
    )
    finer = replace(study, sampled=replace(study.sampled, samples=SAMPLES_OF_NORMAL))
    still = finer.errors()
    for what, loci in (
        (f"FWHM or length of {LONGEST:g} arcsec", _of_sizes(LONGEST, LONGEST, LONGEST)),
        (f"rms of {EQUAL_RMS:g} arcsec", _of_sizes(*_sizes_of_equal_rms(EQUAL_RMS))),
    ):
        for name, both in loci.items():
            costs = [error / alone for error, alone in zip(finer.errors(*both), still, strict=True)]
            remark = "“much more rapidly”" if name.startswith("normal") else ""
            part.add(f"error over that without jitter, {what}: {name}", "", "sec. 4", *costs, remark=remark)
    rms = [size / PLATE_SCALE for size in _rms_of_equal_sizes(paper.MAGNITUDES[0] * PLATE_SCALE)]
    part.slips[7] = (
        f"Magnitudes mean length, peak to peak or FWHM: “{paper.MAGNITUDES[0]:g} pixel” is "
        + ", ".join(f"{r:.3f}" for r in rms)
        + " pixel rms. That the normal's error rises “much more rapidly” is mostly this: at equal rms "
        "along the pair the loci hardly differ (the table). detΣ is in arcsec⁴."
    )


def _of_sizes(length: float, peak_to_peak: float, fwhm: float) -> dict[str, tuple[Locus, Locus]]:
    """Loci along the pair by name, the paper's and exact."""
    sigma = fwhm / FWHM_PER_SIGMA
    normals = {f"normal, η {s:g}": (normal_of_shear(sigma, s), Mvn.sheared(sigma, s)) for s in SHEARS}
    return normals | {
        "linear": (PUBLIC_LOCI["linear"].of(length), Linear.of(length)),
        "shm": (PUBLIC_LOCI["shm"].of(peak_to_peak), Shm.of(peak_to_peak)),
    }


def _sizes_of_equal_rms(rms: float) -> tuple[float, float, float]:
    """Length, peak to peak and FWHM of a streak, a vibration and a normal of one rms along the axis."""
    return rms / Linear.variance**0.5, rms / Shm.variance**0.5, rms * FWHM_PER_SIGMA


def _rms_of_equal_sizes(size: float) -> tuple[float, float, float]:
    """Of a streak, a vibration and a normal of one length, peak to peak and FWHM."""
    return size * Linear.variance**0.5, size * Shm.variance**0.5, size / FWHM_PER_SIGMA
