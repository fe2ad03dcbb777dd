"""Counting: flat spectra by hand, Planck by adaptive quadrature, areas by geometry."""

import math

import numpy as np
import pytest
from refusals import refused
from scipy.integrate import quad

from jitterkit.errors import ErrorCode
from jitterkit.optics import flat_band, obstructed_circle
from jitterkit.optics.pupil import Pupil
from jitterkit.photons import (
    IMX183_QE,
    Curve,
    Throughput,
    annulus_area,
    blackbody,
    collecting_area,
    compare,
    count_photons,
    flat_curve,
)

PERFECT = flat_curve(300, 1100)


def flat_budget(a=3.0, b=1.0, throughput=None, area=2.0, exposure=0.1):
    stars = flat_curve(200, 1200, a), flat_curve(200, 1200, b)
    through = throughput or Throughput(flat_curve(530, 640), plates=0, qe=PERFECT)
    return count_photons(stars, through, area=area, exposure=exposure)


def test_flat_spectra_are_counted_by_hand():
    budget = flat_budget()
    assert budget.rates == pytest.approx((330.0, 110.0), rel=1e-12)
    assert budget.rate == pytest.approx(440.0, rel=1e-12)
    assert budget.contrast == pytest.approx(3.0, rel=1e-12)
    assert budget.mean_wavelength == pytest.approx(585.0, rel=1e-9)
    assert budget.photons == pytest.approx(440 * 2 * 0.1, rel=1e-12)
    assert budget.photons_through(5.0) == pytest.approx(440 * 5 * 0.1, rel=1e-12)


def test_two_plates_count_twice_and_efficiencies_once():
    through = Throughput(flat_curve(530, 640, 0.9), glass=0.91, plates=2, qe=flat_curve(300, 1100, 0.5))
    assert through(600.0) == pytest.approx(0.9 * 0.91**2 * 0.5, rel=1e-12)
    assert through(np.array([529.0, 641.0])) == pytest.approx(0)
    assert flat_budget(throughput=through).rate == pytest.approx(440 * 0.9 * 0.91**2 * 0.5, rel=1e-12)


@pytest.mark.parametrize("high", [530.05, 530.25, 640.0])
def test_light_is_added_up_from_end_to_end_in_steps_of_a_tenth_of_a_nanometre(high):
    grid = Throughput(flat_curve(530.0, high), plates=0, qe=PERFECT).grid()
    assert (grid[0], grid[-1]) == (530.0, high)
    assert np.diff(grid).max() <= 0.1 * (1 + 1e-9)


def test_a_wedge_of_efficiency_is_integrated_and_weighs_the_mean_wavelength():
    # qe = u on 0 < u < 1: integral 1/2, mean u 2/3; the trapezoid errs by (0.1/100)²/6
    through = Throughput(
        flat_curve(500, 600), plates=0, qe=Curve(np.array([500.0, 600.0]), np.array([0.0, 1.0]))
    )
    budget = flat_budget(throughput=through)
    assert budget.rate == pytest.approx(4 * 50, rel=1e-6)
    assert budget.mean_wavelength == pytest.approx(500 + 200 / 3, rel=1e-6)


def test_lines_narrower_than_a_step_are_counted_whole():
    # a triangle of 0.02 nm, 1000 high, holds 10 photons
    nm = np.array([400.0, 579.99, 580.0, 580.01, 800.0])
    star = Curve(nm, np.array([0.0, 0.0, 1000.0, 0.0, 0.0]))
    through = Throughput(flat_curve(530, 640), plates=0, qe=PERFECT)
    budget = count_photons((star, flat_curve(400, 800)), through, area=1, exposure=1)
    assert budget.rates == pytest.approx((10.0, 110.0), rel=1e-9)


def test_only_wavelengths_that_filter_and_detector_share_are_counted():
    through = Throughput(flat_curve(530, 640), plates=0, qe=flat_curve(600, 900))
    assert flat_budget(throughput=through).rate == pytest.approx(4 * 40, rel=1e-12)


