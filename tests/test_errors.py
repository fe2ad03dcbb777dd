"""Check that errors keep their code everywhere, and that the package makes none without a code."""

import ast
import pickle
from pathlib import Path

import pytest

import jitterkit
from jitterkit.errors import (
    ConfigurationError,
    ErrorCode,
    FrameError,
    JitterkitError,
    UndeterminedError,
    code_of,
    reading_code,
)

SOURCES = sorted(Path(jitterkit.__file__).parent.rglob("*.py"))
ERRORS = {kind.__name__ for kind in (ConfigurationError, FrameError, UndeterminedError, JitterkitError)}


@pytest.mark.parametrize("code", ErrorCode)
def test_a_code_is_its_lower_case_name_and_has_a_meaning(code):
    assert code.value == code.name.lower() == str(code)
    assert ErrorCode(code.value) is code
    assert code.meaning
    assert code.meaning != code.value
    assert pickle.loads(pickle.dumps(code)) is code


def test_no_two_codes_are_explained_alike():
    assert len({code.meaning for code in ErrorCode}) == len(ErrorCode)


@pytest.mark.parametrize("kind", [JitterkitError, ConfigurationError, UndeterminedError])
def test_an_error_says_its_message_and_is_a_value_error(kind):
    error = kind(ErrorCode.OUT_OF_RANGE, "gain = -1; give more than zero.")
    assert isinstance(error, ValueError)
    assert (error.code, str(error)) == (ErrorCode.OUT_OF_RANGE, "gain = -1; give more than zero.")


def test_a_frame_error_is_a_sentence_of_path_problem_and_remedy_that_a_terminal_cannot_obey():
    error = FrameError(ErrorCode.COLOUR, Path("night/a\x1b[2J.fits"), "has 3 channels", "convert it")
    assert str(error) == "night/a?[2J.fits: has 3 channels; convert it."
    assert error.path == Path("night/a\x1b[2J.fits")


