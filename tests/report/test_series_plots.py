"""Pictures of a series show its numbers, and stay readable and small with tens of thousands of frames."""

import io

import numpy as np
import pytest
from matplotlib.figure import Figure

from jitterkit.report.series_plots import plot_allan, plot_averaging, plot_pulls, plot_root_n, plot_series
from jitterkit.series import (
    Series,
    allan_deviation,
    block_scatter,
    find_outliers,
    fit_floor,
    fit_trend,
    simulate_flicker,
)

ERROR = 465e-6


def draw(n, rng, floor=0.0, bad=(), slope=0.0):
    y = 10 + ERROR * rng.standard_normal(n) + slope * np.arange(n)
    y += simulate_flicker(n, floor, rng) if floor else 0.0
    y[list(bad)] += 12 * ERROR
    return Series.of(y, ERROR, 0.1 * np.arange(n))


def labelled(ax, start):
    (found,) = (line for line in ax.lines if str(line.get_label()).startswith(start))
    return found


def words(ax):
    return [text.get_text() for text in ax.get_legend().texts]


def test_few_frames_are_drawn_with_bars_about_the_trend(rng):
    series = draw(100, rng, bad=[30], slope=2e-6)
    trend, outliers = fit_trend(series), find_outliers(series)
    ax = Figure().subplots()
    assert plot_series(series, ax, trend=trend, outliers=outliers) is ax
    (bars,) = ax.containers
    x, y = bars.lines[0].get_data()
    np.testing.assert_allclose(x, series.times)
    np.testing.assert_allclose(y, 1e6 * (series.values - trend.mean))
    lengths = np.diff([segment[:, 1] for segment in bars.lines[2][0].get_segments()], axis=1)
    np.testing.assert_allclose(lengths, 2 * 465)
    line = labelled(ax, "trend")
    np.testing.assert_allclose(line.get_ydata(), 1e6 * (trend.at(line.get_xdata()) - trend.mean), atol=1e-3)
    diamond = labelled(ax, "1 do not belong")
    assert diamond.get_xdata() == pytest.approx([3.0])
    assert diamond.get_markerfacecolor() == "none"
    assert ax.get_ylabel().endswith("[µas]")
    assert ax.get_xlabel() == "time [s]"


def test_the_trend_is_given_in_the_units_drawn(rng):
    series = draw(20_000, rng, slope=1e-8)
    trend = fit_trend(series)
    ax = plot_series(series, trend=trend)
    assert ax.get_xlabel() == "time [min]"
    (told,) = (word for word in words(ax) if word.startswith("trend"))
    assert told.endswith("µas/min")
    value = float(told.removeprefix("trend, ").split(" ± ")[0].replace("−", "-"))
    assert value == pytest.approx(1e6 * 60 * trend.slope, rel=0.05)
    assert any(word.startswith("weighted mean") for word in words(plot_series(series)))


def test_many_frames_are_faint_points_under_means_of_stretches(rng):
    series = draw(8000, rng)
    ax = plot_series(series)
    (bars,) = ax.containers
    x, y = bars.lines[0].get_data()
    parts = (1e6 * (series.values - np.mean(series.values))).reshape(40, 200)
    np.testing.assert_allclose(y, parts.mean(axis=1), atol=0.2 * 465 / np.sqrt(200))  # a frame at an edge
    np.testing.assert_allclose(x * 60, np.arange(40) * 20 + 10, atol=0.2)
    half = np.diff([segment[:, 1] for segment in bars.lines[2][0].get_segments()], axis=1) / 2
    np.testing.assert_allclose(half, 465 / np.sqrt(200), rtol=0.01)
    points = ax.lines[0]
    assert points.get_rasterized()
    assert points.get_alpha() < 0.3


def test_sixty_thousand_frames_make_a_small_file(rng):
    stream = io.BytesIO()
    plot_series(draw(60_000, rng)).figure.savefig(stream, format="pdf")
    assert stream.tell() < 300_000


