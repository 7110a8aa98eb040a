"""Printed and converged values of chapter 5, each with the digits it is known to."""

from typing import NamedTuple

from published import Value, values

EQUAL, UNEQUAL = "two_pulley_table_5_1", "two_pulley_table_5_3"
CRITICAL_SPEED = 374.0  # [m/s] as printed and as all its figures use it; 374.24 to two more digits

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


def _not_converged(*texts: str) -> tuple[Value, ...]:
    return tuple(Value(text, UNCONVERGED) for text in texts)


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
        _not_converged("100.2") + values("105.851"),
        _not_converged("64.67") + values("58.483"),
        _not_converged("5.645") + values("5.732"),
        _not_converged("9.503") + values("9.935"),
        _not_converged("1.063") + values("1.0637"),
        _not_converged("1.106") + values("1.1107"),
        values("72.207"),
    ),
    Regular(
        0.015,
        _not_converged("87.18") + values("87.451"),
        _not_converged("50.05") + values("49.704"),
        _not_converged("16.86") + values("16.873"),
        _not_converged("25.92") + values("25.973"),
        values("1.189", "1.1888"),
        values("1.293", "1.2934"),
        values("79.189"),
    ),
    Regular(
        0.05,
        _not_converged("90.26") + values("90.420"),
        _not_converged("15.91") + values("15.692"),
        _not_converged("29.82") + values("29.839"),
        _not_converged("44.00") + values("44.049"),
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

# Fig. 5.8: by EI and c/c_cr, the maximum moment M2/(R2 T_ini) and the efficiency.
_FIGURE_5_8 = {
    0.0: ("2.280 1.703 0.814", "0.9566 0.9672 0.9840"),
    0.0015: ("2.056 1.510 0.683", "0.9609 0.9710 0.9867"),
    0.015: ("1.460 0.997 0.358", "0.9736 0.9823 0.9947"),
    0.05: ("0.606 0.305 0.024", "0.9940 0.9999 1.0055"),
}
SPEEDS = (0.0, 0.5, 0.8)
FIGURE_5_8 = {
    (EI, speed): (Value(moment), Value(efficiency))
    for EI, (moments, efficiencies) in _FIGURE_5_8.items()
    for speed, moment, efficiency in zip(SPEEDS, moments.split(), efficiencies.split(), strict=True)
}

# Largest M2 [N m] of the drive of Table 5.1, by EI.
LARGEST_OF_EQUAL = dict(
    zip((0.0, 0.0015, 0.015, 0.05), values("3.104", "3.043", "3.468", "2.456"), strict=True)
)
