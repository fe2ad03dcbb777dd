"""Tracking or optics, told on moments made by formula."""

import numpy as np
import pytest

from jitterkit.starfield.field_pattern import classify_field

SIDE = 800.0


def streaks(length, angle):
    """Moments (n, 3) of uniform lines."""
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    return (np.broadcast_to(length, np.shape(angle)) ** 2 / 12 * np.stack([c * c, c * s, s * s])).T


def classified(rng, vectors, stars=120, noise=0.02, **options):
    """Pattern of a field whose trails are sums of ``vectors(x, y)``: a list of (length, angle)."""
    x, y = rng.uniform(-SIDE / 2, SIDE / 2, (2, stars))
    moments = 2.2 * np.array([1.0, 0.0, 1.0]) + sum(streaks(*v) for v in vectors(x, y))
    covariance = np.tile(noise**2 * np.diag([2.0, 1.0, 2.0]), (stars, 1, 1))
    moments = moments + np.stack([rng.multivariate_normal(np.zeros(3), c) for c in covariance])
    return classify_field(x, y, moments, covariance, **options)


def radius(x, y):
    return np.hypot(x, y) / (SIDE / 2)


def away(x, y):
    return np.degrees(np.arctan2(y, x))


def everywhere(length, angle):
    return lambda x, y: [(length, np.full(x.shape, angle))]


def test_one_direction_everywhere_is_a_smear_with_its_angle(rng):
    pattern = classified(rng, everywhere(2.0, 107.5))
    assert pattern.kind == "smear"
    # e = 1/3, its error across 0.04/sqrt(120) at most: half of their ratio in degrees is 0.3
    assert pattern.angle == pytest.approx(107.5, abs=4 * pattern.angle_err)
    assert 0.1 < pattern.angle_err < 0.4
    assert pattern.smear_share > 0.97
    assert pattern.pattern_share < 0.05
    assert f"{pattern.angle:.1f} ± {pattern.angle_err:.1f}°" in pattern.sentence


@pytest.mark.parametrize(("turn", "kind"), [(0.0, "radial"), (90.0, "tangential")])
def test_a_pattern_about_the_centre_is_optics(rng, turn, kind):
    pattern = classified(rng, lambda x, y: [(3 * radius(x, y), away(x, y) + turn)])
    assert pattern.kind == kind
    assert pattern.pattern_share > 0.95
    assert pattern.smear_share < 0.1
    assert kind in pattern.sentence
    assert f"{pattern.pattern_share:.0%}" in pattern.sentence


@pytest.mark.parametrize("turn", [0.0, 90.0])
def test_another_law_of_growth_is_still_optics(rng, turn):
    """Astigmatism alone: moments with the fourth power of the distance."""
    pattern = classified(rng, lambda x, y: [(3 * radius(x, y) ** 2, away(x, y) + turn)])
    assert pattern.kind == ("radial", "tangential")[turn > 0]


def test_both_at_once_are_reported(rng):
    pattern = classified(rng, lambda x, y: [*everywhere(2.0, 20.0)(x, y), (3 * radius(x, y), away(x, y))])
    assert pattern.kind == "mixed"
    assert pattern.angle == pytest.approx(20, abs=4 * pattern.angle_err)
    assert pattern.angle_err < 0.5


def test_a_field_that_turned_shows_its_pivot(rng):
    def arcs(x, y):
        dx, dy = x - 250, y + 150
        return [(3 * np.hypot(dx, dy) / (SIDE / 2), np.degrees(np.arctan2(dy, dx)) + 90)]

    pattern = classified(rng, arcs)
    assert pattern.kind == "rotation"
    np.testing.assert_allclose(pattern.centre, [250, -150], atol=5)


def test_round_stars_are_round(rng):
    kinds = [classified(rng, everywhere(0.0, 0.0)).kind for _ in range(40)]
    assert kinds.count("round") >= 38


def test_elongation_with_neither_pattern_is_called_irregular(rng):
    pattern = classified(rng, lambda x, y: [(2.0, np.where(x > 0, 0.0, 90.0) + np.where(y > 0, 45.0, 0.0))])
    assert pattern.kind in ("irregular", "mixed")
    assert pattern.smear_share < 0.5


def test_an_elongation_of_the_reference_within_its_error_is_no_smear(rng):
    shared = 0.02**2 * np.diag([1.0, 0.5, 1.0])
    common = everywhere(np.sqrt(12 * 0.02), 30.0)  # an excess of 0.02, the reference's own error
    assert classified(rng, common).kind == "smear"
    assert classified(rng, common, shared=shared).kind == "round"


def test_scatter_that_noise_does_not_explain_widens_the_error(rng):
    x, y = rng.uniform(-1, 1, (2, 100))
    quiet = streaks(2.0, np.full(100, 40.0)) + rng.normal(0, 0.1, (100, 3))
    claimed = np.tile(1e-4 * np.eye(3), (100, 1, 1))
    pattern = classify_field(x, y, quiet, claimed)
    # e = 1/3; across it lies 2 Sxy cos + ..., of standard deviation sqrt(2 + 4) x 0.1/sqrt(2) at 40 degrees
    assert pattern.angle_err == pytest.approx(np.degrees(0.17 / 10 / (1 / 3) / 2), rel=0.35)


def test_a_few_stars_say_nothing(rng):
    pattern = classified(rng, everywhere(3.0, 10.0), stars=7)
    assert pattern.kind == "undetermined"
    assert "7 isolated stars " in pattern.sentence
    assert " 8 " in pattern.sentence  # are needed


def test_one_star_is_counted_in_the_singular(rng):
    assert "1 isolated star " in classified(rng, everywhere(3.0, 10.0), stars=1).sentence
