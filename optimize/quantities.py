"""Named quantities of a running drive, for objectives and constraints (SI and radians).

A quantity is an array: one number, or one for each thing that the name covers ("clearance" has
one for each gap), so that a limit on it is a smooth limit on each.
"""

import difflib
import functools
import math
from collections.abc import Callable
from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from beltjax.analysis.contact import ContactState, contact_state, maximum_moment
from beltjax.analysis.damping import Damping
from beltjax.analysis.linearization import Linearization, has_inertias, linearize
from beltjax.analysis.modes import Modes, modes
from beltjax.analysis.response import Excitation, Response, frequency_response
from beltjax.analysis.steady import SteadyState
from beltjax.drive.buildable import clearances
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import Legendre
from beltjax.results import RESULTS, succeeded

MODES = 8  # natural modes that a study looks at
BASIS = Legendre(12)  # frequencies to about 0.1 %
MODAL_DAMPING = 0.02  # of forced vibration, beside the arm's own
ORDER = 2.0  # of forced vibration, unless the drive file says: four-cylinder firing


_OF_CONTACT, _OF_VIBRATION = ("contact", "slipping"), ("modes", "response")  # of `Answers`


class Answers:
    """What the analyses say of one drive, each asked when a quantity needs it, and once."""

    def __init__(self, drive: Drive, point: OperatingPoint, steady: SteadyState):
        self.drive, self.point, self.steady = drive, point, steady

    @functools.cached_property
    def contact(self) -> ContactState:
        """Belt and pulleys in contact, under the operating point's torques."""
        return contact_state(self.drive, self.point, throw=False)

    @functools.cached_property
    def slipping(self) -> ContactState:
        """The same under the largest torques."""
        return maximum_moment(self.drive, self.point, throw=False)

    @functools.cached_property
    def linearization(self) -> Linearization:
        """Small vibration about the steady state."""
        return linearize(self.steady, BASIS, throw=False)

    @functools.cached_property
    def modes(self) -> Modes:
        """The natural modes of lowest frequency."""
        return modes(self.linearization, MODES, route="hermitian", throw=False)

    @functools.cached_property
    def response(self) -> Response:
        """Forced vibration by what the drive file's [excitation] says, at this speed."""
        shaken = self.point.excitation
        assert shaken is not None  # as `quantity`'s callers hold
        order = ORDER if shaken.order is None else shaken.order
        crank = 0.0 if shaken.crank is None else shaken.crank
        return frequency_response(
            self.linearization,
            order * self.driver_speed[None],
            Excitation(crank, dict(shaken.torque)),
            self.drive.pulley_names,
            damping=Damping(modal=MODAL_DAMPING),
            throw=False,
        )

    @property
    def driver_speed(self) -> Float[Array, ""]:
        """Of the driver's rotation [rad/s]."""
        return self.point.speed(self.drive) / (self.drive.drives @ self.drive.radii)

    def found(self) -> Bool[Array, ""]:
        """Whether all that was asked so far has an answer, be it of a drive that slips."""
        good = succeeded(self.steady.result)
        for result in self._asked(_OF_CONTACT):
            slips = (result == RESULTS.gross_slip) | (result == RESULTS.wrap_vanished)
            good = good & (succeeded(result) | slips)
        for result in self._asked(_OF_VIBRATION):
            good = good & succeeded(result)
        return good

    @property
    def result(self) -> RESULTS:
        """The first failure of what was asked so far: the running belt, then what is made of it."""
        result = self.steady.result
        for own in self._asked(_OF_CONTACT + _OF_VIBRATION):
            result = RESULTS.where(succeeded(result), own, result)
        return result

    def _asked(self, analyses: tuple[str, ...]) -> list[RESULTS]:
        """Results of those analyses that were asked: a cached property is kept in `vars`."""
        return [getattr(self, name).result for name in analyses if name in vars(self)]


Measure = Callable[[Answers], Float[Array, " parts"]]


class Quantity(NamedTuple):
    """What a name in a study means."""

    name: str
    unit: str
    measure: Measure


class _Kind(NamedTuple):
    unit: str
    of: str  # "", "pulley", "span", "mode" or "order": what follows the colon
    measure: Callable[..., Float[Array, "..."]]  # of the answers, and of the place where named
    needs: str = ""  # "friction", "inertia" of every pulley; "excitation": that and inertias
    many: bool = False  # many numbers at once: fit to be limited, not to be minimized


def _hub_load(of: Answers, j: int):
    at, tensions = of.steady.reference.layout, of.steady.running_tensions
    pull = tensions[j] * at.directions[j] - tensions[j - 1] * at.directions[j - 1]
    # Parallel spans of equal tension round an idler leave no load; its direction is then free.
    return jnp.sqrt(jnp.sum(pull**2) + 1e-30)


def _slip_margin(of: Answers, j: int):
    friction = of.drive.pulleys[j].friction
    assert friction is not None  # as `_require_data` holds
    ratio = of.steady.effective_tensions[j] / of.steady.effective_tensions[j - 1]
    return friction * of.steady.reference.layout.wraps[j] - jnp.abs(jnp.log(ratio))


def _all_gaps(of: Answers):
    gaps = clearances(of.drive, of.steady.reference.layout)
    return jnp.concatenate([gaps.rims, gaps.belt.ravel()])


def _tightness(of: Answers):
    """Span tensions at rest and effective tensions running, over P0: all positive, or slack."""
    return jnp.concatenate([of.steady.groups.tensions, of.steady.effective_tensions])


def _order_distance(of: Answers, order: float):
    """How far each natural frequency is from `order` times the driver's speed."""
    return jnp.abs(of.modes.frequencies - order * of.driver_speed)


