"""Numbers as they shall stand in a text, with as many digits as a mission needs."""

import re
from typing import Self

DEGREE_DECIMALS = 7
"""A hundred-millionth of the Earth's meridian is 1 cm: finer than any receiver."""

METRE_DECIMALS = 2

_DECIMALS = re.compile(r"\.([0-9]+)")


class Digits(float):
    """A number as it shall stand in the text: rounded to so many decimals.

    Attributes:
        decimals: The most that are written.
        fixed: Zeros at the end are written too.
    """

    def __new__(cls, value: float, decimals: int, *, fixed: bool = False) -> Self:
        """Round a number; -0 becomes 0."""
        number = super().__new__(cls, round(value, decimals) + 0.0)
        number.decimals, number.fixed = decimals, fixed
        return number

    decimals: int
    fixed: bool

    def __str__(self) -> str:
        """The number's digits."""
        text = f"{float(self):.{self.decimals}f}"
        return text.rstrip("0").rstrip(".") if "." in text and not self.fixed else text


def degrees(value: float) -> Digits:
    """Degrees with 7 decimals (1 cm)."""
    return Digits(value, DEGREE_DECIMALS, fixed=True)


def degrees_text(value: float) -> str:
    """The same as text."""
    return str(degrees(value))


def metres(value: float, decimals: int = METRE_DECIMALS) -> Digits:
    """Metres, no finer than so many decimals, without trailing zeros."""
    return Digits(value, decimals)


def like(old: str, number: Digits) -> str:
    """A number in the place of an old one, with as many decimals, as far as it has them."""
    kept = _DECIMALS.search(old)
    least = min(len(kept[1]), number.decimals) if kept else 0
    whole, _, fraction = f"{float(number):.{number.decimals}f}".partition(".")
    fraction = fraction.rstrip("0").ljust(least, "0")
    return f"{whole}.{fraction}" if fraction else whole
