"""Frames of a run that decide their scene together."""

import math
from dataclasses import replace

import numpy as np
import pytest

from jitterkit.batch import steps
from jitterkit.batch.plan import Batch
from jitterkit.batch.warm_start import from_searched_frames
from jitterkit.frames import write_fits
from jitterkit.loci import Stable
from jitterkit.refit.scene_choice import SceneChoice, SceneEvidence
from jitterkit.scene import Binary
from jitterkit.simulate import simulate_frame

PAIR = Binary(3.0, 30.0, 1.0, -2.0, 1.2e5, 2.0)


@pytest.fixture
def hesitant(telescope, rng, tmp_path, monkeypatch):
    """A batch of four frames of a pair, each of which says that it leaves that open."""
    choose = steps.choose_scene
    covariance = np.diag([0.05, 6.0, 0.25]) ** 2
    told = SceneEvidence(0.0, 13.0, -0.2, math.log(0.05), np.array([3.0, 30.0, 2.0]), covariance)

    def hesitate(*given, **options):
        found = choose(*given, **options)
        return replace(found, log_odds=1.0, readings="one star, or two", evidence=told)

    monkeypatch.setattr(steps, "choose_scene", hesitate)
    items = []
    for number in range(4):
        path, simulated = tmp_path / f"{number}.fits", simulate_frame(telescope, PAIR, Stable.of(), rng=rng)
        write_fits(path, simulated.raw.data)
        items.append((path, 0))
    return Batch(0, tuple(items), tuple(items), scene_only=True)


def test_few_frames_that_do_not_decide_alone_make_no_pair_together(hesitant, processor, telescope, rng):
    known = processor.for_batch(hesitant).known
    (shown,) = known.values()
    assert (shown.scene, len(shown.choices)) == ("auto", 4)
    assert shown.reference is None  # so few are not registered
    raw = simulate_frame(telescope, PAIR, Stable.of(), rng=rng).raw
    assert processor.process(raw).result.status.name == "UNDETERMINED"
    assert processor.with_warm_starts(known).process(raw).result.status.name == "UNDETERMINED"


def test_frames_that_disagree_about_the_pair_show_one_star(hesitant, processor):
    angles, choose = iter((30.0, 80.0, 130.0, 200.0)), processor.choose_scene

    def turned(frame):
        found = choose(frame)
        told = replace(found.evidence, values=np.array([3.0, next(angles), 2.0]))
        return replace(found, evidence=told)

    processor.choose_scene = turned
    (shown,) = processor.for_batch(hesitant).known.values()
    assert shown.scene == "star"


def test_a_run_is_as_a_frame_that_is_clear_says_if_there_is_one():
    pairs = [SceneChoice(None, 5.0, "one, or two", alike) for alike in (True, True, False)]
    for searched, position in ((pairs[:2], 0), (pairs, 2)):
        found = from_searched_frames(list(enumerate(searched)), lambda frame, choice: (frame, choice), False)
        assert found == (position, searched[position])
