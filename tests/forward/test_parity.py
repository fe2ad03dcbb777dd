"""Parity mode: with the public model's own numerics put in, its own numbers come out.

dLuxToliman samples each pixel at 4 x 4 points and a smear at five, both end points included.  In the
language of transfer functions that is sinc(fp) / sinc(fp/4) and a sum of five phasors.  The discretisations
live beside ``scripts/reproduce_paper`` and not in the package, because they are wrong by tens of
microarcseconds.
"""

import numpy as np
import pytest
from paper_numerics import PUBLIC_LOCI, FiveArcsineImages, FiveEqualImages, point_sampled

from jitterkit.conventions import direction_angle
from jitterkit.forward import Parameters, expected_image
from jitterkit.loci import Stable
from jitterkit.optics import Grid, expand, lines
from jitterkit.scene import Binary


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
        image, ours = telescope.jitter_model(), PUBLIC_LOCI[shape].of(length, angle)
    theta = direction_angle(270 - source.position_angle)  # the public model's runs from +y to +x
    scene = Binary(
        source.separation, theta, source.x_position, source.y_position, 10**source.log_flux, source.contrast
    )
    return binned(image), scene, ours


@pytest.mark.parametrize(
    "locus",
    [
        pytest.param(None, marks=pytest.mark.slow),
        ("linear", 0.75, 25.0),
        pytest.param(("shm", 0.6, 115.0), marks=pytest.mark.slow),
    ],
    ids=["none", "linear", "shm"],
)
def test_images_equal_the_public_models(toliman, toliman_system, locus):
    image, scene, ours = public(toliman_system, locus, position_angle=57.0, x_position=1.3, y_position=-2.1)
    # The largest padding that the pupil's sampling allows; what wraps around it is below 1e-7.
    otf = point_sampled(expand(toliman, lines(530.0, 640.0), Grid((128, 128), 0.375, 192), derivatives=False))
    found = np.asarray(expected_image(Parameters(scene, ours), otf))
    assert found == pytest.approx(image, abs=1e-7 * image.max())
