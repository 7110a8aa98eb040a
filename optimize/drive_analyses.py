"""The analyses of one drive from which its quantities are measured."""

import functools
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from beltjax.analysis.contact import ContactState, contact_state, maximum_moment
from beltjax.analysis.damping import Damping
from beltjax.analysis.groove import GrooveState, groove_state
from beltjax.analysis.groove_methods import groove_method
from beltjax.analysis.linearization import Linearization, linearize
from beltjax.analysis.modes import Modes, modes
from beltjax.analysis.motion import driver_speed
from beltjax.analysis.orders import ORDER, orders_of, single_order
from beltjax.analysis.parametric_margin import parametric_margin
from beltjax.analysis.periodic import PeriodicResponse, periodic_response
from beltjax.analysis.response import Response, frequency_response
from beltjax.analysis.slip_margin import SlipMargin, margins_about, shaken_by
from beltjax.analysis.slip_stability import (
    SlipStability,
    asked_of_slip,
    failure_of,
    stability_about,
)
from beltjax.analysis.steady import SteadyState
from beltjax.drive.canonical import canonical, strongly_typed
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.numerics.bases import Legendre
from beltjax.results import RESULTS, succeeded

MODES = 8  # natural modes that a study computes
BASIS = Legendre(12)  # gives frequencies to about 0.1 %
MODAL_DAMPING = 0.02  # of forced vibration, beside the arm's own
HARMONICS, FUNCTIONS = 8, 12  # of periodic motion: about 0.1 % at moderate amplitudes

SPEEDS = 600 * np.pi / 30, 6000 * np.pi / 30  # of parametric resonance, of the driver [rad/s]
_TONGUE_MODES = 8  # whose pairs are looked at

# Properties with a result.
_CONTACT = "contact", "slipping", "groove"
_VIBRATION = "modes", "response", "periodic", "margins", "tongues"


class LeastTongues(NamedTuple):
    """The tongues that are reached first, of every order of the excitation."""

    factors: Float[Array, " tongues"]  # by which the excitation may grow
    result: RESULTS


class DriveAnalyses:
    """One drive with its analyses, each of which runs when a quantity first needs it.

    Arguments: the drive, its operating point and its steady state, which is at hand already.
    Functions under `quantity` take such an object and return an array.
    """

    def __init__(self, drive: Drive, point: OperatingPoint, steady: SteadyState):
        self.drive, self.point, self.steady = drive, point, steady
        self._squeal: dict[int, SlipStability] = {}

    @functools.cached_property
    def contact(self) -> ContactState:
        """The belt in contact with its pulleys, under the operating point's torques."""
        return contact_state(self.drive, self.point, throw=False)

    @functools.cached_property
    def slipping(self) -> ContactState:
        """The belt in contact with its pulleys, under the largest torques."""
        return maximum_moment(self.drive, self.point, throw=False)

    @functools.cached_property
    def groove(self) -> GrooveState:
        """The belt in the grooves of its pulleys, under the operating point's torques."""
        method = groove_method(self.drive)
        return groove_state(self.drive, self.point, method, throw=False)

    @functools.cached_property
    def linearization(self) -> Linearization:
        """The equations of small vibration about the steady state."""
        return linearize(self.steady, BASIS, throw=False)

    @functools.cached_property
    def modes(self) -> Modes:
        """The natural modes of lowest frequency."""
        return modes(self.linearization, MODES, route="hermitian", throw=False)

    @functools.cached_property
    def response(self) -> Response:
        """Forced vibration by the drive file's [excitation], at this speed of the driver."""
        shaken = self.point.excitation
        assert shaken is not None  # because the quantity needs "excitation"
        order, excitation = single_order(shaken)
        free = shaken.driver == "free"
        return frequency_response(
            linearize(self.steady, BASIS, free=True, throw=False) if free else self.linearization,
            order * self.driver_speed[None],
            excitation,
            self.drive.pulley_names,
            damping=Damping(modal=MODAL_DAMPING),
            throw=False,
        )

    @functools.cached_property
    def periodic(self) -> PeriodicResponse:
        """Periodic motion of finite amplitude by [excitation], at this speed of the driver."""
        return periodic_response(
            self.drive,
            self.point,
            harmonics=HARMONICS,
            functions=FUNCTIONS,
            damping=Damping(modal=MODAL_DAMPING),
            stability=False,
            throw=False,
        )

    def squeal(self, pulley: int) -> SlipStability:
        """The belt sliding on one pulley, at the onset of squeal."""
        if pulley not in self._squeal:
            name = self.drive.pulley_names[pulley]
            drive, point, place = asked_of_slip(self.drive, self.point, name, None)
            self._squeal[pulley] = stability_about(drive, point, self.steady, place, None)
        return self._squeal[pulley]

    @functools.cached_property
    def margins(self) -> SlipMargin:
        """What is left of friction under [excitation], by the linear response."""
        shaken = shaken_by(self.drive, self.point, None, ORDER)
        damping = strongly_typed(Damping(modal=MODAL_DAMPING))
        at = canonical(self.drive, self.point)
        return margins_about(*at, self.steady, shaken, damping, BASIS)

    @functools.cached_property
    def tongues(self) -> LeastTongues:
        """Parametric resonances under [excitation], at all speeds of the driver in `SPEEDS`."""
        shaken = self.point.excitation
        assert shaken is not None  # because the quantity needs "excitation"
        if shaken.orders:
            orders = list(orders_of(shaken).excitations.items())
        else:
            orders = [single_order(shaken)]
        factors, result = [], RESULTS.successful
        for order, excitation in orders:
            found = parametric_margin(
                self.drive,
                self.point,
                SPEEDS,
                excitation,
                damping=Damping(modal=MODAL_DAMPING),
                order=order,
                count=_TONGUE_MODES,
                basis=BASIS,
                throw=False,
            )
            factors.append(found.least)
            result = RESULTS.where(succeeded(result), found.result, result)
        return LeastTongues(jnp.concatenate(factors), result)

    @property
    def driver_speed(self) -> Float[Array, ""]:
        """The driver's angular speed [rad/s]."""
        return driver_speed(self.drive, self.point)

    def all_found(self) -> Bool[Array, ""]:
        """Return whether every analysis that has run found a state, slipping or not."""
        good = succeeded(self.steady.result)
        for result in self._results(_CONTACT):
            slips = (result == RESULTS.gross_slip) | (result == RESULTS.wrap_vanished)
            good = good & (succeeded(result) | slips)
        for result in (*self._results(_VIBRATION), *self._squeal_results()):
            good = good & succeeded(result)
        return good

    @property
    def result(self) -> RESULTS:
        """The first failure among the analyses that have run; the steady state comes first."""
        result = self.steady.result
        for own in (*self._results(_CONTACT + _VIBRATION), *self._squeal_results()):
            result = RESULTS.where(succeeded(result), own, result)
        return result

    def _squeal_results(self) -> list[RESULTS]:
        """Failures alone: that nothing squeals is an answer."""
        return [failure_of(found.result) for found in self._squeal.values()]

    def _results(self, analyses: tuple[str, ...]) -> list[RESULTS]:
        """The results of those analyses that have run: `vars` holds the cached properties."""
        return [getattr(self, name).result for name in analyses if name in vars(self)]
