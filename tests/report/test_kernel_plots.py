import numpy as np
import pytest
from matplotlib.collections import EllipseCollection
from matplotlib.figure import Figure
from matplotlib.patches import Ellipse

from jitterkit.forward import Parameters
from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.kernels import TransferRatio, kernel_image
from jitterkit.loci import Linear, Mvn, Stable
from jitterkit.report.estimate_pictures import plot_estimate, plot_extended, plot_field, template_images
from jitterkit.report.kernel_plots import (
    plot_deblurred,
    plot_differences,
    plot_kernel_image,
    plot_scene,
    plot_spectrum,
    plot_transfer,
    plot_whiskers,
)
from jitterkit.report.plots import plot_kernel, png

PNG = b"\x89PNG"


def estimate(moments, **more):
    return KernelEstimate(np.asarray(moments, float), np.diag([1e-8] * 3), "score", **more)


def ratio(angle=20.0, fitted=True):
    f = np.linspace(0.1, 1.0, 10)
    return TransferRatio(angle, f, np.sinc(0.5 * f), np.full(10, 0.02), np.sinc(0.5 * f) if fitted else None)


def test_functions_draw_on_the_axes_they_are_given():
    stars = np.ones(3), np.ones(3), np.ones((3, 3))
    for draw in (
        lambda ax: plot_kernel_image(np.eye(3), ax),
        lambda ax: plot_transfer([ratio()], ax),
        lambda ax: plot_whiskers(*stars, (8, 8), ax),
        lambda ax: plot_differences(stars[2], np.zeros(3), ax),
        lambda ax: plot_spectrum(np.eye(8), ax),
        lambda ax: plot_scene(np.eye(8), ax),
    ):
        ax = Figure().subplots()
        assert draw(ax) is ax


def test_a_kernel_of_pixels_stands_upright_with_its_ellipse():
    kernel = kernel_image(Mvn.of(0.8, 0.4, 30.0), 0.375)
    ax = plot_kernel_image(kernel, plate_scale=0.375)
    (ellipse,) = (patch for patch in ax.patches if isinstance(patch, Ellipse))
    assert (ellipse.width, ellipse.height, ellipse.angle) == pytest.approx((1.6, 0.8, 30.0))
    assert ax.get_images()[0].origin == "lower"
    assert ax.get_xlim()[1] == pytest.approx(kernel.shape[1] * 0.375 / 2)


def test_a_kernel_whose_scale_is_unknown_is_measured_in_pixels():
    ax = plot_kernel(Linear.of(8.0, 30.0), plate_scale=1.0, unit="pixel")
    assert ax.texts[0].get_text() == "2 pixel"


def test_points_and_lines_of_a_transfer_function_are_told_apart_without_colours():
    ax = plot_transfer([ratio(20), ratio(110)])
    first, second = (container.lines[0] for container in ax.containers)
    assert first.get_marker() != second.get_marker()
    assert {line.get_linestyle() for line in ax.lines if len(line.get_xdata()) == 10} >= {"-", "--"}
    assert [text.get_text() for text in ax.get_legend().texts] == ["along 20.0°", "along 110°"]
    np.testing.assert_allclose(first.get_ydata(), np.sinc(0.5 * first.get_xdata()))
    assert len(plot_transfer([ratio(fitted=False)]).lines) == len(ax.lines) - 3


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


def test_before_and_after_share_one_scale():
    before = np.arange(12.0).reshape(3, 4)
    first, second = plot_deblurred(before, 3 * before)
    assert first.get_images()[0].get_clim() == second.get_images()[0].get_clim()
    assert plot_scene(9 * before, like=before).get_images()[0].get_clim()[1] < 12


def test_an_estimate_with_a_template_shows_kernel_fit_and_residual(make_fit):
    frame, result = make_fit("mvn")
    locus = result.parameters.locus
    found = estimate(locus.moments())
    sharp = np.asarray(make_fit("stable")[1].image) - 400  # the scene of seed 0, before the background
    axes = plot_estimate(
        found,
        frame.electrons - 400,
        sharp,
        result.image - 400,
        0.375,
        variance=frame.variance,
        mask=frame.mask,
    )
    assert [ax.get_title() for ax in axes][:2] == ["kernel: normal with its moments", "transfer function"]
    residual = axes[2].get_images()[0].get_array()
    assert np.ma.std(residual) == pytest.approx(1, abs=0.05)  # 2304 pixels: 1.5 %; noise judged by the data
    assert residual.mask.sum() == frame.mask.sum()
    points = axes[1].containers[0].lines[0]
    u = points.get_xdata()
    # along 60 degrees the normal of 0.2 arcsec falls as a normal, within what the wedge takes off
    np.testing.assert_allclose(
        points.get_ydata()[u < 0.8], np.exp(-2 * (np.pi * 0.2 * u[u < 0.8]) ** 2), atol=0.06
    )
    assert png(axes[0], 40).startswith(PNG)


def test_images_of_a_template_are_those_of_the_forward_model(make_fit):
    truth = make_fit("mvn")[1].parameters
    sharp, blurred = template_images(estimate(truth.locus.moments()), truth, make_fit.otf)
    np.testing.assert_allclose(blurred, make_fit("mvn")[1].image, rtol=1e-10)
    np.testing.assert_allclose(sharp, make_fit("stable")[1].image, rtol=1e-10)


@pytest.mark.parametrize("moments", [[-1e-3, 0, -2e-3], [0.04, 0, -1e-3]])
def test_moments_that_are_no_density_are_drawn_all_the_same(make_fit, moments):
    frame, result = make_fit("stable")
    axes = plot_estimate(
        estimate(moments), frame.electrons, result.image, result.image, 0.375, variance=frame.variance
    )
    assert png(axes[0], 40).startswith(PNG)
    dark = plot_estimate(
        estimate(moments), 0 * frame.electrons, result.image, result.image, 0.375, variance=1e9
    )
    assert "noise" in dark[1].texts[0].get_text()


@pytest.mark.parametrize("plate_scale", [None, 0.4])
def test_a_field_and_a_scene_are_drawn_with_and_without_a_scale(plate_scale, rng):
    unit = "pixel" if plate_scale is None else "arcsec"
    locus = Linear.of(6.0, 30.0)
    moments = np.asarray(locus.moments()) + rng.normal(0, 0.1, (9, 3))
    moments[4] = np.nan
    x, y = rng.uniform(0, 80, (2, 9))
    field = plot_field(
        estimate(locus.moments(), locus=locus), x, y, moments, (80, 80), plate_scale=plate_scale
    )
    assert unit in field[2].get_xlabel()
    assert unit in field[0].texts[-1].get_text() or "″" in field[0].texts[-1].get_text()
    assert png(field[0], 40).startswith(PNG)
    kernel = kernel_image(locus, 1.0)
    for found in (estimate(locus.moments(), locus=locus), estimate(locus.moments(), kernel=kernel)):
        scene = plot_extended(found, rng.normal(size=(64, 70)), plate_scale=plate_scale)
        assert scene[2].get_title() == "as taken"
        assert png(scene[0], 40).startswith(PNG)


def test_a_template_of_no_jitter_keeps_its_other_parameters(make_fit):
    truth = make_fit("stable")[1].parameters
    moved = Parameters(truth.scene, Mvn.of(0.3), truth.aberrations, truth.background)
    sharp, blurred = template_images(estimate([0, 0, 0], locus=Stable.of()), moved, make_fit.otf)
    np.testing.assert_array_equal(sharp, blurred)
