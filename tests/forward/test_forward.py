"""What holds for every image and every derivative of one."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from jitterkit.errors import ConfigurationError
from jitterkit.forward import (
    Parameters,
    expected_image,
    free_parameters,
    image_and_jacobian,
    parameter_names,
    to_vector,
)
from jitterkit.loci import Linear, Mvn, Shm, Stable
from jitterkit.optics import Grid, expand, lines, obstructed_circle
from jitterkit.scene import Binary
from jitterkit.shutter import Drifting

NOLL = (4, 5, 7)
LOCI = {
    "stable": Stable.of(),
    "linear": Linear.of(0.6, 25.0),
    "shm": Shm.of(0.5, 115.0),
    "mvn": Mvn.of(0.2, 0.1, 70.0),
    "no linear": Linear.of(0.0),
    "no shm": Shm.of(0.0),
    "no mvn": Mvn.of(0.0),
}


@pytest.fixture(scope="module")
def pupil():
    # a telescope of its own: struts show the sign of all three aberrations, whose slopes are tested
    return obstructed_circle(0.12, 0.04, strut_width=0.004, struts=3, noll=NOLL, samples=128)


@pytest.fixture(scope="module")
def otf(pupil):
    return expand(pupil, lines(550.0, 600.0), Grid((36, 30), 0.375, 20), np.array([10.0, -5.0, 8.0]))


def scene(**changes):
    values = {"separation": 4.0, "theta": 33.0, "x": 0.4, "y": -0.6, "flux": 1e6, "contrast": 3.37}
    return Binary(**(values | changes))


def parameters(otf, locus=None, **changes):
    return Parameters(scene(**changes), LOCI["stable"] if locus is None else locus, otf.state, 2.0)


def brightest(image):
    row, column = np.unravel_index(np.argmax(image), image.shape)
    return int(column), int(row)


def test_a_lies_opposite_theta_and_y_grows_with_the_row(otf):
    # Frame centre (14.5, 17.5); A, the brighter, 2 arcsec (5.3 pixels) opposite to theta = 90.
    image = expected_image(parameters(otf, theta=90.0, x=0.19, y=0.0), otf)
    assert brightest(image) == (15, 12)
    image = expected_image(parameters(otf, theta=0.0, x=0.0, y=0.19), otf)
    assert brightest(image) == (9, 18)


def test_exchanging_the_stars_turns_theta_and_inverts_the_contrast(otf):
    one = expected_image(parameters(otf, theta=33.0, contrast=2.0), otf)
    other = expected_image(parameters(otf, theta=213.0, contrast=0.5), otf)
    assert np.asarray(one) == pytest.approx(np.asarray(other), abs=1e-13 * float(one.max()))


def test_contrast_is_the_ratio_of_the_fluxes_of_a_and_b(otf):
    x, y, flux = scene(contrast=3.0, flux=8.0).sources()
    assert np.asarray(flux) == pytest.approx([6.0, 2.0], rel=1e-15)
    assert np.hypot(x[1] - x[0], y[1] - y[0]) == pytest.approx(4.0, rel=1e-15)
    assert (float(x.mean()), float(y.mean())) == pytest.approx((0.4, -0.6), rel=1e-15)


def test_a_shift_by_whole_pixels_shifts_the_image(otf):
    one = np.asarray(expected_image(parameters(otf, x=0.1, y=0.2), otf))
    other = np.asarray(expected_image(parameters(otf, x=0.1 + 3 * 0.375, y=0.2 - 2 * 0.375), otf))
    assert other[:-2, 3:] == pytest.approx(one[2:, :-3], abs=1e-13 * one.max())


def test_flux_counts_light_outside_the_frame_and_alpha_cen_keeps_89_point_6_percent(reference_otf):
    binary = Binary(10.0, 180.0, 0.0, 0.0, 1.0, 3.37)
    image = expected_image(Parameters(binary, Stable.of(), np.zeros(7)), reference_otf)
    assert float(image.sum()) == pytest.approx(0.896, abs=5e-4)
    assert float(image.max()) == pytest.approx(0.00154, abs=1e-5)


def test_a_background_is_added_to_every_pixel(otf):
    dark = expected_image(Parameters(scene(), LOCI["linear"], otf.state), otf)
    lit = expected_image(Parameters(scene(), LOCI["linear"], otf.state, 5.0), otf)
    assert np.asarray(lit - dark) == pytest.approx(np.full((36, 30), 5.0), abs=1e-10)
    p = Parameters(scene(), LOCI["linear"], otf.state, 5.0, gradient=(0.5, -2.0))
    y, x = np.mgrid[:36, :30] * otf.grid.plate_scale
    plane = 0.5 * (x - x.mean()) - 2.0 * (y - y.mean())
    assert np.asarray(expected_image(p, otf) - lit) == pytest.approx(plane, abs=1e-10)


@pytest.mark.parametrize("name", ["linear", "shm", "mvn"])
def test_a_locus_of_no_size_leaves_the_image_alone(otf, name):
    still = expected_image(parameters(otf), otf)
    tiny = expected_image(parameters(otf, LOCI[f"no {name}"]), otf)
    assert np.asarray(tiny) == pytest.approx(np.asarray(still), abs=1e-13 * float(still.max()))


def test_jitter_keeps_the_light_and_adds_its_second_moments(pupil):
    # Over a wide frame with one star; the moments of the PSF itself cancel in the difference.
    otf = expand(pupil, lines(550.0), Grid((400, 400), 0.375, 0), derivatives=False)
    x = (np.arange(400) - 199.5) * 0.375

    def moments(locus):
        image = np.asarray(expected_image(Parameters(scene(separation=0.0, x=0, y=0, flux=1.0), locus), otf))
        return image.sum(), np.array(
            [np.sum(image * x**2), np.sum(image * np.outer(x, x)), np.sum(image * x[:, None] ** 2)]
        )

    (light, still), (blurred_light, blurred) = moments(LOCI["stable"]), moments(LOCI["linear"])
    assert blurred_light == pytest.approx(light, rel=1e-12)
    # Rings at the edge of the frame move in and out by the blur: 75^2 arcsec^2 times 1e-7 of the light.
    assert blurred - still == pytest.approx(light * np.asarray(LOCI["linear"].moments()), abs=2e-4)


def test_compiled_and_interpreted_images_agree_to_rounding(otf):
    p = parameters(otf, LOCI["shm"])
    eager = expected_image(p, otf)
    compiled = jax.jit(lambda q: expected_image(q, otf))(p)
    image, _ = image_and_jacobian(p, otf, (0,))
    for other in (compiled, image):
        assert np.asarray(other) == pytest.approx(np.asarray(eager), abs=1e-14 * float(eager.max()))


def test_single_precision_is_good_to_a_part_in_a_hundred_thousand(pupil, otf):
    double = np.asarray(expected_image(parameters(otf, LOCI["linear"]), otf))
    with jax.enable_x64(False):
        grid = Grid((36, 30), 0.375, 20)
        single_otf = expand(pupil, lines(550.0, 600.0), grid, np.array([10.0, -5.0, 8.0], "float32"))
        single = expected_image(parameters(single_otf, Linear.of(0.6, 25.0)), single_otf)
        assert single.dtype == np.float32
    # Focal phases of 1e2 rad carry 1e-7 of themselves; their mean over the pupil is smaller.
    assert np.asarray(single) == pytest.approx(double, abs=1e-5 * double.max())


def test_parameters_are_named_in_the_order_of_the_vector(otf):
    p = parameters(otf, LOCI["mvn"])
    vector, unravel = to_vector(p)
    names = parameter_names(p, otf.names)
    assert len(names) == vector.size == 6 + 3 + 3 + 3
    values = dict(zip(names, vector.tolist(), strict=True))
    assert (values["separation"], values["contrast"], values["background"]) == (4.0, 3.37, 2.0)
    assert values["mvn_xy"] == pytest.approx(float(LOCI["mvn"].coords[1]))
    assert (values["noll4"], values["noll7"]) == (10.0, 8.0)
    assert np.array_equal(to_vector(unravel(vector + 1))[0], vector + 1)


# Central differences: steps that change the image by about 1e-3 of itself leave 1e-6 of truncation.
STEPS = {
    "separation": 1e-3, "theta": 1e-2, "x": 1e-3, "y": 1e-3,
    "flux": 1e3, "contrast": 1e-3, "background": 1e-3, "background_x": 1e-3, "background_y": 1e-3,
    "noll4": 0.05, "noll5": 0.05, "noll7": 0.05,
    "linear_c": 1e-3, "linear_s": 1e-3, "shm_c": 1e-3, "shm_s": 1e-3,
    "mvn_xx": 1e-4, "mvn_xy": 1e-4, "mvn_yy": 1e-4,
}  # fmt: skip


@pytest.mark.parametrize("locus", list(LOCI))
def test_every_derivative_agrees_with_finite_differences(pupil, otf, locus):
    p = parameters(otf, LOCI[locus])
    vector, unravel = to_vector(p)
    names = parameter_names(p, otf.names)
    image, jacobian = image_and_jacobian(p, otf, tuple(range(vector.size)))
    assert np.asarray(image) == pytest.approx(
        np.asarray(expected_image(p, otf)), abs=1e-14 * float(image.max())
    )

    def exact(v):
        """Optics computed anew, so that the aberrations enter in full."""
        q = unravel(v)
        at = otf
        if not np.array_equal(q.aberrations, otf.state):
            at = expand(pupil, lines(550.0, 600.0), otf.grid, q.aberrations)
        return np.asarray(expected_image(q, at))

    for k, name in enumerate(names):
        step = np.zeros(vector.size)
        # At no size a streak's moments have the kink of |x|: the two sides average to the derivative, but
        # with an error of the first order.
        step[k] = STEPS[name] * (1e-2 if locus.startswith("no ") and name in p.locus.names else 1)
        measured = (exact(vector + step) - exact(vector - step)) / (2 * step[k])
        size = np.abs(measured).max()
        assert np.asarray(jacobian[k]) == pytest.approx(measured, abs=1e-5 * size + 1e-9), name


def test_a_jacobian_may_be_of_any_chosen_parameters(otf):
    p = parameters(otf, LOCI["mvn"])
    _, whole = image_and_jacobian(p, otf, tuple(range(13)))
    for chosen in [(0,), (1, 7), (6, 8, 12), (9, 11), (12,)]:
        _, part = image_and_jacobian(p, otf, chosen)
        assert np.asarray(part) == pytest.approx(np.asarray(whole)[list(chosen)], abs=1e-9)


@pytest.mark.parametrize("more", [{}, {"diffusion": 0.01, "shutter": Drifting(1e-4, (30.0, -70.0))}])
def test_numbers_of_32_bits_give_derivatives_of_32_bits(otf, more):
    p = parameters(otf, LOCI["mvn"])
    p = Parameters(p.scene, p.locus, p.aberrations, p.background, **more)
    free = tuple(range(13 + ("diffusion" in more)))
    _, exact = image_and_jacobian(p, otf, free)
    kinds = {jnp.dtype("float64"): jnp.float32, jnp.dtype("complex128"): jnp.complex64}
    p, otf = jax.tree.map(lambda a: a.astype(kinds.get(a.dtype, a.dtype)), (p, otf))
    image, jacobian = image_and_jacobian(p, otf, free)
    assert image.dtype == jacobian.dtype == jnp.float32
    for found, row in zip(np.asarray(jacobian), np.asarray(exact), strict=True):
        assert found == pytest.approx(row, abs=1e-4 * np.abs(row).max())


def test_derivatives_agree_with_automatic_differentiation_of_the_image(otf):
    p = parameters(otf, LOCI["linear"])
    vector, unravel = to_vector(p)
    _, jacobian = image_and_jacobian(p, otf, tuple(range(vector.size)))
    automatic = jax.jacfwd(lambda v: expected_image(unravel(v), otf))(vector)
    for k in range(vector.size):
        reference = np.asarray(automatic[..., k])
        assert np.asarray(jacobian[k]) == pytest.approx(reference, abs=1e-12 * np.abs(reference).max())


def test_something_is_left_to_fit(otf):
    parameters = Parameters(Binary(10.0, 90.0, 0.0, 0.0, 1e5, 3.0), Stable.of(), otf.state)
    every = parameter_names(parameters, otf.names)
    names, free = free_parameters(parameters, otf, set(every) - {"flux"})
    assert (names, free) == (("flux",), (every.index("flux"),))
    with pytest.raises(ConfigurationError, match="leave one free"):
        free_parameters(parameters, otf, every)
    with pytest.raises(ConfigurationError, match="no parameter 'fluxx' to hold"):
        free_parameters(parameters, otf, ["fluxx"])
