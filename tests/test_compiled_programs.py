"""Check that the store keeps only complete programs, shares them between runs, and limits their size."""

import os
import subprocess
import sys
import zlib
from pathlib import Path

import compiled_programs
import jax
import pytest
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


COMPILE = """
import sys
from pathlib import Path
{use}
import jax
{configure}
jax.jit(lambda x: x + 1)(2.0)
"""


@pytest.mark.parametrize("kind", ["test", "command"])
def test_a_program_has_the_same_name_whatever_the_folder(kind, tmp_path):
    """Tests call ``use``; commands that they start set the folder as every command does."""
    parts = {"use": "", "configure": "from jitterkit.cli.runtime import prepare_jax; prepare_jax()"}
    if kind == "test":
        parts = {"use": "import compiled_programs", "configure": "compiled_programs.use(Path(sys.argv[1]))"}
    names = []
    for position in (tmp_path / "one" / "compiled", tmp_path / "two" / "compiled"):
        position.mkdir(parents=True)
        env = os.environ | {
            "PYTHONPATH": str(Path(compiled_programs.__file__).parent),
            "JITTERKIT_CACHE": str(position.parent),
        }
        subprocess.run([sys.executable, "-c", COMPILE.format(**parts), str(position)], env=env, check=True)
        names.append({path.name for path in position.iterdir() if path.name.endswith("-cache")})
    assert names[0] == names[1] != set()


@pytest.mark.parametrize("given", ["", "--xla_cpu_enable_fast_math=false"])
def test_a_command_compiles_quickly_unless_the_environment_says_how(given):
    """XLA would end the process if it did not know an option."""
    code = COMPILE.format(use="", configure="from jitterkit.cli.runtime import prepare_jax; prepare_jax()")
    code += "import os; print(os.environ['XLA_FLAGS'])"
    run = [sys.executable, "-c", code]
    told = subprocess.run(
        run, env=os.environ | {"XLA_FLAGS": given}, check=True, capture_output=True, text=True
    )
    assert told.stdout.strip() == given or (not given and "--xla_" in told.stdout)


def test_an_incomplete_program_is_published_once_it_is_complete(tmp_path):
    store = Store(tmp_path / "store", 10**6)
    _write(tmp_path / "one", "a", PROGRAM[:-5])
    store.exchange(tmp_path / "one")
    assert not list(store.folder.iterdir())
    _write(tmp_path / "one", "a")
    store.exchange(tmp_path / "one")
    assert (store.folder / "a-cache").read_bytes() == PROGRAM


def test_an_incomplete_program_in_the_store_is_deleted_and_replaced(tmp_path):
    store = Store(tmp_path / "store", 10**6)
    _write(store.folder, "a", PROGRAM[:-5])
    store.exchange(tmp_path / "one")
    assert not list(store.folder.iterdir())
    assert not list((tmp_path / "one").iterdir())
    _write(tmp_path / "one", "a")
    store.exchange(tmp_path / "one")
    assert (store.folder / "a-cache").read_bytes() == PROGRAM


def test_a_part_of_a_program_is_no_program(tmp_path):
    store = Store(tmp_path / "store", 10**6)
    (store.folder / "a-cache.123.part").write_bytes(PROGRAM[:5])
    store.exchange(tmp_path / "one")
    assert not list((tmp_path / "one").iterdir())


def test_a_change_of_a_fetched_copy_does_not_reach_the_store(tmp_path):
    """As when another process of the same folder begins to write what was fetched meanwhile."""
    store = Store(tmp_path / "store", 10**6)
    _write(store.folder, "a")
    store.exchange(tmp_path / "one")
    (tmp_path / "one" / "a-cache").write_bytes(b"")
    assert (store.folder / "a-cache").read_bytes() == PROGRAM


def test_the_oldest_programs_are_deleted_first_whatever_their_version(tmp_path):
    store = Store(tmp_path / "jax-2", 2 * len(PROGRAM))
    for age, name in enumerate("abc"):
        os.utime(_write(store.folder, name), (1e9 - age, 1e9 - age))
    os.utime(_write(tmp_path / "jax-1", "d"), (1e9 - 0.5, 1e9 - 0.5))
    store.prune()
    assert sorted(path.name for path in tmp_path.glob("*/*")) == ["a-cache", "d-cache"]


def test_the_name_of_a_machine_is_a_file_name_and_the_same_each_time():
    assert machine() == machine()
    assert "/" not in machine()


def test_the_processes_of_a_session_share_a_store_and_have_caches_of_their_own():
    own = Path(os.environ["JITTERKIT_CACHE"])
    assert own not in Path(os.environ["JITTERKIT_TEST_CACHE"]).parents
    assert jax.config.jax_compilation_cache_dir == str(own / "compiled")