@pytest.mark.parametrize(
    "error",
    [
        JitterkitError(ErrorCode.NO_DATA, "there is none."),
        ConfigurationError(ErrorCode.OUT_OF_RANGE, "gain = -1; give more."),
        UndeterminedError(ErrorCode.TOO_FEW_STARS, "2 stars; give 3."),
        FrameError(ErrorCode.TRUNCATED, "night/a.fits", "holds 12 of 2880 bytes", "copy it again"),
        FrameError(ErrorCode.NO_STAR, Path("b\x07.fits"), "holds no star", "expose longer"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_an_error_crosses_processes_whole(error):
    for protocol in range(2, pickle.HIGHEST_PROTOCOL + 1):
        again = pickle.loads(pickle.dumps(error, protocol))
        assert type(again) is type(error)
        assert again.code is error.code
        assert (str(again), again.args, vars(again)) == (str(error), error.args, vars(error))


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (FrameError(ErrorCode.TRUNCATED, "a.fits", "ends early", "copy it"), ErrorCode.TRUNCATED),
        (UndeterminedError(ErrorCode.NO_STAR, "no star."), ErrorCode.NO_STAR),
        (MemoryError("no room"), ErrorCode.OUT_OF_MEMORY),
        (ZeroDivisionError("division by zero"), ErrorCode.INTERNAL),
        (ValueError("not raised on purpose"), ErrorCode.INTERNAL),
        (KeyboardInterrupt(), ErrorCode.INTERNAL),
        (RuntimeError("RESOURCE_EXHAUSTED: Out of memory allocating 9 bytes."), ErrorCode.OUT_OF_MEMORY),
    ],
)
def test_every_exception_has_a_code(error, code):
    assert code_of(error) is code


def _is_code(given: ast.expr, makers: set[str]) -> bool:
    """Return whether an expression may be a code: a member, an error's code, one of two, or a call."""
    match given:
        case ast.Attribute(value=ast.Name(id="ErrorCode"), attr=name):
            return name in ErrorCode.__members__
        case ast.Attribute(attr="code") | ast.Name():
            return True
        case ast.IfExp(body=one, orelse=other):
            return _is_code(one, makers) and _is_code(other, makers)
        case ast.Call(func=ast.Name(id=name)):
            return name in makers
    return False


def _kinds(trees: list[ast.Module]) -> set[str]:
    """Return the names of all error classes, including those that a module derives for itself."""
    kinds = set(ERRORS)
    for node in (node for tree in trees for node in ast.walk(tree)):
        if isinstance(node, ast.ClassDef) and kinds & {ast.unparse(base) for base in node.bases}:
            kinds.add(node.name)
    return kinds


def _without_code(source: str, kinds: set[str] = ERRORS) -> list[int]:
    """Return the lines that make an error without a code as first argument, or without all arguments."""
    nodes = list(ast.walk(ast.parse(source)))
    made = [node for node in nodes if isinstance(node, ast.FunctionDef)]
    makers = {node.name for node in made if node.returns and ast.unparse(node.returns) == "ErrorCode"}
    calls = [node for node in nodes if isinstance(node, ast.Call)]
    errors = [node for node in calls if ast.unparse(node.func).rpartition(".")[2] in kinds]
    return [
        node.lineno
        for node in errors
        if len(node.args) != (4 if ast.unparse(node.func).endswith("FrameError") else 2)
        or not _is_code(node.args[0], makers | {"ErrorCode", "code_of", "reading_code", "damage_code"})
    ]


def test_every_error_that_the_package_makes_is_given_a_code():
    sources = {path: path.read_text(encoding="utf-8") for path in SOURCES}
    kinds = _kinds([ast.parse(source) for source in sources.values()])
    found = [f"{path}:{line}" for path, source in sources.items() for line in _without_code(source, kinds)]
    assert found == []


@pytest.mark.parametrize(
    ("made", "good"),
    [
        ("ConfigurationError(ErrorCode.OUT_OF_RANGE, text)", True),
        ("errors.FrameError(error.code, path, problem, remedy)", True),
        ("UndeterminedError(code, text)", True),
        ("JitterkitError(ErrorCode.NO_DATA if n else ErrorCode.TOO_FEW, text)", True),
        ("JitterkitError(ErrorCode(fit.reason), text)", True),
        ("JitterkitError(kind_of(error), text)", True),
        ("JitterkitError(sentence(error), text)", False),
        ("ConfigurationError(text)", False),
        ("ConfigurationError('a sentence.')", False),
        ("FrameError(path, problem, remedy)", False),
        ("FrameError(self.path, problem, remedy)", False),
        ("FrameError(code, path, problem, remedy)", True),
        ("ConfigurationError(f'{name} is wrong.', code)", False),
        ("UndeterminedError(ErrorCode.NO_SUCH_CODE, text)", False),
        ("JitterkitError()", False),
    ],
)
def test_the_search_finds_an_error_without_a_code(made, good):
    source = f"def kind_of(error) -> ErrorCode: ...\ndef sentence(error) -> str: ...\nraise {made}"
    assert _without_code(source) == ([] if good else [3])


@pytest.mark.parametrize(
    ("error", "code"),
    [
        (FileNotFoundError(2, "gone"), ErrorCode.NOT_FOUND),
        (NotADirectoryError(20, "a file on the way"), ErrorCode.NOT_FOUND),
        (PermissionError(13, "not yours"), ErrorCode.NOT_READABLE),
        (IsADirectoryError(21, "a directory"), ErrorCode.NOT_READABLE),
        (OSError(5, "disk"), ErrorCode.NOT_READABLE),
        (UnicodeDecodeError("utf-8", b"\xff", 0, 1, "no text"), ErrorCode.MALFORMED),
    ],
)
def test_what_happens_while_a_file_is_read_has_a_code(error, code):
    assert reading_code(error) is code


def test_the_caller_says_what_faulty_contents_are():
    assert reading_code(ValueError("no pickle"), ErrorCode.DAMAGED) is ErrorCode.DAMAGED
