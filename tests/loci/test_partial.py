"""Vibrations of a few cycles, against their definition and their limits."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
import scipy.integrate
import scipy.special
from refusals import refused

from jitterkit.errors import ConfigurationError, ErrorCode
from jitterkit.loci import Linear, PartialShm, Shm

FX, FY = np.meshgrid(np.linspace(-1.2, 1.2, 13), np.linspace(-1.1, 1.1, 12))
CASES = [(0.05, 0.0), (0.3, 40.0), (0.7, 25.0), (0.7, -80.0), (1.4, 160.0), (2.3, 90.0), (2.8, -130.0)]


def along(angle, fx, fy):
    return fx * np.cos(np.radians(angle)) + fy * np.sin(np.radians(angle))


@pytest.mark.parametrize(("cycles", "phase"), CASES)
def test_it_is_the_time_average_of_the_sinusoid_about_its_mean(cycles, phase):
    amplitude, angle, psi = 0.4, 35.0, np.radians(phase)

    def offset(t):
        return amplitude * np.sin(2 * np.pi * cycles * t + psi)

    mean = scipy.integrate.quad(offset, -0.5, 0.5, epsabs=1e-14, limit=200)[0]
    locus = PartialShm.of(2 * amplitude, angle, cycles, phase)
    for fx, fy in [(0.8, 0.3), (-0.5, 1.1)]:
        u = along(angle, fx, fy)
        parts = [
            scipy.integrate.quad(
                lambda t, p=p, u=u: p(2 * np.pi * u * (offset(t) - mean)), -0.5, 0.5, epsabs=1e-13, limit=400
            )[0]
            for p in (np.cos, np.sin)
        ]
        found = complex(locus.transfer(fx, fy))
        # Forwards or backwards is one image, and one transfer function; its sign is that of the mean phasor.
        assert found == pytest.approx(parts[0] - 1j * parts[1], abs=1e-12)


@pytest.mark.parametrize(("cycles", "phase"), CASES)
def test_it_is_the_series_of_bessel_functions(cycles, phase):
    # exp(-iz sin a) = sum_k J_k(z) exp(-ika); the integral about mid-exposure leaves exp(-ik psi) sinc(ka).
    z = 2 * np.pi * 0.4 * along(35.0, FX, FY)
    k = np.arange(-40, 41)[:, None, None]
    terms = scipy.special.jv(k, z) * np.exp(-1j * k * np.radians(phase)) * np.sinc(k * cycles)
    mean = 0.4 * np.sin(np.radians(phase)) * np.sinc(cycles)
    expected = terms.sum(axis=0) * np.exp(2j * np.pi * mean * along(35.0, FX, FY))
    locus = PartialShm.of(0.8, 35.0, cycles, phase)
    assert np.asarray(locus.transfer(FX, FY)) == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("cycles", [1.0, 2.0, 3.0])
def test_whole_cycles_are_harmonic_motion_at_any_phase(cycles):
    expected = np.asarray(Shm.of(0.8, 35.0).transfer(FX, FY))
    for phase in (0.0, 33.0, 90.0):
        locus = PartialShm.of(0.8, 35.0, cycles, phase)
        assert np.asarray(locus.transfer(FX, FY)) == pytest.approx(expected, abs=1e-12)
        assert np.asarray(locus.moments()) == pytest.approx(
            np.asarray(Shm.of(0.8, 35.0).moments()), abs=1e-15
        )


def test_half_a_cycle_from_end_to_end_is_harmonic_motion_too():
    found = np.asarray(PartialShm.of(0.8, 35.0, 0.5).transfer(FX, FY))
    assert found == pytest.approx(np.asarray(Shm.of(0.8, 35.0).transfer(FX, FY)), abs=1e-12)


def test_fewer_and_fewer_cycles_of_one_travelled_length_become_a_drift():
    expected = np.asarray(Linear.of(0.6, 35.0).transfer(FX, FY))
    left = []
    for cycles in (0.2, 0.1, 0.05):
        locus = PartialShm.of(0.6 / np.sin(np.pi * cycles), 35.0, cycles)
        left.append(np.abs(np.asarray(locus.transfer(FX, FY)) - expected).max())
    # The sine differs from its tangent by the square of its argument: a quarter for half the cycles.
    assert left[0] / left[1] == pytest.approx(4, rel=0.1)
    assert left[1] / left[2] == pytest.approx(4, rel=0.03)


def test_a_drift_is_a_regular_point_and_beyond_it_the_motion_runs_away():
    coords = np.asarray(PartialShm.of(0.8, 35.0, 0.3).coords)
    size = 0.6 / np.sqrt(12) * np.array([np.cos(np.radians(35)), np.sin(np.radians(35))])
    drift = PartialShm(np.array([*size, 0.0, 0.0]))
    expected = np.asarray(Linear.of(0.6, 35.0).transfer(FX, FY))
    assert np.asarray(drift.transfer(FX, FY)) == pytest.approx(expected, abs=1e-13)
    slope = jax.jacfwd(lambda c: drift.at(c).transfer(FX, FY))(drift.coords)
    assert np.all(np.isfinite(slope))
    assert np.all(np.abs(slope).max(axis=(0, 1)) > 1e-3)
    # Minus a quarter of a square: sinh(pi t) between its ends.
    fast = PartialShm(np.array([*coords[:2], -0.25, 0.0]))
    t = (np.arange(20000) + 0.5) / 20000 - 0.5
    offset = np.sinh(np.pi * t) / np.sqrt(np.mean(np.sinh(np.pi * t) ** 2))
    phase = 2 * np.pi * (coords[0] * FX + coords[1] * FY)
    expected = np.array([np.mean(np.exp(-1j * p * offset)) for p in phase.ravel()])
    assert np.asarray(fast.transfer(FX, FY)).ravel() == pytest.approx(expected, abs=1e-8)


def test_a_motion_and_its_reversal_are_one_and_so_are_both_ways_to_say_it():
    one = PartialShm.of(0.8, 35.0, 0.7, 25.0)
    for angle, phase in [(35.0, 155.0), (215.0, 205.0), (215.0, -25.0)]:
        other = PartialShm.of(0.8, angle, 0.7, phase)
        assert np.asarray(other.transfer(FX, FY)) == pytest.approx(
            np.asarray(one.transfer(FX, FY)), abs=1e-13
        )
        expected = {"length": 0.8, "angle": 35.0, "cycles": 0.7, "phase": 25.0}
        assert other.describe() == pytest.approx(expected, rel=1e-12)


def test_the_image_lingers_where_the_motion_turns():
    # At 90 degrees mid-exposure is the turning point, along +x: the far tail points the other way.
    x = PartialShm.of(0.8, 0.0, 0.4, 90.0).points(4096)[:, 0]
    assert np.mean(x**3) < 0 < np.median(x)
    assert np.ptp(x) == pytest.approx(0.4 * (1 - np.cos(0.4 * np.pi)), rel=1e-3)


def test_turning_through_180_degrees_moves_the_coordinates_smoothly():
    ahead, back = (np.asarray(PartialShm.of(0.8, angle, 0.7, 25.0).coords) for angle in (179.999, 180.001))
    assert ahead == pytest.approx(back, abs=1e-4)


def test_no_derivative_is_lost_where_the_motion_is_its_own_reversal():
    # There and back: the phase would have no slope; the even share, of value one, has.
    locus = PartialShm.of(0.8, 35.0, 0.7, 90.0)
    assert float(locus.coords[3]) == pytest.approx(1.0)
    slope = np.asarray(jax.jacfwd(lambda c: locus.at(c).transfer(FX, FY))(locus.coords))
    step = np.array([0, 0, 0, 1e-4])
    beyond, within = (np.asarray(locus.at(locus.coords + s * step).transfer(FX, FY)) for s in (1, -1))
    measured = (beyond - within) / 2e-4
    assert np.abs(measured).max() > 0.1
    # Rounding over the square root of the offset under it, and the square of the step.
    assert slope[..., 3] == pytest.approx(measured, abs=1e-6)


@pytest.mark.parametrize(
    ("sizes", "values"),
    [
        ({"length": -1.0}, ["length", "-1.0"]),
        ({"length": 1.0, "cycles": 0.01}, ["0.05 to 3 cycles", "got 0.01", "linear"]),
        ({"length": 1.0, "cycles": 20.0}, ["0.05 to 3 cycles", "got 20", "shm"]),
    ],
)
def test_impossible_sizes_are_refused(sizes, values):
    with refused(ErrorCode.OUT_OF_RANGE, *values, error=ConfigurationError):
        PartialShm.of(**sizes)


def test_the_slope_where_the_motion_turns_round_survives_32_bits():
    # At a phase of 90 degrees the even share is one, where its root has a slope of 1/sqrt(eps).
    def slope():
        locus = PartialShm.of(0.6, 25.0, 0.05, 90.0)
        f = np.linspace(0.0, 1.2, 9)
        slopes = jax.jit(jax.jacfwd(lambda c: jnp.abs(locus.at(c).transfer(f, f))))
        return np.asarray(slopes(locus.coords))[:, 3]

    double = slope()
    with jax.enable_x64(False):
        single = slope()
    assert single == pytest.approx(double, rel=0, abs=1e-3)
