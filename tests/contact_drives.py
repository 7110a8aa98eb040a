"""Drives in contact that several tests share, made so that they share compiled programs too.

Every answer is one call of the public function: drives of equal structure (number of pulleys,
rule of installation, rule of speed) compile once in a process, and a call takes milliseconds.
"""

import functools

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from drives import build, example, random_drives

import beltjax as bj
from beltjax.validation.peers.contact import Arm, PeerDrive

_PLACES = {
    "EI": lambda d, p: d.belt.bending_stiffness,
    "EA": lambda d, p: d.belt.axial_stiffness,
    "m0": lambda d, p: d.belt.mass_per_length,
    "tension": lambda d, p: d.installation.tension,
    "k_r": lambda d, p: d.tensioner.stiffness,
    "c": lambda d, p: p.belt_speed,
    "omega": lambda d, p: p.driver_speed,
    "G": lambda d, p: p.mass_flow,
}


def variant(drive, point, **numbers):
    """The same drive and point with other numbers, by the letters of the source."""
    for letter, value in numbers.items():  # strongly typed: a weak type compiles again
        place = _PLACES[letter]
        drive, point = eqx.tree_at(
            lambda both, place=place: place(*both), (drive, point), jnp.asarray(value, dtype=float)
        )
    return drive, point


def equal(**numbers):
    """The drive of Table 5.1; M2 its torque."""
    return _two("two_pulley_table_5_1", numbers)


def unequal(**numbers):
    """The drive of Table 5.3, on which M2 is 1 N m unless given: what `maximum_moment` scales."""
    return _two("two_pulley_table_5_3", {"M2": 1.0, **numbers})


def _two(name, numbers):
    drive, point = example(name)
    torque = dict(numbers).pop("M2", None)
    numbers = {letter: value for letter, value in numbers.items() if letter != "M2"}
    if torque is not None:
        point = bj.OperatingPoint(
            point.belt_speed, point.driver_speed, point.mass_flow, {"driven": float(torque)}
        )
    return variant(drive, point, **numbers)


def seven(torque=(0.0, 7.0, 0.0, 5.0, 0.4, 11.0), travel="listed", **numbers):
    """The seven-pulley drive; `torque` of all but the first, so that others share its program."""
    drive, point = example("seven_pulley")
    torques = dict(zip(drive.pulley_names[1:], torque, strict=True))
    point = bj.OperatingPoint(driver_speed=point.driver_speed, torque=torques, travel=travel)
    return variant(drive, point, **numbers)


@functools.cache
def random_seven(count, seed=0):
    """Random drives of seven pulleys, on both faces, in the structure of `seven`."""
    arrays = random_drives(7, count, seed)
    rng = np.random.default_rng([seed, 7])
    listed, _ = seven()

    def one(k):
        centers, radii, faces, carried, pivot, stiffness, tension, torques, rest = jax.tree.map(
            lambda x: jnp.asarray(x[k]), arrays
        )
        pulleys = [
            eqx.tree_at(
                lambda p: (p.center, p.radius, p.face, p.on, p.friction),
                pulley,
                (
                    centers[i],
                    radii[i],
                    faces[i],
                    carried[i][None],
                    jnp.asarray(rng.uniform(0.4, 1.2), dtype=float),
                ),
            )
            for i, pulley in enumerate(listed.pulleys)
        ]
        drive = eqx.tree_at(
            lambda d: (d.pulleys, d.tensioner.pivot, d.tensioner.stiffness, d.sense),
            listed,
            (tuple(pulleys), pivot, stiffness, jnp.ones(())),
        )
        numbers = {"EA": rest["EA"], "EI": rest["EI"], "m0": 0.1, "tension": tension}
        drive, point = variant(drive, seven(tuple(torques[1:]))[1], **numbers)
        return variant(drive, point, omega=rest["speed"] / radii[0])

    return [one(k) for k in range(count)]


