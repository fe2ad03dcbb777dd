"""Parse quantities and ranges of the command line: ``1uas``, ``10%``, ``length=0.05:0.75:30``."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterable, Iterator

from jitterkit.errors import ConfigurationError, ErrorCode, refuse_if

_MAX_SWEPT = 2

_QUANTITY = re.compile(r"\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)\s*([^\d]*)", re.ASCII)
"""A number and its unit."""

_LEAST = 1e-60
"""The fourth power of its inverse is a number of 64 bits."""

_CAPITAL_M = re.compile("M(?![iI])")
"""A unit of mega, which only a header in capitals writes for milli; ``MIN`` and ``MILLISEC`` are none."""


def parse_angle(text: str, option: str) -> float:
    """Return an angle on the sky in arcsec, from a number with its unit.

    >>> parse_angle("2.5 mas", "--target")
    0.0025

    Raises
    ------
    ConfigurationError
        If it is not a positive angle.
    """
    return _positive(text, option, "arcsec", "angle", "1uas")


def parse_allowed(text: str, option: str = "--allow", of: str = "time") -> tuple[str, float]:
    """Return what may be lost: ``of`` with a share, or ``"bias"`` and an angle in arcsec.

    >>> parse_allowed("10%")
    ('time', 0.1)

    Raises
    ------
    ConfigurationError
        If it is neither, or not positive.
    """
    if not text.rstrip().endswith("%"):
        return "bias", parse_angle(text, option)
    return of, parse_share(text, f"{option} {text} is not a positive share of the {of}; write 10%, or 1uas.")


def parse_share(text: str, problem: str) -> float:
    """Return a share from a number of percent.

    >>> parse_share("10%", "--target is not a share.")
    0.1

    Raises
    ------
    ConfigurationError
        With ``problem`` as its message, if it is not positive and finite, or has no percent sign.
    """
    number, sign, rest = text.strip().partition("%")
    refuse_if(not sign or rest != "", ErrorCode.MALFORMED, problem)
    return parse_number(number, lambda percent: 0 < percent < float("inf"), problem) / 100


def parse_number(text: str, is_valid: Callable[[float], bool], problem: str) -> float:
    """Return a number, or refuse with ``problem`` as the message what is none, or is not valid.

    Raises
    ------
    ConfigurationError
    """
    try:
        value = float(text)
    except ValueError:
        raise ConfigurationError(ErrorCode.MALFORMED, problem) from None
    refuse_if(not is_valid(value), ErrorCode.OUT_OF_RANGE, problem)
    return computable(value, " ".join(problem.split()[:2]))  # option and text


def computable(value: float, said: str) -> float:
    """Return a number of which squares and inverses can be computed, or refuse it by its name.

    >>> computable(-2.0, "--x")
    -2.0

    Raises
    ------
    ConfigurationError
        If it is not finite, or neither zero nor between 1e-60 and 1e60.
    """
    number = f"{said} = {value:g}"
    refuse_if(not math.isfinite(value), ErrorCode.OUT_OF_RANGE, f"{number} is not a finite number; give one.")
    extreme = value != 0 and not _LEAST <= abs(value) <= 1 / _LEAST
    problem = f"{number} is beyond what can be computed with; give a number between 1e-60 and 1e60."
    refuse_if(extreme, ErrorCode.OUT_OF_RANGE, problem)
    return value


def parse_time(text: str, option: str) -> float:
    """Return a time in s, from a number with its unit.

    >>> parse_time("20ms", "--budget")
    0.02

    Raises
    ------
    ConfigurationError
        If it is not a positive time.
    """
    return _positive(text, option, "s", "time", "20ms")


def _positive(text: str, option: str, unit: str, kind: str, example: str) -> float:
    """Return a quantity of some kind in ``unit``, from a number with any unit of the kind."""
    from astropy.units import Unit

    from jitterkit.frames.units import factor

    code, value = ErrorCode.MALFORMED, 0.0
    if (parts := _QUANTITY.fullmatch(text)) is not None:
        code, value = ErrorCode.OUT_OF_RANGE, float(parts[1])
        mega = _CAPITAL_M.match(parts[2])
        said = None if mega else factor(kind, parts[2])  # in the words of headers, else as astropy has it
        try:
            if mega and kind == "angle":
                raise ValueError("no angle is so large")
            value *= Unit(parts[2]).to(unit) if said is None else float(said)
        except ValueError:
            code, value = ErrorCode.UNKNOWN_UNIT, 0.0
    problem = f"{option} {text} is not a positive {kind}; write one with its unit, {example}."
    refuse_if(not 0 < value < float("inf"), code, problem)
    return computable(value, option)


def named(texts: Iterable[str], option: str, others: Collection[str] = ()) -> Iterator[tuple[str, str]]:
    """Yield name and words of each ``name=words``; the words are empty where there is no equals sign.

    Raises
    ------
    ConfigurationError
        If a name is given twice, or is among ``others``, which were given otherwise.
    """
    given = set(others)
    for text in texts:
        name, _, words = map(str.strip, text.partition("="))
        problem = f"{option} {text}: {name} is given twice; give it once."
        refuse_if(name in given, ErrorCode.DUPLICATE, problem)
        given.add(name)
        yield name, words


def parse_sweeps(texts: list[str]) -> dict[str, list[float]]:
    """Return values by name from ``name=from:to:count``, ``name=from:to:count:log`` or ``name=a,b,c``.

    >>> parse_sweeps(["angle=0:90:4", "flux=1e5,1e6"])
    {'angle': [0.0, 30.0, 60.0, 90.0], 'flux': [100000.0, 1000000.0]}

    Raises
    ------
    ConfigurationError
        If one is neither, or there are more than two.
    """
    problem = f"{len(texts)} settings are swept; a table and a figure take two, --sweep twice."
    refuse_if(len(texts) > _MAX_SWEPT, ErrorCode.TOO_MANY, problem)
    sweeps: dict[str, list[float]] = {}
    for name, values in named(texts, "--sweep"):
        try:
            sweeps[name] = _values(values)
        except ConfigurationError:
            raise
        except (ValueError, OverflowError):
            form = "--sweep length=0.05:0.75:15 (from, to, how many; with :log at the end for equal ratios)"
            problem = f"--sweep {name}={values} is not understood; write {form}, or --sweep angle=0,45,90."
            raise ConfigurationError(ErrorCode.MALFORMED, problem) from None
    return sweeps


def _values(text: str) -> list[float]:
    import numpy as np

    if ":" not in text:
        return [computable(float(value), "a value of --sweep") for value in text.split(",")]
    first, last, count, *log = text.split(":")
    if log not in ([], ["log"]) or int(count) < 1 or (log and not float(first) * float(last) > 0):
        raise ValueError(text)
    spaced = np.geomspace if log else np.linspace
    low, high = (computable(float(end), "a value of --sweep") for end in (first, last))
    return [float(value) for value in spaced(low, high, int(count))]
