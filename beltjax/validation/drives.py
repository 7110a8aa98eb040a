"""The source's drives, built from its printed numbers."""

from typing import Any

import equinox as eqx
import jax.numpy as jnp
import numpy as np

import beltjax as bj
from beltjax.validation.printed import steady as printed

_NAMES = ("crankshaft", "tensioner", "accessory")


def middle_angle(beta: tuple[float, float]) -> float:
    """The mean of the two alignment angles [rad]: their difference is the idler's wrap."""
    return float(np.radians(sum(beta) / 2))


WELL = middle_angle(printed.BETA)


def as_printed() -> bj.Drive:
    """The prototype with the centers and the pivot of Table 3.2; EI = 0."""
    pulleys = [
        bj.Pulley(
            name=name,
            center=center,
            radius=radius,
            inertia=inertia,
            face="grooved" if side > 0 else "back",
            driver=name == "crankshaft",
            on=name == "tensioner",
        )
        for name, center, radius, side, inertia in zip(
            _NAMES, printed.CENTERS, printed.RADII, printed.SIDES, printed.INERTIAS, strict=True
        )
    ]
    return bj.Drive(
        belt=bj.Belt(printed.AXIAL_STIFFNESS, 0.0, printed.MASS_PER_LENGTH),
        pulleys=tuple(pulleys),
        installation=bj.TensionGiven(printed.TENSION, jnp.full(3, printed.TENSION)),
        tensioner=bj.Tensioner(printed.PIVOT, printed.ARM_STIFFNESS, printed.ARM_INERTIA),
        name="prototype of Tables 3.2 and 4.1",
    )


def oriented(drive: bj.Drive, angle: Any) -> bj.Drive:
    """The prototype with its arm r_t = 0.097 m long, at this mean alignment angle [rad].

    The pulley stays and the pivot moves round it, as in the source, whose r_t and angles are
    rounded: they do not follow from its centers to their last digit.
    """
    x, y = jnp.sum(
        bj.layout(drive, throw=False).directions[:2], axis=0
    )  # halfway between the two spans
    arm = jnp.arctan2(y, x) + angle
    pivot = drive.pulleys[1].center - printed.ARM * jnp.stack([jnp.cos(arm), jnp.sin(arm)])
    return eqx.tree_at(lambda d: d.tensioner.pivot, drive, pivot)


def prototype(
    eps: Any = 0.0,
    s: Any = 0.0,
    P: Any = printed.EVEN,
    angle: Any = WELL,
    k_s: Any = printed.SPRING,
    gam: Any = printed.STRETCH,
) -> tuple[bj.Drive, bj.OperatingPoint]:
    """The prototype with these dimensionless numbers; any of them may be traced."""
    tension = printed.TENSION
    eps, s, P, k_s, gam = (jnp.asarray(x, dtype=float) for x in (eps, s, P, k_s, gam))
    drive = eqx.tree_at(
        lambda d: (
            d.belt.bending_stiffness,
            d.belt.axial_stiffness,
            d.tensioner.stiffness,
            d.installation.span_tensions,
        ),
        oriented(as_printed(), angle),
        (stiffness_of(eps), gam * tension, k_s * tension * printed.ARM, P * tension),
    )
    return drive, bj.OperatingPoint(belt_speed=speed_of(s))


def stiffness_of(eps: Any) -> Any:
    """EI [N m^2] of the prototype."""
    length = jnp.mean(bj.layout(as_printed(), throw=False).span_lengths)
    return eps**2 * printed.TENSION * length**2


def speed_of(s: Any) -> Any:
    """Belt speed [m/s] of the prototype."""
    return s * np.sqrt(printed.TENSION / printed.MASS_PER_LENGTH)


def two_pulleys(
    radius: float, other: float, distance: float, EA: float, m0: float, mu: float, tension: float
) -> bj.Drive:
    """A driver and a driven pulley of chapter 5; EI = 0."""
    pulleys = (
        bj.Pulley("driver", (0.0, 0.0), radius, driver=True, friction=mu),
        bj.Pulley("driven", (distance, 0.0), other, friction=mu),
    )
    return bj.Drive(bj.Belt(EA, 0.0, m0), pulleys, bj.TensionGiven(tension))
