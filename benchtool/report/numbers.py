"""Number formats: values rounded to the digits that their uncertainty supports."""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from math import floor, isfinite, log10

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")


def decimal_exponent(value: float, sd: float) -> int:
    """Return the exponent of the common power of ten; 0 from 1e-3 up to below 1e5."""
    size = max(abs(value), abs(sd) if isfinite(sd) else 0.0)
    if size == 0.0 or not isfinite(size):
        return 0
    power = floor(log10(size))
    return power if power < -3 or power > 4 else 0


def decimals_for(sd: float) -> int:
    """Return the number of decimals that shows two significant digits of a standard deviation."""
    if not isfinite(sd) or sd <= 0.0:
        return 4
    return min(12, max(0, 1 - floor(log10(float(f"{sd:.1e}")))))


def power_of_ten(exponent: int) -> str:
    """Return "10⁻⁵", or nothing for exponent 0."""
    return "10" + str(exponent).translate(_SUPERSCRIPTS) if exponent else ""


def display_unit(symbol: str) -> str:
    """Return a unit with superscripts ("N/(rad/s)²") and no-break spaces; "–" for a ratio."""
    if symbol == "1":
        return "–"
    raised = re.sub(r"(?<=[a-z)])[23]\b", lambda match: match[0].translate(_SUPERSCRIPTS), symbol)
    return raised.replace(" ", "\u00a0")


def with_unit(text: str, symbol: str) -> str:
    """Return a number followed by its unit; a ratio has none."""
    return text if symbol == "1" else f"{text} {display_unit(symbol)}"


def format_number(value: float, form: str) -> str:
    """Return a number in a Python format (".2f") with a true minus sign; "–" if not finite."""
    return f"{value:{form}}".replace("-", "−") if isfinite(value) else "–"


def align_columns(rows: Sequence[Sequence[str]], left: Collection[int]) -> list[str]:
    """Return rows of cells as lines with aligned columns; those in `left` are left-aligned."""
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    lines = []
    for row in rows:
        cells = (
            cell.ljust(width) if at in left else cell.rjust(width)
            for at, (cell, width) in enumerate(zip(row, widths, strict=True))
        )
        lines.append("  ".join(cells).rstrip())
    return lines


def scaled(value: float, exponent: int, decimals: int) -> str:
    """Return value / 10**exponent with fixed decimals and a true minus sign."""
    return format_number(value / 10.0**exponent, f".{decimals}f")


def with_statistical(value: float, sd: float, statistical: float, symbol: str = "1") -> str:
    """Return "0.808 ± 0.075 (statistical 0.016)"; the statistical part has two digits.

    If `sd` is nan (no budget), the statistical error is used: "0.808 ± 0.016 (statistical)".
    """
    if not isfinite(sd):
        text = with_unit(value_with_sd(value, statistical), symbol)
        return f"{text} (statistical)" if isfinite(statistical) else text
    exponent = decimal_exponent(value, sd)
    part = scaled(statistical, exponent, decimals_for(statistical / 10.0**exponent))
    power = f"·{power_of_ten(exponent)}" if exponent else ""
    return f"{with_unit(value_with_sd(value, sd), symbol)} (statistical {part}{power})"


def value_with_sd(value: float, sd: float) -> str:
    """Return "1.974 ± 0.021", with a common power of ten if needed; without sd, no ±."""
    exponent = decimal_exponent(value, sd)
    if not isfinite(sd):
        text = format_number(value / 10.0**exponent, ".6g")
        return f"{text}·{power_of_ten(exponent)}" if exponent else text
    decimals = decimals_for(sd / 10.0**exponent)
    text = f"{scaled(value, exponent, decimals)} ± {scaled(sd, exponent, decimals)}"
    return f"({text})·{power_of_ten(exponent)}" if exponent else text
