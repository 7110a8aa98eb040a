"""The orders that a command excites a drive with, and its damping: its own, or the file's."""

import dataclasses
import os
from collections.abc import Sequence
from typing import NamedTuple

from beltjax.analysis.damping import Damping
from beltjax.analysis.orders import ORDER, Orders, orders_of
from beltjax.analysis.response import Excitation
from beltjax.commands.reports.arguments import read_excited_orders, read_option
from beltjax.commands.reports.response import MODAL_DAMPING, commanded, is_free
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.units import to_si


class OrdersAsked(NamedTuple):
    """A command's options of excitation, as text; None stands for the file's."""

    crank: str | None
    torques: Sequence[str]
    order: float | None
    orders: str | None
    driver: str | None = None


def excited_orders(
    path: str | os.PathLike[str], drive: Drive, point: OperatingPoint, given: OrdersAsked
) -> Orders:
    """The command's excitation; the file's where the command names none."""
    single = given.crank is not None or bool(given.torques)
    free = is_free(point, given.driver)
    if given.orders is not None:
        if single or given.order is not None:
            raise FileError("--orders", "", "stands beside --crank, --torque or --order; give one")
        if free:
            raise FileError("--orders", "", "turns the driver, which is free; give --torque")
        return _several(given.orders)
    if not single:
        return _orders_of_file(path, point, given)
    crank, torques = commanded(drive, given.crank, given.torques, free)
    if not (crank or any(torques.values())):
        raise FileError("--crank", "", "nothing is excited; give an amplitude above 0")
    alone = {_order(point, given): Excitation(crank, torques)}
    return read_option("--order", lambda: Orders(alone, driver="free" if free else "prescribed"))


def _several(text: str) -> Orders:
    """The crank motions of --orders."""
    cranks = read_option("--orders", lambda: read_excited_orders(text))
    if not any(cranks.values()):
        raise FileError("--orders", "", f"found {text!r}; give an amplitude above 0")
    excitations = {order: Excitation(crank=crank) for order, crank in cranks.items()}
    return read_option("--orders", lambda: Orders(excitations))


def _orders_of_file(
    path: str | os.PathLike[str], point: OperatingPoint, given: OrdersAsked
) -> Orders:
    """The excitation of [excitation], at the order and with the driver of the command."""
    if point.excitation is None or not point.excitation.excites:
        message = "is not excited; give --crank, --orders, --torque NAME=AMPLITUDE or [excitation]"
        raise FileError(path, "", message)
    file = point.excitation
    if given.order is not None:
        if file.orders:
            message = "is one, and excitation.orders are several; leave it out"
            raise FileError("--order", "", message)
        file = dataclasses.replace(file, order=given.order)
    if given.driver is not None:
        file = dataclasses.replace(file, driver=given.driver)
    try:
        return orders_of(file)
    except ValueError as error:
        raise FileError(path, "excitation", str(error)) from error


def _order(point: OperatingPoint, given: OrdersAsked) -> float:
    if given.order is not None:
        return given.order
    file = point.excitation
    return ORDER if file is None or file.order is None else float(file.order)


def commanded_damping(modal: float | None, belt: str | None) -> Damping:
    """A command's damping: of the modes, unless that of the belt is given."""
    usual = MODAL_DAMPING if belt is None else 0.0
    ratio = usual if modal is None else modal
    damping = read_option("--modal-damping", lambda: Damping(modal=ratio))
    if belt is None:
        return damping
    return read_option("--belt-damping", lambda: Damping(modal=ratio, belt=to_si(belt, "s")))
