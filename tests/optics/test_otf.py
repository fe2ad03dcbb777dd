"""Transfer functions against Airy, the analytic MTF, dLux and finite differences."""

import jax
import numpy as np
import pytest
import scipy.special
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.optics import Grid, Pupil, expand, flat_band, grid_for, lines, obstructed_circle

ARCSEC = np.pi / 648000
WAVELENGTH = 550.0
DIAMETER = 0.1
RESOLUTION = WAVELENGTH * 1e-9 / DIAMETER / ARCSEC  # lambda / D, arcsec


def psf_at(pupil, grid, **options):
    return np.asarray(expand(pupil, lines(WAVELENGTH), grid, derivatives=False, **options).psf())


def test_a_circular_aperture_makes_an_airy_pattern():
    grid, pupil = Grid((101, 101), 0.12 * RESOLUTION, pad=0), obstructed_circle(DIAMETER, noll=())
    psf = psf_at(pupil, grid)[:101, :101]
    y, x = np.ogrid[-50:51, -50:51]
    v = np.pi * 0.12 * np.maximum(np.hypot(x, y), 1e-9)
    airy = (2 * scipy.special.j1(v) / v) ** 2
    peak = np.pi / 4 * 0.12**2  # the aperture over (lambda / pitch)^2
    # 256 samples across: a sample stands for a square of side D/256, whose own pattern falls by
    # (pi r/256)^2 / 3, at most 1.2e-5 of the peak within the first null, where the light is; the
    # softened rim holds the area to the same order.
    assert psf / peak == pytest.approx(airy, abs=3e-5)


def test_the_modulation_transfer_of_a_circular_aperture_is_the_overlap_of_two_discs():
    grid, pupil = Grid((256, 256), 0.5 * RESOLUTION, pad=0), obstructed_circle(DIAMETER, noll=())
    otf = np.asarray(expand(pupil, lines(WAVELENGTH), grid, derivatives=False).value)
    nu = (
        np.hypot(np.fft.fftfreq(256, grid.pitch)[:, None], np.fft.rfftfreq(256, grid.pitch)[None, :])
        * RESOLUTION
    )
    nu = np.minimum(nu, 1.0)
    overlap = 2 / np.pi * (np.arccos(nu) - nu * np.sqrt(1 - nu**2))
    # The frame ends 64 lambda/D from the axis, in the mean over azimuth 64 / 0.9; beyond r lies
    # 2 / (pi^2 r) of the light (Born & Wolf 8.5.18), and within r the squares that the samples stand for
    # take (pi r/256)^2 / 3 of the light at r.  No frequency can lose more than the sum of both.
    lost = 0.9 * 2 / np.pi**2 / 64 + 2 * 64 / (3 * 256**2)
    assert otf[0, 0].real == pytest.approx(1 - lost, abs=0.05 * lost)
    assert np.abs(otf - overlap).max() < 1.05 * lost


@pytest.mark.parametrize("samples", [64, 256])
def test_the_flux_of_a_star_is_the_light_that_passes_hard_edges(samples):
    # the peak of a star of one photon is area / wavelength^2 per steradian (Born & Wolf 8.5.10)
    pupil = obstructed_circle(DIAMETER, 0.04, strut_width=0.004, struts=3, samples=samples, noll=())
    area = np.pi / 4 * (DIAMETER**2 - 0.04**2) - 3 * 0.004 * (DIAMETER - 0.04) / 2
    grid = Grid((21, 21), 0.1 * RESOLUTION, pad=0)
    for drawn in (pupil, pupil.binned(2), pupil.with_shading(["x"])):
        peak = psf_at(drawn, grid)[10, 10] * DIAMETER**2 / 0.1**2
        # 8 x 8 points a sample: a strut's sides lie on them or between, 1/8 sample off at most
        assert peak == pytest.approx(area, rel=0.003 * 64 / samples)


@pytest.mark.parametrize(("towards_y", "towards_x"), [(0, 3), (2, 0), (-4, 1)])
def test_a_wavefront_that_grows_with_x_moves_the_image_towards_plus_x(towards_y, towards_x):
    grid = Grid((40, 40), 0.4 * RESOLUTION, pad=0)
    plain = obstructed_circle(DIAMETER, 0.03, strut_width=0.004, struts=3, noll=())
    metres = (np.arange(256) - 127.5) * DIAMETER / 256
    angle = grid.pitch * ARCSEC  # one sample, in radians: path = angle times height
    opd = 1e9 * angle * (towards_x * metres[None, :] + towards_y * metres[:, None])
    moved = psf_at(Pupil(plain.transmission, DIAMETER, opd, light=plain.light), grid)
    expected = np.roll(psf_at(plain, grid), (towards_y, towards_x), axis=(0, 1))
    inside = np.s_[6:-6, 6:-6]
    assert moved[inside] == pytest.approx(expected[inside], abs=1e-13)


def test_the_toliman_psf_equals_dlux_to_rounding(toliman, toliman_system, rng):
    aberrations = rng.normal(0, 20, 7)
    system = toliman_system.set("aperture.coefficients", aberrations * 1e-9)
    reference = np.asarray(system.propagate_mono(585e-9))
    found = np.asarray(expand(toliman, lines(585.0), Grid((128, 128), 0.375, 0), aberrations).psf())
    # dLux sums 65536 terms one by one, we in four halves: rounding of either, relative to the peak.
    assert found == pytest.approx(reference, abs=1e-13 * reference.max())
    for flipped in (reference[::-1], reference[:, ::-1], reference[::-1, ::-1], reference.T):
        assert np.abs(found - flipped).max() > 0.5 * reference.max()


