"""What a document tells of each tensioner, belt, pulley, span and isolator of a drive."""

from typing import Any, Literal, NamedTuple

import numpy as np
from jaxtyping import Array, Float

from beltjax.analysis.moving_beam import held_spans, lowest_of_spans
from beltjax.analysis.steady import SteadyState, steady_state
from beltjax.commands.reports.documents import Maybe, Part, meaning, plain
from beltjax.drive.components import KINDS, Tensioner
from beltjax.drive.fitting import next_lengths
from beltjax.drive.layout import alignment_angles
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.shafts import transmission
from beltjax.drive.system import Drive
from beltjax.results import RESULTS, succeeded

Kind = Literal["rotary", "linear"]
STOPS = {-1: "least", 1: "greatest"}  # which stop holds a body, as words


class CoordinatePart(Part):
    """Where a tensioner stands, from the drawn position: rad, or m of a linear one."""

    name: str
    kind: Kind
    installed: Maybe = meaning("without torques")
    at_rest: Maybe = meaning("with torques")
    change: Maybe = meaning("from at rest to running")
    at_stop: Literal["least", "greatest"] | None = meaning("which stop holds it")
    to_least: Maybe = meaning("way left to its least position, running; null without a stop")
    to_greatest: Maybe = meaning("way left to its greatest position, running")


class BeltPart(Part):
    """A belt."""

    name: str
    tension_change: Maybe = meaning("N, from at rest to running")
    unstretched_length: Maybe = meaning("m")
    path_length: Maybe = meaning("m")
    standard_lengths: list[float] = meaning(
        "m, next to that of the path: the shorter or equal one and the longer one; empty where "
        "none are known"
    )
    speed: Maybe = meaning("m/s, of the unstretched belt")


class PulleyPart(Part):
    """A pulley."""

    name: str
    wrap_deg: Maybe
    speed: Maybe = meaning("rad/s, counterclockwise")
    hub_load: list[float] | None = meaning(
        "N, x and y, of the tensions less m v^2, which turns the belt round; null: does not run"
    )
    torque: Maybe = meaning("N m, taken from the belt")
    slip_margin: Maybe = meaning(
        "friction times wrap, less the logarithm of the tensions' ratio; null without friction"
    )


class SpanStatePart(Part):
    """A span."""

    name: str
    length: Maybe = meaning("m")
    tension: Maybe = meaning("N, running")
    tension_at_rest: Maybe = meaning("N, with the torques")
    meter_hz: Maybe = meaning("Hz, of the held span at rest, as a tension meter hears it")
    meter_hz_running: Maybe = meaning("Hz, of the running span between pulleys held still")


class IsolatorPart(Part):
    """An isolator."""

    pulley: str = meaning("the first of those that its rim carries")
    torque: Maybe = meaning("N m, from the rim to the hub")
    wind_up: Maybe = meaning("rad, torque over stiffness")


class Readings(NamedTuple):
    """What a document tells of a steady state and what follows from it, computed with it.

    Computed by JAX outside of a compiled function, each sum would be a program of its own.
    """

    alignment_angles: Float[Array, "coordinates 2"]  # [rad]
    turning: Float[Array, " pulleys"]  # [rad/s], counterclockwise
    torques: Float[Array, " pulleys"]  # taken from the belt [N m]
    hub_loads: Float[Array, "pulleys 2"]  # [N]
    slip_exponents: Float[Array, " pulleys"]
    heard: Float[Array, " spans"]  # what a tension meter hears of the running belt [Hz]


def readings(drive: Drive, point: OperatingPoint, steady: SteadyState) -> Readings:
    """The readings of a steady state, for compiled functions."""
    driven = transmission(drive, point)
    return Readings(
        alignment_angles=alignment_angles(drive, steady.reference.layout),
        turning=driven.turning * driven.speeds / drive.radii,
        torques=driven.torques,
        hub_loads=steady.hub_loads,
        slip_exponents=steady.slip_exponents,
        heard=lowest_of_spans(held_spans(steady)),
    )


def read_state(drive: Drive, point: OperatingPoint) -> tuple[SteadyState, Readings]:
    """A steady state and its readings, for compiled functions; a failure is in its result."""
    steady = steady_state(drive, point, throw=False)
    return steady, readings(drive, point, steady)


def kind_of(body: Tensioner) -> str:
    """How a tensioner moves, as the file says it."""
    return next(word for word, sign in KINDS.items() if sign == float(body.kind))


