import numpy as np
import pytest

from jitterkit.motion.split import difference_weight, legendre_weight, part_weights

CYCLES = np.array([0.03, 0.1, 0.2, 0.5, 0.7, 1.0, 1.5, 2.3, 6.1])


def projected(n, cycles):
    """Variance of a unit tone's n-th Legendre term by direct quadrature over time, averaged over phase."""
    t, w = np.polynomial.legendre.leggauss(80)  # of 6.1 cycles: far beyond rounding
    polynomial = np.sqrt(2 * n + 1) * np.polynomial.legendre.Legendre.basis(n)(t)
    total = 0.0
    for phase in (0.0, np.pi / 2):  # the square is a constant and a second harmonic of the phase
        tone = np.sqrt(2) * np.cos(np.pi * cycles * t + phase)
        total += (w / 2 * polynomial * tone).sum() ** 2 / 2
    return total


@pytest.mark.parametrize("n", range(5))
def test_the_weights_are_projections_of_a_tone_on_legendre_polynomials(n):
    expected = [projected(n, cycles) for cycles in CYCLES]
    np.testing.assert_allclose(legendre_weight(n, CYCLES), expected, rtol=1e-10, atol=1e-15)


def test_the_parts_sum_to_one_and_are_the_projections():
    weights = part_weights(CYCLES)
    np.testing.assert_allclose(weights.sum(axis=0), 1, atol=1e-15)
    for k in (0, 1):
        np.testing.assert_allclose(weights[k], [projected(k, c) for c in CYCLES], rtol=1e-10, atol=1e-15)


def test_the_jitter_of_a_very_slow_tone_is_not_lost_to_rounding():
    cycles = np.array([1e-9, 1e-6, 1e-3])
    z = np.pi * cycles
    # j2(z) = z²/15 (1 - z²/14 ...), so 5 j2² = z⁴/45 (1 - z²/7), and what follows is z⁶/1575 or 1/35 z² of it
    np.testing.assert_allclose(part_weights(cycles)[2], z**4 / 45, rtol=2e-6)
    both = part_weights(np.array([1, 1 + 1e-12]) / np.pi)[2]  # where one formula hands over to the other
    assert both[0] == pytest.approx(both[1], rel=1e-11)


@pytest.mark.parametrize(
    ("cycles", "share", "rounding"),
    [(0.1, 0.99, 0.005), (0.2, 0.97, 0.005), (0.5, 0.83, 0.005), (1, 0.30, 0.005), (1.5, 0.006, 0.0005)],
)
def test_smear_has_its_known_share_of_the_blur(cycles, share, rounding):
    _, smear, jitter = part_weights(np.array([cycles]))[:, 0]
    assert smear / (smear + jitter) == pytest.approx(share, abs=rounding)


def test_frames_at_opposite_ends_of_a_swing_differ_by_twice_its_amplitude():
    # variance of the difference of two opposite values is 4 times that of one
    assert difference_weight([0.5], 1e-6, 1.0) == pytest.approx(4, rel=1e-9)
    assert difference_weight([1.0], 1e-6, 1.0) == pytest.approx(0, abs=1e-12)
    assert difference_weight([0.3], 1.0, 2.0) == pytest.approx(
        2 * (1 - np.cos(1.2 * np.pi)) * np.sinc(0.3) ** 2
    )
