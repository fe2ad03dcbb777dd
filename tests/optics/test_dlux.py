"""dLux optical systems: what can be taken over is, to rounding; what cannot is refused."""

import jax.numpy as jnp
import numpy as np
import pytest
from refusals import refused

from jitterkit.errors import ErrorCode
from jitterkit.optics import Grid, expand, lines, pupil_from_dlux

dlux = pytest.importorskip("dLux")
layers = pytest.importorskip("dLux.layers")

N, DIAMETER = 32, 0.2
AXIS = (np.arange(N) - (N - 1) / 2) / N
X, Y = np.meshgrid(AXIS, AXIS)
DISC = (np.hypot(X, Y) < 0.45).astype(float)
BASIS = np.stack([X * Y, X**2 - 0.3 * Y, Y**3])


def system(*parts):
    return dlux.AngularOpticalSystem(N, DIAMETER, list(parts), psf_npixels=24, psf_pixel_scale=0.3)


def aperture(coefficients=(0.0, 0.0, 0.0), **options):
    return layers.BasisOptic(BASIS, DISC * (1 + 0.2 * X), np.array(coefficients), normalise=True, **options)


def psf(pupil, aberrations=None):
    return np.asarray(expand(pupil, lines(600.0), Grid((24, 24), 0.3, 0), aberrations).psf())


def test_the_psf_is_dluxs_own_to_rounding(rng):
    optics = system(aperture(), layers.AberratedLayer(opd=rng.normal(0, 2e-7, (N, N))))
    pupil = pupil_from_dlux(optics)
    reference = np.asarray(optics.propagate_mono(6e-7))
    assert psf(pupil) == pytest.approx(reference, abs=1e-12 * reference.max())
    assert pupil.names == ("mode0", "mode1", "mode2")
    assert pupil.diameter == DIAMETER


def test_aberrations_count_from_the_coefficients_that_the_system_carries():
    base, change = np.array([50e-9, -30e-9, 80e-9]), np.array([20.0, 10.0, -40.0])
    pupil = pupil_from_dlux(system(aperture(base)))
    moved = system(aperture(base + change * 1e-9))
    reference = np.asarray(moved.propagate_mono(6e-7))
    assert psf(pupil, change) == pytest.approx(reference, abs=1e-12 * reference.max())


def test_bases_of_several_layers_are_joined_in_their_order():
    second = layers.BasisLayer(BASIS[:1] ** 2, np.array([5e-9]))
    pupil = pupil_from_dlux(system(aperture(), second), names=["a", "b", "c", "d"])
    assert pupil.names == ("a", "b", "c", "d")
    assert np.array_equal(pupil.basis, np.concatenate([BASIS, BASIS[:1] ** 2]))
    assert pupil.opd[DISC > 0] == pytest.approx((5 * BASIS[0] ** 2)[DISC > 0], abs=1e-11)


def test_a_wavefront_error_of_many_waves_does_not_wrap():
    opd = 9e-6 * (X**2 + Y**2)  # 15 waves in the visible
    pupil = pupil_from_dlux(system(layers.Optic(np.ones((N, N)), opd=opd)))
    assert pupil.opd == pytest.approx(opd * 1e9, abs=1e-10)


def test_layers_of_any_class_will_do_if_they_transmit_and_delay():
    pupil = pupil_from_dlux(system(aperture(), layers.Tilt(np.array([2e-6, -1e-6])), layers.Normalise()))
    expected = 1e9 * DIAMETER * (2e-6 * X - 1e-6 * Y)
    assert pupil.opd[DISC > 0] == pytest.approx(expected[DISC > 0], abs=1e-10)
    assert pupil.transmission.max() == 1.0


@pytest.mark.parametrize(
    "parts",
    [
        (aperture(), layers.AberratedLayer(phase=0.3 * X)),
        (aperture((0.1, 0.2, 0.1), as_phase=True),),
        (aperture(), layers.Flip(1)),  # turns the basis too, so that its modes are not the pupil's
    ],
    ids=["phase", "basis as phase", "flip"],
)
def test_a_system_that_is_more_than_path_and_transmission_is_refused(parts):
    with refused(ErrorCode.UNSUPPORTED, "470 nm"):
        pupil_from_dlux(system(*parts))


def test_a_layer_that_changes_the_sampling_is_refused_by_name():
    with refused(ErrorCode.UNSUPPORTED, "'shrink'"):
        pupil_from_dlux(system(aperture(), ("shrink", layers.Resize(16))))


@pytest.mark.parametrize("thing", [None, 3.0, layers.Normalise()])
def test_what_is_no_layered_system_is_refused(thing):
    with refused(ErrorCode.WRONG_TYPE, type(thing).__name__):
        pupil_from_dlux(thing)


def test_systems_built_in_single_precision_are_accepted():
    single = layers.BasisOptic(jnp.float32(BASIS), jnp.float32(DISC), jnp.zeros(3, "float32"))
    assert pupil_from_dlux(system(single)).basis.dtype == np.float64
