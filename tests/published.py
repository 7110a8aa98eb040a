"""Printed and converged values of chapter 3, each with the digits it is known to."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
import pytest

from beltjax.physics.steady import SteadyModel

# The prototype of Tables 3.2 and 4.1; span lengths as its geometry gives them.
SPANS = np.array([0.15479868, 0.34489550, 0.55182632])
RADII = np.array([0.0889, 0.0452, 0.02697])
SIDES = np.array([1.0, -1.0, 1.0])
ARM = 0.097
BETA = (135.79, 178.74)
BETA_INEFFECTIVE = (68.53, 111.47)
EVEN, LOADED = (1.0, 1.0, 1.0), (0.9395, 0.9395, 1.5395)


def prototype(eps, s, P=EVEN, beta=BETA) -> SteadyModel:
    """The source's dimensionless model, with its own rounded k_s, gamma, r_t and angles."""
    mean, (beta_in, beta_out) = SPANS.mean(), np.radians(beta)
    curvature = SIDES / RADII
    model = SteadyModel(
        eps=eps,
        s=s,
        gam=400.0,
        k_s=4.0,
        P=np.array(P),
        lam=SPANS / mean,
        kap_s=SPANS * curvature,
        kap_e=SPANS * np.roll(curvature, -1),
        a=ARM / SPANS * np.array([np.cos(beta_in), -np.cos(beta_out), 0.0]),
        w_start=ARM / SPANS * np.array([0.0, np.cos(beta_out), 0.0]),
        D=np.sin(beta_in) - np.sin(beta_out),
        rho=ARM / mean,
    )
    return SteadyModel(*(jnp.asarray(value, dtype=float) for value in model))


class Value(NamedTuple):
    """A number as printed: its digits are its tolerance."""

    text: str
    misprint: str = ""  # why the model does not give it; empty where it does

    @property
    def number(self) -> float:
        return float(self.text)

    @property
    def half_digit(self) -> float:
        mantissa, _, exponent = self.text.lower().partition("e")
        decimals = len(mantissa.partition(".")[2])
        return 0.5 * 10.0 ** (int(exponent or 0) - decimals)


def assert_matches_print(computed, value: Value) -> None:
    """Agreement to half a unit of the last printed digit, or a listed misprint that stands."""
    matches = abs(float(computed) - value.number) <= value.half_digit * (1 + 1e-9)
    if value.misprint:
        assert not matches, f"{value.text} is listed as a misprint but agrees"
    else:
        assert matches, f"computed {float(computed):.10g}, printed {value.text}"


TRUNCATED = "solver tolerance of the source is 1e-3: the last printed digit is not converged"


class Case(NamedTuple):
    """One case of Table 3.3 and its figure of deflections."""

    id: str
    model: SteadyModel
    T: tuple[Value, ...]  # every value known for the exact T
    T_leading: tuple[Value, ...]
    th: tuple[Value, ...]
    th_leading: tuple[Value, ...]
    peaks: dict[tuple[str, int], Value]  # of w_i, by method and span


def values(*texts: str) -> tuple[Value, ...]:
    return tuple(Value(text) for text in texts)


TABLE_3_3 = [
    Case(
        "case 1, Fig. 3.12",
        prototype(0.01, 0.6),
        (Value("0.2828", TRUNCATED), Value("0.282674")),
        values("0.2836", "0.28359"),
        values("-0.0106", "-0.010581"),
        values("-0.0113", "-0.01132"),
        {
            ("exact", 0): Value("6.05e-3"),
            ("leading", 0): Value("6.37e-3"),
            ("linear", 0): Value("6.93e-3"),
            ("exact", 2): Value("-8.68e-4"),
            ("leading", 2): Value("-8.68e-4"),
            ("linear", 2): Value("-12.5e-4"),
        },
    ),
    Case(
        "case 2, Fig. 3.13",
        prototype(0.01, 0.9, LOADED),
        (Value("0.6408", TRUNCATED), Value("0.640668")),
        (Value("0.6417"), Value("0.64166", "0.641652 rounds to 0.64165")),
        values("-0.0247", "-0.024716"),
        values("-0.0255", "-0.02546"),
        {
            ("exact", 0): Value("12.3e-3"),
            ("leading", 0): Value("12.6e-3"),
            ("linear", 0): Value("19.4e-3"),
            ("exact", 2): Value("-5.88e-4", "0.0005875 rounds to 5.87e-4"),
            ("leading", 2): Value("-5.87e-4"),
            ("linear", 2): Value("-10.95e-4"),
        },
    ),
]

# Gamma at s = 0, P = 1, converged; and the two curves of Fig. 3.10 (eps = 0.015).
COUPLING = {0.01: "2.747613", 0.015: "4.117255", 0.04: "10.474645", 0.05: "12.617198"}
COUPLING_LEADING = {0.05: "13.73"}
FIGURE_3_10 = [
    (BETA, 0.0, "4.117"),
    (BETA, 0.8, "4.420"),
    (BETA_INEFFECTIVE, 0.0, "4.022"),
    (BETA_INEFFECTIVE, 0.8, "5.805"),
]


def case_id(case: Case) -> str:
    return case.id


cases = pytest.mark.parametrize("case", TABLE_3_3, ids=case_id)
