import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure

from jitterkit.loci import Mvn
from jitterkit.report.field_plots import plot_differences, plot_whiskers


def test_functions_draw_on_the_axes_they_are_given():
    stars = np.ones(3), np.ones(3), np.ones((3, 3))
    for draw in (
        lambda ax: plot_whiskers(*stars, (8, 8), ax),
        lambda ax: plot_differences(stars[2], np.zeros(3), ax),
    ):
        ax = Figure().subplots()
        assert draw(ax) is ax


def test_whiskers_lie_along_the_blur_of_their_star_and_are_enlarged_alike():
    moments = np.array([np.asarray(Mvn.of(s, 0.1, 30.0).moments()) for s in (0.2, 0.4, 0.2)] + [[np.nan] * 3])
    x, y = np.array([10.0, 50, 90, 50]), np.array([20.0, 30, 40, 50])
    ax = plot_whiskers(x, y, moments, (60, 100))
    *whiskers, bar = (np.array(line.get_data()).T for line in ax.lines)
    assert len(whiskers) == 3  # the star without moments is left out
    for (start, end), at in zip(whiskers, zip(x, y, strict=False), strict=False):
        np.testing.assert_allclose((start + end) / 2, at)
        dx, dy = end - start
        assert np.degrees(np.arctan2(dy, dx)) == pytest.approx(30.0)
    lengths = [np.hypot(*(end - start)) for start, end in whiskers]
    assert lengths[1] == pytest.approx(2 * lengths[0])
    assert np.ptp(bar[:, 0]) == pytest.approx(lengths[0] / 2)  # the key: one sigma of the median star
    assert "200 mas" in ax.texts[-1].get_text()
    (ellipses,) = (c for c in ax.collections if isinstance(c, EllipseCollection))
    np.testing.assert_allclose(ellipses.get_offsets()[0], [10, 20])


def test_a_field_without_a_blur_says_so():
    ax = plot_whiskers(np.ones(2), np.ones(2), -np.ones((2, 3)), (8, 8))
    assert "no star" in ax.texts[0].get_text()