def _order_margin(of: Answers, order: float):
    """The same, over that frequency of excitation."""
    return _order_distance(of, order) / (order * of.driver_speed)


def _arm_amplitude(of: Answers):
    turning = of.response.arm_rotation[0]
    return jnp.sqrt(turning.real**2 + turning.imag**2 + 1e-60)


def _speed_ratio(of: Answers, j: int):
    return (of.drive.drives @ of.drive.radii) / of.drive.pulleys[j].radius


_KINDS = {
    "coupling": _Kind("", "", lambda of: jnp.sum(of.steady.coupling)),
    "coupling:": _Kind("", "span", lambda of, i: of.steady.coupling[i]),
    "tensioner_effectiveness": _Kind("", "", lambda of: of.steady.effectiveness),
    "wraps": _Kind("rad", "", lambda of: of.steady.reference.layout.wraps, many=True),
    "wrap:": _Kind("rad", "pulley", lambda of, j: of.steady.reference.layout.wraps[j]),
    "clearance": _Kind("m", "", _all_gaps, many=True),
    "tightness": _Kind("", "", _tightness, many=True),
    "speed_ratio:": _Kind("", "pulley", _speed_ratio),
    "tension:": _Kind("N", "span", lambda of, i: of.steady.running_tensions[i]),
    "hub_load:": _Kind("N", "pulley", _hub_load),
    "slip_margin:": _Kind("", "pulley", _slip_margin),
    "path_length": _Kind("m", "", lambda of: of.steady.reference.layout.path_length),
    "belt_length": _Kind("m", "", lambda of: of.steady.reference.unstretched_length),
    "span_length:": _Kind("m", "span", lambda of, i: of.steady.reference.layout.span_lengths[i]),
    "efficiency": _Kind("", "", lambda of: of.contact.efficiency, needs="friction"),
    "adhesion:": _Kind("rad", "pulley", lambda of, j: of.contact.adhesions[j], needs="friction"),
    "contact_wrap:": _Kind("rad", "pulley", lambda of, j: of.contact.wraps[j], needs="friction"),
    "torque_factor": _Kind("", "", lambda of: of.slipping.torque_factor, needs="friction"),
    "maximum_moment": _Kind("N m", "", lambda of: of.slipping.driver_moment, needs="friction"),
    "span_lengths": _Kind("m", "", lambda of: of.steady.reference.layout.span_lengths, many=True),
    "arm_rotation": _Kind("rad", "", lambda of: of.steady.arm_rotation),
    "frequency:": _Kind("rad/s", "mode", lambda of, k: of.modes.frequencies[k], "inertia"),
    "order_distance:": _Kind("rad/s", "order", _order_distance, "inertia", many=True),
    "order_margin:": _Kind("", "order", _order_margin, "inertia", many=True),
    "span_amplitude:": _Kind("m", "span", lambda of, i: of.response.span_peaks[0, i], "excitation"),
    "arm_amplitude": _Kind("rad", "", _arm_amplitude, "excitation"),
}


def is_many(name: str) -> bool:
    """Whether a quantity is many numbers at once: fit to be limited, not to be minimized."""
    word, colon, _ = name.partition(":")
    return _KINDS[word + colon].many


def is_forced(name: str) -> bool:
    """Whether a quantity needs the drive file's [excitation]."""
    word, colon, _ = name.partition(":")
    return _KINDS[word + colon].needs == "excitation"


def quantity(name: str, drive: Drive) -> Quantity:
    """The quantity of that name; raises `KeyError` with a text that lists what there is."""
    word, colon, place = name.partition(":")
    kind = _KINDS.get(word + colon)
    if kind is None:
        close = difflib.get_close_matches(word, [k.rstrip(":") for k in _KINDS], n=1)
        meant = f"did you mean {close[0]!r}? There are" if close else "give one of"
        known = ", ".join(k + _PLACES[v.of] for k, v in _KINDS.items())
        raise KeyError(f"there is no quantity {name!r}; {meant} {known}")
    places = (_place(kind.of, place, drive),) if kind.of else ()
    _require_data(name, kind, drive, places)
    return Quantity(name, kind.unit, lambda of: jnp.atleast_1d(kind.measure(of, *places)))


_PLACES = {"": "", "pulley": "NAME", "span": "SPAN", "mode": "K", "order": "N"}


def _place(of: str, place: str, drive: Drive) -> int | float:
    """What follows the colon, as a measure takes it; modes are counted from 1 in names."""
    if of == "pulley":
        return drive.pulley(place)
    if of == "span":
        return drive.span(place)
    try:
        number = float(place)
    except ValueError:
        number = math.nan
    if of == "mode":
        if number not in range(1, MODES + 1):
            raise KeyError(f"there is no mode {place!r}; give one of 1 to {MODES}")
        return int(number) - 1
    if not 0 < number < math.inf:
        raise KeyError(f"{place!r} is no order of the driver's speed; give a number such as 2")
    return number


def _require_data(name: str, kind: _Kind, drive: Drive, places: tuple[int | float, ...]) -> None:
    word = name.partition(":")[0]
    if word == "tensioner_effectiveness" and drive.tensioner is None:
        raise KeyError("this drive has no tensioner")
    if kind.needs in ("inertia", "excitation") and not has_inertias(drive):
        raise KeyError(f"{name!r} needs the inertia of every pulley and of the arm; add them")
    lacking = [pulley.name for pulley in drive.pulleys if pulley.friction is None]
    if word == "slip_margin":
        lacking = [bare for bare in lacking if bare == drive.pulleys[int(places[0])].name]
    elif kind.needs != "friction":
        lacking = []
    if lacking:
        missing = f"pulley {lacking[0]!r} has no friction, which {name!r} needs"
        raise KeyError(f"{missing}; add it to the drive file")
