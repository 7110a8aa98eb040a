"""Chapter 3: the prototype's numbers, its steady states and tensioner effectiveness."""

from typing import NamedTuple

from beltjax.validation.printed.value import Value, values

# Tables 3.2 and 4.1, what is given: [m], [N], [N m/rad], [kg/m], [kg m^2].
CENTERS = ((0.5525, 0.0556), (0.3477, 0.05715), (0.0, 0.0))
PIVOT = (0.2508, 0.0635)
RADII = (0.0889, 0.0452, 0.02697)
SIDES = (1.0, -1.0, 1.0)
ARM = 0.097
AXIAL_STIFFNESS = 120000.0
TENSION = 300.0
ARM_STIFFNESS = 116.4
MASS_PER_LENGTH = 0.1029
INERTIAS = (0.07248, 0.000293, 0.000293)
ARM_INERTIA = 0.001165

# Orientations of the arm [deg], and the dimensionless numbers of all figures.
BETA, BETA_HALF, BETA_INEFFECTIVE = (135.79, 178.74), (95.53, 138.47), (68.53, 111.47)
SPRING, STRETCH = 4.0, 400.0
EVEN, LOADED = (1.0, 1.0, 1.0), (0.9395, 0.9395, 1.5395)

ROUNDED_CENTERS = (
    "the printed centers, rounded to 0.1 mm, put the pulley 0.097108 m from the pivot where r_t is "
    "printed as 0.097 m: the angles follow from them to 0.04 deg at best"
)
# What Tables 3.2 and 4.1 calculate from it.
SPAN_LENGTHS = values("0.1548", "0.3449", "0.5518")  # [m]
WIND_UP = Value("0.1688")  # theta_tr [rad]
BASE_TENSION = Value("300")  # [N]
ALIGNMENT = (Value("135.79", ROUNDED_CENTERS), Value("178.74"))  # beta_1, beta_2 [deg]
GROUPS = {"k_s": Value("4"), "gamma": Value("400")}

CUT = "0.785 cut after the second decimal, not rounded"
EFFECTIVENESS = {  # of the captions
    BETA: Value("0.78", CUT),
    BETA_HALF: Value("0.5"),
    BETA_INEFFECTIVE: Value("0"),
}

TRUNCATED = "solver tolerance of the source is 1e-3: the last printed digit is not converged"


class Case(NamedTuple):
    """A row of Table 3.3, every value known for each number: the printed first, then converged."""

    id: str
    eps: float
    s: float
    P: tuple[float, ...]
    T: tuple[Value, ...]
    T_leading: tuple[Value, ...]
    th: tuple[Value, ...]
    th_leading: tuple[Value, ...]


TABLE_3_3 = [
    Case(
        "case 1, Fig. 3.12",
        0.01,
        0.6,
        EVEN,
        (Value("0.2828", TRUNCATED), Value("0.282674")),
        values("0.2836", "0.28359"),
        values("-0.0106", "-0.010581"),
        values("-0.0113", "-0.01132"),
    ),
    Case(
        "case 2, Fig. 3.13",
        0.01,
        0.9,
        LOADED,
        (Value("0.6408", TRUNCATED), Value("0.640668")),
        (Value("0.6417"), Value("0.64166", "0.641652 rounds to 0.64165")),
        values("-0.0247", "-0.024716"),
        values("-0.0255", "-0.02546"),
    ),
]

# Figs. 3.4 and 3.9: the driver's largest torque M_1 [N m], and the P_1 it leaves.
LARGEST_TORQUE = 37.34
LEAST_TENSION = Value(
    "0.8119",
    "the source does not say how the belt on the pulleys stretches: 0.8131 under the mean of the "
    "adjacent tensions, 0.8589 if it does not and the angles are held, which is the rule that "
    "gives the 0.9395 of Fig. 3.13",
)
