"""A printed number, whose digits are its tolerance."""

from typing import NamedTuple


class Value(NamedTuple):
    """A number as printed: its digits are its tolerance."""

    text: str
    misprint: str = ""  # why the model does not give it; empty where it does

    @property
    def number(self) -> float:
        """The number that is printed."""
        return float(self.text)

    @property
    def decimals(self) -> int:
        """Digits after the point, in the units of the number itself."""
        mantissa, _, exponent = self.text.lower().partition("e")
        return len(mantissa.partition(".")[2]) - int(exponent or 0)

    @property
    def half_digit(self) -> float:
        """Half a unit of the last printed digit."""
        return 0.5 * 10.0**-self.decimals

    def matches(self, computed: float) -> bool:
        """Whether `computed` rounds to it."""
        return abs(computed - self.number) <= self.half_digit * (1 + 1e-9)


def values(*texts: str, misprint: str = "") -> tuple[Value, ...]:
    """Numbers in a row, none of them a misprint or all for one reason."""
    return tuple(Value(text, misprint) for text in texts)
