"""Frames of a pair by the one telescope; star fields and views whose smear is known."""

import functools

import numpy as np
import pytest
import skimage.data
from scipy.ndimage import map_coordinates, spline_filter
from scipy.special import erf

from jitterkit.batch import FrameProcessor
from jitterkit.frames import RawFrame, open_frames, write_fits
from jitterkit.loci import Mvn
from jitterkit.scene import Binary
from jitterkit.simulate import simulate_frame

LENGTH, SIGMA = 5.0, 1.5


@pytest.fixture(scope="module")
def processor(telescope):
    return FrameProcessor(telescope, locus="mvn")  # by itself it would try, and compile, a dozen loci


@pytest.fixture(scope="session")
def drawn(drawn_by, telescope):
    """A pair at 8 arcsec under a little jitter; what is named is changed."""
    return functools.partial(drawn_by, telescope)


@pytest.fixture(scope="session")
def drawn_by():
    """Likewise, by any telescope."""

    def draw(telescope, rng, aberrations=None, **changes):
        values = {
            "separation": 8.0,
            "theta": 30.0,
            "x": 1.0,
            "y": -2.0,
            "flux": 1.2e5,
            "contrast": 3.37,
        } | changes
        scene, locus = Binary(**values), Mvn.of(0.1, 0.05, 20.0)
        return simulate_frame(telescope, scene, locus, aberrations=aberrations, rng=rng)

    return draw


def stars(rng, length, n=40, size=256):
    """Gaussian stars trailed along +x: a Gaussian across, a difference of error functions along."""
    y, x = np.indices((size, size))
    image = np.zeros((size, size))
    for x0, y0, flux in zip(*rng.uniform(20, size - 20, (2, n)), rng.uniform(2e4, 1e5, n), strict=True):
        across = np.exp(-((y - y0) ** 2) / (2 * SIGMA**2)) / (SIGMA * np.sqrt(2 * np.pi))
        ends = [(x - x0 + s * length / 2) / (SIGMA * np.sqrt(2)) for s in (1, -1)]
        along = (erf(ends[0]) - erf(ends[1])) / (2 * length)
        image += flux * across * along
    return rng.poisson(image + 50.0) + rng.normal(0, 3.0, image.shape)


def smeared_view(rng, length, angle=0.0):
    """A photograph smeared by averaging shifted copies, interpolated by cubic splines."""
    photograph = skimage.data.camera().astype(float)
    y, x = np.indices((400, 400)) + 56.0
    copies = 64 if length else 1  # equal copies take 64 times as long to draw
    steps = length * ((np.arange(copies) + 0.5) / copies - 0.5)
    c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))
    spline = spline_filter(photograph)
    smeared = np.mean(
        [map_coordinates(spline, [y - t * s, x - t * c], prefilter=False) for t in steps], axis=0
    )
    return smeared + rng.normal(0, photograph.std() / 100, smeared.shape)


@pytest.fixture(scope="session")
def view():
    return smeared_view


@pytest.fixture(scope="session")
def trail():
    """Length of the trails in field.fits of the folder, pixels."""
    return LENGTH


@pytest.fixture(scope="session")
def folder(tmp_path_factory):
    """A star field and a view, either smeared and sharp; tests write elsewhere."""
    rng = np.random.default_rng(5)
    folder = tmp_path_factory.mktemp("scenes")
    unit = {"BUNIT": "electron"}
    write_fits(folder / "field.fits", stars(rng, LENGTH), header={**unit, "PIXSCALE": 0.5})
    write_fits(folder / "sharpfield.fits", stars(rng, 1e-3), header={**unit, "PIXSCALE": 0.5})
    write_fits(folder / "view.fits", smeared_view(rng, 17.3, 30.0).astype(np.float32))
    write_fits(folder / "sharpview.fits", smeared_view(rng, 0.0).astype(np.float32))
    return folder


@pytest.fixture(scope="session")
def first():
    """Read the first frame of a file."""

    def read(path) -> RawFrame:
        with open_frames(path) as file:
            return file[0]

    return read
