"""The picture of a photon budget: what is drawn is what was counted."""

import numpy as np
import pytest
from matplotlib.figure import Figure

from jitterkit.photons import Curve, Throughput, count_photons, flat_curve
from jitterkit.report.photon_plots import plot_detected, plot_photons, plot_starlight, plot_throughput


@pytest.fixture(scope="module")
def budget():
    stars = flat_curve(400, 800, 3.0), flat_curve(400, 800, 1.0)
    qe = Curve(np.array([400.0, 800.0]), np.array([0.8, 0.4]))
    return count_photons(stars, Throughput(flat_curve(530, 640), 0.9, 2, qe), area=1.0, exposure=1.0)


def drawn(ax, label):
    (line,) = (line for line in ax.lines if line.get_label() == label)
    return line.get_xdata(), line.get_ydata()


def test_three_panels_share_wavelengths_and_have_units(budget):
    axes = plot_photons(budget)
    assert len({ax.figure for ax in axes}) == 1
    assert len({ax.get_xlim() for ax in axes}) == 1
    low, high = axes[0].get_xlim()
    assert low < 530 < 640 < high
    assert axes[2].get_xlabel() == "wavelength [nm]"
    assert [ax.get_ylabel().split("\n")[-1] for ax in axes] == [
        "photons / (s cm² nm)",
        "throughput",
        "photons / (s cm² nm)",
    ]
    axes[0].figure.canvas.draw()


def test_the_stars_are_drawn_with_their_sum(budget):
    ax = Figure().subplots()
    assert plot_starlight(budget, ax) is ax
    for label, level in (("A", 3.0), ("B", 1.0), ("A + B", 4.0)):
        assert drawn(ax, label)[1] == pytest.approx(level)


def test_the_total_is_the_product_of_filter_glass_and_efficiency(budget):
    ax = plot_throughput(budget)
    at, total = drawn(ax, "total")
    assert total[1:-1] == pytest.approx(0.81 * (0.8 - 0.001 * (at[1:-1] - 400)))
    assert drawn(ax, "glass, 2 plates")[1] == pytest.approx(0.81)
    assert drawn(ax, "filter")[1] == pytest.approx([0, 1, 1, 0])
    assert ax.get_ylim()[0] == 0


def test_the_shaded_area_is_the_rate_in_the_legend(budget):
    ax = plot_detected(budget)
    (shade,) = ax.collections
    corners = shade.get_paths()[0].vertices
    x, y = corners.T
    # the shoelace formula
    area = abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1))) / 2
    # 4 photons x 0.81 x the efficiency at the band's middle, 585 nm: 0.615
    assert area == pytest.approx(4 * 110 * 0.81 * 0.615, rel=1e-9)
    assert shade.get_label() == "219.2 photons / (s cm²)"


def test_the_lines_differ_without_colour(budget):
    for ax in plot_photons(budget):
        styles = [(line.get_linestyle(), line.get_linewidth()) for line in ax.lines]
        assert len(set(styles)) == len(styles)
