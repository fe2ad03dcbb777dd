"""Causes told apart by one frame: against the laws of a normal image, and against differences of images."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.forecast.causes import forecast_causes
from jitterkit.forecast.causes_frame import Setting, with_seeing
from jitterkit.forecast.causes_information import Information
from jitterkit.forward import GRADIENT, expected_image
from jitterkit.loci import Ellipse, Linear, Mvn, Path, Stable
from jitterkit.optics import (
    FixedOptics,
    Grid,
    OpticalSystem,
    Pupil,
    empirical_otf,
    lines,
    obstructed_circle,
)
from jitterkit.scene import Star

SCALE = 0.375
ARCSEC = np.pi / 648000


def normal_setting(sigma=0.6, flux=1e5):
    """A star whose image is normal, of ``sigma`` arcsec before any jitter, and nothing but photon noise."""
    x = SCALE * (np.arange(41) - 20)
    stamp = np.exp(-(x**2 + x[:, None] ** 2) / (2 * sigma**2))
    optics = FixedOptics(empirical_otf(stamp, SCALE, (41, 41), pad=12))
    return Setting(Star(0.0, 0.0, flux), optics, diffusion=0.1**2)


def lit(obscuration=0.04, strut_width=0.0, **options):
    """A star before a telescope of its own: the tests change its obscuration, struts and defocus."""
    pupil = obstructed_circle(
        0.125, obscuration, noll=(4,), samples=64, struts=3 if strut_width else 0, strut_width=strut_width
    )
    optics = OpticalSystem(pupil, lines(550.0), Grid((32, 32), SCALE, 16))
    settings = {"aberrations": (30.0,), "diffusion": 0.1**2, "seeing": 0.8} | options
    return Setting(Star(0.1, -0.05, 1e5), optics, **settings)


def image(setting, locus):
    return np.asarray(expected_image(setting.under(locus), setting.otf))


def test_of_a_normal_image_jitter_and_diffusion_are_one():
    found = forecast_causes(normal_setting(), Mvn.of(0.3, 0.2, 0.0))
    assert found.names == ("jitter_along", "jitter_turn", "jitter_across", "diffusion")
    assert abs(np.linalg.eigvalsh(found.information.likeness)[0]) < 1e-12
    np.testing.assert_array_equal(np.isfinite(found.errors()), [False, True, False, False])
    (one,) = found.degeneracies()
    assert one.stretch == np.inf
    # one square arcsecond more of both moments and one less of diffusion is no change at all
    assert (one.pivot, set(one.others)) == ("diffusion", {"jitter_along", "jitter_across"})
    sign = np.sign(one.weights["diffusion"])
    third = 3**-0.5
    expected = {"diffusion": third, "jitter_along": -third, "jitter_across": -third, "jitter_turn": 0}
    assert {name: sign * w for name, w in one.weights.items()} == pytest.approx(expected, abs=1e-9)


def test_the_sums_are_known_as_the_variances_of_a_normal_law_are():
    sigma, flux, locus = 0.6, 1e5, Mvn.of(0.3, 0.2, 0.0)
    found = forecast_causes(normal_setting(sigma, flux), locus)
    (one,) = found.degeneracies()
    along, across = sigma**2 + 0.3**2 + 0.1**2, sigma**2 + 0.2**2 + 0.1**2
    # N draws of a normal law tell its variance v to v sqrt(2/N), a covariance to sqrt(v w/N); flux and place
    # are told apart by symmetry.  The frame ends 11 sigma out, and pixels of half a sigma, summed as points,
    # are as good as the integral to exp(-2 pi² 4).
    expected = {"jitter_along": along * (2 / flux) ** 0.5, "jitter_across": across * (2 / flux) ** 0.5}
    for name, error in expected.items():
        assert one.sums[name] == pytest.approx((1.0, error), rel=1e-3)
    assert found.errors()[1] == pytest.approx((along * across / flux) ** 0.5, rel=1e-3)


def moved(setting, locus, name, step):
    """Image with one cause changed by a step of its coordinate, built anew and not by its slope."""
    if name.startswith("jitter"):
        (along, turn, across), angle = jitter_on_axis(locus), 25.0
        change = {"jitter_along": (step, 0, 0), "jitter_turn": (0, step, 0), "jitter_across": (0, 0, step)}
        a, t, c = np.array([along, turn, across]) + change[name]
        if isinstance(locus, Linear):  # a streak turns by its cross moment over its variance
            return image(setting, Linear.of((12 * a) ** 0.5, angle + np.degrees(t / a)))
        u, v = (np.array([np.cos(p), np.sin(p)]) for p in np.radians([angle, angle + 90]))
        matrix = a * np.outer(u, u) + t * (np.outer(u, v) + np.outer(v, u)) + c * np.outer(v, v)
        return image(setting, Mvn.near(matrix[[0, 0, 1], [0, 1, 1]]))
    if name == "diffusion":
        return image(replace(setting, diffusion=setting.diffusion + step), locus)
    if name == "seeing":
        return image(replace(setting, seeing=(setting.seeing ** (5 / 3) + step) ** 0.6), locus)
    if name == "noll4":
        return image(replace(setting, aberrations=(setting.aberrations[0] + step,)), locus)
    if step < 0:  # the square of defocus: the mean of both signs stands for it, and no square is negative
        return 2 * image(setting, locus) - moved(setting, locus, name, -step)
    both = [replace(setting, aberrations=(sign * step**0.5,), square=False) for sign in (1, -1)]
    return sum(image(one, locus) for one in both) / 2


def jitter_on_axis(locus):
    sizes = locus.describe()
    if isinstance(locus, Linear):
        return sizes["length"] ** 2 / 12, 0.0, 0.0
    return sizes["sigma_major"] ** 2, 0.0, sizes["sigma_minor"] ** 2


@pytest.mark.parametrize("locus", [Mvn.of(0.3, 0.2, 25.0), Linear.of(0.8, 25.0)], ids=["mvn", "linear"])
@pytest.mark.parametrize("focus", [pytest.param(30.0, marks=pytest.mark.slow), 0.0])
def test_every_slope_is_that_of_differences_of_images(locus, focus):
    setting = forecast_causes(lit(aberrations=(focus,)), locus).setting
    assert setting.square == (focus == 0)  # a round pupil is its own mirror image
    _, slopes = setting.slopes(locus)
    # a central difference misses by the third derivative times step²/6, which a thousandth of each size makes
    # small; the square of defocus, from one side, by its fourth: (2 pi 1 nm/550 nm)² of itself
    steps = {"noll4": 0.03, "noll4_square": 1.0, "seeing": 1e-3}
    for name in set(slopes) - {"x", "y", "flux", "background", *GRADIENT}:
        step = steps.get(name, 1e-5)
        up, down = (moved(setting, locus, name, sign * step) for sign in (1, -1))
        measured = (up - down) / (2 * step)
        assert slopes[name] == pytest.approx(measured, abs=2e-4 * np.abs(measured).max()), name


def test_the_atmosphere_is_kolmogorovs():
    otf = lit(seeing=None).otf
    fy, fx = otf.grid.frequencies
    wavelength, fwhm = 550e-9, 0.8
    fried = 0.98 * wavelength / (fwhm * ARCSEC)
    for ratio in (1.0, 1.4):  # r0 grows as the 6/5th power of the wavelength
        path = ratio * wavelength * np.hypot(fx, fy) / ARCSEC  # metres in the pupil
        expected = otf.value * np.exp(-3.44 * (path / (fried * ratio**1.2)) ** (5 / 3))
        np.testing.assert_allclose(with_seeing(otf, fwhm, ratio).value, expected, rtol=1e-10, atol=1e-14)
    # and its image is 0.98 wavelength/r0 wide: half the peak of the transform of exp(-3.44 u^(5/3)) at 0.49
    u = np.linspace(0, 6, 60001)
    from scipy.special import j0

    light = [np.trapezoid(np.exp(-3.44 * u ** (5 / 3)) * u * j0(2 * np.pi * r * u), u) for r in (0.0, 0.49)]
    assert light[1] / light[0] == pytest.approx(0.5, abs=0.005)


def test_a_streak_shows_that_diffusion_is_round():
    found = forecast_causes(normal_setting(), Linear.of(0.8, 25.0))
    assert np.all(np.isfinite(found.errors()))
    assert np.linalg.eigvalsh(found.information.likeness)[0] > 0.01
    assert found.names == ("jitter_along", "jitter_turn", "diffusion")
    (one, *_) = found.degeneracies(least=1.1)
    assert one.stretch == pytest.approx(np.linalg.eigvalsh(found.information.likeness)[0] ** -0.5)
    assert {one.pivot, *one.others} == {"jitter_along", "diffusion"}
    ((_, error),) = one.sums.values()
    assert error < found.errors()[found.names.index(one.pivot)]  # together they are better known than one


@pytest.mark.parametrize("locus", [Mvn.of(0.0), Mvn.of(0.3), Ellipse.of(0.2, 0.1, 40.0)])
@pytest.mark.parametrize("obscuration", [0.0, 0.05])
def test_where_the_jitter_is_free_in_both_axes_small_or_normal_it_is_never_distinguished_from_diffusion(
    locus, obscuration
):
    setting = lit(obscuration, seeing=None, diffusion=0.1**2)
    found = forecast_causes(setting, locus)
    diffusion = found.errors()[found.names.index("diffusion")]
    if isinstance(locus, Ellipse):  # a ring is no normal law, but nearly one at half a pixel
        assert 10 * found.information.alone[-1] < diffusion < np.inf
    else:
        assert diffusion == np.inf


def test_defocus_is_distinguished_from_jitter_where_the_pupil_has_rings_to_show_it():
    found = forecast_causes(lit(aberrations=(30.0,), seeing=None), Mvn.of(0.2))
    information = dict(zip(found.names, found.errors() / found.information.alone, strict=True))
    assert information["noll4"] < 2
    assert information["diffusion"] == np.inf


def test_about_perfect_focus_only_a_lopsided_pupil_tells_the_sign_of_defocus():
    bright = {"aberrations": (0.0,), "seeing": None, "diffusion": 0.0}
    light = obstructed_circle(0.125, 0.04, noll=(4,), samples=64)
    half = np.asarray(light.transmission) * np.where(np.arange(64) < 40, 1.0, 0.3)
    pupil = Pupil(half, 0.125, basis=light.basis, names=light.names)
    lopsided = replace(lit(**bright), optics=OpticalSystem(pupil, lines(550.0), Grid((32, 32), SCALE, 16)))
    assert "noll4" in forecast_causes(lopsided, Stable.of()).names
    assert "noll4_square" in forecast_causes(lit(**bright), Stable.of()).names


def test_sizes_are_those_a_person_gives():
    locus = Linear.of(0.6, 30.0)
    found = forecast_causes(lit(), locus)
    sizes = {cause.name: (cause.size, cause.unit) for cause in found.causes}
    assert sizes == {
        "jitter_along": (pytest.approx(600 / 12**0.5), "mas"),
        "jitter_turn": (0.0, "mas2"),
        "noll4": (30.0, "nm"),
        "seeing": (pytest.approx(0.8), "arcsec"),
        "diffusion": (pytest.approx(0.1 / SCALE), "pix"),
    }
    seeing = found.causes[found.names.index("seeing")]
    assert seeing.size_error(1e-6) == pytest.approx(1e-6 / (5 / 3 * 0.8 ** (2 / 3)), rel=1e-4)
    none = seeing._replace(value=0.0)
    assert none.size_error(0.5 ** (5 / 3)) == pytest.approx(0.5)  # what may hide where there seems to be none


def test_what_cannot_be_asked_is_refused_in_a_sentence():
    with refused(ErrorCode.UNSUPPORTED, "path"):
        forecast_causes(normal_setting(), Path.of([[0, 0], [0.1, 0], [0.2, 0.1]]))
    with refused(ErrorCode.OUT_OF_RANGE, 0):
        forecast_causes(normal_setting(), Linear.of(0.0))
    with refused(ErrorCode.OUT_OF_RANGE, "diffusion", -1):
        forecast_causes(replace(normal_setting(), diffusion=-1.0), Mvn.of(0.1))


def test_information_about_some_is_the_inverse_of_their_covariance(rng):
    rows = rng.standard_normal((9, 5))
    matrix = rows.T @ rows
    information = Information(tuple("abcde"), matrix)
    kept = information.about(("d", "b"))
    np.testing.assert_allclose(np.linalg.inv(kept.matrix), np.linalg.inv(matrix)[np.ix_([3, 1], [3, 1])])
    np.testing.assert_allclose(information.errors, np.sqrt(np.diag(np.linalg.inv(matrix))))
    np.testing.assert_allclose(information.knowing("ace").matrix, matrix[np.ix_([1, 3], [1, 3])])
    both = kept + Information.prior({"z": 0.5})
    assert both.names == ("d", "b", "z")
    assert both.errors[2] == pytest.approx(0.5)
    assert kept.about(("d", "q")).errors[1] == np.inf
    turned = information.changed(("a", "b"), ("p", "q"), np.array([[2.0, 1.0], [0.0, 3.0]]))
    covariance = np.linalg.inv(matrix)[:2, :2]
    expected = np.array([[2.0, 1.0], [0.0, 3.0]]) @ covariance @ np.array([[2.0, 0.0], [1.0, 3.0]])
    np.testing.assert_allclose(turned.errors[:2], np.sqrt(np.diag(expected)))
