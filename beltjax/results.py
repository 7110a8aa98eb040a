"""How a computation ended, and what to try when it did not end well.

The members extend optimistix's, so that a result of ours compares with a result of theirs.
Each text says what happened and names the remedy; it is what `throw=True` raises.
"""

from typing import TYPE_CHECKING, Any, TypeVar

import jax
import numpy as np
import optimistix as optx
from jax.core import Tracer
from jaxtyping import Array, Bool

from beltjax.numerics.derivative_rules import frozen_unless

Value = TypeVar("Value")


class AnalysisError(RuntimeError):
    """An analysis failed: what happened, and what to try. `result` is its member of `RESULTS`."""

    def __init__(self, text: str, result: Any):
        super().__init__(text)
        self.result = result


if TYPE_CHECKING:
    # An Equinox enumeration is made by its metaclass; to a type checker its members are
    # plain attributes, which is how they are used.
    class RESULTS:
        """How a computation ended."""

        def __class_getitem__(cls, item: Any) -> str: ...
        def __eq__(self, other: object) -> Any: ...
        def __ne__(self, other: object) -> Any: ...
        def error_if(self, value: Value, pred: Any) -> Value:
            """`value`, which raises with this member's text where `pred`."""
            ...

        @classmethod
        def where(cls, pred: Any, a: Any, b: Any) -> "RESULTS":
            """`a` where `pred`, else `b`."""
            ...

        successful: "RESULTS"
        nonlinear_max_steps_reached: "RESULTS"
        numbers_unusable: "RESULTS"
        no_tangent: "RESULTS"
        contact_lost: "RESULTS"
        path_not_simple: "RESULTS"
        belt_does_not_fit: "RESULTS"
        belt_too_long: "RESULTS"
        belt_too_short: "RESULTS"
        belt_overstretched: "RESULTS"
        arm_at_stop: "RESULTS"
        tensioner_unstable: "RESULTS"
        span_slack: "RESULTS"
        belt_stiff_on_pulley: "RESULTS"
        tensioner_moves_far: "RESULTS"
        load_outside_table: "RESULTS"
        steady_state_not_found: "RESULTS"
        beam_unusable: "RESULTS"
        beyond_critical_speed: "RESULTS"
        frequency_not_found: "RESULTS"
        equations_nonfinite: "RESULTS"
        mesh_exhausted: "RESULTS"
        newton_failed: "RESULTS"
        singular_system: "RESULTS"
        drive_diverges: "RESULTS"
        drive_flutters: "RESULTS"
        span_slackens: "RESULTS"
        response_not_finite: "RESULTS"
        orbit_not_found: "RESULTS"
        orbit_unstable: "RESULTS"
        span_slack_in_motion: "RESULTS"
        slope_too_large: "RESULTS"
        belt_slips_in_motion: "RESULTS"
        too_many_steps: "RESULTS"
        motion_not_finite: "RESULTS"
        too_many_events: "RESULTS"
        grazing: "RESULTS"
        motion_has_modes: "RESULTS"
        no_negative_slope: "RESULTS"
        no_stick_slip: "RESULTS"
        onset_beyond_stick: "RESULTS"
        slides_back: "RESULTS"
        strongly_damped: "RESULTS"
        commensurate: "RESULTS"
        no_damping: "RESULTS"
        frequencies_not_isolated: "RESULTS"
        belt_too_stiff: "RESULTS"
        contact_pressure_lost: "RESULTS"
        wrap_vanished: "RESULTS"
        gross_slip: "RESULTS"
        contact_not_found: "RESULTS"
        groove_not_found: "RESULTS"
        groove_unresolved: "RESULTS"
        friction_blurred: "RESULTS"
        thin_groove_slides: "RESULTS"
        cushion_too_soft: "RESULTS"
        cushion_state_not_found: "RESULTS"
        no_torque_to_scale: "RESULTS"
        no_starting_design: "RESULTS"
        constraints_infeasible: "RESULTS"
        optimum_not_reached: "RESULTS"
        time_limit_reached: "RESULTS"

