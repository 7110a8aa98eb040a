"""Damping of a linearized drive."""

import equinox as eqx
import jax.numpy as jnp
import numpy as np
from jax.scipy.linalg import block_diag
from jaxtyping import Array, Float

from beltjax.analysis.linearization import Linearization
from beltjax.drive.components import as_real, concrete
from beltjax.numerics.gyroscopic import modal_damping


class Damping(eqx.Module):
    """Viscous damping: a ratio for all modes, factors of the stiffness, and the drive's dampers.

    `modal` is the damping ratio of every mode of the drive without gyroscopic forces, `stiffness`
    [s] the factor of the stiffness matrix, and `belt` [s] that of the belt's stretch alone: modal
    damping also joins the two sides of a clutch that is open. The dampers of tensioners, arm
    springs, isolators and rings come from the drive, and what a load takes more at a higher speed
    (which is negative for a constant power); both are counted unless `arm` is False. Raises
    `ValueError` for a factor that is negative or not finite.
    """

    modal: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)
    stiffness: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)
    belt: Float[Array, ""] = eqx.field(converter=as_real, default=0.0)
    arm: bool = eqx.field(static=True, default=True)

    def __check_init__(self):
        for name in ("modal", "stiffness", "belt"):
            value = concrete(getattr(self, name))
            if value is not None and not ((value >= 0) & (value < np.inf)).all():
                raise ValueError(
                    f"Damping: {name} must not be negative and must be finite; found {value}."
                )


def damping_matrix(linearization: Linearization, damping: Damping) -> Float[Array, "size size"]:
    """Symmetric damping matrix of the linearization, dimensionless."""
    lin = linearization
    matrix = damping.stiffness / lin.scales.time * lin.stiffness
    matrix = matrix + modal_damping(lin.mass, lin.stiffness, damping.modal)
    d, work = lin.elongations, lin.model.lam * lin.model.gam
    matrix = matrix + damping.belt / lin.scales.time * (d.T @ (work[:, None] * d))
    if damping.arm:
        rotors, bodies = own_damping(lin)
        none = jnp.zeros((lin.spans * lin.basis.size,) * 2)
        matrix = matrix + block_diag(none, rotors, bodies)
    return matrix


def own_damping(
    linearization: Linearization,
) -> tuple[Float[Array, "turning turning"], Float[Array, "coordinates coordinates"]]:
    """Damping matrices of the drive's own dampers, for the rotors and the tensioners.

    Both are dimensionless; the first is of the rotors that turn.
    """
    lin, groups = linearization, linearization.steady.groups
    moving = lin.model.movable[:, None] * lin.model.movable
    return groups.rotor_damping[lin.rotors][:, lin.rotors], moving * groups.arm_damping
