"""The largest torques of a drive, of a belt that lies on its pulleys or wedges in grooves."""

from beltjax.analysis.contact import ContactState, Law
from beltjax.analysis.contact import maximum_moment as maximum_contact_moment
from beltjax.analysis.groove import GrooveState, solved_groove
from beltjax.analysis.groove_methods import AdhesionLimit, Groove, SlipLimit, ThinGroove
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive


def maximum_moment(
    drive: Drive,
    point: OperatingPoint,
    *,
    limit: SlipLimit | AdhesionLimit | None = None,
    law: Law = "kong",
    method: Groove | ThinGroove | None = None,
    throw: bool = True,
) -> ContactState | GrooveState:
    """The state under the largest torques, all scaled by one `torque_factor`.

    Of a belt that lies flat it is `contact_state`, where a first pulley slips over its whole arc.
    A belt that wedges in grooves passes on ever more torque the more it slips; which limit is
    meant is said by `limit`. Two pulleys need no torque given: it acts on the one that does not
    drive. The results are those of `contact_state` or `groove_state`, and `no_torque_to_scale`.
    docs/contact.md, docs/grooves.md.

    Args:
        drive: a drive of one belt, or several flat ones.
        point: speeds, and torques whose proportion is kept.
        limit: of a belt in grooves `SlipLimit(0.05)` unless given, or `AdhesionLimit()`, which
            depends on the method's `slip_velocity`, below which friction is viscous.
        law: the belt law of a flat belt, as in `contact_state`.
        method: of a belt in grooves, as in `groove_state`.
        throw: raise where the result is a failure.

    Returns:
        The state under the largest torques, in SI units and listed order.

    Raises:
        KeyError: a torque is given for a pulley that is not there.
        ValueError: `limit` or `method` is given for a belt without grooves, or the drive is not
            one that the model describes.
        AnalysisError: the result is a failure, and `throw` is set.
    """
    if drive.belt.wedge_angle is not None:
        given = SlipLimit(drive.contact.slip_limit) if limit is None else limit
        return solved_groove(drive, point, method, given, throw)
    if limit is not None or method is not None:
        raise ValueError("limit and method belong to a belt with wedge_angle: leave them out.")
    return maximum_contact_moment(drive, point, law=law, throw=throw)
