"""Numbers and names as a person reads them."""

from __future__ import annotations

import math

MINUS, TIMES, MICRO = "\N{MINUS SIGN}", "\N{MULTIPLICATION SIGN}", "\N{MICRO SIGN}"
SUPERSCRIPT = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NOTHING = "\N{EN DASH}"

#: Sizes from which, and to which, a number is written with a power of ten.
LARGE, SMALL = 1e6, 1e-5


def number(value: float, digits: int = 4) -> str:
    """Write a number with so many significant digits, never as ``1e+03``; a dash for NaN.

    >>> number(999.96), number(0.25, 2), number(-38110000.0)
    ('1000', '0.25', '−3.811 × 10⁷')
    """
    if not math.isfinite(value):
        return NOTHING
    if value == 0:
        return "0"
    exponent = _exponent(value, digits)
    if LARGE > abs(value) >= SMALL:
        return _fixed(value, digits - 1 - exponent)
    return f"{_fixed(value / 10.0**exponent, digits - 1)} {_power(exponent)}"


def short_number(value: float) -> str:
    """Write a round number in little room.

    >>> short_number(-20.0), short_number(1e5), short_number(0.002)
    ('−20', '10⁵', '2×10⁻³')
    """
    if value == 0 or 0.01 <= abs(value) < 10000:
        return f"{value:g}".replace("-", MINUS)
    mantissa, _, exponent = f"{value:e}".partition("e")
    factor = f"{float(mantissa):g}".replace("-", MINUS) + TIMES
    factor = {f"1{TIMES}": "", f"{MINUS}1{TIMES}": MINUS}.get(factor, factor)
    return f"{factor}10{str(int(exponent)).translate(SUPERSCRIPT)}"


def with_error(value: float, error: float) -> str:
    """Write a value to the second significant digit of its error.

    >>> with_error(8.12345678, 0.000241), with_error(3.811e7, 6173.0)
    ('8.12346 ± 0.00024', '(3.81100 ± 0.00062) × 10⁷')

    Without an error the value alone is given, to six digits; a dash for NaN.
    """
    if not (math.isfinite(value) and math.isfinite(error) and error > 0):
        return number(value, 6)
    larger, decimals = max(abs(value), error), 1 - _exponent(error, 2)
    if LARGE > larger >= SMALL:
        return f"{_fixed(value, decimals)} ± {_fixed(error, decimals)}"
    exponent = _exponent(larger, decimals + 1)
    scale, decimals = 10.0**exponent, decimals + exponent
    return f"({_fixed(value / scale, decimals)} ± {_fixed(error / scale, decimals)}) {_power(exponent)}"


def angle_size(arcsec: float, digits: int = 3) -> str:
    """Write a small angle in the unit that suits it.

    >>> angle_size(0.0002408), angle_size(0.05), angle_size(8.1)
    ('241 µas', '50.0 mas', '8.10″')
    """
    if not math.isfinite(arcsec):
        return NOTHING
    per_arcsec, unit = angle_unit(arcsec)
    return f"{number(arcsec * per_arcsec, digits)}{unit}"


def angle_unit(arcsec: float) -> tuple[float, str]:
    """Return the unit that suits an angle: how many of it make an arcsecond, and its symbol with its space.

    >>> angle_unit(0.05)
    (1000.0, ' mas')
    """
    size = abs(arcsec)
    if 0 < size < 0.9995e-3:
        return 1e6, f" {MICRO}as"
    return (1e3, " mas") if 0 < size < 0.9995 else (1.0, "″")


_TIMES = ((300, 1, "s"), (3 * 3600, 60, "min"), (3 * 86400, 3600, "h"), (math.inf, 86400, "d"))
"""Seconds up to which a time is given in such units, and their name."""


def suited_time(span: float, unit: str) -> tuple[float, str]:
    """Return how many of the times' unit make the unit that suits a span, and its name.

    >>> suited_time(7200.0, "s"), suited_time(7200.0, "frame")
    ((60, 'min'), (1.0, 'frame'))
    """
    if unit != "s":
        return 1.0, unit
    return next((per, name) for most, per, name in _TIMES if span < most)


def by_scale(error: float) -> str:
    """Write the error of a separation by the plate scale, to follow the mean; nothing where none is stated.

    >>> by_scale(0.0001), by_scale(math.nan)
    ('; the plate scale adds ± 100 µas, which does not average out', '')
    """
    if not math.isfinite(error):
        return ""
    return f"; the plate scale adds ± {angle_size(error)}, which does not average out"


def ellipse_size(major: float, minor: float) -> str:
    """Write the two axes of an ellipse in the unit of the larger.

    >>> ellipse_size(0.2167, 0.0), ellipse_size(0.0, 0.0)
    ('217 × 0 mas', 'none')
    """
    if not (math.isfinite(major) and math.isfinite(minor)):
        return NOTHING
    if major <= 0:
        return "none"
    per_arcsec, unit = angle_unit(major)
    decimals = max(0, 2 - _exponent(major * per_arcsec, 3))
    return f"{_fixed(major * per_arcsec, decimals)} {TIMES} {_fixed(minor * per_arcsec, decimals)}{unit}"


def _exponent(value: float, digits: int) -> int:
    """Return the power of ten of a number once it is rounded: 9.96 to two digits is 10."""
    return int(f"{value:.{max(digits, 1) - 1}e}".partition("e")[2])


def _fixed(value: float, decimals: int) -> str:
    text = f"{round(value, decimals):.{max(decimals, 0)}f}"
    return text.replace("-", MINUS) if float(text) != 0 else text.removeprefix("-")


def _power(exponent: int) -> str:
    return f"{TIMES} 10{str(exponent).translate(SUPERSCRIPT)}"