def random_armed(n, count):
    """Random drives of n pulleys, on both faces, with a tensioner."""
    arrays = random_drives(n, count)
    rng = np.random.default_rng([1, n])
    for k in range(count):
        drive, point = build(*jax.tree.map(lambda x, k=k: jnp.asarray(x[k]), arrays))
        friction = [jnp.asarray(mu) for mu in rng.uniform(0.4, 1.2, n)]
        yield (
            eqx.tree_at(
                lambda d: [p.friction for p in d.pulleys],
                drive,
                friction,
                is_leaf=lambda leaf: leaf is None,
            ),
            point,
        )


def state(drive, point, **how):
    """`contact_state`, whatever its result."""
    return bj.contact_state(drive, point, throw=False, **how)


def largest(drive, point, **how):
    """`maximum_moment`, whatever its result."""
    return bj.maximum_moment(drive, point, throw=False, **how)


def mirrored(drive, point):
    """The same drive seen from behind: y reversed, and with it the sense of the list."""

    def flip(at):
        return at * jnp.array([1.0, -1.0])

    drive = eqx.tree_at(lambda d: [p.center for p in d.pulleys], drive, replace_fn=flip)
    drive = eqx.tree_at(lambda d: d.sense, drive, -drive.sense)
    if drive.tensioner is not None:
        drive = eqx.tree_at(lambda d: d.tensioner.pivot, drive, replace_fn=flip)
    return drive, point


def relisted(drive, point):
    """The same drive listed in the other sense from the same first pulley, running as it did.

    Names keep their places, so that no new program is compiled: pulley i becomes pulley -i.
    """
    names, n = drive.pulley_names, len(drive.pulleys)
    backwards = [-i % n for i in range(n)]
    pulleys = [eqx.tree_at(_numbers, drive.pulleys[i], _numbers(drive.pulleys[j]))
               for i, j in enumerate(backwards)]  # fmt: skip
    torque = {
        names[i]: point.torque[names[j]]
        for i, j in enumerate(backwards)
        if names[j] in point.torque
    }
    drive = eqx.tree_at(lambda d: (d.pulleys, d.sense), drive, (tuple(pulleys), -drive.sense))
    return drive, eqx.tree_at(lambda p: (p.torque, p.travel), point, (torque, -point.travel))


def _numbers(pulley):
    return pulley.center, pulley.radius, pulley.face, pulley.friction, pulley.driver, pulley.on


def peer_of(drive, point):
    """The drive as the SciPy peer takes it, along the travel; its pulleys' and spans' places."""
    n, forward = len(drive.pulleys), float(point.travel) > 0
    order = np.arange(n) if forward else -np.arange(n) % n
    spans = order if forward else (order - 1) % n
    pulleys = [drive.pulleys[i] for i in order]
    side = float(drive.sense) * float(point.travel)
    tensioner, rule, arm = drive.tensioner, drive.installation, None
    if tensioner is not None:
        carried = int(np.argmax([p.on[0] for p in pulleys]))
        free = rule.free_angle if isinstance(rule, bj.BeltGiven) else None
        arm = Arm(carried, tuple(np.asarray(tensioner.pivot)), float(tensioner.stiffness), free)
    tensioned = isinstance(rule, bj.TensionGiven)

    def number(x):
        return None if x is None else float(x)

    peer = PeerDrive(
        centers=np.array([p.center for p in pulleys]),
        radii=np.array([side * float(p.face) * float(p.radius) for p in pulleys]),
        moments=np.array([float(point.torque.get(p.name, 0.0)) for p in pulleys]),
        friction=np.array([1.0 if p.friction is None else float(p.friction) for p in pulleys]),
        bending_stiffness=float(drive.belt.bending_stiffness),
        axial_stiffness=float(drive.belt.axial_stiffness),
        driver=int(np.argmax([p.driver for p in pulleys])),
        tension=number(rule.tension) if tensioned else None,
        unstretched_length=None if tensioned else number(rule.belt_length),
        mass_per_length=number(drive.belt.mass_per_length) if point.mass_flow is None else None,
        belt_speed=number(point.belt_speed),
        mass_flow=number(point.mass_flow),
        driver_speed=number(point.driver_speed),
        arm=arm,
    )
    return peer, order, spans
