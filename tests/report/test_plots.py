import jax.numpy as jnp
import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse, Rectangle

from jitterkit.loci import Linear, Mvn, Smear, Stable
from jitterkit.report.kernel_plots import plot_kernel
from jitterkit.report.plots import (
    change_image,
    plot_image,
    plot_residual,
    plot_stars,
    png,
    stretch,
)
from jitterkit.report.row import make_row
from jitterkit.report.summary import summarise
from jitterkit.report.table import make_table
from jitterkit.report.time_plots import plot_separations


def _patch(ax, kind):
    return [patch for patch in ax.patches if isinstance(patch, kind)]


def test_functions_draw_on_the_axes_they_are_given():
    ax = Figure().subplots()
    assert plot_image(np.ones((4, 6)), 0.5, ax) is ax
    assert ax.get_images()[0].get_extent() == [-1.5, 1.5, -1.0, 1.0]
    assert ax.get_images()[0].origin == "lower"
    assert ax.get_xlabel() == "x [arcsec]"


def test_a_pixel_lies_where_the_conventions_put_it():
    image = np.zeros((5, 5))
    image[4, 0] = 1.0  # the last row is the upper one
    ax = plot_image(image, 1.0)
    left, right, low, high = ax.get_images()[0].get_extent()
    assert (left, high) == (-2.5, 2.5)
    assert ax.get_ylim() == (low, high)
    assert ax.get_xlim() == (left, right)


def test_stars_are_marked_on_the_light_they_make(make_fit):
    frame, result = make_fit("stable")
    ax = plot_stars(*result.parameters.scene.sources()[:2], plot_image(frame.electrons, frame.plate_scale))
    x, y = (float(v[0]) for v in ax.lines[0].get_data())
    row, column = np.unravel_index(np.argmax(frame.electrons), frame.shape)
    centre = (np.array(frame.shape) - 1) / 2
    assert abs(x / 0.375 + centre[1] - column) <= 0.75
    assert abs(y / 0.375 + centre[0] - row) <= 0.75


def test_further_stars_are_marked_with_their_numbers():
    ax = plot_image(np.ones((9, 9)), 1.0)
    plot_stars([0.0, 1.0, 2.0], [0.0, 1.0, -2.0], ax)
    assert [text.get_text() for text in ax.texts] == ["A", "B", "3"]
    ax = plot_image(np.ones((9, 9)), 1.0)
    plot_stars([0.0, 1.0], [0.0, 1.0], ax, "")
    assert [text.get_text() for text in ax.texts] == ["1", "2"]


def test_residuals_are_red_where_the_data_are_brighter_on_a_symmetric_scale():
    picture = plot_residual(np.array([[-9.0, 0.0, 9.0]])).get_images()[0]
    assert picture.get_clim() == (-5, 5)
    blue, white, red = picture.to_rgba(picture.get_array())[0]
    assert blue[2] > blue[0]
    assert red[0] > red[2]
    assert white[:3].min() > 0.9


@pytest.mark.parametrize("image", [np.full((3, 3), np.nan), np.zeros((3, 3)), -np.ones((3, 3))])
def test_a_frame_without_contrast_or_data_is_drawn_all_the_same(image):
    norm = stretch(image)
    assert norm.vmin < norm.vmax
    assert png(plot_image(image)).startswith(b"\x89PNG")


def test_the_kernel_shows_its_ellipse_where_the_locus_lies():
    ax = plot_kernel(Linear.of(1.0, 30.0), plate_scale=0.375)
    (ellipse,) = _patch(ax, Ellipse)
    assert ellipse.angle == pytest.approx(30.0)
    assert ellipse.width == pytest.approx(2 / np.sqrt(12), rel=0.01)  # the smoothing adds 0.3 %
    density = ax.get_images()[0].get_array()
    left, right, *_ = ax.get_images()[0].get_extent()
    y, x = np.indices(density.shape) - (density.shape[0] - 1) / 2
    cell = (right - left) / density.shape[0]
    sxx, sxy = (np.average(a * b, weights=density) * cell**2 for a, b in ((x, x), (x, y)))
    smoothing = (1.2 * cell) ** 2 + cell**2 / 12
    assert sxx - smoothing == pytest.approx(0.75 / 12, rel=0.02)  # L²/12 cos² 30°
    assert sxy == pytest.approx(np.sqrt(0.75) / 2 / 12, rel=0.02)


