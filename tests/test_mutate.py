"""``scripts/mutate`` edits what it means to and nothing else, and reads what pytest says of a mutant."""

import subprocess
from collections import Counter
from pathlib import Path

import mutate_tests
import mutate_trial
import pytest
from mutate_draw import Mutation, draw, find_sites, sites_of
from mutate_kinds import KINDS
from mutate_tests import Run, copy_tree, run_tests, stages
from mutate_trial import try_all

ROOT = Path(__file__).parents[1]

CASES = {
    "sign": {
        "a + b": ["a - b"],
        "a - (b)  # a - b": ["a + (b)  # a - b"],
        "σ = (a  # + not here\n     + b)": ["σ = (a  # + not here\n     - b)"],
        "total += part": ["total -= part"],
        "total -= part": ["total += part"],
        "f(-x)": ["f(x)"],
        "w = -2 * v": ["w = 2 * v"],
        "a[i + 1], b[-1], range(n - 1)": [],  # indices
        "f(axis=-1)": [],
        "(-x) ** 2, abs(-x)": [],  # even
        "i += 1": [],
        "name + 'x', [a] + b, set(a) - set(b)": [],  # no numbers
        "x + 1e-12, n // 2 + 1": [],  # a guard, a length
    },
    "factor of 2π": {
        "2 * np.pi * f": ["1 * np.pi * f", "1 * f"],
        "f / (2 * math.pi)": ["f / (1 * math.pi)", "f / (1)"],
        "-2j * jnp.pi * x": ["-1j * jnp.pi * x", "-1j * x"],
        "2 * np.pi**2 * w": ["2 * (np.pi / 2)**2 * w"],
        "rng.uniform(0, np.pi)": ["rng.uniform(0, (np.pi / 2))"],
        "phase + rng.uniform(0, 2 * np.pi)": [],
        "np.pi * x < 1": [],
    },
    "x for y": {
        "def f(x, y):\n    return x": ["def f(x, y):\n    return y"],
        "def f(x, ny):\n    return x, ny": [],
        "def f(x):\n    a = x\n    y = 1\n": [],  # y is bound too late
        "s.sxx + s.syy": ["s.syy + s.syy", "s.sxx + s.sxx"],
        "s.x": [],
        "ny, nx = a.shape": ["nx, ny = a.shape"],
        "f(fx, fy)": ["f(fy, fx)"],
        "hypot(x, y), f(name, value)": [],
        "np.cos(a)": ["np.sin(a)"],
        "a.shape[0]": ["a.shape[1]"],
        "a.shape[-1], a.shape[0] * a.shape[1]": [],
    },
    "unit": {
        "1e3 * size": ["1 * size", "1e6 * size"],
        "t / 3600": ["t / 1", "t / 60"],
        "L**2 / 12": ["L**2 / 1", "L**2 / 3"],
        "np.sqrt(12)": ["np.sqrt(1)", "np.sqrt(3)"],
        "a % 180.0": ["a % 360"],
        "{'ms': 1e-3}": ["{'ms': 1}", "{'ms': 1e-6}"],
        "np.radians(a + b)": ["np.degrees(a + b)", "(a + b)"],
        "s / ARCSEC": ["s / 1"],
        "x > 1e-3 * y, max(a, 1e-6 * b), rows[:12], n / 1000, {8: 60.0}": [],
        "slack = 1e-9 * span": [],
    },
    "comparison": {
        "a < b": ["a > b"],
        "0 <= i < n": ["0 >= i < n", "0 <= i > n"],
        "a == b": ["a != b"],
        "a and b and c": ["a or b and c", "a and b or c"],
        "not (a or b)": ["(a or b)", "not (a and b)"],
        "max(a, b)": ["min(a, b)"],
        "np.minimum(a, b)": ["np.maximum(a, b)"],
        "a is None, a in b": [],
    },
    "dropped mask": {
        "(a > 0) & (b > 0)": ["(a > 0)", "(b > 0)"],
        "a & b & c": ["a & c", "b & c", "(a & b)", "c"],
        "np.where(used, a / b, 0.0)": ["(a / b)"],
        "np.where(bad, 0.0, a)": ["a"],
        "np.where(x > 0, x, 1.0)": [],  # guards a division
        "np.where(used, f(np.where(used, a, 1.0)), 0.0)": ["f(np.where(used, a, 1.0))"],
        "a[mask]": ["a"],
        "a[a > 0]": ["a"],
        "a[~odd]": ["a", "a[odd]"],
        "a[used[0]], a[i], flags & 3, set(a) & names, going & (steps < most)": [],
    },
    "degrees of freedom": {
        "a.std(ddof=1)": ["a.std(ddof=0)"],
        "chi2 / (len(x) - 2)": ["chi2 / (len(x))"],
        "s / np.sqrt(2 * (count - 1))": ["s / np.sqrt(2 * (count))"],
        "s / max(n - 1, 1)": ["s / max(n, 1)"],
        "dof = fit.pixels - len(names)": ["dof = fit.pixels"],
        "chi2, freedom = total, len(t) - order - 1": ["chi2, freedom = total, (len(t) - order)"],
        "(n - 1) / 2, 2 * step / (n - 1) - 1, a[len(a) - 1], a.std(ddof=0)": [],
    },
}
"""By kind: a text, and every text that one mutation makes of it."""