def coordinates(drive: Drive, steady: SteadyState, running: bool) -> list[dict[str, Any]]:
    """Where each tensioner stands: installed, at rest with torques, and how running moves it."""
    reference = steady.reference
    stops = np.array([np.asarray(body.stops) for body in drive.tensioners]).reshape(-1, 2)
    stands = np.asarray(reference.coordinates) + np.asarray(steady.coordinate_change)
    # Of a body that a stop holds rounding leaves no way of its own.
    left = np.maximum(np.stack([stands - stops[:, 0], stops[:, 1] - stands]), 0.0)
    left = left if running else np.full_like(left, np.nan)
    columns = zip(
        drive.tensioners,
        plain(reference.installed),
        plain(reference.coordinates),
        plain(steady.coordinate_change),
        np.where(steady.at_stop != 0, steady.at_stop, reference.at_stop).tolist(),
        *plain(left),
        strict=True,
    )
    return [
        {
            "name": body.name,
            "kind": kind_of(body),
            "installed": installed,
            "at_rest": at_rest,
            "change": change,
            "at_stop": STOPS.get(int(at_stop)),
            "to_least": to_least,
            "to_greatest": to_greatest,
        }
        for body, installed, at_rest, change, at_stop, to_least, to_greatest in columns
    ]


def belts(drive: Drive, steady: SteadyState, running: bool) -> list[dict[str, Any]]:
    """Each belt: how its tension changes when it runs, its lengths and its speed."""
    reference, scales = steady.reference, steady.scales
    changes = np.atleast_1d(np.asarray(steady.tension_change)) * float(scales.tension)
    mass = float(drive.belt.mass_per_length)
    speeds = np.asarray(steady.groups.speeds) * np.sqrt(float(scales.tension) / mass)
    columns = zip(
        drive.belts,
        plain(changes),
        plain(reference.unstretched_lengths),
        plain(reference.layout.path_lengths),
        plain(speeds),
        strict=True,
    )
    return [
        {
            "name": belt.name,
            "tension_change": change if running else None,
            "unstretched_length": unstretched,
            "path_length": path,
            "standard_lengths": [] if path is None else next_lengths(belt, path),
            "speed": speed,
        }
        for belt, change, unstretched, path, speed in columns
    ]


def pulleys(
    drive: Drive, steady: SteadyState, read: Readings, running: bool
) -> list[dict[str, Any]]:
    """Each pulley: wrap, speed of rotation, load on its hub and torque."""
    columns = zip(
        drive.pulley_names,
        plain(np.degrees(steady.reference.layout.wraps)),
        plain(read.turning),
        plain(read.hub_loads),
        plain(read.torques),
        slip_margins(drive, steady, read),
        strict=True,
    )
    return [
        {
            "name": name,
            "wrap_deg": wrap,
            "speed": speed,
            "hub_load": load if running else None,
            "torque": torque,
            "slip_margin": margin if running else None,
        }
        for name, wrap, speed, load, torque, margin in columns
    ]


def slip_margins(drive: Drive, steady: SteadyState, read: Readings) -> list[float | None]:
    """Friction times wrap of each pulley, less what its tensions use of it; None: no friction."""
    wraps = np.asarray(steady.reference.layout.wraps)
    used = np.asarray(read.slip_exponents)
    return [
        None if pulley.holding is None else plain(float(pulley.holding) * wrap - exponent)
        for pulley, wrap, exponent in zip(drive.pulleys, wraps, used, strict=True)
    ]


def spans(drive: Drive, steady: SteadyState, read: Readings, running: bool) -> list[dict[str, Any]]:
    """Each span: its length, its tensions and what a tension meter hears."""
    at, rest = steady.reference.layout, np.asarray(steady.reference.tensions)
    of_span = [drive.belts[b] for b in drive.belt_of_span]
    bending = np.array([float(belt.bending_stiffness) for belt in of_span])
    mass = np.array([float(belt.mass_per_length) for belt in of_span])
    number = np.pi / np.asarray(at.span_lengths)  # of the half wave
    # What a tension meter hears: the held span at rest, whose ends turn freely.
    squares = number**2 * (rest + bending * number**2) / mass
    hertz = np.sqrt(np.maximum(squares, 0.0)) / (2 * np.pi)
    columns = zip(
        drive.span_names,
        plain(at.span_lengths),
        plain(steady.running_tensions),
        plain(rest),
        plain(hertz),
        plain(read.heard),
        strict=True,
    )
    tight = bool(succeeded(steady.reference.result))
    rests = tight or bool(steady.reference.result == RESULTS.span_slack)
    return [
        {
            "name": name,
            "length": length,
            "tension": tension if running else None,
            "tension_at_rest": still if rests else None,
            "meter_hz": at_rest if tight else None,
            "meter_hz_running": hears if running else None,
        }
        for name, length, tension, still, at_rest, hears in columns
    ]


def isolators(drive: Drive, steady: SteadyState) -> list[dict[str, Any]]:
    """Each isolator: what it transmits, and by how much that winds it up."""
    torques = np.asarray(steady.reference.torques)
    found = []
    for isolator in drive.isolators:
        flags = np.asarray(isolator.pulleys)
        torque = float(np.sum(flags * torques))
        found.append(
            {
                "pulley": drive.pulley_names[int(np.argmax(flags))],
                "torque": torque,
                "wind_up": torque / float(isolator.stiffness),
            }
        )
    return found
