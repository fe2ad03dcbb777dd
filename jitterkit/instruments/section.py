"""One table of an instrument file: its values, taken out with their types, or a sentence.

Every complaint names the file, the key, the value and what would be accepted.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any, NoReturn

from jitterkit.errors import ConfigurationError, ErrorCode, did_you_mean


def refuse_unknown(file: Path, what: str, names: Collection[str], allowed: Collection[str]) -> None:
    """Raise for the first name that is not allowed, and suggest the nearest that is."""
    for name in names:
        if name not in allowed:
            hint = did_you_mean(name, allowed)
            problem = f"{file}: the {what} {name!r} is unknown; {hint}use {', '.join(allowed)}."
            raise ConfigurationError(ErrorCode.UNKNOWN_NAME, problem)


class Section:
    """A table of a TOML file.

    Parameters
    ----------
    file : Path
        Named in complaints; other files are looked for beside it.
    name : str
        Of the table.
    values : object
        What the TOML has under that name.
    units : mapping
        Keys it may have, and the unit of each as complaints name it.

    Raises
    ------
    ConfigurationError
        If it is no table or has a key that is not allowed.
    """

    def __init__(self, file: Path, name: str, values: Any, units: Mapping[str, str]) -> None:
        self.file, self.name, self.units = file, name, units
        if not isinstance(values, Mapping):
            problem = f"{file}: {name} = {values!r} is not a table; begin a line with [{name}]."
            raise ConfigurationError(ErrorCode.WRONG_TYPE, problem)
        self.values = dict(values)
        refuse_unknown(file, f"key of [{name}]", self.values, units)

    def __contains__(self, key: str) -> bool:
        return key in self.values

    def source(self, key: str) -> str:
        """Return where a value comes from, in words."""
        return f"instrument file {self.file.name} [{self.name}] {key}"

    def refuse(self, code: ErrorCode, key: str, remedy: str) -> NoReturn:
        """Raise for the value of a key."""
        raise ConfigurationError(code, f"{self.file}: [{self.name}] {key} = {self.values[key]!r}; {remedy}.")

    def require(self, key: str, remedy: str) -> None:
        """Raise if a key is missing."""
        if key not in self.values:
            problem = f"{self.file}: [{self.name}] has no {key}; {remedy}."
            raise ConfigurationError(ErrorCode.MISSING_VALUE, problem)

    def number(self, key: str, default: Any = None) -> Any:
        """Return a number as float; a truth value is none."""
        value = self._typed(key, default, _is_number, f"give a number, in {self.units[key]}")
        return None if value is None else self._finite(key, value)

    def _typed(self, key: str, default: Any, is_typed: Callable[[Any], bool], remedy: str) -> Any:
        value = self.values.get(key, default)
        if key in self.values and not is_typed(value):
            self.refuse(ErrorCode.WRONG_TYPE, key, remedy)
        return value

    def _finite(self, key: str, value: float) -> float:
        if not math.isfinite(value):
            self.refuse(ErrorCode.OUT_OF_RANGE, key, f"give a finite number, in {self.units[key]}")
        return float(value)

    def integer(self, key: str, default: Any = None) -> Any:
        """Return a whole number."""
        return self._typed(key, default, _is_whole, "give a whole number")

    def text(self, key: str, default: Any = None) -> Any:
        """Return a text."""
        return self._typed(key, default, _is_text, "give a text in quotation marks")

    def truth(self, key: str) -> bool | None:
        """Return true or false, or None."""
        return self._typed(key, None, lambda v: isinstance(v, bool), "give true or false")

    def texts(self, key: str) -> tuple[str, ...] | None:
        """Return different texts of a list, or None."""
        if key not in self.values:
            return None
        remedy = "give a list of different texts in quotation marks"
        return tuple(self._list(key, _is_text, lambda v: len(set(v)) == len(v), remedy))

    def numbers(self, key: str, count: int | None = None) -> list[float]:
        """Return a list of numbers, of a given length if there is one."""
        remedy = f"give {'a list of' if count is None else f'[{count}]'} numbers, in {self.units[key]}"
        value = self._list(key, _is_number, lambda v: v and count in (None, len(v)), remedy)
        return [self._finite(key, v) for v in value]

    def number_or_path(self, key: str, what: str) -> float | Path:
        """Return a number as float, or the path of a file that exists."""
        value = self.values[key]
        if isinstance(value, str):
            return self.path(key)
        if not _is_number(value):
            self.refuse(
                ErrorCode.WRONG_TYPE, key, f"give a number, in {self.units[key]}, or the name of {what}"
            )
        return self._finite(key, value)

    def whole_numbers(self, key: str, count: int | None, what: str) -> list[int]:
        """Return a list of whole numbers, of a given length if there is one; it may be empty otherwise."""
        return self._list(key, _is_whole, lambda v: count in (None, len(v)), f"give {what}")

    def _list(self, key: str, is_typed: Callable, is_right: Callable, remedy: str) -> list[Any]:
        """Return a list whose values are of a type, and that is right as a whole."""
        value = self.values[key]
        is_list = isinstance(value, list) and all(map(is_typed, value))
        if not is_list or not is_right(value):
            self.refuse(ErrorCode.WRONG_SHAPE if is_list else ErrorCode.WRONG_TYPE, key, remedy)
        return value

    def path(self, key: str) -> Path:
        """Return the path of a file that exists, relative to the TOML's directory."""
        return self._existing(key, self.text(key))

    def paths(self, key: str) -> list[Path]:
        """Return the paths of files that exist, of one text or a list of them."""
        given = self.texts(key) if isinstance(self.values[key], list) else (self.text(key),)
        return [self._existing(key, name) for name in given or ()]

    def _existing(self, key: str, name: Any) -> Path:
        path = self.file.parent / str(name)
        if not path.is_file():
            self.refuse(
                ErrorCode.NOT_FOUND, key, f"there is no file {path}: give a path relative to {self.file.name}"
            )
        return path


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def _is_whole(value: Any) -> bool:
    return isinstance(value, int) and not isinstance(value, bool)


def _is_text(value: Any) -> bool:
    return isinstance(value, str)