@pytest.mark.parametrize("across", [0.2, 0.02, -0.02])
def test_a_kernel_of_several_motions_has_no_stripes(across):
    """A normal moved by a small smear falls to either side of its middle; a negative variance counts as 0."""
    moments = jnp.asarray([0.2**2, 0.0, np.sign(across) * across**2])
    density = plot_kernel(Smear(Linear.of(0.05, 30.0), Mvn(moments))).get_images()[0].get_array()
    profile = density.sum(axis=0) / density.sum(axis=0).max()
    assert np.all(np.isfinite(profile))
    half = len(profile) // 2
    for side in (profile[half:], profile[half::-1]):
        assert np.diff(side).max() < 0.01  # the points of a normal law are as sparse as it is far out


@pytest.mark.parametrize("level", [0.0, 100.0])
@pytest.mark.parametrize("flux", [0.05, 5.0, 100.0, 1e4, 1e7])
def test_numbers_on_a_colour_bar_lie_apart(flux, level, rng):
    """Of faint frames too, whose scale is linear about zero; a bar of 2 inches holds ten lines of text."""
    y, x = np.indices((32, 32)) - 16
    image, other = (
        flux * np.exp(-(x**2 + y**2) / 8) + level + rng.normal(0, flux / 10, x.shape) for _ in "ab"
    )
    ax = plot_image(other / 7)
    for values in (other / 7, image):
        change_image(ax, values, stretch(values))
        norm, bar = ax.images[0].norm, ax.images[0].colorbar.ax
        apart = np.diff(norm(np.asarray(bar.get_yticks())))
        assert len(apart) >= 2
        assert apart.min() > 0.1
        assert len(bar.get_yticks(minor=True)) == 0
        texts = [label.get_text() for label in bar.get_yticklabels()]
        assert len(set(texts)) == len(texts)


def test_a_pixel_is_drawn_where_it_fits_and_the_scale_bar_is_round():
    assert len(_patch(plot_kernel(Linear.of(1.0), plate_scale=0.375), Rectangle)) == 1
    small = plot_kernel(Mvn.of(0.01), plate_scale=0.375)
    assert not _patch(small, Rectangle)
    bar = np.ptp(small.lines[0].get_xdata())
    assert bar == pytest.approx(0.02)
    assert small.texts[0].get_text() == "20 mas"


def test_a_kernel_whose_scale_is_unknown_is_measured_in_pixels():
    ax = plot_kernel(Linear.of(8.0, 30.0), plate_scale=1.0, unit="pixel")
    assert ax.texts[0].get_text() == "2 pixel"


@pytest.mark.parametrize("locus", [Stable.of(), Mvn.near([-1e-4, 2e-4, 1e-4]), Mvn.near([np.nan] * 3)])
def test_a_kernel_that_is_no_density_is_drawn_all_the_same(locus):
    assert png(plot_kernel(locus, plate_scale=0.375), 40).startswith(b"\x89PNG")


@pytest.fixture(scope="module")
def row(make_fit):
    return make_row(make_fit()[1], "f")


def test_separations_stand_about_their_weighted_mean_and_failures_are_marked(row):
    rows = [{**row, "separation": 8.1 + d * 1e-4} for d in (-1, 0, 1)]
    rows.insert(1, {**row, "status": "poor_fit", "separation": 50.0})
    table = make_table(rows)
    ax = plot_separations(table, summary=summarise(table))
    points = ax.containers[0].lines[0]
    np.testing.assert_array_equal(points.get_xdata(), [1, 3, 4])
    np.testing.assert_allclose(points.get_ydata(), [-100, 0, 100], atol=1e-6)  # µas
    failed = next(line for line in ax.lines if line.get_label() == "1 failed")
    np.testing.assert_array_equal(failed.get_xdata(), [2])
    assert "µas" in ax.get_ylabel()
    assert any("139 µas" in text.get_text() or "140 µas" in text.get_text() for text in ax.get_legend().texts)


def test_many_frames_become_block_means_with_smaller_errors(row, rng):
    table = make_table({**row, "separation": 8.1 + 2.4e-4 * e} for e in rng.normal(size=1000))
    ax = plot_separations(table, summary=summarise(table))
    _, _, (bars,) = ax.containers[0].lines
    lengths = [np.ptp(segment[:, 1]) / 2 for segment in bars.get_segments()]
    np.testing.assert_allclose(lengths, 240 / np.sqrt(25), rtol=1e-6)  # 40 blocks of 25


@pytest.mark.parametrize("changes", [{"status": "no_star"}, {"separation_err": np.nan}])
def test_a_run_without_errors_or_fits_is_drawn_all_the_same(row, changes):
    for n in (0, 2, 400):
        table = make_table([{**row, **changes}] * n)
        assert png(plot_separations(table, summary=summarise(table)), 40).startswith(b"\x89PNG")
