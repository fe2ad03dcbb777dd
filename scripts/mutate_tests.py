"""Choose the tests of a module, and run tests in a copy of the tree.

Reach for :func:`stages` and :func:`run_tests`.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import dataclass
from pathlib import Path, PurePosixPath

__all__ = ["Run", "check_import", "copy_tree", "environment", "run_tests", "stages"]

_FOLDERS = {
    "scene": ("forward",),
    "shutter": ("forward",),
    "scoring": ("likelihood", "refit", "estimators"),
    "kernel_estimate": ("estimators",),
}
"""Test folders of the modules that have no test folder of their own name."""

_REPORTED = re.compile(r"^(?:FAILED|ERROR) (.+?)(?: - .*)?$", re.MULTILINE)
_NO_TESTS = 5
"""Exit status of pytest if it finds no tests."""


@dataclass(frozen=True)
class Run:
    """Result of a run of tests.

    Attributes
    ----------
    ended : {"passed", "failed", "import", "timeout", "crash"}
    by : str
        The first test that did not pass, or the file that could not be imported; otherwise empty.
    seconds : float
    """

    ended: str
    by: str
    seconds: float


def stages(root: Path, module: str, wide: bool = False) -> list[tuple[str, ...]]:
    """Return the tests of a module in sets, the most direct set first.

    Parameters
    ----------
    root : Path
        Root of the tree.
    module : str
        Path of the module from the root, with slashes.
    wide : bool, optional
        Add the two other test folders that import the module's subpackage most often.

    Returns
    -------
    stages : list of tuple of str
        Paths for pytest.  The first set is the module itself, for its doctests, with the test files that are
        named after it or import it by name; if there are none, with those that mention a public function or
        class of it.
        The second set is the test folder of its subpackage.
    """
    path = PurePosixPath(module)
    package = path.parts[1].removesuffix(".py")
    imported = _importing(root, package)
    if (root / "tests" / package).is_dir():
        folders: tuple[str, ...] = (package,)
    else:
        folders = _FOLDERS.get(package, tuple(name for name, _ in imported.most_common(1)))
    files = [file for folder in folders for file in sorted((root / "tests" / folder).rglob("test_*.py"))]
    near = [file for file in files if _is_named_after(file, path) or _imports(file, path)]
    near += [file for file in sorted((root / "tests").glob("test_*.py")) if _is_named_after(file, path)]
    near = near or [file for file in files if _mentions(file, root / module)]
    found = [(module, *(file.relative_to(root).as_posix() for file in near))]
    found.append(tuple(f"tests/{folder}" for folder in folders))
    if wide:
        others = [name for name, _ in imported.most_common() if name not in folders]
        found.append(tuple(f"tests/{name}" for name in others[:2]))
    return [stage for stage in found if stage]


def _is_named_after(file: Path, module: PurePosixPath) -> bool:
    return file.name.startswith(f"test_{module.stem}")


def _imports(file: Path, module: PurePosixPath) -> bool:
    dotted = re.escape(".".join(module.with_suffix("").parts))
    return bool(re.search(rf"^\s*(?:from|import) {dotted}\b", file.read_text(encoding="utf-8"), re.MULTILINE))


def _mentions(file: Path, module: Path) -> bool:
    names = re.findall(r"^(?:def|class) ([A-Za-z]\w*)", module.read_text(encoding="utf-8"), re.MULTILINE)
    return bool(set(names) & set(re.findall(r"\w+", file.read_text(encoding="utf-8"))))


def _importing(root: Path, package: str) -> Counter[str]:
    """Count the imports of a subpackage by folder of tests."""
    counts: Counter[str] = Counter()
    for file in sorted((root / "tests").glob("*/*.py")):
        text = file.read_text(encoding="utf-8")
        counts[file.parent.name] += len(
            re.findall(rf"^\s*(?:from|import) jitterkit\.{package}\b", text, re.M)
        )
    return +counts


def copy_tree(root: Path, target: Path) -> None:
    """Copy the tracked files in their current state, and the untracked files that git does not ignore."""
    command = ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"]
    listed = subprocess.run(command, cwd=root, capture_output=True, check=True).stdout.decode()
    for name in filter(None, listed.split("\0")):
        if (root / name).is_file():
            (target / name).parent.mkdir(parents=True, exist_ok=True)
            (target / name).write_bytes((root / name).read_bytes())
            (target / name).chmod((root / name).stat().st_mode)


def environment(copy: Path) -> dict[str, str]:
    """Return variables with which tests, and the processes they start, import jitterkit from the copy."""
    paths = [str(copy), *filter(None, [os.environ.get("PYTHONPATH")])]
    programs = os.environ.get("JITTERKIT_TEST_CACHE", str(copy.parent / "programs"))
    return os.environ | {"PYTHONPATH": os.pathsep.join(paths), "JITTERKIT_TEST_CACHE": programs}


def check_import(copy: Path) -> None:
    """Raise an error if Python would not import jitterkit from the copy.

    Raises
    ------
    SystemExit
        If it would not; the message names the file that would be imported.
    """
    command = [sys.executable, "-c", "import jitterkit; print(jitterkit.__file__)"]
    done = subprocess.run(
        command, cwd=copy.parent, env=environment(copy), capture_output=True, text=True, check=False
    )
    file = Path(done.stdout.strip() or "nothing")
    if not file.resolve().is_relative_to(copy.resolve()):
        raise SystemExit(f"import jitterkit gives {file}, not the copy in {copy}. {done.stderr.strip()}")


def run_tests(copy: Path, tests: tuple[str, ...], limit: float) -> Run:
    """Run tests of a copy until one fails.

    Parameters
    ----------
    copy : Path
        Root of a copy of the tree.
    tests : tuple of str
        Paths from that root.
    limit : float
        Seconds after which the run, with all processes that it started, is killed.

    Returns
    -------
    run : Run
    """
    command = [sys.executable, "-m", "pytest", "-x", "-q", "--tb=no", "-p", "no:cacheprovider", *tests]
    began = time.perf_counter()
    process = subprocess.Popen(
        command,
        cwd=copy,
        env=environment(copy),
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    try:
        output, _ = process.communicate(timeout=limit)
    except subprocess.TimeoutExpired:
        return Run("timeout", "", time.perf_counter() - began)
    finally:
        if process.poll() is None:
            os.killpg(process.pid, signal.SIGKILL)
            process.communicate()
    return _judged(process.returncode, output, time.perf_counter() - began)


def _judged(status: int, output: str, seconds: float) -> Run:
    if status in (0, _NO_TESTS):
        return Run("passed", "", seconds)
    found = _REPORTED.search(output)
    by = found[1] if found else (output.strip().splitlines() or [""])[-1]
    if status < 0:
        return Run("crash", by, seconds)
    return Run("failed" if found and "::" in by else "import", by, seconds)
