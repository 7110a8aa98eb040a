"""Chapter 2: the waves of a single moving beam, and what supports send back."""

from collections.abc import Callable
from typing import NamedTuple

from beltjax.validation.printed.value import Value, values

TRUNCATED = "truncated after the fourth decimal, not rounded"


class WaveCase(NamedTuple):
    """A row of Table 2.1: r1, r2, Re r3 and Im r3, exact and by (2.15); r4 conjugate to r3."""

    eps: float
    v: float
    omega: float
    exact: tuple[Value, ...]
    leading: tuple[Value, ...]


TABLE_2_1 = [
    WaveCase(
        0.01,
        0.80,
        1.30,
        values("0.7222", "-6.4335", "2.8556", "60.2421"),
        (*values("0.7222", "-6.4313", "2.8889"), Value("59.9999", "60 exactly: " + TRUNCATED)),
    ),
    WaveCase(
        0.05,
        0.28,
        0.83,
        values("0.6482", "-1.1501", "0.2510", "19.2243"),
        values("0.6482", "-1.1501", "0.2522", "19.2000"),
    ),
    WaveCase(
        0.10,
        0.15,
        1.50,
        (Value("1.2949"), Value("-1.7342", TRUNCATED), *values("0.2197", "10.0070")),
        values("1.2947", "-1.7324", "0.2302", "9.8869"),
    ),
]


class Coefficient(NamedTuple):
    """A formula of Table 2.2; its text is the formula itself, r the four wave numbers."""

    support: str
    name: str
    text: str
    formula: Callable[..., complex]


TABLE_2_2 = [
    Coefficient("simple", "R_A", "-(r3^2-r2^2)/(r3^2-r1^2)",
                lambda r1, r2, r3, r4: -(r3**2 - r2**2) / (r3**2 - r1**2)),
    Coefficient("simple", "Rbar_A", "(r1^2-r2^2)/(r3^2-r1^2)",
                lambda r1, r2, r3, r4: (r1**2 - r2**2) / (r3**2 - r1**2)),
    Coefficient("simple", "R_B", "-(r4^2-r1^2)/(r4^2-r2^2)",
                lambda r1, r2, r3, r4: -(r4**2 - r1**2) / (r4**2 - r2**2)),
    Coefficient("simple", "Rbar_B", "-(r1^2-r2^2)/(r4^2-r2^2)",
                lambda r1, r2, r3, r4: -(r1**2 - r2**2) / (r4**2 - r2**2)),
    Coefficient("fixed", "R_A", "-(r3-r2)/(r3-r1)",
                lambda r1, r2, r3, r4: -(r3 - r2) / (r3 - r1)),
    Coefficient("fixed", "Rbar_A", "(r1-r2)/(r3-r1)",
                lambda r1, r2, r3, r4: (r1 - r2) / (r3 - r1)),
    Coefficient("fixed", "R_B", "-(r4-r1)/(r4-r2)",
                lambda r1, r2, r3, r4: -(r4 - r1) / (r4 - r2)),
    Coefficient("fixed", "Rbar_B", "-(r1-r2)/(r4-r2)",
                lambda r1, r2, r3, r4: -(r1 - r2) / (r4 - r2)),
]  # fmt: skip

# Orders in eps of the parts of D = -R_A, and of its phase, that Fig. 2.2 names.
FIGURE_2_2 = {"D1": Value("1"), "D2": Value("2"), "D3": Value("0"), "phase of D": Value("3")}
FIGURE_2_3_SPEEDS = (0.0, 0.3, 0.6, 0.9)
