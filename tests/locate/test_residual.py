"""Stars and single pixels that stand out of a residual; images by sums of exponentials and Poisson laws."""

import numpy as np
import pytest

from jitterkit.conventions import offsets
from jitterkit.forward import Parameters, expected_image
from jitterkit.likelihood import Data
from jitterkit.locate import Residual, locate_binary
from jitterkit.loci import Mvn, Stable
from jitterkit.optics import empirical_otf
from jitterkit.scene import Binary, FurtherStars, Star, Stars

SCALE = 0.5


def normal_star(sigma, x=0.0, y=0.0, size=48):
    """A star of a normal profile on the pixels' centres: sigma and place in arcsec, light of one."""
    grid = offsets(size, SCALE)
    image = np.exp(-((grid - x) ** 2 + (grid[:, None] - y) ** 2) / (2 * sigma**2))
    return image * SCALE**2 / (2 * np.pi * sigma**2)


def optics(sigma):
    """A transfer function of such a star, pixel included."""
    return empirical_otf(normal_star(sigma, size=49), SCALE, (48, 48), pad=8)


@pytest.mark.parametrize("sky", [0.3, 3.0, 300.0])
def test_noise_of_any_light_has_no_outliers(sky, rng):
    """Once in a thousand frames by chance, as a Poisson law has it, not a normal one."""
    otf, flat = optics(0.6), np.full((48, 48), sky)
    found = sum(Residual(Data(rng.poisson(flat)), flat, otf).outliers(sky).any() for _ in range(300))
    assert found <= 3  # more than three of 0.3 that are expected: once in 4,000


@pytest.mark.parametrize("sigma", [0.6, 0.3], ids=["sampled", "undersampled"])
def test_hot_and_dead_pixels_are_found_and_stars_are_not(sigma, rng):
    otf, noise = optics(sigma), 4.0
    light = 30.0 + 2e4 * normal_star(sigma, 3.1, -2.2)
    counts = rng.poisson(light) + rng.normal(0, noise, light.shape)
    counts[5, 40], counts[30, 7], counts[31, 7] = 400.0, 150.0, 120.0  # a ray hits two pixels
    dark = Residual.of_dark(Data(counts, noise**2), otf).outliers(0.0, surely=True)
    near = np.hypot(*np.meshgrid(offsets(48, SCALE) - 3.1, offsets(48, SCALE) + 2.2)) < 2.0
    assert not dark[near].any()  # the star has not been taken away yet
    row, column = np.unravel_index(light.argmax(), light.shape)
    counts[row, column] = 0.0
    found = Residual(Data(counts, noise**2), light, otf).outliers(30.0)
    assert sorted(map(tuple, np.argwhere(found).tolist())) == sorted(
        [(5, 40), (30, 7), (31, 7), (int(row), int(column))]
    )


def test_what_a_model_of_the_optics_may_be_wrong_by_is_no_outlier(rng):
    otf, light = optics(0.6), 30.0 + 1e6 * normal_star(0.6, 0.2, 0.1)
    counts = rng.poisson(light).astype(float)
    row, column = np.unravel_index(light.argmax(), light.shape)
    counts[row, column] *= 0.85  # 60 sigmas
    assert not Residual(Data(counts), light, otf).outliers(30.0).any()


def test_pixels_all_over_the_frame_are_the_models_fault(rng):
    otf, flat = optics(0.6), np.full((48, 48), 100.0)
    counts = rng.poisson(flat).astype(float)
    counts[::8, ::8] += 200.0
    assert not Residual(Data(counts), flat, otf).outliers(100.0).any()


def test_further_stars_are_found_one_by_one_and_hot_pixels_are_none(rng):
    otf, known = optics(0.6), Star(0.0, 0.0, 3e5)
    positions = [(6.2, 3.1, 4000.0), (9.0, 3.4, 2500.0), (-8.0, 5.0, 1500.0)]
    base = 20.0 + 3e5 * normal_star(0.6)
    counts = rng.poisson(base + sum(flux * normal_star(0.6, x, y) for x, y, flux in positions)).astype(float)
    counts[8, 8] += 500.0
    left = Residual(Data(counts), base, otf)
    found = left.further_stars(known)
    assert isinstance(found, FurtherStars)
    for x, y, flux in positions:
        i = int(np.hypot(np.asarray(found.x) - x, np.asarray(found.y) - y).argmin())
        assert (float(found.x[i]), float(found.y[i])) == pytest.approx((x, y), abs=0.2)
        assert float(found.flux[i]) == pytest.approx(flux, rel=0.15)
    assert len(found.x) == 3