def test_the_transfer_function_at_zero_frequency_is_the_share_of_light_inside_the_grid(toliman):
    otf = expand(toliman, lines(530.0, 640.0), Grid((128, 128), 0.375, 64))
    assert complex(otf.value[0, 0]) == pytest.approx(complex(otf.psf().sum()), rel=1e-13)


def test_a_plane_as_wide_as_the_pupils_period_holds_all_the_light(toliman):
    # Parseval: lambda / pitch in exactly 600 samples.
    wavelength = 600 * 0.375 * ARCSEC * toliman.pitch * 1e9
    otf = expand(toliman, lines(wavelength), Grid((600, 600), 0.375, 0), derivatives=False)
    assert complex(otf.value[0, 0]) == pytest.approx(1.0, abs=1e-12)


def test_no_frequency_beyond_the_cutoff_passes():
    pupil = obstructed_circle(DIAMETER, noll=())
    grid = Grid((512, 512), 0.25 * RESOLUTION, pad=0)
    otf = np.asarray(expand(pupil, lines(WAVELENGTH), grid, derivatives=False).value)
    f = np.hypot(np.fft.fftfreq(512, grid.pitch)[:, None], np.fft.rfftfreq(512, grid.pitch)[None, :])
    # What remains comes from cutting the field at 64 lambda/D: the step there, spread over the edge.
    assert np.abs(otf[f > 1.05 / RESOLUTION]).max() < 1e-4


def test_derivatives_by_the_aberrations_agree_with_finite_differences(toliman, rng):
    grid, spectrum = Grid((48, 48), 0.375, 8), lines(540.0, 620.0)
    state = rng.normal(0, 20, 7)
    otf = expand(toliman, spectrum, grid, state)
    # Central differences of 0.1 nm (1e-3 rad of phase, times 2.5 in a mode's extremes): 1e-6 of truncation.
    h = 0.1
    for k in range(7):
        step = h * np.eye(7)[k]
        up, down = (
            expand(toliman, spectrum, grid, state + s, derivatives=False).value for s in (step, -step)
        )
        measured = np.asarray(up - down) / (2 * h)
        assert np.asarray(otf.jacobian[k]) == pytest.approx(measured, abs=3e-6 * np.abs(measured).max())


def test_the_first_order_expansion_errs_in_second_order(toliman):
    grid, spectrum = Grid((48, 48), 0.375, 8), lines(585.0)
    otf, change = expand(toliman, spectrum, grid), np.array([1.0, -0.5, 0.3, 0, 0.7, 0, -1])

    def error(size):
        exact = expand(toliman, spectrum, grid, size * change, derivatives=False).value
        return np.abs(np.asarray(otf.at(size * change) - exact)).max()

    assert error(0.0) < 1e-15  # two compiled programs may round differently
    # Halving the step quarters the error, up to the third order, (2 pi 0.5/585) of the second.
    assert error(1.0) / error(0.5) == pytest.approx(4, rel=0.02)


def test_aberrations_without_derivatives_stay_as_given(toliman):
    grid, state = Grid((32, 32), 0.375, 0), np.full(7, 10.0)
    fixed = expand(toliman, lines(585.0), grid, state, derivatives=False)
    free = expand(toliman, lines(585.0), grid, state)
    assert fixed.names == ()
    assert fixed.state.shape == (0,)
    assert fixed.jacobian.shape[0] == 0
    assert np.array_equal(fixed.at(np.zeros(0)), fixed.value)
    assert np.asarray(fixed.value) == pytest.approx(np.asarray(free.value), abs=1e-15)


def test_a_wrong_number_of_aberrations_is_refused():
    pupil, grid = obstructed_circle(DIAMETER, noll=(4, 5)), Grid((8, 8), 0.4, 0)
    with refused(ErrorCode.WRONG_SHAPE, "2 aberrations", (3,)):
        expand(pupil, lines(WAVELENGTH), grid, np.zeros(3))


def test_the_detector_of_toliman_samples_its_optics_so_that_the_grid_is_not_refined(toliman):
    assert grid_for(toliman, flat_band(530, 640), (128, 128), 0.375).refine == 1
    # Cutoff 0.125 m / 530 nm = 1.143 cycles/arcsec; three halves of the pixel put Nyquist at 0.889.
    assert grid_for(toliman, flat_band(530, 640), (64, 64), 0.5625).refine == 2


def test_a_grid_wider_than_the_pupils_own_period_is_refused(toliman):
    # lambda / pitch = 530 nm / 0.488 mm = 223.9 arcsec, 597 pixels.
    assert grid_for(toliman, lines(530.0), (128, 128), 0.375, 220).refine == 1
    with refused(ErrorCode.SAMPLING, "234.4 arcsec", "0.000488 m", "223.9 arcsec"):
        grid_for(toliman, lines(530.0), (128, 128), 0.375, 240)


def test_single_precision_agrees_with_double(toliman):
    grid, spectrum, state = Grid((64, 64), 0.375, 16), lines(585.0), np.full(7, 5.0)
    double = np.asarray(expand(toliman, spectrum, grid, state).psf())
    with jax.enable_x64(False):
        single = expand(toliman, spectrum, grid, state).psf()
        assert single.dtype == np.float32
    # Phases of up to 2e2 rad rounded to 1e-7 of themselves, in random directions over 65536 samples.
    assert np.asarray(single) == pytest.approx(double, abs=2e-5 * double.max())


def test_every_aberration_shows_through_the_diffractive_pupil(toliman):
    assert expand(toliman, lines(585.0), Grid((64, 64), 0.375, 0)).blind() == ()
