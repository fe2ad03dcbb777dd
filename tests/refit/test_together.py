"""One star or a pair, by several frames: against integrals over all pairs, by brute force."""

import math

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from jitterkit.forward import Parameters
from jitterkit.locate import Start
from jitterkit.loci import Stable
from jitterkit.refit.scene_choice import SceneChoice, SceneEvidence
from jitterkit.refit.scene_prior import COMPANIONS, FAINTEST
from jitterkit.refit.together import log_odds_together, scene_together
from jitterkit.scene import Binary, Star

ALONE = math.log(0.8)
ERROR = np.array([0.05, 6.0, 0.25])
"""Of separation [arcsec], theta [deg] and contrast, in one frame."""


def evidence(gain, values=(1.0, 40.0, 2.0), error=ERROR):
    """What a frame says whose pair is as likely as one star times e^gain, where it fits best."""
    covariance = np.diag(error**2)
    volume = 0.5 * np.linalg.slogdet(2 * np.pi * covariance)[1]
    return SceneEvidence(
        -50.0, -50.0 + gain + volume, ALONE, math.log(COMPANIONS), np.array(values), covariance
    )


def integrated(frames):
    """Logarithm of the odds, by a sum over separation, direction and contrast."""
    axes = np.linspace(0.7, 1.3, 91), np.linspace(0, 80, 91), np.linspace(1, 4, 91)
    s, t, c = np.meshgrid(*axes, indexing="ij")
    positions = np.stack([s, t, c], axis=-1)
    log = np.log(COMPANIONS / (s * 360 * c * math.log(FAINTEST))) - ALONE
    for one in frames:
        normal = multivariate_normal(one.values, one.covariance)
        log += one.pair + normal.logpdf(positions) - one.star
    cell = np.prod([np.diff(axis[:2])[0] for axis in axes])
    return float(np.logaddexp.reduce(log, axis=None) + math.log(cell))


@pytest.mark.parametrize("count", [1, 4])
def test_odds_are_the_integral_over_all_pairs(count):
    rng = np.random.default_rng(1)
    frames = [evidence(2.0, rng.normal([1.0, 40.0, 2.2], ERROR / 2)) for _ in range(count)]
    # the densities are normal in other coordinates, and Laplace takes the prior for flat
    assert log_odds_together(frames) == pytest.approx(integrated(frames), abs=0.3)


def test_the_prior_counts_once():
    """Where frames say the same, one frame of all their light says as much."""
    one, four = evidence(6.0), evidence(24.0, error=ERROR / 2)
    joint = log_odds_together([one] * 4)
    assert joint == pytest.approx(log_odds_together([four]), abs=1e-6)
    assert joint > 4 * log_odds_together([one]) + 10


def test_which_of_two_like_stars_is_called_a_does_not_matter():
    frames = [evidence(6.0, (1.0, 40.0, 1.05)), evidence(6.0, (1.0, 40.0, 1 / 1.05))]
    turned = [frames[0], evidence(6.0, (1.0, 220.0, 1.05), ERROR * [1, 1, 1.05**2])]
    assert log_odds_together(turned) == pytest.approx(log_odds_together(frames), abs=1e-6)


def choice(scene, evidence=None, odds=0.0):
    found = Binary(1.0, 40.0, 0.0, 0.0, 1e5, 2.0) if scene == "binary" else Star(0.0, 0.0, 1e5)
    start = Start(Parameters(found, Stable.of()), None, 1.0, np.eye(1), ())
    return SceneChoice(start, odds, evidence=evidence)


def test_frames_that_do_not_decide_alone_decide_together():
    rng = np.random.default_rng(2)
    pairs = [evidence(12.5, rng.normal([1.0, 40.0, 2.0], ERROR)) for _ in range(4)]
    assert all(abs(log_odds_together([one])) < 3 for one in pairs)
    # a drift that is the same in every frame looks like a pair that persists
    assert log_odds_together(pairs) > 3
    assert scene_together([choice("binary", one) for one in pairs]) is None
    # the same gains of pairs that lie anywhere are noise, or jitter that differs from frame to frame
    spread = [evidence(12.5, (1.0, theta, 2.0)) for theta in (10.0, 75.0, 120.0, 160.0)]
    assert scene_together([choice("binary", one) for one in spread]) == "star"
    assert scene_together([choice("binary", pairs[0])]) is None


def test_an_odd_frame_splits_no_run():
    sure = [choice("star", odds=-math.inf)] * 3
    assert scene_together([choice("binary", evidence(9.0)), *sure]) == "star"
    assert scene_together([choice("binary", odds=math.inf), *sure]) == "star"
    assert scene_together([choice("binary", odds=math.inf), sure[0]]) is None
    assert scene_together([]) is None
