"""The forward model against the direct integral: what "exact" means, in chi-squared of a bright frame."""

import numpy as np
import pytest

from jitterkit.forward import Parameters, expected_image
from jitterkit.loci import LOCI
from jitterkit.optics import Grid, expand, flat_band, grid_for, lines, obstructed_circle
from jitterkit.scene import Binary

PAIR = {"separation": 10.0, "theta": 33.0, "x": 1.3, "y": -2.1, "flux": 3.811e7, "contrast": 3.37}
SIZES = {
    "stable": {},
    "linear": {"length": 0.75, "angle": 25.0},
    "shm": {"length": 0.75, "angle": 115.0},
    "mvn": {"sigma_major": 0.2, "sigma_minor": 0.1, "angle": 70.0},
    "ellipse": {"semi_major": 0.3, "semi_minor": 0.15, "angle": 40.0},
    "partial": {"length": 0.6, "angle": 150.0, "cycles": 0.7, "phase": 50.0},
    "path": {"knots": [[-0.3, 0.1], [0.1, 0.3], [0.2, -0.2]]},
    "tones": {"length1": 0.3, "angle1": 20.0, "length2": 0.2, "angle2": 80.0},
}
"""One of each kind of transfer function; a lissajous is an ellipse, and the rest are products of these or
held to scipy's Bessel functions with the loci."""
ABERRATIONS = np.array([20.0, -10.0, 5.0, 15.0, 0.0, -20.0, 10.0])


def chi_squared(toliman, spectrum, truth, locus, pad):
    grid = grid_for(toliman, spectrum, (128, 128), 0.375, pad)
    otf = expand(toliman, spectrum, grid, ABERRATIONS, derivatives=False)
    image = expected_image(Parameters(Binary(**PAIR), LOCI[locus].of(**SIZES[locus])), otf)
    return np.sum((np.asarray(image) - truth) ** 2 / truth)


SLOW = ("mvn", "tones", "ellipse", "path")
"""tests/loci holds their transfer functions to sums over their points, as it does those of the others."""


@pytest.mark.parametrize(
    "locus", [pytest.param(name, marks=pytest.mark.slow) if name in SLOW else name for name in SIZES]
)
@pytest.mark.parametrize(
    "spectrum",
    [lines(530.0, 585.0, 640.0), pytest.param(flat_band(530, 640), marks=pytest.mark.slow)],
    ids=["lines", "band"],
)
def test_a_frame_of_38_million_photons_cannot_distinguish_the_model_from_the_integral(
    toliman, direct_image, locus, spectrum
):
    pairs = list(zip(spectrum.wavelengths, spectrum.weights, strict=True))
    truth = direct_image(toliman, pairs, (128, 128), 0.375, PAIR, locus, SIZES[locus], ABERRATIONS)
    assert chi_squared(toliman, spectrum, truth, locus, 64) < 0.05
    assert chi_squared(toliman, spectrum, truth, locus, 192) < 0.001


def test_an_undersampled_telescope_is_modelled_on_a_refined_grid(direct_image):
    # 0.3 m at 550 nm passes 2.64 cycles/arcsec; pixels of 0.5 arcsec sample 1.
    pupil, spectrum = obstructed_circle(0.3, 0.1, strut_width=0.008, struts=4, noll=()), lines(550.0)
    grid = grid_for(pupil, spectrum, (24, 20), 0.5, pad=40)
    assert grid.refine == 3
    pair = PAIR | {"separation": 3.0, "x": 0.2, "y": -0.3}
    found = expected_image(
        Parameters(Binary(**pair), LOCI["linear"].of(0.6, 25.0)),
        expand(pupil, spectrum, grid, derivatives=False),
    )
    # 1.3 cycles a pixel: ten nodes leave 1e-12.
    truth = direct_image(
        pupil, [(550.0, 1.0)], (24, 20), 0.5, pair, "linear", {"length": 0.6, "angle": 25.0}, order=10
    )
    assert np.sum((np.asarray(found) - truth) ** 2 / truth) < 0.05
    coarse = expected_image(
        Parameters(Binary(**pair), LOCI["linear"].of(0.6, 25.0)),
        expand(pupil, spectrum, Grid((24, 20), 0.5, 40), derivatives=False),
    )
    assert np.sum((np.asarray(coarse) - truth) ** 2 / truth) > 1e4