def mutants(content, kind=None):
    """Return every text that a mutation makes of one."""
    found = [site for site in sites_of(content, "a.py") if kind in (None, site.kind)]
    return [Mutation(**vars(site) | {"new": new}).of(content) for site in found for new in site.new]


@pytest.mark.parametrize(("kind", "text"), [(kind, text) for kind, texts in CASES.items() for text in texts])
def test_a_kind_edits_its_sites_and_nothing_else(kind, text):
    assert sorted(one.decode() for one in mutants(text.encode(), kind)) == sorted(CASES[kind][text])


def test_texts_messages_annotations_and_decorators_stay():
    text = '''"""A - b, 2 * np.pi."""
__all__ = ["a" + "b"]

@decorated(-x, n < 1)
def f(a: Array[1 - n] = None) -> x < y:
    """Not - this."""
    value: Array[a - b]
    assert a < b, -c
    warnings.warn(f"{a - b}" if a < b else -c)
    if unread:
        raise ValueError(a - b)
    return f"{a - b:.3f}"
'''
    assert mutants(text.encode()) == []


@pytest.mark.parametrize("name", ["series/allan.py", "optics/otf.py", "frames/sky.py", "loci/base.py"])
def test_every_mutant_of_a_module_compiles_and_differs(name):
    content = (ROOT / "jitterkit" / name).read_bytes()
    made = mutants(content)
    assert len({site.kind for site in sites_of(content, name)}) >= 4
    assert content not in made
    for mutant in made:
        compile(mutant, name, "exec")


def test_a_diff_shows_the_changed_line():
    content = b"first\nsecond = a - b\nthird\n"
    (site,) = sites_of(content, "jitterkit/a.py")
    assert site.line == 2
    lines = Mutation(**vars(site) | {"new": "+"}).diff(content).splitlines()
    assert lines[-2:] == ["-second = a - b", "+second = a + b"]


@pytest.fixture
def sites():
    text = b"""
def f(x, y, n, mask):
    a = x + y
    b = 2 * np.pi * a
    c = np.degrees(b)
    d = max(c, a)
    e = d[mask]
    return e.std(ddof=1) - x
"""
    return [site for i in range(40) for site in sites_of(text, f"jitterkit/{i}.py")]


def test_a_draw_follows_from_its_seed_and_takes_kinds_alike(sites):
    drawn = draw(sites, 50, 29)
    assert drawn == draw(sites, 50, 29)
    assert drawn != draw(sites, 50, 30)
    assert len({(one.path, one.line) for one in drawn}) == 50
    assert sorted(Counter(one.kind for one in drawn).values()) == [7] * 6 + [8]
    assert max(Counter(one.path for one in drawn).values()) == 2
    assert list(dict.fromkeys(one.kind for one in drawn)) == list(KINDS)


def test_a_draw_ends_with_the_sites(sites):
    assert len(draw([site for site in sites if site.path == "jitterkit/3.py"], 50, 29)) == 2


def test_pictures_and_the_shell_are_left_out(tmp_path):
    for name in ("cli/main.py", "report/field_plots.py", "report/means.py", "loci/__init__.py", "scene.py"):
        path = tmp_path / "jitterkit" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text("a = b - c\n")
    assert [site.path for site in find_sites(tmp_path)] == ["jitterkit/report/means.py", "jitterkit/scene.py"]


