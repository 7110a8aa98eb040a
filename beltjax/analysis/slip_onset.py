"""Onset of squeal of a whole drive, found on the host, with its derivatives."""

from typing import NamedTuple

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int

from beltjax.analysis.slip_stability import (
    SlipStability,
    Tracked,
    asked_of_slip,
    eigenvalues_at,
    matrices_at,
    sliding_at,
    slip_stability,
    with_damping,
)
from beltjax.analysis.steady import steady_state
from beltjax.compiling.kept_programs import run_kept
from beltjax.drive.canonical import restored
from beltjax.drive.components import as_real
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.results import succeeded

Gradient = tuple[Drive, OperatingPoint]

_STEPS = 40
_TOLERANCE = 1e-12  # of the speed


class SlipOnset(NamedTuple):
    """The sliding speed above which a whole drive does not squeal on one pulley."""

    speed: float  # [m/s]; 0 or infinite as `SlipStability.onset_speed`
    frequency: float  # [rad/s]
    runaway_rate: float  # there, of the whole drive; 0 where no pulley runs away [1/s]
    eigenvalues: Complex[np.ndarray, " states"]  # there [1/s]
    # Other oscillations that grow there, of pulleys on the belt: upper half of the plane [1/s].
    growing: Complex[np.ndarray, " others"]
    gradient: Gradient | None  # of the speed by the numbers of the drive; None unless asked for


def slip_onset(
    drive: Drive,
    point: OperatingPoint,
    pulley: str,
    *,
    damping: Float[Array, ""] | float | None = None,
    slopes: bool = True,
) -> SlipOnset:
    """Onset of squeal on one pulley by the eigenvalues of the whole drive.

    The stiffness is not symmetric, so that this runs on the host and is not traced by JAX; for
    searches and gradients in JAX `slip_stability` is within half a percent of it. The derivatives
    are those of the eigenvalue, by its left and right vectors;
    docs/theory/friction_vibration.md, (F16) and (F17).

    Args:
        drive: the drive, with all inertias.
        point: speeds and torques.
        pulley: the pulley's name.
        damping: of the belt's motion along the pulley, > 0 [N s/m]; `Belt.longitudinal_damping`
            unless given.
        slopes: find the derivatives, too.

    Returns:
        The speed, with the frequency of squeal, how fast the pulley would run away, and the
        derivatives as a drive and an operating point.

    Raises:
        KeyError: there is no such pulley.
        ValueError: what `slip_stability` raises, or an inertia is missing.
        AnalysisError: the steady state was not found.

    Examples:
        >>> import dataclasses
        >>> drive, point = bj.load_drive("examples/seven_pulley.toml")
        >>> law = {"friction_static": 0.6, "friction": 0.3, "friction_speed": 0.3}
        >>> pulleys = tuple(dataclasses.replace(one, **law) for one in drive.pulleys)
        >>> drive = dataclasses.replace(drive, pulleys=pulleys)
        >>> found = bj.slip_onset(drive, point, "alternator", damping=50.0)
        >>> found.speed, found.gradient[0].belt.axial_stiffness
    """
    drive = with_damping(drive, damping)
    found = slip_stability(drive, point, pulley)
    return onset_of(found, drive, point, pulley, slopes)


def onset_of(
    found: SlipStability,
    drive: Drive,
    point: OperatingPoint,
    pulley: str,
    slopes: bool,
) -> SlipOnset:
    """`slip_onset` from the stability of one arc at its own onset."""
    start = float(found.onset_speed)
    if not (succeeded(found.result) and 0 < start < np.inf):
        return _told(start, eigenvalues_at(found, found.sliding_speed), None)
    speed, there = _crossing(found, start)
    gradient = None
    if slopes:
        asked = asked_of_slip(drive, point, pulley, None)
        rows = _vectors(found, speed, there.squeal)
        pulled = run_kept(_pulled, *asked, as_real(speed), *map(jnp.asarray, rows))
        gradient = restored(pulled, drive, point)
    return _told(speed, there, gradient)


def _told(speed: float, there: Tracked, gradient: Gradient | None) -> SlipOnset:
    values, size = there.values, np.abs(there.values)
    growth, turning = np.real(values), np.imag(values)
    real = growth[np.abs(turning) <= 1e-6 * size]
    others = (growth > 1e-6 * size) & (turning > 1e-6 * size)
    others &= np.abs(values - there.squeal) > 1e-9 * size
    runaway = float(max([0.0, *real]))
    frequency = abs(there.squeal.imag)
    return SlipOnset(speed, frequency, runaway, values, values[others], gradient)


def _crossing(found: SlipStability, start: float) -> tuple[float, Tracked]:
    """The sliding speed at which the squealing pair neither grows nor dies out: secant method."""
    before, now = start, 1.002 * start
    last = eigenvalues_at(found, before)
    for _ in range(_STEPS):
        there = eigenvalues_at(found, now, near=last.squeal)
        rise = there.squeal.real - last.squeal.real
        step = -there.squeal.real * (now - before) / (rise if rise else np.inf)
        before, last = now, there
        now = now + float(np.clip(step, -0.2 * start, 0.2 * start))
        if abs(now - before) <= _TOLERANCE * start:
            return now, eigenvalues_at(found, now, near=last.squeal)
    raise ValueError(
        "slip_onset: the pair that squeals was lost on the way; compare `slip_stability`, and look "
        "for a mode of the drive at the same frequency."
    )


def _vectors(
    found: SlipStability, speed: float, squeal: complex
) -> tuple[Complex[np.ndarray, ""], Complex[np.ndarray, " size"], Complex[np.ndarray, " size"]]:
    """The dimensionless eigenvalue, its left vector, scaled for (F17), and its right vector."""
    assert found.equations is not None  # as `eigenvalues_at` found
    C, K = (np.asarray(x) for x in matrices_at(found.equations, found.model, as_real(speed)))
    M, value = np.asarray(found.equations.mass), squeal * float(found.equations.time)
    left, _, right = np.linalg.svd(value**2 * M + value * C + K)
    y, x = left[:, -1], right[-1].conj()
    return np.array(value), y / np.conj(y.conj() @ (2 * value * M + C) @ x), x


def _pulled(
    drive: Drive,
    point: OperatingPoint,
    place: Int[Array, ""],
    speed: Float[Array, ""],
    value: Complex[Array, ""],
    left: Complex[Array, " size"],
    right: Complex[Array, " size"],
) -> Gradient:
    """Derivatives of the onset speed by a canonical drive and point."""

    def growth(numbers: tuple[Gradient, Array]) -> Float[Array, ""]:
        (drive, point), v = numbers
        steady = steady_state(drive, point, throw=False)
        equations, model = sliding_at(drive, steady, place)
        assert equations is not None  # because there are vectors
        C, K = equations.at(model, v)
        pencil = value**2 * equations.mass + value * C + K
        return (jnp.conj(left) @ pencil @ right).real

    by_drive, by_speed = eqx.filter_grad(growth)(((drive, point), speed))
    return jax.tree.map(lambda slope: -slope / by_speed, by_drive)
