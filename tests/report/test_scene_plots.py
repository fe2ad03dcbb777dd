import numpy as np
import pytest
from matplotlib.figure import Figure

from jitterkit.loci import Linear, Mvn
from jitterkit.report.field_plots import plot_scene, plot_spectrum


def test_functions_draw_on_the_axes_they_are_given():
    for draw in (
        lambda ax: plot_spectrum(np.eye(8), ax),
        lambda ax: plot_scene(np.eye(8), ax),
    ):
        ax = Figure().subplots()
        assert draw(ax) is ax


def test_nulls_are_drawn_where_the_streak_puts_them(rng):
    locus = Linear.of(5.0, 30.0)
    ax = plot_spectrum(rng.normal(size=(64, 80)), locus=locus)
    lines = ax.collections[0].get_paths()
    vertices = np.concatenate([path.vertices for path in lines])
    along = np.abs(vertices @ [np.cos(np.radians(30)), np.sin(np.radians(30))]) * 5
    # sinc(u L) vanishes at whole u L; contours are straight between samples 1/256 apart
    np.testing.assert_allclose(along, np.round(along), atol=0.02)
    assert set(np.round(along)) == {1, 2, 3}
    assert not plot_spectrum(rng.normal(size=(64, 80)), locus=Mvn.of(2.0)).collections


def test_frequencies_of_a_spectrum_lie_on_their_axes():
    y, x = np.mgrid[:64, :64]
    ax = plot_spectrum(np.cos(2 * np.pi * (0.25 * x + 0.125 * y)), plate_scale=0.5)
    power = ax.get_images()[0].get_array()
    row, column = np.unravel_index(np.argmax(power[:, 33:]), power[:, 33:].shape)
    left, right, low, high = ax.get_images()[0].get_extent()
    assert left + (column + 33.5) * (right - left) / 64 == pytest.approx(0.5)
    assert low + (row + 0.5) * (high - low) / 64 == pytest.approx(0.25)


def test_a_scene_is_drawn_on_the_scale_of_another():
    before = np.arange(12.0).reshape(3, 4)
    assert plot_scene(9 * before, like=before).get_images()[0].get_clim()[1] < 12
