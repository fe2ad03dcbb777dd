"""Define the errors that a user can correct, with a code for the kind of each error.

Two rules hold everywhere in jitterkit:

* A *bad argument* raises an exception.  Its message is one full sentence that names the value
  received and what would have been accepted.
* A *bad frame* becomes a row with a status, and the other frames are not affected.  The reader
  raises :class:`FrameError`; only the batch catches it.

Every exception that jitterkit raises deliberately derives from :class:`JitterkitError` and carries an
:class:`ErrorCode`.  Programs should compare the code, because the wording of messages may change.
"""

from __future__ import annotations

import enum
import math
from collections.abc import Collection, Iterable
from difflib import get_close_matches
from pathlib import Path


class ErrorCode(enum.StrEnum):
    """Kind of an error.

    Results tables hold the value in their column ``reason``; ``meaning`` explains it in one line.
    """

    meaning: str

    def __new__(cls, value: str, meaning: str = "") -> ErrorCode:
        """Make a member from its value and meaning."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.meaning = meaning
        return member

    # values, names and settings
    WRONG_TYPE = "wrong_type", "a value does not have the required type"
    OUT_OF_RANGE = "out_of_range", "a number is outside its range, or not finite"
    WRONG_SHAPE = "wrong_shape", "an array does not have the required shape"
    UNKNOWN_NAME = "unknown_name", "a name, key or option does not exist"
    UNKNOWN_UNIT = "unknown_unit", "a unit is unknown, or has the wrong dimension"
    MISSING_VALUE = "missing_value", "a required value is neither given nor known"
    CONFLICT = "conflict", "two settings or inputs cannot be combined"
    DUPLICATE = "duplicate", "something that must be unique is given twice"
    TOO_FEW = "too_few", "there are fewer data than the method needs"
    TOO_MANY = "too_many", "there are more data than the method accepts"
    UNSUPPORTED = "unsupported", "the method does not apply to this kind of input"
    SAMPLING = "sampling", "a sampling is too coarse, or an extent too small, for an exact computation"
    MALFORMED = "malformed", "a text, table or settings file does not follow its format"
    MISSING_PACKAGE = "missing_package", "an optional package is not installed"
    # files and directories
    NOT_FOUND = "not_found", "a file or directory does not exist"
    EXISTS = "exists", "a file exists already and must not be replaced"
    NOT_READABLE = "not_readable", "a file or directory cannot be opened for reading"
    NOT_WRITABLE = "not_writable", "a file or directory cannot be written"
    LOCKED = "locked", "another process has locked a file"
    UNREACHABLE = "unreachable", "a scheduler does not answer, or has no workers"
    WRONG_SUFFIX = "wrong_suffix", "a file's name does not end as its format requires"
    # contents of image files
    UNKNOWN_FORMAT = "unknown_format", "a file is neither FITS nor TIFF"
    DAMAGED = "damaged", "the contents of a file are inconsistent"
    TRUNCATED = "truncated", "a file ends before its data do"
    CHANGED = "changed", "a file changed while it was read, or afterwards"
    NO_IMAGE = "no_image", "a file holds no image, or not the requested one"
    COLOUR = "colour", "an image has colour channels"
    UNSUPPORTED_ENCODING = "unsupported_encoding", "pixels are stored in an encoding that is not supported"
    TOO_LARGE = "too_large", "an image declares more pixels than jitterkit reads"
    # what an image shows
    NO_DATA = "no_data", "no usable pixel, or too few"
    NO_SIGNAL = "no_signal", "nothing rises above the noise"
    NO_STAR = "no_star", "no star rises above the noise"
    TOO_FEW_STARS = "too_few_stars", "fewer isolated stars than the method needs"
    NO_PAIR = "no_pair", "only one star is seen"
    NOT_CONSTRAINED = "not_constrained", "the image does not constrain the answer"
    AMBIGUOUS = "ambiguous", "several answers explain the image equally well"
    MODEL_MISMATCH = "model_mismatch", "the model does not describe the image"
    IMPLAUSIBLE = "implausible", "a fitted value is physically impossible"
    NOT_CONVERGED = "not_converged", "an iteration did not converge"
    WRONG_INSTRUMENT = "wrong_instrument", "a frame does not suit the instrument or the other frames"
    BAD_REFERENCE = "bad_reference", "the reference is blurrier than the frame, or is the only frame"
    IS_REFERENCE = "is_reference", "the frame is itself the reference"
    # the run
    OUT_OF_MEMORY = "out_of_memory", "memory ran out"
    WORKER_LOST = "worker_lost", "the process that worked on a frame was killed"
    INTERNAL = "internal", "an error in jitterkit: please report it"


class JitterkitError(ValueError):
    """Error that the user can correct.

    Parameters
    ----------
    code : ErrorCode
    message : str
        One sentence that names the value received and the remedy.
    """

    def __init__(self, code: ErrorCode, message: str) -> None:
        super().__init__(code, message)
        self.code = code
        self.message = message

    def __str__(self) -> str:
        """Return the message."""
        return self.message


class ConfigurationError(JitterkitError):
    """Error about an argument, instrument file, preset or option that cannot be used as given."""


class FrameError(JitterkitError):
    """Error about a file, or one frame of it, that cannot be used.

    Parameters
    ----------
    code : ErrorCode
    path : str or Path
        The file the user named.
    problem : str
        What was found, with the value: ``"has 3 colour channels"``.
    remedy : str
        What to do about it: ``"convert it to one channel"``.
    """

    def __init__(self, code: ErrorCode, path: str | Path, problem: str, remedy: str) -> None:
        name = "".join(c if c.isprintable() else "?" for c in str(path))  # others are unsafe in a terminal
        super().__init__(code, f"{name}: {problem}; {remedy}.")
        self.args = (code, path, problem, remedy)  # unpickling calls the class with these
        self.path = Path(path)
        self.problem = problem
        self.remedy = remedy


class UndeterminedError(JitterkitError):
    """Error about an image that does not determine the answer; the message says what is missing.

    The batch reports such a frame as a row with a status.
    """


def code_of(error: BaseException) -> ErrorCode:
    """Return the code of any exception; ``INTERNAL`` if jitterkit did not raise it deliberately."""
    if isinstance(error, JitterkitError):
        return error.code
    return ErrorCode.OUT_OF_MEMORY if out_of_memory(error) else ErrorCode.INTERNAL


def reading_code(error: Exception, contents: ErrorCode = ErrorCode.MALFORMED) -> ErrorCode:
    """Return the code of an exception that occurred while a file was read.

    Parameters
    ----------
    error : Exception
    contents : ErrorCode
        Code of any error that does not come from the operating system: the file's contents are at fault.
    """
    if isinstance(error, FileNotFoundError | NotADirectoryError):
        return ErrorCode.NOT_FOUND
    return ErrorCode.NOT_READABLE if isinstance(error, OSError) else contents


def printable(text: object) -> str:
    r"""Escape everything a terminal, a table or a page could mistake for a command.

    Line breaks, control characters, text-direction marks and the undecodable bytes of a file name
    become visible escapes.

    >>> printable("night\n1.fits")
    'night\\n1.fits'
    """
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode("ascii") for c in str(text))


def out_of_memory(error: BaseException) -> bool:
    """Return whether an exception means that memory ran out; for a device, only JAX's message shows it."""
    return isinstance(error, MemoryError) or "RESOURCE_EXHAUSTED" in str(error)


