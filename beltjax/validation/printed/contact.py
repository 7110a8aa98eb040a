"""Chapter 5: two pulleys in contact, regular and maximum moment.

Of each number the printed value stands first, the converged one after it.
"""

import math
from typing import NamedTuple

from beltjax.validation.printed.value import Value, values

# Tables 5.1 and 5.3, what is given [SI].
EQUAL = {"R": 0.05, "L": 0.05 * math.pi, "EA": 25e3, "mu": 0.6, "tension": 50.0, "omega_1": 500.0,
         "M2": 2.0, "G": 0.5}  # fmt: skip
UNEQUAL = {"R1": 0.01, "R2": 0.05, "L": 0.1, "EA": 40e3, "mu": 1.0, "tension": 800.0,
           "m0": 0.0056}  # fmt: skip
UNIT = "G = m0 c is in kg/s, and m0 = rho_0 A is mass per length"
ANY_MASS = 0.02  # per length [kg/m]: Table 5.1 gives the mass flow instead
STIFFNESSES = (0.0, 0.0015, 0.015, 0.05)  # EI [N m^2]
EQUAL_SPAN = Value("0.1571")  # of Table 5.1, pi R1 [m]
CRITICAL = Value("374")  # of Table 5.3, by the string model [m/s]
CRITICAL_SPEED = CRITICAL.number  # as all its figures use it; 374.24 to two more digits

UNCONVERGED = (
    "the source stops at 0.1 % of the belt's length, and an error dL moves the tension by EA dL/L: "
    "25 N of 72; a tighter stop gives the converged column, by two independent solvers"
)


class Regular(NamedTuple):
    """A row of Table 5.2: every value known for each number, the printed first."""

    EI: float
    slip: tuple[Value, ...]  # [deg], alike on both pulleys
    adhesion: tuple[Value, ...]  # [deg]
    tight: tuple[Value, ...]  # th1(0) [deg]
    slack: tuple[Value, ...]  # -th2(0) [deg]
    tight_length: tuple[Value, ...]  # L1/d
    slack_length: tuple[Value, ...]  # L2/d
    tension: tuple[Value, ...]  # T1(0) [N]


TABLE_5_2 = [
    Regular(
        0.0,
        values("109.4", "109.379"),
        (
            Value("70.60", "180 - 109.379 is 70.62: the printed slip and adhesion add up to 180.0"),
            Value("70.621"),
        ),
        values("0", "0.000"),
        values("0", "0.000"),
        values("1", "1.0000"),
        values("1", "1.0000"),
        values("71.16"),
    ),
    Regular(
        0.0015,
        values("100.2", misprint=UNCONVERGED) + values("105.851"),
        values("64.67", misprint=UNCONVERGED) + values("58.483"),
        values("5.645", misprint=UNCONVERGED) + values("5.732"),
        values("9.503", misprint=UNCONVERGED) + values("9.935"),
        values("1.063", misprint=UNCONVERGED) + values("1.0637"),
        values("1.106", misprint=UNCONVERGED) + values("1.1107"),
        values("72.207"),
    ),
    Regular(
        0.015,
        values("87.18", misprint=UNCONVERGED) + values("87.451"),
        values("50.05", misprint=UNCONVERGED) + values("49.704"),
        values("16.86", misprint=UNCONVERGED) + values("16.873"),
        values("25.92", misprint=UNCONVERGED) + values("25.973"),
        values("1.189", "1.1888"),
        values("1.293", "1.2934"),
        values("79.189"),
    ),
    Regular(
        0.05,
        values("90.26", misprint=UNCONVERGED) + values("90.420"),
        values("15.91", misprint=UNCONVERGED) + values("15.692"),
        values("29.82", misprint=UNCONVERGED) + values("29.839"),
        values("44.00", misprint=UNCONVERGED) + values("44.049"),
        values("1.339", "1.3388"),
        values("1.511", "1.5112"),
        values("77.854"),
    ),
]

# Fig. 5.7: th1(0), th1(L), -th2(0), -th2(L) [deg], printed and converged.
TRUNCATED = "the source's tolerance: its last printed digits are not converged"
FIGURE_5_7 = {
    0.0015: (
        values("29.45", "29.451"),
        values("22.37", "22.372"),
        values("38.83", "38.833"),
        values("20.32", "20.320"),
    ),
    0.015: (
        (Value("43.98", TRUNCATED), Value("43.962")),
        (Value("19.13", TRUNCATED), Value("19.136")),
        (Value("60.05", TRUNCATED), Value("60.034")),
        values("15.18", "15.181"),
    ),
    0.05: (
        values("68.58", "68.580"),
        values("12.96", "12.959"),
        values("77.92", "77.919"),
        values("10.48", "10.475"),
    ),
}
