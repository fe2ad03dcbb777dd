"""Pictures of forecasts show the forecasts: curves, scales of the other axes, words."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
from matplotlib.colors import to_rgb
from matplotlib.patches import Ellipse
from study_plots import plot_shears

from jitterkit.forecast import Forecast, Requirement, Sweep
from jitterkit.forward import Parameters
from jitterkit.loci import Mvn
from jitterkit.report.forecast_plots import (
    curve_colours,
    plot_errors,
    plot_matrices,
    plot_requirements,
    spread,
)
from jitterkit.scene import Binary

LENGTHS, ANGLES = np.array([0.2, 0.5, 0.8]), np.array([0.0, 45.0, 90.0])
ERRORS = 1e-4 * (2.4 + LENGTHS[:, None] * np.cos(np.radians(ANGLES / 2)))


def told(error, locus=None):
    """A forecast of the separation alone."""
    parameters = Parameters(Binary(10, 180, 0, 0, 1e6, 3), locus or Mvn.of(0.1))
    one = np.array([[error**2]])
    return Forecast(parameters, ("separation",), 1 / one, one, np.array([10.0]))


def swept(first="length", sizes=LENGTHS, shear=0.0):
    forecasts = np.empty(ERRORS.shape, object)
    for position, error in np.ndenumerate(ERRORS):
        forecasts[position] = told(error, Mvn.sheared(sizes[position[0]], shear, ANGLES[position[1]]))
    return Sweep({first: sizes, "angle": ANGLES}, forecasts)


def curves(ax):
    return [line for line in ax.lines if len(line.get_xdata()) == len(LENGTHS)]


def secondary(ax):
    return {type(child).__name__ + child._orientation: child for child in ax.child_axes}


def test_curves_are_the_errors_of_the_sweep_in_microarcseconds():
    ax = plot_errors(swept(), still=2.4e-4, marks={"drift": 0.1})
    for line, column in zip(curves(ax), ERRORS.T, strict=True):
        np.testing.assert_allclose(line.get_xdata(), LENGTHS)
        np.testing.assert_allclose(line.get_ydata(), 1e6 * column)
    assert ax.get_xlabel() == "length [arcsec]"
    assert ax.get_ylabel() == "error of separation, one frame [µas]"
    words = [text.get_text().strip() for text in ax.texts]
    assert sorted(words) == sorted(["no jitter", "0°", "45°", "90°", "drift"])
    level, mark = ax.lines[-2], ax.lines[-1]
    np.testing.assert_allclose(level.get_ydata(), 240.0)
    np.testing.assert_allclose(mark.get_xdata(), 0.1)


def test_other_axes_count_pixels_and_hours():
    ax = plot_errors(swept(), plate_scale=0.4, exposure=0.1, target=2e-6)
    above, right = secondary(ax)["SecondaryAxisx"], secondary(ax)["SecondaryAxisy"]
    assert above.get_xlabel() == "[pixel]"
    pixels, arcsec = above._functions
    assert pixels(0.8) == pytest.approx(2.0)
    assert arcsec(pixels(0.3)) == pytest.approx(0.3)
    assert right.get_ylabel() == "time to 2 µas [h]"
    hours, error = right._functions
    # 240 µas to 2 µas: 14,400 frames of 0.1 s
    assert hours(240.0) == pytest.approx(0.4)
    assert error(hours(300.0)) == pytest.approx(300.0)


def test_labels_stand_at_their_curves_in_their_order_and_do_not_overlap():
    ax = plot_errors(swept(), limits=(0.0, 2000.0))
    assert ax.get_ylim() == (0.0, 2000.0)
    positions = {text.get_text().strip(): text.xy[1] for text in ax.texts}
    assert positions["0°"] > positions["45°"] > positions["90°"]
    assert min(-np.diff([positions["0°"], positions["45°"], positions["90°"]])) > 0.04 * 2000
    assert np.mean(list(positions.values())) == pytest.approx(1e6 * ERRORS[-1].mean())
    np.testing.assert_allclose(spread([1.0, 9.0, 4.0], 2.0), [1.0, 9.0, 4.0])  # far enough apart


def test_equal_ratios_are_drawn_on_logarithmic_axes():
    ax = plot_errors(swept("flux", np.array([1e4, 1e5, 1e6])))
    assert (ax.get_xscale(), ax.get_yscale()) == ("log", "log")
    assert all(line.get_marker() == "o" for line in curves(ax))  # few points are marked
    positions = [text.xy[1] for text in ax.texts]
    assert np.prod(positions) == pytest.approx(
        np.prod(1e6 * ERRORS[-1])
    )  # spread about their mean, in ratios


def test_shades_of_curves_differ_in_grey():
    luminance = [np.dot(to_rgb(colour), (0.299, 0.587, 0.114)) for colour in curve_colours(7)]
    assert min(np.diff(luminance)) > 0.04


def test_a_row_for_each_shear_shows_the_kernel_that_was_swept():
    sizes = np.array([0.05, 0.1, 0.25])
    sweeps = {shear: swept("sigma_major", sizes, shear) for shear in (0.1, 0.7)}
    figure = plot_shears(sweeps, still=2.4e-4, plate_scale=0.375, exposure=0.1)
    lefts, rights = figure.axes[0::2], figure.axes[1::2]
    assert [ax.get_title() for ax in lefts] == ["shear 0.1", "shear 0.7"]
    assert {ax.get_xlabel() for ax in lefts} == {"sigma_major [arcsec]"}
    assert lefts[0].get_ylim() == lefts[1].get_ylim()
    width = secondary(lefts[0])["SecondaryAxisx"]
    assert width.get_xlabel() == "FWHM of the major axis [arcsec]"
    assert width._functions[0](1.0) == pytest.approx(2 * math.sqrt(2 * math.log(2)))
    for ax, shear in zip(rights, sweeps, strict=True):
        (ellipse,) = [patch for patch in ax.patches if isinstance(patch, Ellipse)]
        assert ellipse.width / ellipse.height == pytest.approx(1 / (1 - shear), rel=0.1)  # smoothed a little
        assert ax.get_title() == "FWHM 0.589″, 0°"


def test_matrices_stand_beside_each_other_with_signs_for_print_in_grey():
    covariance = np.array([[4.0, -1.0], [-1.0, 2.0]])
    found = SimpleNamespace(
        names=("separation", "contrast"), covariance=covariance, information=np.linalg.inv(covariance)
    )
    left, right, *_ = plot_matrices(found).axes
    np.testing.assert_allclose(np.asarray(left.images[0].get_array()), found.information)
    np.testing.assert_allclose(np.asarray(right.images[0].get_array()), covariance)
    assert [label.get_text() for label in right.get_xticklabels()] == ["sep", "cont"]
    assert {text.get_position() for text in right.texts} == {(0, 1), (1, 0)}
    assert not left.texts  # the inverse has no negative element


def test_vibrations_allowed_are_drawn_against_frequency():
    every = [
        Requirement("vibration", c, a, s, s / 3) for a in (0.0, 90.0) for c, s in ((0.1, 1.0), (3.0, 0.2))
    ]
    every.append(Requirement("linear", math.nan, 0.0, 0.5, 0.1))
    ax = plot_requirements(every, exposure=0.1)
    drawn = ax.get_legend_handles_labels()
    assert drawn[1] == ["0°", "90°"]
    np.testing.assert_allclose(drawn[0][0].get_xdata(), [1.0, 30.0])
    np.testing.assert_allclose(drawn[0][0].get_ydata(), [1.0, 0.2])
    assert (ax.get_xlabel(), ax.get_ylabel()) == ("frequency [Hz]", "largest peak to peak [arcsec]")
