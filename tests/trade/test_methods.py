"""Ways to a separation: each against the truth, and against what the others make of the same frames."""

from dataclasses import replace

import numpy as np
import pytest
from refusals import refused

from jitterkit.batch import FrameProcessor
from jitterkit.errors import ErrorCode, JitterkitError
from jitterkit.loci import Linear, Mvn
from jitterkit.scene import Binary
from jitterkit.trade import TradeScene
from jitterkit.trade.grid import without_noise
from jitterkit.trade.methods import Fitting, separations


@pytest.fixture(scope="module")
def anchored(plain, scene):
    return Fitting.anchored(FrameProcessor(plain, locus="mvn"), scene.reference).processor


@pytest.fixture(scope="module")
def exact(anchored, scene):
    """Frames without noise, first those that share their direction."""
    frames = zip(scene.plain, scene.images, strict=True)
    return [without_noise(anchored.calibrate(raw), image) for raw, image in frames]


@pytest.fixture(scope="module")
def wide(plain):
    """The same with so many pixels that a frame can repeat another, and a turned one."""
    telescope, pair = replace(plain, shape=(128, 128)), Binary(5.0, 0.0, 0.0, 0.0, plain.flux, 3.0)
    scene = TradeScene.of(telescope, pair, Mvn.of(0.2, 0.1, 20.0), 1, np.random.default_rng(5))
    anchored = Fitting.anchored(FrameProcessor(telescope, locus="mvn"), scene.reference).processor
    frames = zip(scene.plain, scene.images, strict=True)
    return anchored, [without_noise(anchored.calibrate(raw), image) for raw, image in frames]


@pytest.fixture(scope="module")
def refitted(anchored, exact):
    return separations("refit", anchored, exact)


@pytest.mark.slow
def test_without_noise_every_method_finds_the_separation(anchored, exact, refitted, scene):
    truth, sigma, alike = float(scene.truths[0].binary.separation), refitted[0, 1], exact[:3]
    assert refitted[:, 0] == pytest.approx(truth, abs=1e-3 * sigma)
    assert separations("joint", anchored, alike)[:, 0] == pytest.approx(truth, abs=1e-2 * sigma)
    assert separations("mtf", anchored, exact)[:, 0] == pytest.approx(truth, abs=0.05 * sigma)


@pytest.mark.slow
def test_a_step_from_another_frame_finds_the_separation(wide, refitted):
    """It is believed where less than 0.05 of an error is left; a search ends at 0.1."""
    anchored, frames = wide
    found = separations("score", anchored, frames[:1])
    assert found[0, 0] == pytest.approx(5.0, abs=0.05 * refitted[0, 1])
    assert np.isnan(found[0, 1])  # states none
    turned = separations("score", anchored, frames[1:])
    assert turned[0, 0] == pytest.approx(5.0, abs=0.1 * refitted[0, 1])


@pytest.mark.slow
def test_a_blur_that_is_no_normal_is_held_as_it_was_measured(plain):
    pair = Binary(5.0, 0.0, 0.0, 0.0, 1e6, 3.0)
    scene = TradeScene.of(plain, pair, Linear.of(1.0, 20.0), 1, np.random.default_rng(5))
    processor = FrameProcessor(plain, locus="linear")
    frame = without_noise(processor.calibrate(scene.plain[0]), scene.images[0])
    found, (fit,) = separations("mtf", processor, [frame]), separations("refit", processor, [frame])
    assert found[0, 0] == pytest.approx(5.0, abs=0.05 * fit[1])
    assert found[0, 1] < fit[1]


@pytest.mark.slow
def test_draws_have_the_mean_and_the_error_of_the_fit(anchored, exact, refitted):
    """Of 150 draws as good as 50 independent ones the mean scatters by 0.14, their spread by 0.1."""
    found = separations("sampling", anchored, exact[:2])
    off = (found[:, 0] - refitted[:2, 0]) / refitted[:2, 1]
    assert np.all(np.abs(off) < 3 * 0.14)
    assert off[0] != off[1]  # each frame has a chance of its own
    assert found[:, 1] == pytest.approx(refitted[:2, 1], rel=3 * 0.1)


@pytest.mark.slow
def test_a_blur_that_is_held_is_taken_for_known(anchored, exact, refitted):
    held = separations("mtf", anchored, exact)[:, 1] / refitted[:, 1]
    assert np.all((held > 0.9) & (held < 1.001))  # of three parameters fewer, which hardly matter


@pytest.mark.slow
def test_three_frames_whose_aberrations_vary_determine_together_what_they_do_alone(anchored, scene):
    frames = [anchored.calibrate(raw) for raw in scene.noisy]
    alone, together = (separations(how, replace(anchored, known={}), frames) for how in ("refit", "joint"))
    assert together[:, 1] == pytest.approx(np.sqrt(np.mean(alone[:, 1] ** 2)), rel=0.01)
    assert together[:, 0].mean() == pytest.approx(alone[:, 0].mean(), abs=0.1 * together[0, 1])


@pytest.mark.parametrize("method", ["score", "mtf", "refit", "joint", "sampling"])
def test_what_shows_no_pair_is_refused(anchored, scene, method):
    frame = anchored.calibrate(scene.noisy[0])
    blank = replace(frame, electrons=np.zeros(frame.shape))
    with refused(ErrorCode.NO_STAR, error=JitterkitError):
        separations(method, anchored, [blank])
