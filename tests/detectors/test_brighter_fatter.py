"""The brighter-fatter effect: against borders that are moved one by one."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.detectors import Detector
from jitterkit.detectors.response import broaden, narrow
from jitterkit.errors import ErrorCode
from jitterkit.frames import RawFrame

SIZE = 2e-6


def moved_borders(charge, size):
    """Each border moves into the brighter pixel, and the mean charge of both sides goes with it."""
    found = charge.copy()
    ny, nx = charge.shape
    for y in range(ny):
        for x in range(nx):
            for v, u in ((y + 1, x), (y, x + 1)):
                if v < ny and u < nx:
                    by = size * (charge[y, x] - charge[v, u])  # pixels
                    moved = by * (charge[y, x] + charge[v, u]) / 2
                    found[y, x] -= moved
                    found[v, u] += moved
    return found


def test_each_border_moves_by_the_difference_of_its_sides(rng):
    charge = rng.uniform(0, 1e4, (9, 11))
    np.testing.assert_allclose(broaden(charge, SIZE), moved_borders(charge, SIZE), rtol=1e-12)
    assert broaden(charge, SIZE).sum() == pytest.approx(charge.sum())


@pytest.mark.parametrize("size", [1e-8, 2e-6, 1e-5])
def test_narrowing_undoes_it(size, rng):
    charge = rng.uniform(0, 1e4, (40, 30))
    np.testing.assert_allclose(narrow(broaden(charge, size), size), charge, rtol=1e-10, atol=1e-8)


def test_calibration_gives_back_independent_photon_noise(rng):
    """A bright flat loses variance by the effect, as photon transfer curves show; calibration restores it."""
    level, n = 8000.0, 300
    detector = Detector(gain=0.1, read_noise=0.0, bias=100.0, brighter_fatter=SIZE)
    adu = detector.expose(np.full((n, n), level), rng)
    blind = Detector(gain=0.1, read_noise=0.0, bias=100.0).calibrate(RawFrame.from_array(adu)).electrons
    known = detector.calibrate(RawFrame.from_array(adu)).electrons
    assert known.var() == pytest.approx(level, rel=4 * np.sqrt(2) / n)
    # a step of Q² by 2 Q dQ: each pixel keeps 1 - 4 b Q of its own deviation
    assert blind.var() == pytest.approx(level * (1 - 4 * SIZE * level) ** 2, rel=4 * np.sqrt(2) / n)


def test_neighbours_of_a_full_pixel_are_not_known():
    detector = Detector(
        gain=1.0, read_noise=0.0, bias=100.0, full_well=10_000.0, bits=16, brighter_fatter=SIZE
    )
    truth = np.full((9, 9), 2000.0)
    truth[4, 4] = 1.2e4
    frame = detector.calibrate(RawFrame.from_array(detector.expose(truth)))
    cross = np.array([[0, 1, 0], [1, 1, 1], [0, 1, 0]], bool)
    np.testing.assert_array_equal(frame.mask[3:6, 3:6], cross)
    assert frame.mask.sum() == 5
    assert frame.saturated == 1
    assert np.abs(frame.electrons[~frame.mask] - 2000).max() < 1.0  # rounding to an electron


@pytest.mark.parametrize("size", [SIZE, 6e-6])  # with the well: 0.02 and 0.06 pixel
@pytest.mark.parametrize("light", [1.1e4, 1e5, 1e7])
def test_a_star_however_bright_is_full_and_spoils_its_neighbours_only(size, light):
    known = {"gain": 1.0, "read_noise": 0.0, "bias": 100.0, "bits": 16}
    detector = Detector(**known, full_well=10_000.0, brighter_fatter=size)
    truth = np.full((9, 9), 2000.0)
    truth[4, 4] = light
    frame = detector.calibrate(RawFrame.from_array(detector.expose(truth)))
    assert frame.mask.sum() == 5
    assert frame.saturated == 1
    # what the star's own charge was is not known, which reaches the second neighbours
    assert np.abs(frame.electrons[~frame.mask] - 2000).max() < 0.1 * np.sqrt(2000)


def test_readings_beyond_the_law_are_full_where_no_well_is_known():
    """One hot pixel must not spoil the frame."""
    detector = Detector(gain=1.0, read_noise=0.0, bias=0.0, brighter_fatter=SIZE)
    readings = np.full((20, 20), 1000.0)
    readings[10, 10] = 2e5
    frame = detector.calibrate(RawFrame.from_array(readings))
    assert frame.mask.sum() == 5
    assert np.isfinite(frame.electrons).all()
    # its neighbours are wrong by up to 1000, and those of two of them by twice size/2 times 1000²
    np.testing.assert_allclose(frame.electrons[~frame.mask], 1000.0, atol=2.1)
    with refused(ErrorCode.OUT_OF_RANGE, "brighter_fatter = 2e-06", "200000", "full_well"):
        detector.expose(np.full((4, 4), 2e5))


def test_an_effect_as_large_as_a_pixel_is_refused():
    with refused(ErrorCode.OUT_OF_RANGE, "brighter_fatter = 1e-05", "7500"):
        Detector(full_well=7500.0, brighter_fatter=1e-5)
