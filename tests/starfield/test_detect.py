"""Finding stars: those that stand alone, and nothing else."""

import numpy as np
from refusals import refused

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.frames import Frame
from jitterkit.starfield.detect import find_stars


def nearest(positions, stars):
    """Distance of each place to the nearest star found."""
    found = np.stack([stars.x, stars.y], axis=1)
    return np.min(np.hypot(*(positions[:, None] - found).transpose(2, 0, 1)), axis=1)


def placed(star, positions, flux=5e4, shape=(200, 240), seed=3):
    """A frame with equal stars at integer places, and noise."""
    image = np.full(shape, 100.0)
    for x, y in positions:
        stamp = star(0, 0, half=16)
        image[y - 16 : y + 17, x - 16 : x + 17] += flux * stamp
    return np.random.default_rng(seed).poisson(image).astype(float)


PLACES = np.array([(40, 40), (90, 40), (40, 90), (90, 90), (150, 150)])


def test_every_isolated_star_of_a_trailed_field_is_found_once(trailed):
    frame, positions = trailed
    stars = find_stars(frame)
    # the faintest, 3e3 electrons on a sky of 200, are near the least signal to noise that is asked for
    assert len(positions) * 0.95 < len(stars) <= len(positions)
    # a centroid within a contour: a tenth of a pixel, at most a quarter where a star is faint
    assert np.sum(nearest(positions, stars) < 0.3) == len(stars)


def test_x_is_the_column(star):
    stars = find_stars(Frame(placed(star, [(160, 60)]), 0.0))
    np.testing.assert_allclose([stars.x[0], stars.y[0]], [160, 60], atol=0.05)
    assert stars.middle.tolist() == [[160, 60]]
    assert stars.electrons[0].argmax() == stars.electrons[0].size // 2


def test_blends_saturated_stars_and_stars_at_the_edge_are_left_out(star):
    image = placed(star, [*PLACES, (157, 150), (220, 100)])
    mask = np.zeros(image.shape, bool)
    mask[40, 40] = True  # a saturated core
    image[40, 40] = 1e6
    cut = slice(None), slice(0, 222)  # through the star at x = 220
    stars = find_stars(Frame(image[cut], 0.0, mask[cut]))
    assert sorted(zip(stars.x.round(), stars.y.round(), strict=True)) == [(40, 90), (90, 40), (90, 90)]


def test_a_star_too_faint_for_its_moments_is_left_out_and_a_brighter_one_is_not(star):
    image = placed(star, PLACES)
    for flux, expected in ((700.0, len(PLACES)), (7e3, len(PLACES) + 1)):
        one_more = placed(star, [(200, 60)], flux) - 100.0  # its own light and noise
        stars = find_stars(Frame(image + one_more, 0.0))
        assert len(stars) == expected
        assert (nearest(np.array([(200, 60)]), stars) < 1.0) == (expected > len(PLACES))


def test_a_streak_across_the_field_is_no_star(star):
    image = placed(star, PLACES)
    for x in range(10, 130):
        image[118 + x // 20, x] += 300.0
        image[119 + x // 20, x] += 300.0
    stars = find_stars(Frame(image, 0.0))
    assert len(stars) == len(PLACES)
    assert nearest(PLACES, stars).max() < 0.1


def test_cosmic_rays_and_dead_pixels_are_neither_stars_nor_used(star):
    image = placed(star, PLACES)
    image[130, 60], image[100, 98], image[20, 200] = 5e3, -4e2, 9e3
    stars = find_stars(Frame(image, 0.0))
    assert len(stars) == len(PLACES)
    nearby = np.argmin(np.hypot(stars.x - 90, stars.y - 90))
    x, y = stars.middle[nearby]
    half = stars.used.shape[-1] // 2
    assert not stars.used[nearby, 100 - y + half, 98 - x + half]
    assert stars.used[nearby].sum() >= stars.used[nearby].size - 1


def test_the_noise_is_that_of_the_sky(trailed):
    frame, _ = trailed
    stars = find_stars(frame)
    # sky 200 and read noise 5: 225; boxes of 64 pixels and clipped wings leave a few per cent
    np.testing.assert_allclose(np.median(stars.sky_variance), 225, rtol=0.05)


def test_an_empty_frame_is_refused(rng):
    with refused(ErrorCode.NO_STAR, error=UndeterminedError):
        find_stars(Frame(rng.normal(100, 10, (128, 128)), 0.0))


def test_a_frame_of_blends_is_refused(star):
    with refused(ErrorCode.TOO_FEW_STARS, error=UndeterminedError):
        find_stars(Frame(placed(star, [(100, 100), (107, 100)]), 0.0))


def test_a_frame_without_a_usable_pixel_is_refused_by_name():
    with refused(ErrorCode.NO_DATA, "array", error=UndeterminedError):
        find_stars(Frame(np.full((64, 64), np.nan), 0.0))