else:

    class _ReadableEnumeration(type(optx.RESULTS)):
        """An enumeration whose success, too, prints as a word."""

        def __getitem__(cls, item: Any):
            return super().__getitem__(item) or "successful"

    class RESULTS(optx.RESULTS, metaclass=_ReadableEnumeration):
        """How a computation ended."""

        numbers_unusable = (
            "A number of the drive is not finite, a radius, stiffness, mass, length or tension is "
            "not positive, or a load takes power from a pulley that stands still. Correct it "
            "before anything else."
        )
        no_tangent = (
            "Two neighboring pulleys have no common tangent: they lie inside each other, or "
            "overlap where the belt crosses between them. Move them apart or shrink them."
        )
        contact_lost = (
            "The belt does not touch one of its pulleys: a wrap angle is zero or negative. "
            "`layout.wraps` shows which. Move that pulley into the belt, or change its face."
        )
        path_not_simple = (
            "The pulleys do not give a closed path that goes round once. Check the order of "
            "the pulleys, the sense in which they are listed, and their faces."
        )
        belt_does_not_fit = (
            "No arm angle and tension near the drawn ones hold this belt on this layout. Check "
            "belt_length and free_angle, or lower the torques or raise the tension that they move."
        )
        belt_too_long = (
            "The belt is too long for this layout: it hangs slack at rest. Shorten belt_length "
            "or turn free_angle so that the tensioner takes up more belt."
        )
        belt_too_short = (
            "The belt is too short for this layout: it would be stretched by more than a tenth. "
            "Lengthen belt_length or move the pulleys closer together."
        )
        belt_overstretched = (
            "The running belt would be stretched by more than a tenth. Lower the belt speed, or "
            "raise the tension that keeps its spans straight."
        )
        arm_at_stop = (
            "The tensioner's arm would pass one of its stops. Widen tensioner.stops, or change "
            "the belt length, the tension or the torques."
        )
        tensioner_unstable = (
            "The springs do not hold a tensioner against the belt: it is over center and snaps "
            "away. Raise its stiffness, or turn the arm so that its pulley moves into the belt."
        )
        span_slack = (
            "A span has lost its tension. Raise the pretension or lower the belt speed or the "
            "torques; `reference.tensions` shows the spans' tensions at rest."
        )
        tensioner_moves_far = (
            "A tensioner moves by more than 0.1 rad, or a tenth of a mean span, where the model is "
            "linear in its motion. Compare with [model] stretching_arcs, which is exact for the "
            "string, or with `contact_state`."
        )
        belt_stiff_on_pulley = (
            "The belt is stiff for a pulley: sqrt(EI/T)/radius is above 0.15, so that it touches "
            "elsewhere than a string would. `steady.stiffness_ratios` shows which pulley; "
            "`contact_state` finds where the belt really touches."
        )
        load_outside_table = (
            "A pulley turns faster or slower than the table of its load says; the torque at the "
            "end of the table is held. Extend the table, or change the speed."
        )
        steady_state_not_found = (
            "The search for the running tension did not end. Look for a number that is far out of "
            "the ordinary: bending stiffness, tension, belt speed."
        )
        beam_unusable = (
            "The bending of a moving beam is negative, or its bending or speed is not finite. "
            "Bending is sqrt(EI/P)/L, 0 for a string."
        )
        beyond_critical_speed = (
            "The beam moves at its critical speed or faster: it diverges, and its lowest frequency "
            "is gone. Lower the speed or raise the tension. (The perturbation stops at speed 1; "
            'method="exact" goes on to v^2 = 1 + (pi bending)^2 or more.)'
        )
        frequency_not_found = (
            "The search for a frequency did not end. Look for a bending or a speed that is far "
            "out of the ordinary."
        )
        equations_nonfinite = (
            "The equations gave inf or nan where the search began. Check the guess and the "
            "arguments for values outside the equations' domain."
        )
        mesh_exhausted = (
            "The estimated error is above the tolerance on the finest mesh allowed; the best "
            "solution found and its `error` are returned. Raise nodes or max_nodes, loosen tol, "
            "or reach a thin layer by continuation from a thicker one (`continue_bvp`)."
        )
        newton_failed = (
            "Newton's method did not converge to a solution of the boundary value problem. "
            "Give a closer guess, or follow the solution from an easier problem "
            "(`continue_bvp`). There may also be no solution."
        )
        singular_system = (
            "The linearized boundary value problem is singular, or so ill-conditioned that "
            "rounding alone exceeds the tolerance: a condition is missing or repeated, the data "
            "sit on an eigenvalue or resonance, or at a fold (`follow_branch` passes folds)."
        )
        drive_diverges = (
            "The running drive is unstable without oscillating: a mode grows at frequency zero. "
            "Lower the belt speed or raise the pretension; `growth_rates` shows how fast."
        )
        drive_flutters = (
            "The running drive is unstable: an oscillation grows. Lower the belt speed or raise "
            "the pretension; `growth_rates` shows which mode."
        )
        span_slackens = (
            "The fluctuation of a span's tension exceeds its running tension: there it goes slack, "
            "and linear amplitudes do not hold. `response.slack_factors` shows which span and from "
            "which part of the excitation on; lower that, or raise the tension."
        )
        response_not_finite = (
            "No finite motion answers this excitation: it is at a resonance without damping, or "
            "its frequency or amplitude is far out of the ordinary. Lower them, or add damping."
        )
        orbit_not_found = (
            "No periodic motion was found that grows from rest up to this excitation: on the way "
            "it folds back, or loses its period. Lower the amplitude, add damping, change the "
            "speed, or give more harmonics and samples."
        )
        orbit_unstable = (
            "The periodic motion is unstable: a small disturbance grows, and the drive moves "
            "otherwise. `multipliers` shows how fast; near -1 the period doubles."
        )
        span_slack_in_motion = (
            "A span loses its tension during the motion, where slack is not in the model. "
            "`measures.slack_fractions` shows which span; lower the excitation or raise the "
            "tension."
        )
        slope_too_large = (
            "A span deflects by a slope above 0.2, where the equations for small slopes are "
            "inaccurate. `measures.slope_max` shows which span; lower the excitation or add "
            "damping."
        )
        belt_slips_in_motion = (
            "The tensions beside a pulley differ by more than its friction holds during the "
            "motion, and slip is not in the model. `friction_use` shows which pulley; lower the "
            "excitation or raise the tension."
        )
        too_many_steps = (
            "The motion took more steps in time than allowed. Shorten it, raise max_steps, use "
            'fewer functions, or method="implicit" for friction with a small friction_speed.'
        )
        motion_not_finite = (
            "The motion grew beyond all numbers: its excitation, a rate of its speed or a number "
            "of the drive is far out of the ordinary. Lower the excitation, or add damping."
        )
        too_many_events = (
            "Tensioners stick and slip, or clutches open and close, more often than is followed: "
            "32 times in a period of shooting, and max_events times in a transient. Look for "
            "friction that is far out of the ordinary, or give the friction a friction_speed."
        )
        grazing = (
            "An event of the motion only just happens: a tensioner that barely stops or slips, or "
            "a clutch that barely opens. Derivatives hold as long as it does; `conditioning` shows "
            "how clearly events are met. Change the excitation or the friction a little and "
            "compare."
        )
        motion_has_modes = (
            "A tensioner's dry friction holds (friction_speed = 0), or a joint is a decoupler or a "
            "rigid clutch: their equations change at events, which harmonic balance does not know. "
            "Give method=Shooting(), or a friction_speed."
        )
        no_negative_slope = (
            "Friction does not fall as the belt slides faster, so that steady sliding is stable at "
            "any speed. Nothing needs to be done; a law that falls has a friction_static above "
            "its friction."
        )
        no_stick_slip = (
            "Nothing sticks at this speed, and no oscillation lasts. Nothing needs to be done; "
            "`fold_speed` is the speed below which one would."
        )
        onset_beyond_stick = (
            "The damping is above critical_damping, so that steady sliding is stable at any speed, "
            "though friction falls. Nothing needs to be done."
        )
        slides_back = (
            "The mass meets the belt with its spring pulled farther than friction holds, and "
            "slides on against it: an oscillation that is not followed here. So it is on a fast "
            "belt with little damping; add damping, or lower the belt's speed."
        )
        strongly_damped = (
            "The damping is above 2.5 times the critical one of an oscillation, where slips creep "
            "back, and some are missed: the fold and the cycle are not sure. The onset is."
        )
        commensurate = (
            "A moving belt has no bending stiffness (EI = 0): the frequencies of its spans are "
            "multiples of each other, so that more modes resonate the more are counted, and no "
            "number of them answers. Give the belt its bending stiffness."
        )
        no_damping = (
            "The drive has no damping: each resonance is unstable from the smallest excitation on, "
            "and there is no critical one. Give damping, as modal ratio or of the belt."
        )
        frequencies_not_isolated = (
            "The exact frequencies could not be told apart. Use a finer basis for the first "
            "guess, or modes(..., exact=False)."
        )
        belt_too_stiff = (
            "The belt is too stiff for a pulley: even at rest its tension cannot bend it round, "
            "EI/(2 R^2) is above it. Enlarge the smallest pulley, raise the tension or take a "
            "belt of lower bending stiffness."
        )
        contact_pressure_lost = (
            "The belt does not press on a pulley any more: torque, speed and bending use up its "
            "tension. Raise the tension, or lower the torques or the speed."
        )
        wrap_vanished = (
            "The stiff belt does not wrap a pulley that takes torque: `wraps` shows which. Enlarge "
            "that pulley or its wrap, or take a belt of lower bending stiffness."
        )
        gross_slip = (
            "A pulley slips over its whole arc of contact: `slips` beside `wraps` shows which. "
            "Lower the torques, raise the tension, or give that pulley more wrap or friction."
        )
        cushion_too_soft = (
            "The belt sinks through its cushion: the pull on a pulley of radius R is above half of "
            "belt.cushion_radial R^2, where the layer is no longer thin. Raise belt.cushion_radial "
            "or the radii, or lower the tension."
        )
        cushion_state_not_found = (
            "No state of the belt on its cushion was found. The torques may be more than friction "
            "holds, the speed too high for the tension, or a pulley may lose contact: lower the "
            "torques or the speed, raise the tension, or give the pulleys more wrap. For a layer "
            "much harder than 1e8 N/m^2 take ThinCushion()."
        )
        contact_not_found = (
            "No shape of the belt was found that touches the pulleys. Look for a number far out "
            "of the ordinary: tension, bending stiffness, belt length, torques."
        )
        groove_not_found = (
            "No state of the belt in its grooves was found. The torques may be more than friction "
            "passes on (`maximum_moment` finds their limit), a span may have lost its tension, or "
            "a number is far out of the ordinary: wedge stiffness, belt length, friction."
        )
        groove_unresolved = (
            "The belt in a groove is not resolved: the moment of its friction is not that of its "
            "tensions. Give more elements, as `Groove(elements=800)`, or a larger slip_velocity."
        )
        thin_groove_slides = (
            "The belt slides over a whole arc in a groove, where the formulas for a belt that "
            "sinks in little end. Lower the torques, or take the full model, `Groove()`."
        )
        friction_blurred = (
            "The sliding speed below which friction is taken to be viscous moves the moments by "
            "more than a hundredth. Lower slip_velocity; `regularization` shows each number's part."
        )
        no_torque_to_scale = (
            "No accessory takes torque, so there is nothing to raise to its maximum. Give "
            "operation.torque the accessories' torques; their proportion is kept."
        )
        no_starting_design = (
            "No design within the bounds could be evaluated. Widen the bounds, or move them "
            "closer to a drive that runs."
        )
        constraints_infeasible = (
            "No design within the bounds meets all constraints. `design.constraints` shows by how "
            "much; relax that limit or widen the bounds."
        )
        optimum_not_reached = (
            "The optimizer stopped before it reached an optimum. Use more starts, or scale down "
            "the bounds."
        )
        time_limit_reached = (
            "The time limit ended the search before any start reached an optimum. Raise "
            "optimizer.time_limit, or go on from a checkpoint or with the design reached as a "
            "warm start."
        )


