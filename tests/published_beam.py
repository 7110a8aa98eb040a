"""Printed values of chapter 2: the four waves of a single moving beam."""

from typing import NamedTuple

from published import Value

TRUNCATED = "truncated after the fourth decimal, not rounded"


class WaveCase(NamedTuple):
    """A row of Table 2.1: r1, r2, Re r3 and Im r3, exact and by (2.15)."""

    eps: float
    v: float
    omega: float
    exact: tuple[Value, ...]
    leading: tuple[Value, ...]


def row(*texts):
    return tuple(Value(text) for text in texts)


TABLE_2_1 = [
    WaveCase(
        0.01,
        0.80,
        1.30,
        row("0.7222", "-6.4335", "2.8556", "60.2421"),
        (*row("0.7222", "-6.4313", "2.8889"), Value("59.9999", "60 exactly: " + TRUNCATED)),
    ),
    WaveCase(
        0.05,
        0.28,
        0.83,
        row("0.6482", "-1.1501", "0.2510", "19.2243"),
        row("0.6482", "-1.1501", "0.2522", "19.2000"),
    ),
    WaveCase(
        0.10,
        0.15,
        1.50,
        (Value("1.2949"), Value("-1.7342", TRUNCATED), *row("0.2197", "10.0070")),
        row("1.2947", "-1.7324", "0.2302", "9.8869"),
    ),
]
