"""Workers of dask.distributed, one of which is killed by a frame, against one process."""

import contextlib
import os
import signal
import sys
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from records import process_batches
from refusals import refused

from jitterkit.batch import FrameProcessor, cluster
from jitterkit.batch.cluster import connected, execute_on_cluster
from jitterkit.batch.executor import execute
from jitterkit.batch.plan import plan_batches
from jitterkit.batch.ranking import TOP
from jitterkit.batch.worker import WorkerSetup
from jitterkit.errors import ErrorCode
from jitterkit.frames import write_fits
from jitterkit.run import process_files

distributed = pytest.importorskip("distributed")
cloudpickle = pytest.importorskip("cloudpickle")

SIZE, FRAMES, DEADLY = 8, 16, 12
"""Of a batch, of the night; and the place of the frame that kills."""


@pytest.fixture(scope="module")
def night(telescope, drawn_by, tmp_path_factory):
    """Sixteen frames; one is damaged and one is about to be deadly."""
    directory, rng = tmp_path_factory.mktemp("night"), np.random.default_rng(11)
    for number in range(FRAMES):
        name = f"{number:02d}{'-deadly' * (number == DEADLY)}.fits"
        image = drawn_by(telescope, rng, aberrations=[15.0, -6.0]).raw.data
        path = write_fits(directory / name, image.astype(np.float32))
        if number == 5:
            path.write_bytes(path.read_bytes()[:-3000])
    return sorted(directory.iterdir())


@pytest.fixture(scope="module")
def processor(telescope):
    return FrameProcessor(telescope, locus="mvn")


def done(night, processor, executor):
    """What becomes of each batch, by its number; one picture is left to be drawn, the worst."""
    ranks = [(True, -1e9, -1, position) for position in range(TOP - 1)]
    batches = plan_batches(night, [1] * FRAMES, SIZE)
    return {
        part.batch.number: part
        for part in process_batches(batches, processor, ranks=ranks, executor=executor)
    }


@pytest.fixture(scope="module")
def alone(night, processor):
    return done(night, processor, partial(execute, threads=1))


class Armed(distributed.WorkerPlugin):
    """Makes a worker die of opening a file that is called deadly."""

    def setup(self, worker):
        import os
        import signal

        from jitterkit.batch import plan

        sound = plan.open_frames

        def opened(path, **options):
            if "deadly" in path.name:
                os.kill(os.getpid(), signal.SIGKILL)
            return sound(path, **options)

        plan.open_frames = opened


@pytest.fixture(scope="module")
def spread(night, processor, alone):
    """The same by a worker that is killed, and again, and again."""
    with connected(workers=1) as client:
        cloudpickle.register_pickle_by_value(sys.modules[__name__])  # which workers cannot import
        client.register_plugin(Armed())
        cloudpickle.unregister_pickle_by_value(sys.modules[__name__])
        return done(night, processor, partial(execute_on_cluster, client=client))


def exactly(parts):
    """Rows by file, every number to the last bit, NaN too, but for the time that a frame took."""
    rows = (row for number in sorted(parts) for row in parts[number].rows)
    return {row["file"]: repr({**row, "seconds": 0.0}) for row in rows}


@pytest.mark.slow
def test_workers_give_what_one_process_gives_to_the_last_digit(alone, spread, night):
    expected, found = exactly(alone), exactly(spread)
    assert list(found) == list(expected) == [path.name for path in night]
    other = [name for name in found if found[name] != expected[name]]
    assert other == [night[DEADLY].name]
    assert sum("'status': 'ok'" in row for row in found.values()) == FRAMES - 2