def test_a_filter_s_steep_edges_are_counted_as_its_rows_say():
    ramps = Curve(np.array([529.97, 530.0, 640.0, 640.03]), np.array([0.0, 1.0, 1.0, 0.0]))
    budget = flat_budget(throughput=Throughput(ramps, plates=0, qe=PERFECT))
    assert budget.rate == pytest.approx(4 * 110.03, rel=1e-12)


def test_blackbodies_through_toliman_are_their_adaptive_quadrature():
    pytest.importorskip("synphot")
    stars = blackbody(5790, 0.01), blackbody(5260, 1.33)
    budget = count_photons(stars, Throughput(flat_curve(530, 640)), area=114.67, exposure=0.1)
    rates = [
        quad(lambda nm, s=s: s(nm) * 0.91**2 * IMX183_QE(nm), 530, 640, points=(550, 600), limit=2000)[0]
        for s in stars
    ]
    assert budget.rates == pytest.approx(rates, rel=1e-7)
    # the atmospheres of the paper's notebook (6.342e5, 1.967e5) are no blackbodies and their filter is not
    # flat: 3 % is the difference that we found, and what the V zero point is worth
    assert budget.rates == pytest.approx((6.342e5, 1.967e5), rel=0.03)
    assert budget.contrast == pytest.approx(rates[0] / rates[1], rel=1e-6)


def test_the_spectrum_of_the_detected_photons_has_their_moments():
    pytest.importorskip("synphot")
    stars = blackbody(5790, 0.01), blackbody(5260, 1.33)
    budget = count_photons(stars, Throughput(flat_curve(530, 640)), area=1, exposure=1)
    spectrum = budget.spectrum(5)
    nm, weights = np.array(spectrum.wavelengths), np.array(spectrum.weights)
    share = lambda at: (stars[0](at) + stars[1](at)) * IMX183_QE(at)  # noqa: E731
    for power in range(4):
        moment = [
            quad(lambda at, k=k: share(at) * ((at - 585) / 55) ** k, 530, 640, points=(550, 600), limit=2000)[
                0
            ]
            for k in (0, power)
        ]
        assert weights @ ((nm - 585) / 55) ** power == pytest.approx(moment[1] / moment[0], abs=1e-6)


def test_photons_without_a_slope_are_a_flat_band():
    found, band = flat_budget().spectrum(13), flat_band(530, 640, 13)
    assert found.wavelengths == pytest.approx(band.wavelengths, rel=1e-9)
    assert found.weights == pytest.approx(band.weights, rel=1e-7)


def test_an_annulus_has_a_quarter_pi_of_its_diameters():
    assert annulus_area(0.125, 0.032) == pytest.approx(math.pi * (6.25**2 - 1.6**2), rel=1e-12)
    assert annulus_area(0.02) == pytest.approx(math.pi, rel=1e-12)


@pytest.mark.parametrize("samples", [64, 256])
def test_a_pupil_collects_what_its_annulus_and_struts_leave(samples):
    # edges are averaged over 8 x 8 points a sample: a sample that one cuts errs by a tenth at random, and
    # 4 x 64 of them together by 2 of 3000
    pupil = obstructed_circle(0.125, 0.032, samples=samples, noll=())
    annulus = math.pi / 4 * (12.5**2 - 3.2**2)
    assert collecting_area(pupil) == pytest.approx(annulus, rel=1e-3)
    struts = obstructed_circle(0.125, 0.032, struts=3, strut_width=0.002, samples=samples, noll=())
    # each 0.2 cm wide; both edges of one along x lie on rows of points, 8 x 64 a diameter: 1/8 at most
    blocked = collecting_area(pupil) - collecting_area(struts)
    assert blocked == pytest.approx(3 * 0.2 * (6.25 - 1.6), rel=0.03 * 256 / samples)


def test_a_grey_pupil_passes_the_square_of_its_amplitude():
    assert collecting_area(Pupil(np.full((10, 10), 0.5), 0.02)) == pytest.approx(4 * 0.25, rel=1e-12)
    disc = obstructed_circle(0.125, samples=256, noll=()).transmission / 2
    # its edge is squared too: at most 1/4 of the 4 x 256 samples that it cuts, of 51,000
    expected = math.pi / 4 * 12.5**2 / 4
    assert collecting_area(Pupil(disc, 0.125)) == pytest.approx(expected, rel=5e-3)


