"""Chapter 5: Tables 5.1 to 5.3 and Figs. 5.4 to 5.8, belts in contact with two pulleys."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array

import beltjax as bj
from beltjax.analysis.contact import ContactState, contact_question, contact_solution
from beltjax.compiling.quick import quickly_compiled
from beltjax.validation.drives import two_pulleys
from beltjax.validation.printed import contact as printed
from beltjax.validation.verdicts import MISPRINT, Line, compared

LOADED = tuple(EI for EI in printed.STIFFNESSES if EI)  # those whose belt is drawn
SPEEDS = np.linspace(0.0, 0.8, 17)  # C = c/c_cr of Fig. 5.8
HALF = int(np.argmin(np.abs(SPEEDS - 0.5)))  # that of Fig. 5.7
# The belt runs in the listed order and leaves the driver, listed first, slack.
SLACK, TIGHT = 0, 1


class SolvedDrives(NamedTuple):
    """One drive's states over EI, and over speed where it is varied: [EI][speed]."""

    drives: list[bj.Drive]
    states: list[list[ContactState]]


def equal_pulleys() -> tuple[bj.Drive, bj.OperatingPoint]:
    """Table 5.1."""
    R, d, EA, mu, tension = (printed.EQUAL[k] for k in ("R", "L", "EA", "mu", "tension"))
    drive = two_pulleys(R, R, d, EA, printed.ANY_MASS, mu, tension)
    torque = {"driven": printed.EQUAL["M2"]}
    point = bj.OperatingPoint(
        driver_speed=printed.EQUAL["omega_1"], mass_flow=printed.EQUAL["G"], torque=torque
    )
    return drive, point


def unequal_pulleys() -> bj.Drive:
    """Table 5.3."""
    names = ("R1", "R2", "L", "EA", "m0", "mu", "tension")
    return two_pulleys(*(printed.UNEQUAL[name] for name in names))


def regular() -> SolvedDrives:
    """The drive of Table 5.1 under its torque, for each EI of Table 5.2."""
    drive, point = equal_pulleys()
    stiff = jnp.asarray(printed.STIFFNESSES)
    batch = quickly_compiled(_regular)(drive, point, stiff)
    return SolvedDrives(
        [_with(drive, EI) for EI in stiff], [[_lane(batch, k)] for k in range(len(stiff))]
    )


def largest() -> SolvedDrives:
    """The drive of Table 5.3 under its largest torque, over EI and speed."""
    drive = unequal_pulleys()
    stiff = jnp.asarray(printed.STIFFNESSES)
    EI, C = (x.ravel() for x in jnp.meshgrid(stiff, jnp.asarray(SPEEDS), indexing="ij"))
    batch = quickly_compiled(_largest)(drive, EI, C * printed.CRITICAL_SPEED)
    lanes = iter(range(len(EI)))
    states = [[_lane(batch, next(lanes)) for _ in SPEEDS] for _ in stiff]
    return SolvedDrives([_with(drive, one) for one in stiff], states)


def _with(drive: bj.Drive, EI: Any) -> bj.Drive:
    return eqx.tree_at(lambda d: d.belt.bending_stiffness, drive, EI)


def _regular(drive: bj.Drive, point: bj.OperatingPoint, stiff: Array) -> ContactState:
    def at(EI: Array) -> ContactState:
        return contact_solution(_with(drive, EI), point, *contact_question("kong", False))

    return eqx.filter_vmap(at)(stiff)


def _largest(drive: bj.Drive, stiff: Array, speeds: Array) -> ContactState:
    def at(EI: Array, speed: Array) -> ContactState:
        point = bj.OperatingPoint(belt_speed=speed, torque={"driven": 1.0})
        return contact_solution(_with(drive, EI), point, *contact_question("kong", True))

    return eqx.filter_vmap(at)(stiff, speeds)


def _lane(batch: ContactState, k: int) -> ContactState:
    return jax.tree.map(lambda x: x[k], batch)


def fixed_boundaries(drive: bj.Drive) -> bj.SteadyState:
    """The belt by the model of chapter 3, for the tensions and the speed of Table 5.1."""
    _, point = equal_pulleys()
    speed = printed.EQUAL["omega_1"] * printed.EQUAL["R"]
    mass = printed.EQUAL["G"] / speed
    drive = eqx.tree_at(lambda d: d.belt.mass_per_length, drive, jnp.asarray(mass))
    point = bj.OperatingPoint(belt_speed=speed, torque=point.torque)
    return bj.steady_state(drive, point)


def tables(solved: SolvedDrives) -> list[Line]:
    """What Tables 5.1 and 5.3 calculate, and Table 5.2."""
    m0, EA, tension = (printed.UNEQUAL[name] for name in ("m0", "EA", "tension"))
    critical = np.sqrt(tension / (m0 * (1 + tension / EA)))
    return [
        compared("Table 5.1", "L = pi R1 (m)", printed.EQUAL_SPAN, printed.EQUAL["L"]),
        *_table_5_2(solved),
        Line("Table 5.3", "unit of m0", "kg/s", "kg/m", MISPRINT, printed.UNIT),
        compared("Table 5.3", "c_cr (m/s)", printed.CRITICAL, critical),
    ]


def _table_5_2(solved: SolvedDrives) -> Iterator[Line]:
    for row, (state,) in zip(printed.TABLE_5_2, solved.states, strict=True):
        distance = printed.EQUAL["L"]
        for name, known, number in (
            ("beta_1 = beta_2 (deg)", row.slip, np.degrees(state.slips[0])),
            ("alpha_1 = alpha_2 (deg)", row.adhesion, np.degrees(state.adhesions[0])),
            ("theta_1(0) (deg)", row.tight, -np.degrees(state.angles[TIGHT, 1])),
            ("-theta_2(0) (deg)", row.slack, np.degrees(state.angles[SLACK, 0])),
            ("L1/L", row.tight_length, state.span_lengths[TIGHT] / distance),
            ("L2/L", row.slack_length, state.span_lengths[SLACK] / distance),
        ):
            yield compared("Table 5.2", f"{name}, EI = {row.EI:g}", known[0], number)


def departures(state: ContactState) -> np.ndarray:
    """Angles of Fig. 5.7 [deg]: of the tight span at driver and driven, then of the slack one."""
    tight, slack = state.angles[TIGHT], state.angles[SLACK]
    return np.abs(np.degrees([tight[1], tight[0], slack[0], slack[1]]))
