"""The angle at which the belt enters a pulley that lies in another plane."""

import jax.numpy as jnp
from jaxtyping import Array, Float

from beltjax.drive.layout import layout
from beltjax.drive.system import Drive

GUIDELINE = 0.33  # degrees a grooved pulley: Meckstroth and others, SAE 1999-01-1709


def entry_angles(
    drive: Drive, span_lengths: Float[Array, " spans"] | None = None
) -> Float[Array, " spans"]:
    """Angle of each span against the planes of its pulleys.

    The difference of the two `Pulley.offset` over the length of the span;
    docs/theory/friction_vibration.md, (F20). A pulley without one lies in the plane 0.

    Args:
        drive: the drive.
        span_lengths: of the spans [m]; those of the drawn layout unless given.

    Returns:
        Angles >= 0, one for each span [rad].

    Raises:
        AnalysisError: there is no such layout.

    Examples:
        >>> drive, point = bj.load_drive("examples/six_pulley_accessory.toml")
        >>> bj.entry_angles(drive)
    """
    if span_lengths is None:
        span_lengths = layout(drive).span_lengths
    none = jnp.zeros(())
    offsets = jnp.stack([none if p.offset is None else p.offset for p in drive.pulleys])
    apart = drive.loops.following(offsets) - offsets
    # Where two planes are one the angle has no slope.
    return jnp.where(apart == 0, 0.0, jnp.abs(apart)) / span_lengths
