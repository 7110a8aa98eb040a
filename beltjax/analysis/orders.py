"""Excitation at several orders of the driver's speed, with a common period."""

import math
from fractions import Fraction
from typing import NamedTuple

import equinox as eqx
import jax.numpy as jnp
from jaxtyping import Array, Complex, Float

from beltjax.analysis.response import Excitation
from beltjax.drive.components import as_real, concrete
from beltjax.drive.operation import ExcitationGiven, as_driver

_FINEST = 64  # denominator of an order


class Forcing(NamedTuple):
    """An excitation by harmonics of its period, from 0 on: Re(x e^{i k tau}) of each."""

    crank: Complex[Array, " harmonics"]  # [rad]
    torques: Complex[Array, "harmonics pulleys"]  # [N m]


ORDER = 2.0  # of a four-cylinder engine's firing, where none is given


class Orders(eqx.Module):
    """Harmonic excitations by their order, which is their frequency over the driver's speed.

    Orders are whole numbers or fractions with small denominators (0.5 for the irregularity of a
    four-stroke engine), so that all have a common period. With `subharmonic` = m that
    period is m times as long, for motions that repeat less often than what excites them. The
    `driver` is "prescribed", so that it turns as the excitations say, or "free": it turns by its
    torque, which may fluctuate as that of any pulley, about a mean speed that is given. Raises
    `ValueError` for no orders, for one that is not a positive fraction, and for the motion of a
    driver that is free.
    """

    excitations: dict[float, Excitation] = eqx.field(
        converter=lambda given: {float(order): one for order, one in given.items()}
    )
    subharmonic: int = eqx.field(static=True, default=1)
    driver: str = eqx.field(static=True, converter=as_driver, default="prescribed")

    def __check_init__(self):
        if not self.excitations:
            raise ValueError(
                "Orders: found none; give at least one, as {2: Excitation(crank=...)}."
            )
        if self.subharmonic < 1:
            raise ValueError(f"Orders.subharmonic: found {self.subharmonic}; give 1 or more.")
        for order, one in self.excitations.items():
            crank = concrete(one.crank)
            if self.driver == "free" and crank is not None and crank.any():
                raise ValueError(
                    f"Orders: found crank motion of order {order:g}, and the driver is free; "
                    "give torques, that of the driver among them."
                )
            near = (
                Fraction(order).limit_denominator(_FINEST) if math.isfinite(order) else Fraction()
            )
            if not (near > 0 and abs(order - near) < 1e-9 * near):
                raise ValueError(
                    f"Orders: found order {order:g}; give a positive fraction of whole numbers up "
                    f"to {_FINEST}, so that the motion has a period."
                )

    @property
    def base(self) -> float:
        """Order of the common period: the largest of which all orders are multiples."""
        return float(self._base)

    @property
    def _base(self) -> Fraction:
        parts = [Fraction(order).limit_denominator(_FINEST) for order in self.excitations]
        common = math.lcm(*(part.denominator for part in parts))
        whole = math.gcd(*(int(part * common) for part in parts))
        return Fraction(whole, common * self.subharmonic)

    def forcing(self, names: tuple[str, ...], harmonics: int) -> Forcing:
        """The excitation by the harmonics 0 .. `harmonics` of the common period.

        Raises `ValueError` for a pulley that is not among `names`, or an order above them all.
        """
        crank = jnp.zeros(harmonics + 1, complex)
        torques = jnp.zeros((harmonics + 1, len(names)), complex)
        for order, one in self.excitations.items():
            place = round(order / self.base)
            if place > harmonics:
                raise ValueError(
                    f"harmonics: found {harmonics}; order {order:g} is harmonic {place} of the "
                    f"period, give at least {place}, and several times that for an accurate motion."
                )
            turned = one.crank
            if self.driver == "free":
                turned = jnp.where(
                    turned == 0, turned, jnp.nan
                )  # a traced one, as in __check_init__
            crank = crank.at[place].add(turned)
            torques = torques.at[place].add(one.on(names))
        return Forcing(crank, torques)


def orders_of(given: ExcitationGiven) -> Orders:
    """The orders of a drive file's excitation, whose numbers must not be traced."""
    if given.orders:
        parts: dict[float, list[Excitation]] = {}
        for one in given.orders:
            turn = jnp.exp(1j * one.phase)
            torques = {name: turn * size for name, size in one.torque.items()}
            parts.setdefault(one.order, []).append(Excitation(turn * one.crank, torques))
        together = {order: _together(same) for order, same in parts.items()}
        return Orders(together, driver=given.driver)
    order, excitation = single_order(given)
    return Orders({float(order): excitation}, driver=given.driver)


def given_forcing(
    given: ExcitationGiven, names: tuple[str, ...], harmonics: int
) -> tuple[Forcing, Float[Array, ""]]:
    """The excitation of a drive file by harmonics, and the order of its period.

    Raises `ValueError` as `Orders.forcing` does.
    """
    if given.orders:
        orders = orders_of(given)
        return orders.forcing(names, harmonics), jnp.asarray(orders.base)
    order, excitation = single_order(given)  # which is the period's
    return Orders({1.0: excitation}, driver=given.driver).forcing(names, harmonics), order


def single_order(given: ExcitationGiven) -> tuple[Float[Array, ""], Excitation]:
    """The order of an excitation without a list of them, which may be traced, and what it does."""
    order = as_real(ORDER) if given.order is None else given.order
    return order, Excitation(0.0 if given.crank is None else given.crank, dict(given.torque))


def _together(parts: list[Excitation]) -> Excitation:
    """The sum of excitations of one order."""
    names = dict.fromkeys(name for part in parts for name in part.torques)
    torques = {name: sum(part.torques.get(name, 0.0) for part in parts) for name in names}
    return Excitation(sum(part.crank for part in parts), torques)
