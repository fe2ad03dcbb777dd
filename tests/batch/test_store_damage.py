"""Files in a store's place that are none, or no longer."""

import sqlite3

import numpy as np
import pytest
from refusals import refused

from jitterkit.batch.store import STORE, Store
from jitterkit.errors import ConfigurationError, ErrorCode

CONFIGURATION = {"size": 5}
SUMS = np.random.default_rng(1).bytes(20_000)


def rows_of(batch):
    rng = np.random.default_rng(batch)
    return [
        {
            "file": f"{batch}.fits",
            "frame": position,
            "status": str(rng.choice(["ok", "ok", "no_star"])),
            "chi2_dof": float(rng.choice([rng.random(), np.nan])),
            "separation": float(rng.normal(10, 1e-6)),
            "separation_err": float(rng.random()),
        }
        for position in range(5)
    ]


@pytest.fixture
def filled(tmp_path):
    """A closed store of forty batches."""
    with Store.create(tmp_path, CONFIGURATION) as store:
        for batch in range(40):
            store.add(batch, rows_of(batch), stacks={"binary": SUMS})
    return tmp_path / STORE


def test_a_file_that_is_no_database_is_refused_and_left_alone(tmp_path):
    (tmp_path / STORE).write_text("my notes, " * 1000)
    for prepare_run in (Store.resume, Store.create):
        with refused(ErrorCode.DAMAGED, tmp_path / STORE):
            prepare_run(tmp_path, CONFIGURATION)
    assert (tmp_path / STORE).read_text() == "my notes, " * 1000


def test_another_programs_database_is_refused_and_left_alone(tmp_path):
    other = sqlite3.connect(tmp_path / STORE)
    other.execute("CREATE TABLE run (mine)")
    other.close()
    before = (tmp_path / STORE).read_bytes()
    with refused(ErrorCode.UNKNOWN_FORMAT, tmp_path / STORE):
        Store.create(tmp_path, CONFIGURATION, overwrite=True)
    assert (tmp_path / STORE).read_bytes() == before


def test_a_ledger_of_another_format_is_refused(filled):
    other = sqlite3.connect(filled)
    other.execute("PRAGMA user_version = 99")
    other.close()
    with refused(ErrorCode.UNSUPPORTED, filled, "99, not 4"):
        Store.resume(filled.parent, CONFIGURATION)


def test_a_ledger_cut_short_is_refused(filled):
    filled.write_bytes(filled.read_bytes()[:-5000])
    with refused(ErrorCode.DAMAGED, filled):
        Store.resume(filled.parent, CONFIGURATION)


def test_damage_anywhere_is_reported_or_does_no_harm(filled):
    rng = np.random.default_rng(4)
    whole, rows = filled.read_bytes(), [one for batch in range(40) for one in rows_of(batch)]
    told = 0
    for position in rng.integers(100, len(whole) - 64, 150):
        filled.write_bytes(whole[:position] + rng.bytes(64) + whole[position + 64 :])
        try:
            with Store.resume(filled.parent, CONFIGURATION) as store:
                assert repr(list(store.rows())) == repr(rows)
                assert store.stacks() == {"binary": SUMS}
        except ConfigurationError as error:
            assert error.code in (ErrorCode.DAMAGED, ErrorCode.CONFLICT)  # noqa: PT017
            assert str(filled.parent) in str(error)  # noqa: PT017
            told += 1
    assert told > 50
