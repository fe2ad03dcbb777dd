"""Cosmic rays: how many, how much charge, how long."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.detectors.readout import CHARGE, DEPTH, cosmic_rays
from jitterkit.errors import ErrorCode


class OneHit(np.random.Generator):
    """A generator that always counts one."""

    def poisson(self, *_, **__):
        return 1


def test_hits_come_at_the_rate_that_was_asked_for():
    # an exposure is empty with probability exp(-rate seconds pixels)
    rng, n, hits = np.random.default_rng(1), 4000, 0.7
    empty = sum(not cosmic_rays((20, 25), hits / 500 / 3.0, 3.0, rng).any() for _ in range(n)) / n
    expected = np.exp(-hits)
    assert empty == pytest.approx(expected, abs=4 * np.sqrt(expected * (1 - expected) / n))


def test_paths_are_those_of_particles_from_a_hemisphere():
    rng, n = OneHit(np.random.PCG64(2)), 2000
    tracks = [cosmic_rays((120, 120), 1.0, 1.0, rng) for _ in range(n)]
    paths = np.array([track.sum() for track in tracks]) / (CHARGE * DEPTH)
    for k in (1.2, 2.0, 4.0):  # longer than k depths: 1/k²; what leaves the frame is below 1 % of the cases
        assert np.mean(paths > k) == pytest.approx(k**-2, abs=4 * np.sqrt(k**-2 * (1 - k**-2) / n) + 0.01)
    starts = np.array([np.mean(np.nonzero(track), axis=1) for track in tracks if track.any()])
    assert starts.mean(0) == pytest.approx([59.5, 59.5], abs=4 * 120 / np.sqrt(12 * n))
    assert starts.std(0) == pytest.approx(120 / np.sqrt(12), rel=0.05)
    assert np.mean(paths < 0.999) < 0.03  # only where a track leaves the frame is less than a depth seen


def test_a_track_is_as_long_as_its_charge_says():
    rng, seen = OneHit(np.random.PCG64(3)), 0
    for _ in range(400):
        track = cosmic_rays((200, 200), 1.0, 1.0, rng)
        y, x = np.nonzero(track)
        if min(y.min(), x.min()) == 0 or max(y.max(), x.max()) == 199:
            continue  # it leaves the frame
        path = track.sum() / CHARGE
        extent = np.hypot(np.ptp(y), np.ptp(x))
        assert extent == pytest.approx(
            np.sqrt(path**2 - DEPTH**2), abs=np.sqrt(2) + 0.1
        )  # a pixel's rounding
        seen += path > 3
    assert seen > 20


def test_tracks_have_no_preferred_direction():
    rng = OneHit(np.random.PCG64(4))
    doubled = []
    for _ in range(1500):
        y, x = np.nonzero(cosmic_rays((200, 200), 1.0, 1.0, rng))
        if np.hypot(np.ptp(y), np.ptp(x)) > 4:
            slope = np.polyfit(x, y, 1)[0] if np.ptp(x) > np.ptp(y) else 1 / np.polyfit(y, x, 1)[0]
            doubled.append(2 * np.arctan(slope))
    # the mean of cos and of sin of twice an even angle is 0 with variance 1/2
    limit = 4 * np.sqrt(0.5 / len(doubled))
    assert abs(np.mean(np.cos(doubled))) < limit
    assert abs(np.mean(np.sin(doubled))) < limit


def test_a_detector_is_hit_only_where_noise_is_drawn_and_only_if_it_is_asked_to_be():
    detector = Detector(gain=1.0, cosmic_rays=1e-2)
    dark = np.zeros((50, 50))
    assert not detector.expose(dark, exposure=1.0).any()
    assert not Detector(gain=1.0).expose(dark, np.random.default_rng(6), exposure=1.0).any()
    assert detector.expose(dark, np.random.default_rng(6), exposure=1.0).max() >= 50
    clipped = Detector(gain=1.0, cosmic_rays=1e-2, full_well=60.0)
    assert clipped.expose(dark, np.random.default_rng(6), exposure=1.0).max() == 60
    with refused(ErrorCode.MISSING_VALUE, "cosmic_rays", "exposure"):
        detector.expose(dark, np.random.default_rng(6))
