"""Two pulleys, of which one has a spring-clutch, as rotations alone."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import beltjax as bj
from beltjax.analysis.motion import (
    Excited,
    joints_of,
    load_series,
    motion_model,
    narrowed,
    oscillator,
    widened,
)
from beltjax.analysis.orbit_measures import Signals, measures
from beltjax.analysis.orbit_motion import HarmonicMotion, SteppedMotion
from beltjax.analysis.shooting import shot_system
from beltjax.numerics.periodic import multipliers, periodic_orbit
from beltjax.numerics.shooting import shot_multipliers, shot_orbit
from beltjax.physics.motion import projected

RPM = 2 * np.pi / 60
BELT = bj.Damping(belt=1e-4)  # [s]
HUB = 0.03  # [N m s/rad], of the hub to the ground


def clutched(law="spring-clutch", stiffness=100.0, **stops):
    """The drive."""
    crank = bj.Pulley("crank", (0.0, 0.0), 0.08, inertia=0.07, driver=1.0)
    pulley = bj.Pulley("alternator", (0.3, 0.0), 0.03, inertia=0.003)
    joint = bj.Isolator((0.0, 1.0), stiffness, rim_inertia=0.00025, law=law, **stops)
    return bj.Drive(
        belt=bj.Belt(120e3, 0.015, 0.1029),
        pulleys=(crank, pulley),
        installation=bj.TensionGiven(500.0),
        isolators=(joint,),
    )


def excited_at(drive, speed, forcing):
    """The drive in motion at a speed of the driver [rad/s], with a damper on its hub."""
    point = bj.OperatingPoint(driver_speed=speed, torque={"alternator": 5.0})
    lin = bj.linearize(bj.steady_state(drive, point, throw=False), bj.Legendre(1), throw=False)
    whole = motion_model(lin, BELT, None, joints_of(drive, lin, BELT))
    hub = lin.spans  # one function a span, then the hub and the rim
    damped = HUB / (lin.scales.energy * lin.scales.time)
    whole = eqx.tree_at(lambda m: m.damping, whole, whole.damping.at[hub, hub].add(damped))
    driver, load = load_series(lin, forcing, 2 * speed * lin.scales.time, BELT)
    none = jnp.zeros((lin.spans, 1, 0))
    frequency = 2 * speed * lin.scales.time
    excited = Excited(projected(whole, none), frequency, driver, narrowed(none, load))
    return excited, lin, whole, none


def moved(drive, speed, forcing, samples):
    """Its orbit, extremes, the open part of the period and the multipliers."""
    excited, lin, whole, none = excited_at(drive, speed, forcing)
    orbit = periodic_orbit(oscillator, excited, len(forcing.crank) - 1, samples, past_folds=True)
    coefficients = widened(none, orbit.coefficients)
    motion = HarmonicMotion(coefficients, excited.driver, excited.frequency)
    found = measures(Signals(lin, whole, motion), samples)
    return orbit, found, multipliers(oscillator, excited, orbit.coefficients, 800)


def shot(drive, speed, forcing, steps):
    """The orbit by shooting, its extremes and multipliers, and the drive in motion."""
    excited, lin, whole, none = excited_at(drive, speed, forcing)
    orbit = shot_orbit(shot_system, excited, steps)
    motion = SteppedMotion(trajectory=orbit.trajectory, shapes=none, frequency=excited.frequency)
    found = measures(Signals(lin, whole, motion, excited.driver), 96)
    return orbit, found, shot_multipliers(orbit), (excited, lin)
