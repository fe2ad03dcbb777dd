import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.optics import Pupil, obstructed_circle
from jitterkit.optics.pupil import noll_to_nm, zernike


def test_the_light_through_an_obstructed_circle_is_its_area():
    pupil = obstructed_circle(2.0, 0.6, strut_width=0.0625, struts=4)
    # Four struts of 0.7 m: rectangles, up to the 2e-4 m by which the rims curve across them;
    # they are 64 of the 2048 points wide.
    area = np.pi * (1.0**2 - 0.3**2) - 4 * 0.0625 * 0.7
    assert pupil.transmission.sum() * pupil.pitch**2 == pytest.approx(area, rel=3e-4)


def test_the_first_strut_points_towards_plus_x():
    pupil = obstructed_circle(1.0, strut_width=0.02, struts=1)
    assert pupil.transmission[128, 200] < 0.01 < 0.99 < pupil.transmission[128, 56]
    assert pupil.transmission[200, 128] > 0.99


def test_struts_are_equally_spaced():
    pupil = obstructed_circle(1.0, strut_width=0.02, struts=3)
    azimuth = np.radians(60.0 * np.arange(6))
    row, column = (np.rint(127.5 + 72 * f(azimuth)).astype(int) for f in (np.sin, np.cos))
    light = pupil.transmission[row, column]
    assert light[::2] == pytest.approx(np.zeros(3), abs=0.01)  # 0, 120 and 240 degrees
    assert light[1::2] == pytest.approx(np.ones(3), abs=0.01)


def test_the_cutoff_is_set_by_the_samples_that_pass_light():
    transmission = np.zeros((100, 100))
    transmission[40:60, 10:90] = 1
    assert Pupil(transmission, 0.5).cutoff_diameter == pytest.approx(0.4, rel=1e-14)


def test_missing_arrays_are_no_aberrations():
    pupil = Pupil(np.ones((4, 4)), 1.0)
    assert np.array_equal(pupil.opd, np.zeros((4, 4)))
    assert pupil.basis.shape == (0, 4, 4)
    assert pupil.names == ()
    assert Pupil(np.ones((4, 4)), 1.0, basis=np.ones((2, 4, 4))).names == ("mode0", "mode1")


@pytest.mark.parametrize(
    ("build", "code", "values"),
    [
        (lambda: Pupil(np.ones((4, 5)), 1.0), ErrorCode.WRONG_SHAPE, ("transmission", (4, 5))),
        (
            lambda: Pupil(np.ones((4, 4)), 1.0, opd=np.ones((3, 3))),
            ErrorCode.WRONG_SHAPE,
            ("transmission (4, 4)", "opd (3, 3)"),
        ),
        (
            lambda: Pupil(np.ones((4, 4)), 1.0, basis=np.ones((4, 5))),
            ErrorCode.WRONG_SHAPE,
            ("transmission (4, 4)", "basis (4, 5)"),
        ),
        (lambda: Pupil(np.full((4, 4), np.nan), 1.0), ErrorCode.OUT_OF_RANGE, ("16 NaN",)),
        (lambda: Pupil(np.zeros((4, 4)), 1.0), ErrorCode.OUT_OF_RANGE, ("transmission", "zero")),
        (lambda: Pupil(np.ones((4, 4)), -0.5), ErrorCode.OUT_OF_RANGE, ("diameter", -0.5)),
        (
            lambda: Pupil(np.ones((4, 4)), 1.0, basis=np.ones((2, 4, 4)), names=["a"]),
            ErrorCode.WRONG_SHAPE,
            ("2 modes", "1 names"),
        ),
        (lambda: obstructed_circle(0.1, 0.2), ErrorCode.OUT_OF_RANGE, ("obscuration", "0.1 m", "0.2 m")),
        (lambda: obstructed_circle(0.1, 0.1), ErrorCode.OUT_OF_RANGE, ("obscuration", "0.1 m")),
    ],
)
def test_arrays_that_make_no_pupil_are_refused(build, code, values):
    with refused(code, *values):
        build()


def disc(n=801):
    axis = np.linspace(-1, 1, n)
    x, y = np.meshgrid(axis, axis)
    inside = np.hypot(x, y) <= 1
    return x[inside], y[inside]


def test_zernike_polynomials_are_orthonormal_over_the_disc():
    x, y = disc()
    modes = np.array([zernike(j, x, y) for j in range(1, 16)])
    # A staircase rim of 801 samples misplaces 1/801 of the area in random directions.
    assert modes @ modes.T / x.size == pytest.approx(np.eye(15), abs=5e-3)


@pytest.mark.parametrize(
    ("index", "formula"),
    [
        (1, lambda x, y: np.ones_like(x)),
        (2, lambda x, y: 2 * x),
        (3, lambda x, y: 2 * y),
        (4, lambda x, y: np.sqrt(3) * (2 * (x**2 + y**2) - 1)),
        (5, lambda x, y: 2 * np.sqrt(6) * x * y),
        (6, lambda x, y: np.sqrt(6) * (x**2 - y**2)),
        (7, lambda x, y: np.sqrt(8) * (3 * (x**2 + y**2) - 2) * y),
        (8, lambda x, y: np.sqrt(8) * (3 * (x**2 + y**2) - 2) * x),
        (9, lambda x, y: np.sqrt(8) * (3 * x**2 - y**2) * y),
        (10, lambda x, y: np.sqrt(8) * (x**2 - 3 * y**2) * x),
        (11, lambda x, y: np.sqrt(5) * (6 * (x**2 + y**2) ** 2 - 6 * (x**2 + y**2) + 1)),
    ],
)
def test_zernike_polynomials_are_nolls_table_in_cartesian_form(index, formula):
    x, y = disc(41)
    assert zernike(index, x, y) == pytest.approx(formula(x, y), abs=1e-13)


def test_zernike_indices_start_at_one():
    with refused(ErrorCode.OUT_OF_RANGE, -2):
        noll_to_nm(-2)
    with refused(ErrorCode.OUT_OF_RANGE, 0):
        noll_to_nm(0)


def test_binning_keeps_the_light_of_a_pupil_and_the_mean_of_its_modes():
    fine = obstructed_circle(1.0, 0.3, noll=(4, 7), samples=64)
    coarse = fine.binned(4)
    assert coarse.transmission.shape == (16, 16)
    assert coarse.pitch == 4 * fine.pitch
    assert coarse.names == fine.names
    assert np.mean(coarse.transmission) == pytest.approx(np.mean(fine.transmission), rel=1e-12)
    assert coarse.basis[1, 3, 5] == pytest.approx(np.mean(fine.basis[1, 12:16, 20:24]), rel=1e-12)
    assert fine.binned(1) is fine
    # softened edges of samples four times as wide are those of samples made so
    np.testing.assert_allclose(
        coarse.transmission, obstructed_circle(1.0, 0.3, samples=16).transmission, atol=0.06
    )


@pytest.mark.parametrize("factor", [0, 3, 128])
def test_a_pupil_is_binned_by_divisors_only(factor):
    with refused(ErrorCode.OUT_OF_RANGE, "64 samples", f"by {factor};"):
        obstructed_circle(1.0, samples=64).binned(factor)
