"""The store of compiled programs between runs: complete programs only, shared, and bounded."""

import os
import zlib

from compiled_programs import Store, machine

PROGRAM = zlib.compress(os.urandom(1000))


def _write(folder, name, content=PROGRAM):
    folder.mkdir(exist_ok=True)
    path = folder / f"{name}-cache"
    path.write_bytes(content)
    return path


def test_a_program_of_one_process_reaches_another(tmp_path):
    store = Store(tmp_path / "store", 10**6)
    _write(tmp_path / "one", "a")
    store.exchange(tmp_path / "one")
    Store(tmp_path / "store", 10**6).exchange(tmp_path / "two")
    assert (tmp_path / "two" / "a-cache").read_bytes() == PROGRAM


def test_half_a_program_stays_where_it_is(tmp_path):
    store = Store(tmp_path / "store", 10**6)
    half = _write(tmp_path / "one", "a", PROGRAM[:-5])
    store.exchange(tmp_path / "one")
    assert half.exists()
    assert not list(store.folder.iterdir())


def test_what_a_store_holds_is_not_replaced(tmp_path):
    store = Store(tmp_path / "store", 10**6)
    kept = _write(store.folder, "a")
    _write(tmp_path / "one", "a", zlib.compress(b"other"))
    store.exchange(tmp_path / "one")
    assert kept.read_bytes() == PROGRAM


def test_programs_are_copied_where_links_are_not_possible(tmp_path, monkeypatch):
    def refuse(source, target):
        raise PermissionError(1, "no links here")

    monkeypatch.setattr(os, "link", refuse)
    store = Store(tmp_path / "store", 10**6)
    _write(tmp_path / "one", "a")
    store.exchange(tmp_path / "one")
    assert [path.name for path in store.folder.iterdir()] == ["a-cache"]
    assert (store.folder / "a-cache").read_bytes() == PROGRAM


def test_the_oldest_programs_are_deleted_first(tmp_path):
    store = Store(tmp_path / "store", 2 * len(PROGRAM))
    for age, name in enumerate("abc"):
        os.utime(_write(store.folder, name), (1e9 - age, 1e9 - age))
    store.prune()
    assert sorted(path.name for path in store.folder.iterdir()) == ["a-cache", "b-cache"]


def test_the_name_of_a_machine_is_a_file_name_and_the_same_each_time():
    assert machine() == machine()
    assert "/" not in machine()
