"""Chapter 4: frequencies of the string that captions print, and counts the text gives."""

from beltjax.validation.printed.value import Value

INERTIA = (
    "an extra factor r_i/r_t on each pulley's inertia gives 4.125 and 3.0951: "
    "the source very probably carries that slip"
)
# Captions of Figs. 4.2 to 4.4: omega at eps = 0, s = 0.
STRING = {
    "4.2": ("rotational", Value("4.1205", INERTIA)),
    "4.3": ("span 2", Value("3.0951", INERTIA)),
    "4.4": ("span 3", Value("1.9968", "pi l/l_3 = 1.99546 whatever the inertia")),
}
STIFFNESSES = (0.01, 0.04, 0.07, 0.1)  # eps of their panels

# Text on Fig. 4.7, s = 1: frequencies below omega = 11, by eps.
COUNTED_BELOW = 11.0
COUNTS = {
    0.1: Value("8"),
    0.01: Value(
        "16", "17 by a Legendre basis, and by the count of the exact characteristic function"
    ),
}
