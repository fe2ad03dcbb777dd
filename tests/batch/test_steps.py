"""The five steps of a frame, one by one."""

from dataclasses import replace

import equinox as eqx
import numpy as np
import pytest
from own_images import star_image

from jitterkit.batch import steps
from jitterkit.batch.warm_start import WarmStart
from jitterkit.frames import Frame, RawFrame
from jitterkit.loci import Mvn
from jitterkit.refit import FitResult, Priors
from jitterkit.scene import Binary, FurtherStars
from jitterkit.simulate import simulate_frame

SCENE, LOCUS = Binary(5.0, 30.0, 0.7, -0.4, 2e5, 2.5), Mvn.of(0.3, 0.15, 20.0)


@pytest.fixture(scope="module")
def located(telescope):
    """A frame, and where its fits start."""
    raw = simulate_frame(telescope, SCENE, LOCUS, rng=np.random.default_rng(3)).raw
    frame = steps.calibrate(raw, telescope)
    optics = telescope.system(shape=frame.shape, plate_scale=frame.plate_scale)
    return frame, steps.locate(frame, optics)


@pytest.mark.parametrize("kernel", ["score", "mtf"])
def test_a_located_frame_yields_an_estimate_of_its_blur(located, kernel):
    frame, start = located
    found = steps.estimate(start, kernel)
    off = found.moments - np.asarray(LOCUS.moments())
    assert off @ np.linalg.solve(found.covariance, off) < 3 + 4 * np.sqrt(6)  # chi-squared of three
    assert (found.method, found.source, found.digest) == (kernel, frame.name, frame.digest)


def test_a_fit_and_its_diagnosis_yield_the_pair_and_a_prior_narrows_it(telescope, located):
    frame, start = located
    free = steps.diagnose(frame, start, steps.fit(start, locus="mvn"), telescope.plate_scale)
    assert free.status.usable, free.message
    assert abs(free.of_scene("separation") - 5.0) < 4 * free.error("separation")
    sigma = free.error("separation")
    known = steps.fit(start, Priors({"separation": (5.0, sigma)}), locus="mvn")
    # two equal weights; further parameters are the less bound for it
    assert known.error("separation") == pytest.approx(sigma / np.sqrt(2), rel=1e-3)


@pytest.mark.parametrize(("x", "flux", "doubted"), [(0.5, 3e3, True), (0.5, 9e4, False), (40.0, 3e3, False)])
def test_a_faint_star_beside_a_bright_one_may_be_none(telescope, located, x, flux, doubted):
    frame, start = located
    result = steps.fit(start, locus="mvn")
    (at, *_), (up, *_), _ = SCENE.sources()
    scene = Binary(5.0, 30.0, 0.7, -0.4, 2e5, 2.5, FurtherStars([at + x], [up], [flux]))
    given = replace(result, parameters=eqx.tree_at(lambda p: p.scene, result.parameters, scene))
    shown = steps.diagnose(frame, start, given, telescope.plate_scale)
    assert "further_stars" in shown.flags
    assert ("may be an error of the optics" in shown.message) is doubted


def test_a_frame_without_a_star_has_a_status_in_place_of_a_start(telescope, rng):
    raw = RawFrame.from_array(
        rng.normal(100.0, 3.0, telescope.shape), gain=1.0, read_noise=3.0, bias=100.0, exposure=1.0
    )
    frame = steps.calibrate(raw, telescope, {"plate_scale": telescope.plate_scale})
    start = steps.locate(frame, telescope.system(shape=frame.shape), "star")
    assert isinstance(start, FitResult)
    assert start.status.name == "NO_STAR"


def test_a_core_that_is_cut_off_below_the_stated_level_is_saturated(telescope):
    raw = simulate_frame(telescope, SCENE, LOCUS, rng=np.random.default_rng(3)).raw
    level = np.round(0.4 * raw.data.max())
    frame = steps.calibrate(replace(raw, data=np.minimum(raw.data, level)), telescope)
    assert "saturated" in frame.flags
    np.testing.assert_array_equal(frame.full, raw.data >= level)
    assert not {"saturated"} & set(steps.calibrate(raw, telescope).flags)


def test_one_star_among_pairs_is_a_star(telescope, rng):
    """Two stars that share its light fit it too; `estimate` took its blur of 0.1 arcsec for none."""
    q, w = np.polynomial.hermite_e.hermegauss(5)  # a normal blur, by quadrature
    path = [(0.2 * q[i], 0.1 * q[j], w[i] * w[j] / w.sum() ** 2) for i in range(5) for j in range(5)]
    image = star_image(0.6, -1.1, 2e5, path) + 3.0
    image = rng.poisson(image) + rng.normal(0, 3, image.shape)
    frame = Frame(image, 9.0, plate_scale=telescope.plate_scale)
    start = steps.locate(frame, telescope.system(), "auto", warm=WarmStart("binary"))
    assert start.parameters.scene.name == "star"
    off = (start.estimate.moments - [0.04, 0.0, 0.01]) / np.sqrt(np.diag(start.estimate.covariance))
    assert np.all(np.abs(off) < 3.5)