def test_a_dark_spot_says_that_the_model_is_wrong(rng):
    otf, known = optics(0.6), Star(0.0, 0.0, 3e5)
    base = 50.0 + 3e5 * normal_star(0.6)
    sound = Residual(Data(rng.poisson(base)), base, otf)
    wrong = Residual(Data(rng.poisson(base - 300.0 * normal_star(0.6, 6.0, 3.0))), base, otf)
    assert sound.is_all_stars(known)
    assert not wrong.is_all_stars(known)


@pytest.mark.parametrize("fainter", [6.0, 7.5])
def test_a_third_star_is_fitted_beside_a_pair(fainter, telescope, rng):
    """Seven magnitudes fainter it biases the separation of a frame in which chi-squared hides it."""
    system = telescope.system()
    flux = 3e6 * 10 ** (-0.4 * fainter)
    scene = Binary(5.0, 140.0, 0.3, -0.2, 3e6, 3.0, FurtherStars(-4.5, 5.5, flux))
    truth = Parameters(scene, Mvn.of(0.12, 0.06, 30.0), [4.0, -3.0], 2.0)
    image = np.asarray(expected_image(truth, system.otf(truth.aberrations)))
    data = Data(rng.poisson(image) + rng.normal(0, 2.4, image.shape), 2.4**2)
    start = locate_binary(data, system)
    others = start.parameters.scene.others
    assert others is not None
    assert len(others.x) == 1
    error = np.sqrt(np.diag(start.covariance_of(("x_3", "y_3", "flux_3", "separation"))))
    found = np.array([others.x[0], others.y[0], others.flux[0], start.parameters.scene.separation])
    assert np.all(np.abs(found - [-4.5, 5.5, flux, 5.0]) < 4.5 * error)
    pair = Parameters(Binary(5.0, 140.0, 0.3, -0.2, 3e6, 3.0), truth.locus, [4.0, -3.0], 2.0)
    lonely = np.asarray(expected_image(pair, system.otf(truth.aberrations)))
    data = Data(rng.poisson(lonely) + rng.normal(0, 2.4, image.shape), 2.4**2)
    assert locate_binary(data, system).parameters.scene.others is None


def test_a_scene_with_further_stars_is_the_sum_of_its_stars(plain_otf):
    more = FurtherStars([4.0, -6.0], [3.0, 1.0], [2e4, 5e4])
    pair = Binary(5.0, 140.0, 0.3, -0.2, 1e6, 3.0, more)
    x, y, flux = map(np.asarray, pair.sources())
    parts = [Parameters(Star(*one), Stable.of(), np.zeros(2)) for one in zip(x, y, flux, strict=True)]
    summed = sum(np.asarray(expected_image(one, plain_otf)) for one in parts)
    for scene in (pair, Stars.of(x, y, flux), pair.shifted(1.0, -2.0).shifted(-1.0, 2.0)):
        image = np.asarray(expected_image(Parameters(scene, Stable.of(), np.zeros(2)), plain_otf))
        np.testing.assert_allclose(image, summed, rtol=0, atol=1e-9 * summed.max())


def test_the_light_that_may_hide_is_that_of_white_noise_under_a_normal_star():
    """A star of sigma s on pixels p in a flat sky b has an error of sqrt(4 pi b) s/p by least squares."""
    sigma, sky = 0.6, 30.0
    star = Star(3.1, -2.2, 2e4)
    left = Residual(Data(np.full((48, 48), sky)), np.full((48, 48), sky), optics(sigma))
    # nine tenths of the places reach into the row next to the edge, where 4 % of a star's square is lost
    assert left.hidden(star) == pytest.approx(8 * np.sqrt(4 * np.pi * sky) * sigma / SCALE, rel=0.03)
    blind = Residual(Data(np.full((48, 48), sky), used=np.zeros((48, 48), bool)), left.image, left.otf)
    assert np.isnan(blind.hidden(star))


def test_a_star_of_that_light_is_found_and_one_of_half_of_it_is_not(rng):
    otf, sky, known = optics(0.6), 30.0, Star(3.1, -2.2, 2e4)
    light = sky + 2e4 * normal_star(0.6, 3.1, -2.2)
    limit = Residual(Data(light), light, otf).hidden(known)

    def found(flux):
        x, y = rng.uniform(-9.0, 0.0, 2)
        counts = rng.poisson(light + flux * normal_star(0.6, x, y))
        further = Residual(Data(counts), light, otf).further_stars(known)
        return further is not None and np.hypot(further.x[0] - x, further.y[0] - y) < 0.5

    assert sum(found(limit) for _ in range(40)) >= 35  # of 39.1 that are expected
    assert sum(found(limit / 2) for _ in range(40)) <= 6  # of 0.9, and of more between the pixels