def first_failure(*checks: tuple[Bool[Array, ""], RESULTS]) -> RESULTS:
    """The result of the first check, in the order given, whose flag says that it failed."""
    result = RESULTS.successful
    for failed, why in reversed(checks):
        result = RESULTS.where(failed, why, result)
    return result


def raise_unless_successful(value: Value, result: RESULTS, throw: bool) -> Value:
    """`value`; raises with the text of `result` if that is a failure and `throw` is set.

    Raises `AnalysisError` outside of compiled code, where of a batch the first failure counts,
    and Equinox's own error from inside it.
    """
    if not throw:
        return value
    number = code(result)
    if isinstance(number, Tracer):
        return result.error_if(value, result != RESULTS.successful)
    failure = next(filter(None, explanations(result)), "")
    if failure:
        raise AnalysisError(failure, result)
    return value


def frozen_where_failed(state: Value, result: RESULTS) -> Value:
    """`state`, whose numbers carry no derivative where `result` is a failure."""
    return frozen_unless(succeeded(result), state)


def successes(result: RESULTS) -> np.ndarray:
    """Which of a batch of results are successes, on the host; compiles nothing."""
    return np.asarray(code(result)) == np.asarray(code(RESULTS.successful))


def explanation(result: RESULTS) -> str:
    """The text of a result: what happened, and what to try; empty where it is a success."""
    return explanations(result)[0]


def explanations(result: RESULTS) -> tuple[str, ...]:
    """The text of each of a batch of results, or of a single one; empty where it is a success."""
    texts = {number: text for number, text in outcomes().values()}
    return tuple(texts[int(number)] for number in np.atleast_1d(np.asarray(code(result))))


def code(result: RESULTS) -> Array:
    """The number that stands for `result` in an array; `outcomes` says which is which."""
    return jax.tree.leaves(result)[0]


def outcomes() -> dict[str, tuple[int, str]]:
    """Code and text of every result, by its name."""
    # Equinox has no public lists of an enumeration's members and texts.
    members, texts = (getattr(RESULTS, name) for name in ("_name_to_item", "_index_to_message"))
    return {name: (int(code(one)), texts[int(code(one))]) for name, one in members.items()}


def succeeded(result: RESULTS) -> Bool[Array, ""]:
    """Whether `result` is a success, as an array."""
    return result == RESULTS.successful
