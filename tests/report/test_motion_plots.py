import numpy as np
import pytest
from matplotlib.figure import Figure
from study_plots import plot_arcsine

from jitterkit.loci import Linear, Mvn, Product, Shm, Stable
from jitterkit.motion import Line, PowerSpectrum, Record, Split, assess_motion, split_spectrum
from jitterkit.report.motion_plots import (
    plot_budget,
    plot_locus_transfer,
    plot_motion,
    plot_motion_spectrum,
    plot_parts,
    plot_pointing,
)
from jitterkit.report.plots import png

MOTION = PowerSpectrum(
    [0.1, 300.0], [[1e-5, 0, 2e-5], [1e-9, 0, 2e-9]], (Line(61.0, 0.02, 30.0), Line(4.0, 0.01, 90.0))
)


def test_functions_draw_on_the_axes_they_are_given(rng):
    for draw in (
        lambda ax: plot_motion_spectrum(MOTION, 0.1, ax),
        lambda ax: plot_budget(MOTION, 0.1, ax),
        lambda ax: plot_parts(Split(), ax),
        lambda ax: plot_pointing(Mvn.of(0.1), ax),
        lambda ax: plot_locus_transfer(Mvn.of(0.1), ax),
        lambda ax: plot_arcsine(rng, draws=100, ax=ax),
    ):
        ax = Figure().subplots()
        assert draw(ax) is ax


def test_a_page_has_four_panels_with_units():
    axes = plot_motion(assess_motion(MOTION, 0.1), "a motion")
    assert [ax.get_xlabel() for ax in axes] == [
        "frequency [Hz]",
        "frequency [Hz]",
        "x [arcsec]",
        "frequency [cycles/arcsec]",
    ]
    assert [ax.get_ylabel() for ax in axes[:3]] == [
        "density [arcsec²/Hz]",
        "rms up to there [mas]",
        "y [arcsec]",
    ]
    assert all(ax.figure is axes[0].figure for ax in axes)


@pytest.mark.parametrize(
    "part",
    [
        PowerSpectrum(lines=MOTION.lines),
        PowerSpectrum(MOTION.frequencies, MOTION.density),
        PowerSpectrum(lines=(Line(4.0, 0.0), Line(61.0, 0.02))),
        PowerSpectrum(lines=(Line(4.0, 0.0),)),
        PowerSpectrum([1.0, 9.0], np.zeros((2, 3))),
        Record(np.linspace(0, 1, 3), np.arange(3.0), np.zeros(3)),
        Record(np.linspace(0, 1, 50), np.zeros(50), np.zeros(50)),
    ],
)
def test_any_part_of_a_motion_alone_is_drawn_without_a_warning(part):
    png(plot_motion(assess_motion(part, 0.1))[0])


def test_the_budget_of_a_record_is_that_of_its_exposures_and_its_spectrum_is_said_to_be_welch_s():
    # 0.02"/s for 10 s: 100 means 2 mas apart, of variance n (n + 1) / 12 steps², and smears of 2 mas / √12
    t = np.linspace(0, 10, 1001)
    spectrum, budget, *_ = plot_motion(assess_motion(Record(t, 0.02 * t, 0 * t), 0.1))
    assert [text.get_text() for text in budget.texts] == ["58.0 mas", "0.577 mas", "0 mas"]
    expected = [2 * np.sqrt(100 * 101 / 12), 2 / np.sqrt(12), 0]
    np.testing.assert_allclose([bar.get_height() for bar in budget.patches], expected, atol=1e-6)
    assert [label.get_text() for label in budget.get_xticklabels()] == ["displacement", "smear", "jitter"]
    # eight segments of 125 samples: the first bin is at 0.8 Hz
    assert spectrum.get_title() == "Welch's estimate: nothing below 0.4 Hz"


def test_a_record_too_short_for_a_spectrum_is_said_to_be():
    short = Record(np.linspace(0, 1, 3), np.arange(3.0), np.zeros(3))
    assert plot_motion(assess_motion(short, 0.5))[0].get_title() == "too short for a spectrum"


def test_parts_differ_without_their_colours_and_end_at_their_sizes():
    ax = plot_budget(MOTION, 0.1)
    parts = [
        line for line in ax.lines if line.get_label().split(":")[0] in ("displacement", "smear", "jitter")
    ]
    assert len({line.get_linestyle() for line in parts}) == 3
    split = split_spectrum(MOTION, 0.1)
    for line, moments in zip(parts, (split.displacement, split.smear, split.jitter), strict=True):
        assert line.get_ydata()[-1] == pytest.approx(1e3 * np.sqrt(moments[0] + moments[2]), rel=1e-9)


def test_a_transfer_function_falls_along_the_longer_axis_first():
    ax = plot_locus_transfer(Linear.of(0.3, 40.0))
    longer, shorter = ax.lines
    f = longer.get_xdata()
    np.testing.assert_allclose(longer.get_ydata(), np.abs(np.sinc(0.3 * f)), atol=1e-12)
    np.testing.assert_allclose(shorter.get_ydata(), 1, atol=1e-12)
    assert "40.0°" in longer.get_label()
    assert longer.get_linestyle() != shorter.get_linestyle()


def test_the_pointing_of_several_motions_has_their_moments():
    # cells of a 40th of the reach, a blur of one cell, a million draws: the sizes are good to about 2 %
    locus = Product(Shm.of(0.3, 20.0), Mvn.of(0.05, 0.03, 80.0), Linear.of(0.1, 0.0))
    (ellipse,) = (patch for patch in plot_pointing(locus).patches if hasattr(patch, "angle"))
    (sxx, sxy, syy) = np.asarray(locus.moments())
    values, vectors = np.linalg.eigh([[sxx, sxy], [sxy, syy]])
    assert ellipse.width / 2 == pytest.approx(np.sqrt(values[1]), rel=0.03)
    assert ellipse.angle == pytest.approx(np.degrees(np.arctan2(*vectors[::-1, 1])) % 180, abs=1)


def test_a_telescope_that_stands_still_is_said_to():
    for draw in (plot_pointing, plot_locus_transfer):
        assert [text.get_text() for text in draw(Stable.of()).texts] == ["no blur"]


def test_the_histogram_of_appendix_b_lies_on_the_law(rng):
    ax = plot_arcsine(rng, 2.0, 400_000)
    (law,) = ax.lines
    (histogram,) = ax.patches
    heights = histogram.get_data().values
    # the middle cell holds 1/94 of the draws: 4250, so 1.5 % one sigma
    np.testing.assert_allclose(heights, law.get_ydata(), rtol=0.08)
    assert np.sum(law.get_ydata()) * (4 / 60) == pytest.approx(1)