def did_you_mean(name: str, allowed: Iterable[str]) -> str:
    """Return a suggestion of the closest allowed name, to begin a remedy; empty if no name is close.

    >>> did_you_mean("tolimann", ["toliman", "smallsat"])
    "did you mean 'toliman'? "
    """
    close = get_close_matches(name, list(allowed), 1, 0.5)
    return f"did you mean {close[0]!r}? " if close else ""


def one_of(kind: str, name: str, choices: Collection[str], other: str = "") -> str:
    """Return a name that is among the choices; refuse any other.

    Parameters
    ----------
    kind : str
        What is named: ``"preset"``.
    name : str
    choices : collection of str
    other : str, optional
        What may be given in place of a name: ``"a TOML file"``.

    Raises
    ------
    ConfigurationError
        The message names the choices, and the closest of them.
    """
    if name not in choices:
        listed = f"{', '.join(choices)}, or give {other}" if other else ", ".join(choices)
        problem = f"There is no {kind} {name!r}; {did_you_mean(name, choices)}choose from {listed}."
        raise ConfigurationError(ErrorCode.UNKNOWN_NAME, problem)
    return name


def refuse_if(condition: bool, code: ErrorCode, message: str) -> None:
    """Raise a ConfigurationError if a condition holds."""
    if condition:
        raise ConfigurationError(code, message)


def positive(name: str, value: float, unit: str = "") -> float:
    """Return a number that is positive and finite; refuse any other.

    >>> positive("exposure", 0.1, "s")
    0.1
    """
    if not 0 < value < math.inf:
        given = f"{name} = {value:g} {unit}".strip()
        raise ConfigurationError(ErrorCode.OUT_OF_RANGE, f"{given} is impossible; give a positive number.")
    return value
