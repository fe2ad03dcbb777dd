import numpy as np
import pytest

from jitterkit.kernel_estimate import KernelEstimate
from jitterkit.kernels import kernel_image
from jitterkit.loci import Linear
from jitterkit.report.estimate_pictures import plot_estimate, plot_extended, plot_field
from jitterkit.report.plots import png

PNG = b"\x89PNG"


def estimate(moments, **more):
    return KernelEstimate(np.asarray(moments, float), np.diag([1e-8] * 3), "score", **more)


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


@pytest.mark.parametrize("kernel", [None, np.full((3, 3), 1 / 9)])
@pytest.mark.parametrize(("size", "told"), [(3.0, True), (6.0, False)])
def test_undetected_jitter_is_called_so_beneath_its_kernel(size, told, kernel, rng):
    # one moment of 3 and 6 standard errors: chi-squared 9 and 36, and of three one in 1000 is beyond 16.3
    found = estimate([size * 1e-4, 0, 0], kernel=kernel)
    ax = plot_extended(found, rng.normal(size=(64, 70)), plate_scale=0.4)[0]
    caption = " ".join([ax.get_title(), *(text.get_text() for text in ax.texts)])
    assert ("undetected" in caption) == told


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
    assert not dark[1].axison


@pytest.mark.parametrize("plate_scale", [None, 0.4])
def test_a_field_and_a_scene_are_drawn_with_and_without_a_scale(plate_scale, rng):
    unit = "pixel" if plate_scale is None else "arcsec"
    locus = Linear.of(6.0, 30.0)
    moments = np.asarray(locus.moments()) + rng.normal(0, 0.1, (9, 3))
    moments[4] = np.nan
    x, y = rng.uniform(0, 80, (2, 9))
    common = 1.1 * np.asarray(locus.moments())  # adaptive moments overstate those of a line
    moments = moments + common - np.asarray(locus.moments())
    where = x, y, moments, common, (80, 80)
    field = plot_field(estimate(locus.moments(), locus=locus), *where, plate_scale=plate_scale)
    points = np.array(field[2].lines[0].get_data())
    assert np.abs(np.nanmean(points, axis=1)).max() < 0.15  # about the cross: noise is 0.1
    assert unit in field[2].get_xlabel()
    assert unit in field[0].texts[-1].get_text() or "″" in field[0].texts[-1].get_text()
    assert png(field[0], 40).startswith(PNG)
    kernel = kernel_image(locus, 1.0)
    for found in (estimate(locus.moments(), locus=locus), estimate(locus.moments(), kernel=kernel)):
        scene = plot_extended(found, rng.normal(size=(64, 70)), plate_scale=plate_scale)
        assert scene[2].get_title() == "as taken"
        assert png(scene[0], 40).startswith(PNG)