@pytest.mark.slow
def test_a_frame_that_kills_its_worker_has_a_row_that_says_so(spread, night):
    row = spread[DEADLY // SIZE].rows[DEADLY % SIZE]
    assert (row["path"], row["frame"], row["status"]) == (str(night[DEADLY]), 0, "failed")
    assert row["reason"] == "worker_lost"
    assert np.isnan(row["separation"])


@pytest.mark.slow
def test_pictures_come_back_with_the_rows(alone, spread):
    assert list(spread[0].pictures) == list(alone[0].pictures)
    name = next(iter(alone[0].pictures))
    assert spread[0].pictures[name] == alone[0].pictures[name]


@pytest.mark.slow
def test_the_stack_of_a_batch_is_that_of_one_process_to_the_last_bit(alone, spread):
    there, here = ({name: one.pack() for name, one in done[0].stacks.items()} for done in (spread, alone))
    assert here
    assert there == here


def test_a_run_takes_what_workers_give_in_any_order(night, processor, alone, tmp_path, monkeypatch):
    def backwards(batches, processor, finish, *, hdu):
        return [alone[batch.number] for batch in reversed(list(batches))]

    monkeypatch.setattr("jitterkit.run.process.batch_size", lambda shape: SIZE)
    run = process_files(night, tmp_path / "out", processor, executor=backwards)
    assert list(run.table["file"]) == [path.name for path in night]
    assert run.summary["fit"]["stack_frames"] == run.summary["status"]["ok"]


@pytest.mark.slow
def test_a_worker_is_replaced_however_often_it_dies():
    with connected(workers=1) as client:
        end = time.monotonic() + 17  # dask gives up a worker that is not there 15 s after an earlier death
        while time.monotonic() < end:
            with pytest.raises(distributed.KilledWorker):
                client.submit(signal.raise_signal, signal.SIGKILL, pure=False).result()
        assert client.submit(os.getpid).result() != os.getpid()


def test_a_scheduler_that_does_not_answer_is_reported(monkeypatch):
    monkeypatch.setattr(cluster, "_REACHED", 0.5)
    with (
        refused(ErrorCode.UNREACHABLE, "tcp://127.0.0.1:9"),
        connected(scheduler="tcp://127.0.0.1:9"),
    ):
        pass


def test_a_scheduler_without_workers_is_reported(monkeypatch):
    monkeypatch.setattr(cluster, "_JOINED", 0.2)
    empty = distributed.LocalCluster(n_workers=0, processes=False, dashboard_address=None)
    with (
        contextlib.closing(empty),
        refused(ErrorCode.UNREACHABLE, f"'dask worker {empty.scheduler_address}"),
        connected(scheduler=empty.scheduler_address),
    ):
        pass


def test_without_dask_the_remedy_is_reported(monkeypatch):
    monkeypatch.setattr(cluster, "distributed", None)
    with refused(ErrorCode.MISSING_PACKAGE, "jitterkit[cluster]"), connected(workers=2):
        pass


@pytest.fixture
def setup(processor, night):
    return WorkerSetup(processor, None, night[0])


@pytest.fixture
def far(monkeypatch):
    """A worker of three threads, as far as its setup asks it; what it sets does not outlast the test."""
    for name in ("NPROC", "XLA_PYTHON_CLIENT_PREALLOCATE"):
        monkeypatch.setenv(name, "")  # noted, to be put back
        monkeypatch.delenv(name)
    return SimpleNamespace(address="tcp://far:1", state=SimpleNamespace(nthreads=3))


def test_threads_of_a_worker_need_not_wait_for_each_other(setup, far):
    setup.setup(far)
    assert os.environ["NPROC"] == "3"


def test_what_a_worker_has_set_itself_is_kept(setup, far, monkeypatch):
    monkeypatch.setenv("NPROC", "2")
    setup.setup(far)
    assert os.environ["NPROC"] == "2"


def test_a_worker_that_does_not_see_the_files_is_reported(setup, far, tmp_path):
    setup.probe = tmp_path / "elsewhere.fits"
    with refused(ErrorCode.NOT_FOUND, far.address, setup.probe):
        setup.setup(far)


def test_a_worker_of_another_version_is_reported(setup, far):
    setup.computed["numpy"] = "1.0"
    with refused(ErrorCode.CONFLICT, far.address, f"numpy {np.__version__}", "1.0"):
        setup.setup(far)


@pytest.mark.parametrize(
    ("error", "gone"),
    [
        (distributed.scheduler.NoValidWorkerError("task", set(), set(), set(), 120.0), "worker"),
        (distributed.scheduler.NoWorkerError("task", 120.0), "worker"),
        (distributed.client.FutureCancelledError("task", "scheduler-connection-lost"), "scheduler"),
    ],
    ids=["restrictions", "workers", "scheduler"],
)
def test_where_nothing_is_left_to_work_the_run_ends_with_a_sentence(error, gone):
    def result():
        raise error

    with refused(ErrorCode.WORKER_LOST, gone, "--resume"):
        cluster._Scheduler(client=None, name="any", finish=list)._result(SimpleNamespace(result=result))


def test_workers_that_die_whatever_they_do_end_the_run():
    def result():
        raise distributed.KilledWorker("task", None, 0)

    one = cluster._Scheduler(client=None, name="any", finish=list)
    killing = SimpleNamespace(result=result)
    assert [one._result(killing) for _ in range(cluster._MOST_DEATHS - 1)] == [None] * 7
    with refused(ErrorCode.WORKER_LOST, 8):
        one._result(killing)