@pytest.mark.parametrize(
    ("status", "output", "ended", "by"),
    [
        (0, "3 passed", "passed", ""),
        (5, "no tests ran", "passed", ""),
        (1, "F\nFAILED tests/a.py::test_b[1] - assert 1\n1 failed", "failed", "tests/a.py::test_b[1]"),
        (1, "E\nERROR tests/a.py::test_b - KeyError", "failed", "tests/a.py::test_b"),
        (2, "ERROR tests/a.py - NameError: x", "import", "tests/a.py"),
        (4, "ImportError while loading conftest", "import", "ImportError while loading conftest"),
        (-11, "Fatal Python error", "crash", "Fatal Python error"),
    ],
)
def test_what_pytest_says_is_read(status, output, ended, by):
    assert mutate_tests._judged(status, output, 1.0) == Run(ended, by, 1.0)


def test_a_run_without_end_is_killed(tmp_path):
    (tmp_path / "test_one.py").write_text("while True:\n    pass\n")
    run = run_tests(tmp_path, ("test_one.py",), 0.2)
    assert run.ended == "timeout"


MODULE, FOLDER = "jitterkit/series/one.py", "tests/series"


@pytest.fixture
def tree(tmp_path):
    """Return a git repository with files that are tracked, new, deleted and ignored."""
    for name, text in {
        "jitterkit/__init__.py": "",
        MODULE: "__all__ = ['f']\n\ndef f(a, b):\n    return a - b\n",
        "jitterkit/scene.py": "",
        "tests/series/test_one.py": "from jitterkit.series import f\n",
        "tests/series/test_two.py": "",
        "tests/forward/test_scene.py": "from jitterkit.scene import f\nfrom jitterkit.series import f\n",
        "gone.py": "",
        ".gitignore": "ignored.py\n",
        "ignored.py": "",
    }.items():
        path = tmp_path / "tree" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    for command in (["init", "-q"], ["add", "jitterkit", "gone.py"]):
        subprocess.run(["git", *command], cwd=tmp_path / "tree", check=True)
    (tmp_path / "tree/gone.py").unlink()
    return tmp_path / "tree"


def test_a_copy_holds_what_is_not_ignored(tree, tmp_path):
    copy_tree(tree, tmp_path / "copy")
    before, copied = (
        {path.relative_to(root).as_posix() for path in root.rglob("*.py")}
        for root in (tree, tmp_path / "copy")
    )
    assert before - copied == {"ignored.py"}
    assert len(copied) == 6
    assert (tmp_path / "copy" / MODULE).read_bytes() == (tree / MODULE).read_bytes()


def test_the_tests_of_a_module_go_from_near_to_far(tree):
    near = (MODULE, "tests/series/test_one.py")
    assert stages(tree, MODULE) == [near, (FOLDER,)]
    assert stages(tree, MODULE, wide=True) == [near, (FOLDER,), ("tests/forward",)]
    near = ("jitterkit/scene.py", "tests/forward/test_scene.py")
    assert stages(tree, "jitterkit/scene.py") == [near, ("tests/forward",)]


@pytest.mark.parametrize("case", ["caught", "survived", "broken"])
def test_a_mutant_is_run_in_a_copy_after_the_tests_pass_without_it(tree, monkeypatch, case):
    seen = []

    def run(copy, tests, limit):
        is_whole = "a - b" in (copy / MODULE).read_text()
        seen.append((tests[0], is_whole))
        fails = case == "broken" or (case == "caught" and not is_whole)
        return Run("failed", "tests/a.py::test_b", 1.0) if fails else Run("passed", "", 1.0)

    monkeypatch.setattr(mutate_trial, "run_tests", run)
    monkeypatch.setattr(mutate_trial, "check_import", lambda copy: None)
    content = (tree / MODULE).read_bytes()
    ((number, outcome),) = try_all(tree, {7: draw(sites_of(content, MODULE), 1, 0)[0]}, 1, 10.0, False)
    assert number == 7
    assert outcome.is_caught == (case == "caught")
    assert outcome.result == ("failed" if case == "caught" else case)
    runs = {"caught": 2, "survived": 4, "broken": 1}[case]
    assert seen == [(MODULE, True), (MODULE, False), (FOLDER, True), (FOLDER, False)][:runs]
    assert (tree / MODULE).read_bytes() == content
