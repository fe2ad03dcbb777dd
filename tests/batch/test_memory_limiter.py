"""When memory runs out: fewer frames at a time, and a row for one that even alone has none."""

import logging
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import jax.numpy as jnp
import numpy as np
import pytest
from jax.errors import JaxRuntimeError
from records import process_batches

from jitterkit.batch import FrameProcessor
from jitterkit.batch.memory import MemoryLimiter
from jitterkit.batch.plan import Batch, plan_batches
from jitterkit.batch.template_blur import TemplateBlurEstimator
from jitterkit.errors import ErrorCode, code_of, out_of_memory
from jitterkit.frames import RawFrame, write_fits
from jitterkit.run.estimate import estimate_files

FRAMES, GREEDY = 8, 3


def too_much():
    """Ask for a million times what a machine has, as a program does that is too large for its device."""
    return jnp.zeros(2**55, jnp.uint8).block_until_ready()


def test_what_jax_and_numpy_say_is_understood():
    for ask, kind in ((too_much, JaxRuntimeError), (lambda: np.zeros(2**55, np.uint8), MemoryError)):
        with pytest.raises(kind) as caught:
            ask()
        assert out_of_memory(caught.value)
        assert code_of(caught.value) is ErrorCode.OUT_OF_MEMORY
    assert not out_of_memory(ValueError("no"))
    assert code_of(ValueError("no")) is ErrorCode.INTERNAL


@pytest.fixture
def crowd():
    """Counts who is at work, and what the most were."""

    class Crowd:
        def __init__(self):
            self.lock, self.now, self.most = threading.Lock(), 0, []

        def __enter__(self):
            with self.lock:
                self.now += 1
                self.most.append(self.now)
                return self.now

        def __exit__(self, *_):
            with self.lock:
                self.now -= 1

    return Crowd()


@pytest.mark.parametrize("fits", [1, 2])
def test_fewer_work_at_a_time_after_memory_has_run_out(crowd, fits, caplog):
    limiter, together, waiting = MemoryLimiter(3), threading.Barrier(3), {0, 1, 2}

    def task(number):
        def work(alone):
            with crowd as here:
                if number in waiting:  # three at once, at least once
                    waiting.discard(number)
                    together.wait(10)
                    here = 3
                time.sleep(0.01)  # so that others come
                if max(here, crowd.now) > fits:
                    raise MemoryError
                return number

        return work

    with caplog.at_level(logging.WARNING), ThreadPoolExecutor(3) as pool:
        done = list(pool.map(limiter.run, map(task, range(30))))
    assert done == list(range(30))
    assert max(crowd.most[-20:]) <= fits
    assert caplog.records[-1].args == (fits,)


def test_one_that_has_no_memory_even_alone_takes_no_place_from_the_others(crowd):
    limiter, together = MemoryLimiter(2), threading.Barrier(2)

    def hopeless(alone):
        with crowd as here:
            assert here == 1 or not alone
            raise MemoryError

    with pytest.raises(MemoryError):
        limiter.run(hopeless)
    with ThreadPoolExecutor(2) as pool:
        list(pool.map(limiter.run, [lambda alone: together.wait(10)] * 2))  # which breaks if one has to wait


def test_an_error_that_is_not_for_want_of_memory_is_raised_at_once():
    calls = []

    def task(alone):
        calls.append(alone)
        raise ValueError("wrong")

    with pytest.raises(ValueError, match="wrong"):
        MemoryLimiter(2).run(task)
    assert calls == [False]


@pytest.fixture(scope="module")
def files(drawn, tmp_path_factory):
    directory, rng = tmp_path_factory.mktemp("frames"), np.random.default_rng(11)
    return [write_fits(directory / f"{n}.fits", drawn(rng).raw.data) for n in range(FRAMES)]


@pytest.fixture
def greedy(telescope, crowd):
    """A processor for which there is memory for one frame at a time, and none at all for one of them."""

    class Greedy(FrameProcessor):
        def estimate(self, frame, **options):
            with crowd as here:
                if here > 1 or frame.name == f"{GREEDY}.fits":
                    too_much()
                return super().estimate(frame, **options)

    return Greedy(telescope, locus="mvn")


@pytest.mark.slow
def test_a_frame_without_memory_is_a_row_and_the_others_are_fitted_as_ever(files, greedy, telescope):
    plan = [*plan_batches(files, [1] * FRAMES, FRAMES)]
    (done,) = process_batches(plan, greedy, threads=3)
    (sound,) = process_batches(plan, FrameProcessor(telescope, locus="mvn"), threads=3)
    for position, (row, expected) in enumerate(zip(done.rows, sound.rows, strict=True)):
        if position == GREEDY:
            assert (row["status"], row["reason"]) == ("failed", "out_of_memory")
        else:
            assert repr({**row, "seconds": 0}) == repr({**expected, "seconds": 0})


def test_an_estimate_without_memory_is_a_row_too(files, greedy):
    table = estimate_files(files[:5], TemplateBlurEstimator(greedy))
    assert list(table["status"]) == ["ok"] * GREEDY + ["failed"] + ["ok"] * (4 - GREEDY)
    assert list(table["reason"]) == [""] * GREEDY + ["out_of_memory"] + [""] * (4 - GREEDY)


@pytest.mark.slow
def test_a_frame_for_which_there_was_no_memory_as_it_was_read_is_calibrated_again(files, telescope):
    asked = set()

    class Late(FrameProcessor):
        def calibrate(self, raw):
            if raw.name not in asked or raw.name == f"{GREEDY}.fits":
                asked.add(raw.name)
                too_much()
            return super().calibrate(raw)

    (done,) = process_batches([Batch(0, tuple((path, 0) for path in files))], Late(telescope, locus="mvn"))
    expected = ["ok"] * FRAMES
    expected[GREEDY] = "failed"
    assert [row["status"] for row in done.rows] == expected
    assert done.rows[GREEDY]["reason"] == "out_of_memory"


def test_an_estimate_for_which_there_was_no_memory_as_its_frame_was_read_is_made_again(
    files, telescope, monkeypatch
):
    """Once for each frame to calibrate it, once more for its digest; and for one of them every time."""
    asked, digest = set(), RawFrame.digest.func

    def scarce(raw, what):
        if (raw.name, what) not in asked or raw.name == f"{GREEDY}.fits":
            asked.add((raw.name, what))
            too_much()

    def late_digest(raw):
        scarce(raw, "digest")
        return digest(raw)

    class Late(FrameProcessor):
        def calibrate(self, raw):
            scarce(raw, "calibrate")
            return super().calibrate(raw)

    monkeypatch.setattr(RawFrame, "digest", property(late_digest))
    table = estimate_files(files[:5], TemplateBlurEstimator(Late(telescope)))
    assert list(table["status"]) == ["ok"] * GREEDY + ["failed"] + ["ok"] * (4 - GREEDY)
    assert list(table["reason"]) == [""] * GREEDY + ["out_of_memory"] + [""] * (4 - GREEDY)
    assert len(asked) == 9  # of the one there is no digest either
