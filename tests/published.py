"""Printed and converged values of chapter 3, each with the digits it is known to."""

import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.physics.steady import SteadyModel
from beltjax.validation.printed import steady as printed
from beltjax.validation.printed.steady import ARM, BETA, BETA_INEFFECTIVE, EVEN, TABLE_3_3
from beltjax.validation.printed.value import Value

# The prototype of Tables 3.2 and 4.1; span lengths as its geometry gives them.
SPANS = np.array([0.15479868, 0.34489550, 0.55182632])
RADII, SIDES = np.array(printed.RADII), np.array(printed.SIDES)


def prototype(eps, s, P=EVEN, beta=BETA) -> SteadyModel:
    """The source's dimensionless model, with its own rounded k_s, gamma, r_t and angles."""
    mean, (beta_in, beta_out) = SPANS.mean(), np.radians(beta)
    curvature = SIDES / RADII
    lam, rho, one = SPANS / mean, ARM / mean, jnp.ones(3)
    model = SteadyModel(
        eps=eps * one,
        c2=s**2 * one,
        give=np.array([np.sum(lam) / printed.STRETCH]),
        belts=np.ones((1, 3)),
        P=np.array(P),
        lam=lam,
        kap_s=SPANS * curvature,
        kap_e=SPANS * np.roll(curvature, -1),
        S=rho * np.array([[-np.sin(beta_in)], [np.sin(beta_out)], [0.0]]),
        a=(ARM / SPANS * np.array([np.cos(beta_in), -np.cos(beta_out), 0.0]))[:, None],
        W0=(ARM / SPANS * np.array([0.0, np.cos(beta_out), 0.0]))[:, None],
        H=np.zeros((3, 1, 1)),
        K=np.array([[printed.SPRING * rho]]),
        movable=np.ones(1),
        lo=np.array([-np.inf]),
        hi=np.array([np.inf]),
        rho=np.zeros(1),
    )
    return SteadyModel(*(jnp.asarray(value, dtype=float) for value in model))


def assert_matches_print(computed, value: Value) -> None:
    """Agreement to half a unit of the last printed digit, or a listed misprint that stands."""
    matches = value.matches(float(computed))
    if value.misprint:
        assert not matches, f"{value.text} is listed as a misprint but agrees"
    else:
        assert matches, f"computed {float(computed):.10g}, printed {value.text}"


# Gamma at s = 0, P = 1, converged; and the two curves of Fig. 3.10 (eps = 0.015).
COUPLING = {0.01: "2.747613", 0.015: "4.117255", 0.04: "10.474645", 0.05: "12.617198"}
COUPLING_LEADING = {0.05: "13.73"}
FIGURE_3_10 = [
    (BETA, 0.0, "4.117"),
    (BETA, 0.8, "4.420"),
    (BETA_INEFFECTIVE, 0.0, "4.022"),
    (BETA_INEFFECTIVE, 0.8, "5.805"),
]


# Largest w_i of Figs. 3.12 and 3.13, by method and span.
PEAKS = {
    TABLE_3_3[0].id: {
        ("exact", 0): Value("6.05e-3"),
        ("leading", 0): Value("6.37e-3"),
        ("linear", 0): Value("6.93e-3"),
        ("exact", 2): Value("-8.68e-4"),
        ("leading", 2): Value("-8.68e-4"),
        ("linear", 2): Value("-12.5e-4"),
    },
    TABLE_3_3[1].id: {
        ("exact", 0): Value("12.3e-3"),
        ("leading", 0): Value("12.6e-3"),
        ("linear", 0): Value("19.4e-3"),
        ("exact", 2): Value("-5.88e-4", "0.0005875 rounds to 5.87e-4"),
        ("leading", 2): Value("-5.87e-4"),
        ("linear", 2): Value("-10.95e-4"),
    },
}

cases = pytest.mark.parametrize("case", TABLE_3_3, ids=lambda case: case.id)


def model_of(case: printed.Case) -> SteadyModel:
    """The source's model of a row of Table 3.3."""
    return prototype(case.eps, case.s, case.P)
