"""What is no trail: other seeing, galaxies, saturated and undersampled stars; and what still is one."""

import numpy as np
import pytest
from refusals import refused
from scipy.special import j1

from jitterkit.errors import ErrorCode, UndeterminedError
from jitterkit.frames import Frame
from jitterkit.starfield import estimate_field
from jitterkit.starfield.certainty import not_linear
from jitterkit.starfield.detect import find_stars
from jitterkit.starfield.moments import Moments

HALF = 20


def drawn(profiles, seed, *, side=420, sky=100.0, low=8e3, high=1e5, line=(0.0, 0.0)):
    """A noisy frame with a star of each profile ``f(dx, dy)``, on a grid, drawn along a line.

    Each is the mean over 3 x 3 points a pixel and four a pixel of line, its sum over the stamp one.
    """
    rng = np.random.default_rng(seed)
    image, columns = np.full((side, side), sky), int(side // (2 * HALF + 2))
    points = 1 + 4 * int(np.ceil(np.hypot(*line)))
    steps = (np.arange(points) + 0.5) / points - 0.5
    fine = (np.arange(3) - 1) / 3
    grid = (np.arange(-HALF, HALF + 1)[:, None] + fine).ravel()
    for k, profile in enumerate(profiles):
        x, y = (2 * HALF + 2) * (k % columns) + HALF + 1, (2 * HALF + 2) * (k // columns) + HALF + 1
        px, py = rng.uniform(-0.5, 0.5, 2)
        star = np.mean(
            [profile(grid - px - s * line[0], grid[:, None] - py - s * line[1]) for s in steps], axis=0
        )
        star = star.reshape(2 * HALF + 1, 3, 2 * HALF + 1, 3).sum((1, 3))
        flux = np.exp(rng.uniform(np.log(low), np.log(high)))
        image[y - HALF : y + HALF + 1, x - HALF : x + HALF + 1] += flux * star / star.sum()
    return Frame(rng.poisson(image) + rng.normal(0, 5, image.shape), 25.0)


def field(profile, seed, **options):
    """A frame of equal stars: as many as the joint fit takes at once, with the light of 50 usual ones."""
    return drawn([profile] * 32, seed, low=8e3 * 50 / 32, high=1e5 * 50 / 32, **options)


def moffat(fwhm, beta=3.5):
    a = fwhm / 2 / np.sqrt(2 ** (1 / beta) - 1)
    return lambda x, y: (1 + (x * x + y * y) / a**2) ** -beta


def normal(fwhm):
    return lambda x, y: np.exp(-4 * np.log(2) * (x * x + y * y) / fwhm**2)


def airy(fwhm):
    def profile(x, y):
        u = np.maximum(np.pi * 1.029 * np.hypot(x, y) / fwhm, 1e-6)
        return (2 * j1(u) / u) ** 2

    return profile


def donut(radius, soft=1.0):
    """A defocused pupil with a central hole, its edges softened."""

    def profile(x, y):
        r = np.hypot(x, y)
        return 1 / (1 + np.exp((r - radius) / (soft / 4))) / (1 + np.exp((0.4 * radius - r) / (soft / 4)))

    return profile


def oval(fwhm, ratio, angle):
    """A star whose axes have a ratio, by Moffat."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    round_one = moffat(fwhm)
    return lambda x, y: round_one(c * x + s * y, (c * y - s * x) / ratio)


def galaxy(size, ratio, angle):
    """An exponential disc of a half-light radius, seen at an angle and through the seeing of a star."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    radii, turns = size * np.array([0.35, 0.8, 1.3, 2.2]), np.arange(6) * np.pi / 3  # equal shares of light
    u = (radii[:, None] * np.cos(turns + 0.5 * np.arange(4)[:, None])).ravel()
    v = (radii[:, None] * np.sin(turns + 0.5 * np.arange(4)[:, None])).ravel() * ratio
    star = moffat(3.2)
    return lambda x, y: sum(star(x - c * p + s * q, y - s * p - c * q) for p, q in zip(u, v, strict=True))


def galaxies(n, seed):
    rng = np.random.default_rng(seed)
    return [galaxy(rng.uniform(2.5, 4.5), rng.uniform(0.4, 0.9), rng.uniform(0, 180)) for _ in range(n)]


@pytest.fixture(scope="module")
def reference():
    return field(moffat(3.2), 1)


OTHER_SEEING = {
    "moffat": (moffat(3.2), moffat(4.5)),
    "moffat with wings": (moffat(3.0, 2.5), moffat(4.8, 2.5)),
    "normal": (normal(2.5), normal(5.0)),
    "airy": (airy(3.0), moffat(4.5)),
    "oval": (oval(3.2, 0.85, 30.0), oval(4.5, 0.85, 30.0)),
}
QUICK = "moffat with wings"


@pytest.mark.parametrize(
    "kind", [k if k == QUICK else pytest.param(k, marks=pytest.mark.slow) for k in OTHER_SEEING]
)
def test_worse_seeing_or_focus_is_no_trail(kind):
    sharp, soft = (field(profile, seed) for seed, profile in enumerate(OTHER_SEEING[kind]))
    estimate = estimate_field(soft, reference=sharp)
    assert "compatible with zero" in estimate.kernel.undetermined
    assert np.isnan(estimate.kernel.significance)
    assert not estimate.kernel.is_undetected
    assert estimate.length < 2 * estimate.length_err


@pytest.mark.parametrize("radius", [pytest.param(3.0, marks=pytest.mark.slow), 5.0])
def test_defocus_to_a_ring_is_refused_as_no_trail(radius):
    with refused(ErrorCode.MODEL_MISMATCH, "chi²/dof", error=UndeterminedError):
        estimate_field(field(donut(radius), 2), reference=field(moffat(3.0), 1))


@pytest.mark.parametrize(
    ("length", "fwhm"),
    [
        (2.0, 3.2),
        pytest.param(2.0, 3.6, marks=pytest.mark.slow),
        (3.0, 4.5),
        pytest.param(6.0, 4.0, marks=pytest.mark.slow),
    ],
)
def test_a_trail_is_found_in_the_same_and_in_worse_seeing(reference, length, fwhm):
    line = length * np.cos(np.radians(25)), length * np.sin(np.radians(25))
    estimate = estimate_field(field(moffat(fwhm), 3, line=line), reference=reference)
    assert not estimate.kernel.undetermined
    assert estimate.length == pytest.approx(length, rel=0.05)
    assert abs(estimate.angle - 25) < 3


@pytest.mark.parametrize("stars", [2, 5, 7])
def test_a_few_stars_that_agree_have_a_trail(stars):
    estimate = estimate_field(drawn([moffat(3.2)] * stars, stars, side=140, line=(3.5, 2.0)))
    assert not estimate.kernel.undetermined
    assert estimate.length == pytest.approx(np.hypot(3.5, 2.0), abs=4 * estimate.length_err)
    assert estimate.length_err < 0.2


def test_one_star_has_a_trail_beside_a_reference_only(reference):
    alone = drawn([moffat(3.2)], 4, side=100, low=5e4, line=(3.5, 2.0))
    assert "1 star " in estimate_field(alone).kernel.undetermined
    estimate = estimate_field(alone, reference=reference)
    assert not estimate.kernel.undetermined
    assert estimate.length == pytest.approx(np.hypot(3.5, 2.0), abs=4 * estimate.length_err)


@pytest.mark.parametrize(
    ("n", "beside"),
    [
        (1, True),
        pytest.param(6, True, marks=pytest.mark.slow),
        pytest.param(32, True, marks=pytest.mark.slow),
        (1, False),
        pytest.param(6, False, marks=pytest.mark.slow),
        pytest.param(32, False, marks=pytest.mark.slow),
    ],
)
def test_galaxies_are_no_trailed_stars(n, beside, reference):
    frame = drawn(galaxies(n, 3), 6, low=2e4)
    assert estimate_field(frame, reference=reference if beside else None).kernel.undetermined


def test_stars_are_distinguished_from_galaxies_and_give_the_trail():
    stars = [moffat(3.2)] * 25
    frame = drawn([*stars, *galaxies(25, 5)], 7, low=2e4, line=(3.5, 2.0))
    estimate = estimate_field(frame)
    assert not estimate.kernel.undetermined
    # the first 25 places are the stars'
    assert np.mean(estimate.y[estimate.used] < 4 * (2 * HALF + 2)) > 0.9
    assert estimate.length == pytest.approx(np.hypot(3.5, 2.0), rel=0.05)


@pytest.mark.parametrize("line", [(0.0, 0.0), (5.0, 0.0)])
def test_flat_tops_are_distinguished_from_the_tops_of_trails(line):
    frame = drawn([moffat(3.2)] * 50, 8, low=2e4, high=4e5, line=line)
    assert len(find_stars(frame)) == 50
    ceiling = np.sort(frame.electrons.ravel())[-60]
    full = Frame(np.minimum(frame.electrons, ceiling), 25.0)
    found = find_stars(full)
    assert 20 < len(found) < 50
    assert found.electrons.max() < ceiling - 100 - 1  # the sky


def test_a_frame_of_saturated_stars_says_so():
    frame = drawn([moffat(3.2)] * 16, 9, side=170, low=3e5, high=5e5)
    with refused(ErrorCode.TOO_FEW_STARS, "16 of 16", error=UndeterminedError):
        find_stars(Frame(np.minimum(frame.electrons, 5e3), 25.0))


@pytest.mark.parametrize("profile", [normal(1.4), normal(2.0), airy(2.0), airy(2.7)])
def test_sharp_stars_are_stars_and_the_cosmic_rays_among_them_are_not(profile):
    frame = drawn([profile] * 40, 10)
    rng = np.random.default_rng(11)
    for y, x in rng.integers(0, 8, (30, 2)) * (2 * HALF + 2):  # between the stars
        frame.electrons[y + 1, x + 1 : x + 1 + rng.integers(1, 5)] += 10 ** rng.uniform(3, 4.5)
    stars = find_stars(frame)
    off = [(values - HALF - 1 + HALF) % (2 * HALF + 2) - HALF for values in (stars.x, stars.y)]
    assert np.abs(off).max() < 1.5
    assert len(stars) > 36


@pytest.mark.parametrize(("fwhm", "length"), [(1.7, 2.0), (2.0, 3.0)])
@pytest.mark.slow
def test_a_trail_of_sharp_stars_is_right_within_its_error(fwhm, length):
    sharp, frame = field(normal(fwhm), 12), field(normal(fwhm), 13, line=(length, 0.0))
    estimate = estimate_field(frame, reference=sharp)
    assert not estimate.kernel.undetermined
    assert estimate.length == pytest.approx(length, abs=2 * estimate.length_err)
    assert estimate.length_err < 0.1 * length


def test_where_sampling_is_the_obstacle_it_is_named():
    with refused(ErrorCode.SAMPLING, "undersampled", 1.8, error=UndeterminedError):
        estimate_field(drawn([normal(1.2)] * 40, 14))


def test_a_star_with_speckles_and_a_halo_is_one_star():
    core, halo = airy(3.0), moffat(14.0, 2.5)
    positions = [(7 * np.cos(t), 7 * np.sin(t)) for t in np.arange(0.3, 6.3, 0.7)]

    def profile(x, y):
        return core(x, y) + 0.03 * halo(x, y) + 0.01 * sum(core(x - u, y - v) for u, v in positions)

    stars = find_stars(drawn([profile], 15, side=100, low=1e6, high=1e6))
    assert len(stars) == 1
    assert np.hypot(stars.x[0] - HALF - 1, stars.y[0] - HALF - 1) < 1


@pytest.mark.parametrize("compressed", [0.0, 0.1, 0.25])
def test_stars_that_near_saturation_are_compressed_are_said(compressed):
    """By 0.25 of the signal at the peak, a trail of 4 pixels comes out 0.12 too long, ten of its errors."""
    light = drawn([moffat(3.0, 3.0)] * 90, 21, low=3e3, high=3e5, line=(4.0, 0.0)).electrons
    frame = Frame(light * (1 - compressed * np.clip(light, 0, None) / light.max()), 25.0)
    remarks = " ".join(estimate_field(frame).remarks)
    assert ("in proportion to the light" in remarks) is (compressed > 0)


@pytest.mark.parametrize(("factor", "said"), [(0.75, "0.75 times"), (1.0, ""), (1.3, "1.30 times")])
def test_bright_stars_of_another_size_are_said_and_smaller_ones_may_mean_galaxies(factor, said):
    """Of thirty stars the ten brightest; what is faint and wide may be a galaxy, but nothing bright is."""
    moments = np.tile([2.0, 0.3, 1.0], (30, 1)) * np.where(np.arange(30) < 20, 1.0, factor)[:, None]
    flux, sound = np.arange(1.0, 31.0), np.ones(30, bool)
    stars = Moments(np.zeros((30, 2)), moments, np.zeros((30, 3, 3)), flux, sound)
    message = not_linear(stars, sound)
    assert (said in message) if said else not message
    assert ("galaxies" in message) is (factor < 1)
