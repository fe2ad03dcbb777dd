"""A measured PSF in the place of a pupil."""

import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.forward import Parameters, expected_image
from jitterkit.loci import Linear, Stable
from jitterkit.optics import Grid, empirical_otf, expand, lines, obstructed_circle
from jitterkit.scene import Binary

SCALE = 0.5
TELESCOPE = obstructed_circle(0.12, 0.03, noll=())
LINES = lines(550.0, 600.0)


def optical(shape, pad=64):
    # Cutoff 1.06 cycles/arcsec: refined twice, so that this image is free of aliasing.
    return expand(TELESCOPE, LINES, Grid(shape, SCALE, pad, 2), derivatives=False)


def one_star(x, y):
    """One star at an offset from the frame's centre [arcsec]: both of the pair in one place."""
    return Binary(0.0, 0.0, x, y, 1.0, 1.0)


def gaussian(shape, x, y, sigma=2.5):
    rows, columns = np.indices(shape)
    return np.exp(-((columns - x) ** 2 + (rows - y) ** 2) / 2 / sigma**2)


@pytest.mark.parametrize("shape", [(33, 33), (32, 32), (31, 34), (40, 29)])
def test_a_star_at_the_stamps_centre_reproduces_the_stamp(shape):
    ny, nx = shape
    stamp = gaussian(shape, (nx - 1) / 2, (ny - 1) / 2)
    otf = empirical_otf(7 * stamp, SCALE, shape, centre=((nx - 1) / 2, (ny - 1) / 2), pad=5)
    image = expected_image(Parameters(one_star(0, 0), Stable.of()), otf)
    assert np.asarray(image) == pytest.approx(stamp / stamp.sum(), abs=1e-15)


def test_flux_means_the_light_of_the_whole_stamp():
    otf = empirical_otf(3 * gaussian((41, 41), 20, 20), SCALE, (64, 64))
    assert float(otf.value[0, 0].real) == pytest.approx(1.0, rel=1e-14)
    image = expected_image(Parameters(Binary(4.0, 30.0, 0, 0, 1e6, 3.0), Stable.of()), otf)
    assert float(image.sum()) == pytest.approx(1e6, rel=1e-12)


def test_stars_lie_where_the_scene_puts_them():
    otf = empirical_otf(gaussian((21, 23), 12.3, 9.1), SCALE, (48, 50), centre=(12.3, 9.1))
    image = expected_image(Parameters(one_star(2.3, -1.7), Stable.of()), otf)
    # A Gaussian of 2.5 pixels passes exp(-2 (pi 2.5/2)^2) = 4e-14 at Nyquist, but the stamp cuts it
    # 3.6 sigma from the centre: steps of exp(-3.6^2/2) = 1.5e-3 of the peak at the edge, none inside.
    expected = gaussian((48, 50), 24.5 + 2.3 / SCALE, 23.5 - 1.7 / SCALE)
    core = expected > 0.02
    assert (np.asarray(image) / image.max())[core] == pytest.approx(
        (expected / expected.max())[core], abs=5e-3
    )


def test_the_centroid_stands_in_for_a_missing_centre():
    stamp = gaussian((31, 33), 15.4, 14.8)
    found = empirical_otf(stamp, SCALE, (32, 32))
    given = empirical_otf(stamp, SCALE, (32, 32), centre=(15.4, 14.8))
    # Cutting 6 sigma from the centre moves the centroid by less than exp(-18) of a pixel.
    assert np.asarray(found.value) == pytest.approx(np.asarray(given.value), abs=1e-7)


def test_a_stack_of_a_telescopes_stars_stands_in_for_its_pupil():
    shape, scale = (48, 48), 0.4
    grid = Grid(shape, scale, 64)  # cutoff 1.06, Nyquist 1.25 cycles/arcsec
    true = expand(TELESCOPE, LINES, grid, derivatives=False)
    stamp = expected_image(
        Parameters(one_star(0.13, -0.07), Stable.of()),
        expand(TELESCOPE, LINES, Grid((160, 160), scale, 64), derivatives=False),
    )
    measured = empirical_otf(stamp, scale, shape, centre=(79.5 + 0.13 / scale, 79.5 - 0.07 / scale))
    scene = Parameters(Binary(5.0, 40.0, 0.31, 0.22, float(np.sum(stamp)), 3.0), Linear.of(0.6, 20.0))
    reference = expected_image(
        Parameters(Binary(5.0, 40.0, 0.31, 0.22, 1.0, 3.0), Linear.of(0.6, 20.0)), true
    )
    # The stamp ends 80 pixels from the star, where the pattern is 1e-6 of the peak.
    assert np.asarray(expected_image(scene, measured)) == pytest.approx(
        np.asarray(reference), abs=3e-6 * float(reference.max())
    )


def test_padding_grows_until_the_stamp_fits():
    assert empirical_otf(gaussian((101, 51), 25, 50), SCALE, (32, 32), pad=4).grid.pad == 35


def test_an_empirical_psf_has_no_aberrations_and_holds_the_pixel():
    otf = empirical_otf(gaussian((9, 9), 4, 4), SCALE, (16, 16))
    assert otf.names == ()
    assert otf.jacobian.shape[0] == 0
    assert otf.pixel_included
    assert np.array_equal(otf.at(np.zeros(0)), otf.value)


@pytest.mark.parametrize(
    ("psf", "centre", "code", "values"),
    [
        (np.ones(5), None, ErrorCode.WRONG_SHAPE, ((5,),)),
        (np.ones((0, 3)), None, ErrorCode.WRONG_SHAPE, ((0, 3),)),
        (np.full((3, 3), np.nan), None, ErrorCode.OUT_OF_RANGE, ("9 NaN",)),
        (np.zeros((3, 3)), None, ErrorCode.OUT_OF_RANGE, ("to 0,",)),
        (-np.ones((3, 3)), None, ErrorCode.OUT_OF_RANGE, ("to -9,",)),
        (np.ones((3, 3)), (1.0, 2.6), ErrorCode.OUT_OF_RANGE, ("(1, 2.6)", (3, 3))),
        (np.ones((3, 3)), (np.nan, 1.0), ErrorCode.OUT_OF_RANGE, ("(nan, 1)", (3, 3))),
    ],
)
def test_images_that_are_no_star_are_refused(psf, centre, code, values):
    with refused(code, *values):
        empirical_otf(psf, SCALE, (8, 8), centre=centre)
