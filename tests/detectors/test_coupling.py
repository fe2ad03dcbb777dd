"""Inter-pixel coupling: against direct sums, matrices and the covariance that theory gives."""

import numpy as np
import pytest
from refusals import refused
from scipy.ndimage import convolve

from jitterkit.detectors import Detector
from jitterkit.detectors.response import beside, couple, decouple, decoupled_variance
from jitterkit.errors import ErrorCode
from jitterkit.frames import RawFrame

SHARE = 0.02


def matrix(ny, nx, share):
    """The coupling as a matrix, built pair by pair of neighbours."""
    pixels = [(y, x) for y in range(ny) for x in range(nx)]
    found = np.eye(len(pixels))
    for i, (y, x) in enumerate(pixels):
        for j, (v, u) in enumerate(pixels):
            if abs(y - v) + abs(x - u) == 1:
                found[i, j] += share
                found[i, i] -= share
    return found


def test_charge_goes_to_four_neighbours_and_none_is_lost():
    image = np.random.default_rng(1).uniform(0, 1e4, (13, 17))
    cross = np.array([[0, SHARE, 0], [SHARE, 1 - 4 * SHARE, SHARE], [0, SHARE, 0]])
    assert couple(image, SHARE) == pytest.approx(convolve(image, cross, mode="reflect"))
    assert couple(image, SHARE).sum() == pytest.approx(image.sum())
    assert couple(image, SHARE).ravel() == pytest.approx(matrix(13, 17, SHARE) @ image.ravel())


@pytest.mark.parametrize("shape", [(64, 64), (7, 30), (1, 5)])
@pytest.mark.parametrize("share", [1e-3, 0.02, 0.1])
def test_decoupling_undoes_coupling_to_rounding(shape, share):
    image = np.random.default_rng(2).uniform(0, 1e4, shape)
    # the weakest frequency keeps 1 - 8a, by which roundings grow; 100 for the transform's sums
    tolerance = 100 * np.finfo(float).eps * 1e4 / (1 - 8 * share)
    assert np.abs(decouple(couple(image, share), share) - image).max() < tolerance


def test_coupled_photon_noise_has_the_covariance_of_the_kernel_with_itself():
    n, level, a = 400, 500.0, 0.04
    image = couple(np.random.default_rng(3).poisson(level, (n, n)).astype(float), a)[1:-1, 1:-1] - level
    laws = {(0, 0): 1 - 8 * a + 20 * a**2, (0, 1): 2 * a * (1 - 4 * a), (1, 1): 2 * a**2, (2, 0): a**2}
    for (dy, dx), law in laws.items():
        found = np.mean(image[: n - 2 - dy, : n - 2 - dx] * image[dy:, dx:])
        # a mean of n² products of nearly normal numbers, whose own correlation is small
        assert found == pytest.approx(level * law, abs=4 * level * 1.5 / n), (dy, dx)


def test_calibration_makes_photon_noise_independent_again():
    n, level, a = 400, 4000.0, 0.04
    detector = Detector(gain=0.2, read_noise=0.0, bias=100.0, coupling=a)
    adu = detector.expose(np.full((n, n), level), np.random.default_rng(3))
    error = detector.calibrate(RawFrame.from_array(adu)).electrons - level
    assert error.var() == pytest.approx(level, rel=4 * np.sqrt(2) / n)
    for dy, dx in ((0, 1), (1, 0), (1, 1), (2, 0)):
        assert abs(np.mean(error[: n - dy, : n - dx] * error[dy:, dx:])) < 4 * level / n
    coupled = (adu - 100.0) * 0.2 - level
    before = np.mean(coupled[:, 1:] * coupled[:, :-1])
    assert before == pytest.approx(2 * a * (1 - 4 * a) * level, abs=4 * level / n)


@pytest.mark.parametrize("share", [0.005, 0.05])
def test_noise_that_comes_after_the_coupling_grows_as_the_inverse_matrix_says(share):
    ny, nx = 15, 14
    variance = np.random.default_rng(4).uniform(1.0, 30.0, (ny, nx))
    inverse = np.linalg.inv(matrix(ny, nx, share))
    exact = (inverse**2 @ variance.ravel()).reshape(ny, nx)
    # away from the edges all that is left out are paths of more than three pixels, a^8
    inside = (slice(5, -5), slice(5, -5))
    assert decoupled_variance(variance, share)[inside] == pytest.approx(exact[inside], rel=1e-4)
    # a corner has two neighbours less, each of which would bring 2a of variance, and a²
    assert decoupled_variance(variance, share) == pytest.approx(exact, rel=4 * share + 60 * share**2)
    even = (inverse**2).sum(1).reshape(ny, nx)[inside]
    assert decoupled_variance(1.0, share) == pytest.approx(even[0, 0], rel=1e-4)
    if share < 0.01:
        assert decoupled_variance(1.0, share) == pytest.approx(1 + 8 * share + 60 * share**2, rel=1e-4)


def test_a_full_well_beside_empty_ones_is_found_though_its_reading_is_lower():
    detector = Detector(gain=1.0, read_noise=2.0, bias=100.0, full_well=10_000.0, bits=16, coupling=SHARE)
    image = np.full((11, 11), 50.0)
    image[5, 5] = 1e6
    adu = detector.expose(image, np.random.default_rng(5))
    assert adu[5, 5] < 9500
    frame = detector.calibrate(RawFrame.from_array(adu))
    assert np.argwhere(frame.full).tolist() == [[5, 5]]
    assert np.array_equal(frame.mask, frame.full)
    # its neighbours have got their share back: 200 e- each; 5 sigma of photons and reading
    assert frame.electrons[5, 6] == pytest.approx(50.0, abs=5 * np.sqrt(50 + 4 * 1.2))


def test_full_wells_side_by_side_are_all_full_and_nothing_else_is_masked():
    # the middle one's reading is a full well's too; it is a reading, so its neighbours' share is known
    detector = Detector(gain=1.0, read_noise=2.0, bias=100.0, full_well=10_000.0, bits=16, coupling=SHARE)
    image = np.full((11, 11), 50.0)
    image[4:7, 4:7] = 1e6
    frame = detector.calibrate(RawFrame.from_array(detector.expose(image, np.random.default_rng(5))))
    assert np.array_equal(frame.full, image > 50)
    assert np.array_equal(frame.mask, frame.full)


def test_neighbours_of_a_pixel_without_a_reading_are_masked_but_not_full():
    detector = Detector(gain=1.0, read_noise=2.0, bias=100.0, bits=12, coupling=SHARE)
    image = np.full((11, 11), 50.0)
    image[5, 5] = 1e5
    frame = detector.calibrate(RawFrame.from_array(detector.expose(image)))
    assert np.argwhere(frame.full).tolist() == [[5, 5]]
    assert np.argwhere(frame.mask).tolist() == [[4, 5], [5, 4], [5, 5], [5, 6], [6, 5]]
    assert frame.saturated == 1


def test_beside_holds_a_mask_and_its_four_neighbours():
    mask = np.zeros((4, 4), bool)
    mask[0, 3] = True
    assert np.argwhere(beside(mask)).tolist() == [[0, 2], [0, 3], [1, 3]]


@pytest.mark.parametrize("share", [-0.01, 0.125, 0.3])
def test_a_share_that_cannot_be_undone_is_refused(share):
    with refused(ErrorCode.OUT_OF_RANGE, f"coupling = {share} ", "0 to 0.125 "):
        Detector(coupling=share)
