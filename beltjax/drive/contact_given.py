"""How contact in grooves is computed, where nothing else is said."""

from typing import NamedTuple


class ContactGiven(NamedTuple):
    """The table [contact] of a drive file: the defaults of `groove_state` and `maximum_moment`.

    `model` is "full" or "thin"; `slip_velocity` is the sliding speed, over the belt's, below which
    friction is viscous; `slip_limit` is the slip at which `maximum_moment` ends.
    """

    model: str = "full"
    slip_velocity: float = 1e-5
    slip_limit: float = 0.05
