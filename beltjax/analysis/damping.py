"""Damping of a linearized drive."""

import equinox as eqx
import numpy as np
from jaxtyping import Array, Float

from beltjax.analysis.linearization import Linearization
from beltjax.drive.components import as_real, concrete
from beltjax.numerics.gyroscopic import modal_damping


class Damping(eqx.Module):
    """Viscous damping: of all modes alike, of the belt's and arm's stiffness, and of the arm.

    `modal` is the damping ratio of every mode of the drive without gyroscopic forces;
    `stiffness` [s] the factor of the stiffness matrix. The arm's own damper is the drive's
    `Tensioner.damping`, counted unless `arm` is False. Raises `ValueError` where negative.
    """

    modal: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)
    stiffness: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)
    arm: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        for name in ("modal", "stiffness"):
            value = concrete(getattr(self, name))
            if value is not None and not ((value >= 0) & (value < np.inf)).all():
                raise ValueError(
                    f"Damping: {name} must not be negative and must be finite, and is {value}."
                )


def damping_matrix(linearization: Linearization, damping: Damping) -> Float[Array, "size size"]:
    """Symmetric damping matrix of the linearization, dimensionless."""
    lin = linearization
    matrix = damping.stiffness / lin.scales.time * lin.stiffness
    matrix = matrix + modal_damping(lin.mass, lin.stiffness, damping.modal)
    if lin.has_arm and damping.arm:
        matrix = matrix.at[-1, -1].add(lin.steady.groups.arm_damping)
    return matrix
