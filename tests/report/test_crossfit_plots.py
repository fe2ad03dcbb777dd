"""The picture and the table of a cross-fit show the numbers of its panels."""

import numpy as np
import pytest

from jitterkit.forecast import Panel
from jitterkit.report.crossfit_plots import crossfit_table, plot_crossfit, plot_panel


def panel(data, fitted, shift, rng):
    offsets = (shift + 250 * rng.standard_normal((2, 4000))) * 1e-6
    bias = np.array([shift, shift + 10]) * 1e-6
    return Panel(data, fitted, offsets, bias, np.full(2, 250e-6), np.array([1.0, 2.0]), (fitted, fitted))


@pytest.fixture
def panels(rng):
    return [panel(d, f, 100 * (d != f), rng) for d in ("linear", "mvn") for f in ("linear", "mvn")]


def test_the_law_drawn_has_the_moments_of_the_draws(panels):
    ax = plot_panel(panels[1], 250e-6)
    law = ax.lines[0]
    x, y = law.get_data()
    assert np.trapezoid(y, x) == pytest.approx(1, abs=1e-3)  # four sigmas hold all but 6e-5
    assert np.trapezoid(x * y, x) == pytest.approx(panels[1].offsets.mean() / 250e-6, abs=1e-3)
    heights = np.array([patch.get_height() * patch.get_width() for patch in ax.patches])
    assert heights.sum() == pytest.approx(1)
    marks = ax.lines[-1].get_xdata()
    np.testing.assert_allclose(marks, [0.4, 0.44])
    assert f"{1e6 * panels[1].offsets.mean():+.1f} ± 2.8" in ax.texts[0].get_text()  # 250/sqrt(8000)
    assert "µas" in ax.texts[0].get_text()


def test_columns_are_data_and_rows_what_was_fitted(panels):
    figure = plot_crossfit(panels, 250e-6)
    axes = np.array(figure.axes).reshape(2, 2)
    assert [ax.get_title() for ax in axes[0]] == ["linear", "mvn"]
    assert [ax.get_ylabel() for ax in axes[:, 0]] == ["linear", "mvn"]
    wrong = panels[1]  # linear data fitted with a normal
    assert f"{1e6 * wrong.offsets.mean():+.1f}" in axes[1, 0].texts[0].get_text()
    assert "250 µas" in figure.get_supxlabel()


def test_the_table_has_a_row_for_every_setting(panels):
    table = crossfit_table(panels, [(0.1, 0.0), (0.1, 90.0)])
    assert len(table) == 8
    row = table[(table["data"] == "linear") & (table["fitted"] == "mvn")][1]
    assert row["angle"].to_value("deg") == 90
    assert row["bias"].to_value("uas") == pytest.approx(110)
    assert row["mean_err"].to_value("uas") == pytest.approx(250 / np.sqrt(4000), rel=0.05)
