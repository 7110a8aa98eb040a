"""Steady states of one drive at several operating points, by one compiled program."""

from collections.abc import Mapping

import equinox as eqx
import jax
from jaxtyping import Array, Bool

from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.compiling.quick import boundary_jit
from beltjax.drive.canonical import canonical
from beltjax.drive.duties import at_belt_speeds
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.results import RESULTS, succeeded

_FEW = 4  # numbers of duties are filled up to a multiple of this, so that few shapes compile


def duty_states(drive: Drive, duties: Mapping[str, OperatingPoint]) -> SteadyState:
    """The steady states of a drive at all its duties, which are found together.

    It raises nothing for numbers: read `.result`, one for each duty. A duty that fails holds finite
    placeholders with zero derivatives, as in `steady_state`, and does not affect the others.

    Args:
        drive: the drive.
        duties: at least one operating point by its name, as `load_duties` gives them; some may have
            a belt speed and some a driver speed, loads or torques.

    Returns:
        The state of each duty along a leading axis of all arrays, in the order of `duties`.

    Raises:
        KeyError: a torque or a load is given for a pulley that is not there.
        ValueError: there are no duties.

    Examples:
        >>> drive, duties = bj.load_duties("examples/three_pulley.toml")
        >>> bj.duty_states(drive, duties).running_tensions  # [duties, spans] [N]
    """
    canonical_drive, points, outside = duty_numbers(drive, duties)
    states = steady_states(canonical_drive, points)
    off = outside & succeeded(states.result) & succeeded(states.warning)
    warning = jax.vmap(_warning)(off, states.warning)
    warned = eqx.tree_at(lambda state: state.warning, states, warning)
    return of_duties(warned, len(duties))


def _warning(off: Bool[Array, ""], other: RESULTS) -> RESULTS:
    return RESULTS.where(off, RESULTS.load_outside_table, other)


def duty_numbers(
    drive: Drive, duties: Mapping[str, OperatingPoint]
) -> tuple[Drive, OperatingPoint, Bool[Array, " duties"]]:
    """The canonical drive, and its duties as one point [duties], filled up with the last one.

    The third says which of them are outside of the table of a load.
    """
    if not duties:
        raise ValueError("duties: found none; give at least one operating point.")
    points = [*duties.values()]
    points += points[-1:] * (-len(points) % _FEW)
    point, outside = at_belt_speeds(drive, points)
    return *canonical(drive, point), outside


def of_duties(states: SteadyState, count: int) -> SteadyState:
    """The first `count` of some states."""
    return jax.tree.map(lambda x: x[:count], states)


@boundary_jit
def steady_states(drive: Drive, points: OperatingPoint) -> SteadyState:
    """`steady_state` at points of equal structure [points], whose failures are in its results."""
    return jax.vmap(lambda point: steady_state(drive, point, throw=False))(points)