def test_block_means_are_drawn_with_the_errors_expectation(rng):
    scatter = block_scatter(draw(4000, rng))
    ax = plot_root_n(scatter)
    expected = labelled(ax, "errors")
    np.testing.assert_allclose(expected.get_xydata().T, [scatter.lengths, 1e6 * scatter.expected])
    assert expected.get_linestyle() == "--"
    np.testing.assert_allclose(ax.containers[0].lines[0].get_ydata(), 1e6 * scatter.scatter)
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert ax.get_xlabel() == "steps of 0.100 s in a block"
    assert plot_root_n(scatter, time_unit="frame").get_xlabel() == "frames in a block"


def test_an_allan_deviation_is_drawn_with_its_floor_and_where_it_is_met(rng):
    series = draw(20_000, rng, floor=50e-6)
    allan, floor = allan_deviation(series), fit_floor(series)
    ax = plot_allan(allan, floor=floor)
    np.testing.assert_allclose(labelled(ax, "Allan").get_ydata(), 1e6 * allan.deviation)
    np.testing.assert_allclose(labelled(ax, "fitted").get_ydata(), 1e6 * floor.deviation(allan.lengths))
    np.testing.assert_allclose(labelled(ax, "floor").get_ydata(), 1e6 * floor.floor)
    met = labelled(ax, "met at")
    assert met.get_xydata()[0] == pytest.approx([floor.meets, 1e6 * floor.floor])
    assert met.get_label().endswith(" s")
    band = ax.collections[0].get_paths()[0].vertices
    assert band[:, 1].max() == pytest.approx(1e6 * allan.high.max())
    (above,) = ax.child_axes
    ax.figure.draw_without_rendering()
    assert above.get_xlabel() == "time averaged [min]"
    np.testing.assert_allclose(above.get_xlim(), np.array(ax.get_xlim()) * 0.1 / 60)


def test_without_a_floor_its_upper_limit_is_drawn(rng):
    series = next(one for one in (draw(2000, rng) for _ in range(9)) if fit_floor(one).p_value > 0.2)
    floor = fit_floor(series)
    ax = plot_allan(allan_deviation(series), floor=floor, time_unit="frame")
    limit = labelled(ax, "floor below")
    np.testing.assert_allclose(limit.get_ydata(), 1e6 * floor.upper)
    assert "95 %" in limit.get_label()
    assert not ax.child_axes
    assert len(plot_allan(allan_deviation(Series.of(series.values))).lines) == 1


def test_pulls_are_counted_in_stated_errors(rng):
    series = draw(3000, rng, bad=[7, 70])
    outliers = find_outliers(series)
    ax = plot_pulls(outliers)
    assert sum(patch.get_height() for patch in ax.patches) == 3000
    x, law = labelled(ax, "stated errors").get_data()
    width = ax.patches[0].get_width()
    assert np.trapezoid(law, x) / width == pytest.approx(3000, rel=1e-3)
    np.testing.assert_allclose(
        labelled(ax, "2 do not").get_xdata(), outliers.pulls[[7, 70]] * outliers.scale, rtol=1e-6
    )
    assert ax.get_xlabel() == "residual / stated error"
    bare = plot_pulls(find_outliers(Series.of(series.values)))
    assert bare.get_xlabel() == "residual / scatter"
    assert "stated errors" not in words(bare)


def test_a_page_has_all_four_and_keeps_outliers_from_the_noise(rng):
    series = draw(2000, rng, bad=[5, 900, 901])
    axes = plot_averaging(series)
    assert len(axes) == 4
    assert len({ax.figure for ax in axes}) == 1
    assert "3 do not belong" in words(axes[0])
    clean = block_scatter(series.without(find_outliers(series).flags))
    np.testing.assert_allclose(axes[2].containers[0].lines[0].get_ydata(), 1e6 * clean.scatter)