def test_a_pupil_that_fades_outwards_passes_the_square_of_its_amplitude():
    # of exp(-r²/2s²) over the plane the square holds pi s², itself twice that; 1e-8 is left outside
    y, x = np.mgrid[-63.5:64, -63.5:64] / 128
    fading = Pupil(np.exp(-(x**2 + y**2) / (2 * 0.1**2)), 0.01)
    assert collecting_area(fading) == pytest.approx(math.pi * 0.1**2, rel=1e-6)


def test_toliman_s_pupil_is_the_annulus_less_its_struts(toliman):
    # three struts of 2 mm from rim to obscuration; dLux cuts its samples to a few tenths of a per cent
    expected = annulus_area(0.125, 0.032) - 3 * 0.2 * (6.25 - 1.6)
    assert collecting_area(toliman) == pytest.approx(expected, rel=2e-3)


def test_a_comparison_says_the_photons_by_the_paper_s_area_and_by_the_right_one():
    lines = compare(flat_budget(area=100.0))
    values = {line.quantity: line for line in lines}
    right, slip = values["area without struts"], values["area, diameters for radii"]
    assert right.here == pytest.approx(math.pi * (6.25**2 - 1.6**2), rel=1e-12)
    assert slip.here == pytest.approx(math.pi * (12.5**2 - 3.2**2), rel=1e-12)
    assert slip.here == pytest.approx(slip.paper, abs=0.05)  # published to 0.1 cm²
    by_pupil, by_right, by_slip = (line for line in lines if line.quantity == "photons by it")
    assert by_pupil.here == pytest.approx(440 * 100 * 0.1, rel=1e-12)
    assert by_right.here == pytest.approx(44 * right.here, rel=1e-12)
    assert by_slip.here == pytest.approx(44 * slip.here, rel=1e-12)
    assert math.isnan(by_right.paper)  # which published no photons by it
    assert by_slip.paper == 3.811e7
    assert values["contrast in the band"].notebook == pytest.approx(6.342 / 1.967)


def test_another_telescope_is_compared_with_nothing():
    lines = compare(flat_budget(), published=False)
    assert all(math.isnan(line.paper) and math.isnan(line.notebook) for line in lines)
    assert not any("radii" in line.quantity for line in lines)


@pytest.mark.parametrize(
    ("make", "code", "values"),
    [
        (lambda: Throughput(flat_curve(530, 640, 92.0)), ErrorCode.OUT_OF_RANGE, ("filter", 92)),
        (
            lambda: Throughput(PERFECT, qe=flat_curve(530, 640, 84)),
            ErrorCode.OUT_OF_RANGE,
            ("quantum efficiency", 84),
        ),
        (lambda: Throughput(PERFECT, glass=1.1), ErrorCode.OUT_OF_RANGE, ("glass = 1.1", "0 to 1")),
        (lambda: Throughput(PERFECT, plates=-1), ErrorCode.OUT_OF_RANGE, ("plates = -1",)),
        (
            lambda: Throughput(flat_curve(530, 640), qe=flat_curve(700, 800)),
            ErrorCode.CONFLICT,
            ("Filter (530 to 640 nm)", "quantum efficiency (700 to 800 nm)"),
        ),
        (lambda: flat_budget(area=0), ErrorCode.OUT_OF_RANGE, ("area = 0", "cm²")),
        (lambda: flat_budget(exposure=math.nan), ErrorCode.OUT_OF_RANGE, ("exposure = nan",)),
        (
            lambda: flat_budget(throughput=Throughput(flat_curve(100, 640), qe=flat_curve(100, 1300))),
            ErrorCode.SAMPLING,
            ("spectrum of A", "200 to 1200 nm", "100 to 640 nm"),
        ),
        (lambda: annulus_area(0.032, 0.125), ErrorCode.OUT_OF_RANGE, ("0.032 m", "0.125 m")),
    ],
)
def test_what_cannot_be_counted_is_refused(make, code, values):
    with refused(code, *values):
        make()
