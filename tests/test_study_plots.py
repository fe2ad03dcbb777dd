import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from study_plots import plot_marginal


@pytest.fixture
def draws(rng):
    return rng.normal(3.0, 0.5, 20_000)


def drawn(ax):
    """Heights and edges of the bars, and the curve."""
    (bars,) = (patch for patch in ax.patches if isinstance(patch, StepPatch))
    (curve,) = (line for line in ax.lines if line.get_label() == "Laplace")
    return bars.get_data().values, bars.get_data().edges, curve


def test_the_picture_is_drawn_on_the_axes_it_is_given(draws):
    ax = Figure().subplots()
    assert plot_marginal(draws, 3.0, 0.5, ax, label="length [arcsec]") is ax
    assert ax.get_xlabel() == "length [arcsec]"


def test_bars_and_curve_are_densities(draws):
    ax = plot_marginal(draws, 3.1, 0.4, label="length [arcsec]")
    heights, edges, curve = drawn(ax)
    # all but 7e-6 of a normal lies within 4.5 sigma
    assert np.sum(heights * np.diff(edges)) == pytest.approx(1, abs=1e-3)
    x, y = curve.get_data()
    assert np.trapezoid(y, x) == pytest.approx(1, abs=1e-3)
    assert x[np.argmax(y)] == pytest.approx(3.1, abs=np.diff(x)[0])
    assert y.max() == pytest.approx(1 / (0.4 * np.sqrt(2 * np.pi)), rel=1e-3)
    # 20,000 draws, of which one bar in the middle holds 7 %: known to 2.6 %; four times that
    assert heights.max() == pytest.approx(1 / (0.5 * np.sqrt(2 * np.pi)), rel=0.11)


def test_bars_and_curve_are_distinguished_without_colours(draws):
    ax = plot_marginal(draws, 3.0, 0.5, label="length [arcsec]", truth=2.8)
    _, _, curve = drawn(ax)
    assert curve.get_linestyle() == "--"
    assert [text.get_text() for text in ax.get_legend().texts] == ["posterior", "Laplace", "truth"]
    assert ax.lines[-1].get_xdata()[0] == pytest.approx(2.8)


def test_a_fit_without_an_error_has_no_curve(draws):
    ax = plot_marginal(draws, 3.0, np.nan, label="length [arcsec]")
    assert not ax.lines
