"""Parity mode: with the public model's own numerics put in, its own numbers come out.

dLuxToliman samples each pixel at 4 x 4 points and a smear at five, both end points included.  In the
language of transfer functions that is sinc(fp) / sinc(fp/4) and a sum of five phasors.  The
discretisations live here and not in the package, because they are wrong by tens of microarcseconds.
"""

from typing import ClassVar

import equinox as eqx
import jax.numpy as jnp
import numpy as np
import pytest

from jitterkit.conventions import theta_from_dlux
from jitterkit.forward import Parameters, expected_image
from jitterkit.loci import Linear, Stable
from jitterkit.optics import Grid, expand, lines
from jitterkit.scene import Binary

NODES = np.linspace(-0.5, 0.5, 5)
EQUAL = np.full(5, 0.2)
EDGES = np.concatenate([[-1.0], NODES[:-1] + NODES[1:], [1.0]])  # half-cells, in amplitudes
ARCSINE = np.diff(np.arcsin(EDGES)) / np.pi


class FiveImages(Linear):
    """Five images along a streak, as the public model has them."""

    weights: ClassVar[np.ndarray]

    def transfer(self, fx, fy):
        phase = 2 * jnp.pi * jnp.sqrt(jnp.maximum(self.along(fx, fy), 1e-30))
        return sum(w * jnp.cos(phase * node) for w, node in zip(self.weights, NODES, strict=True))


class FiveEqualImages(FiveImages):
    weights = EQUAL


class FiveArcsineImages(FiveImages):
    weights = ARCSINE


PUBLIC = {"linear": FiveEqualImages, "shm": FiveArcsineImages}


def point_sampled(otf, samples=4):
    """Replace the integral over a pixel by the mean over ``samples`` x ``samples`` points in it."""
    fy, fx = otf.grid.frequencies
    p = otf.grid.plate_scale
    inverse = 1 / (np.sinc(p * fx / samples) * np.sinc(p * fy / samples))
    return eqx.tree_at(lambda o: (o.value, o.jacobian), otf, (otf.value * inverse, otf.jacobian * inverse))


@pytest.mark.parametrize(
    ("locus", "flux", "published"),
    [
        (Stable.of(), 3.811e7, 240.8),
        (FiveEqualImages.of(0.75), 9.53e6, 782.0),
        (FiveArcsineImages.of(0.75), 9.53e6, 821.0),
    ],
    ids=["no jitter", "linear", "shm"],
)
def test_the_public_models_numerics_give_the_public_models_errors(
    reference_otf, sigma_separation, locus, flux, published
):
    assert sigma_separation(point_sampled(reference_otf), locus, flux) == pytest.approx(published, rel=0.005)


def test_five_equal_images_have_the_variance_of_harmonic_motion():
    # L^2/8 and not L^2/12: half of what was published as "linear and SHM are almost identical".
    assert np.sum(EQUAL * NODES**2) == pytest.approx(1 / 8, rel=1e-14)
    assert np.sum(ARCSINE * NODES**2) == pytest.approx(1.11 / 8, rel=2e-3)


def binned(image):
    """4 x 4 samples to a pixel."""
    ny, nx = image.shape
    return np.asarray(image).reshape(ny // 4, 4, nx // 4, 4).sum(axis=(1, 3))


def public(system, locus, **source):
    """The public model's image and the same scene and locus in our words."""
    import dLuxToliman

    source = dLuxToliman.AlphaCen(n_wavels=2, **source)
    optics = system.set("oversample", 4)
    if locus is None:
        image, ours = dLuxToliman.Toliman(optics, source).model(), Stable.of()
    else:
        shape, length, angle = locus
        telescope = dLuxToliman.JitteredToliman(optics, source, length, angle, n_psfs=5, jitter_shape=shape)
        image, ours = telescope.jitter_model(), PUBLIC[shape].of(length, angle)
    theta = theta_from_dlux(source.position_angle)
    scene = Binary(
        source.separation, theta, source.x_position, source.y_position, 10**source.log_flux, source.contrast
    )
    return binned(image), scene, ours


@pytest.mark.parametrize(
    "locus", [None, ("linear", 0.75, 25.0), ("shm", 0.6, 115.0)], ids=["none", "linear", "shm"]
)
def test_images_equal_the_public_models(toliman, toliman_system, locus):
    image, scene, ours = public(toliman_system, locus, position_angle=57.0, x_position=1.3, y_position=-2.1)
    # The largest padding that the pupil's sampling allows; what wraps around it is below 1e-7.
    otf = point_sampled(expand(toliman, lines(530.0, 640.0), Grid((128, 128), 0.375, 192), derivatives=False))
    found = np.asarray(expected_image(Parameters(scene, ours), otf))
    assert found == pytest.approx(image, abs=1e-7 * image.max())
