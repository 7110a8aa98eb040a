"""Converged values of chapter 5 beside the printed ones, with the digits they are known to."""

from beltjax.validation.printed.contact import CRITICAL_SPEED as CRITICAL_SPEED
from beltjax.validation.printed.contact import FIGURE_5_7 as FIGURE_5_7
from beltjax.validation.printed.contact import TABLE_5_2 as TABLE_5_2
from beltjax.validation.printed.value import Value, values

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
