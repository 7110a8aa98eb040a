"""What a page must know of its drive before the first answer: names, handles, limits, orders."""

from typing import Any

import numpy as np

from beltjax import optimize
from beltjax.commands.reports.documents import plain
from beltjax.studio.handles import descriptions
from beltjax.studio.session import TOLERANCES, Session

_USUAL_ORDER = 2.0  # of the firing of four cylinders


def drive_of(session: Session) -> dict[str, Any]:
    """Names and facts that do not change while the drive is dragged."""
    drive, study, opened = session.drive, session.study, session.opened
    loops = drive.loops
    variables = study.variables
    return {
        "name": drive.name,
        "title": study.name,
        "isStudy": opened.is_study,
        "files": list(opened.texts),
        "pulleys": [
            {
                "name": pulley.name,
                "grooved": float(pulley.face) > 0,
                "driver": bool(float(pulley.driver)),
                "friction": None if pulley.holding is None else float(pulley.holding),
                # In which sense it turns the belt, seen along its listed order.
                "turn": float(turn),
            }
            for pulley, turn in zip(drive.pulleys, drive.faces * drive.senses, strict=True)
        ],
        "spans": list(drive.span_names),
        "belts": [
            {"start": start, "size": size, "name": belt.name}
            for start, size, belt in zip(
                loops.starts.tolist(), loops.sizes, drive.belts, strict=True
            )
        ],
        "travel": plain(session.point.travel),
        "cases": session.cases,
        "handles": [
            {
                "key": one.key,
                "kind": one.kind,
                "label": one.label,
                "place": one.place,
                "names": [list(way) for way in one.names],
            }
            for one in session.handles
        ],
        "numbers": descriptions(drive, session.names),
        "objective": [
            {"name": name, "weight": float(weight)}
            for name, weight in zip(study.objective, study.weights, strict=True)
        ],
        "variables": [
            {"name": name, "lower": float(low), "upper": float(high)}
            for name, low, high in zip(
                variables.names, variables.lower, variables.upper, strict=True
            )
        ]
        if opened.is_study
        else [],
        "orders": orders(session),
        "idle": min(session.driver_speeds()),
        "modes": session.modes,
        "contact": all(pulley.friction is not None for pulley in drive.pulleys),
        "case": session.case,
        "tolerances": dict(TOLERANCES) if study.scatter is None else None,
        "tolerated": list(study.scatter.names) if study.scatter else [],
        "view": (opened.kept or {}).get("view"),
    }


def orders(session: Session) -> list[float]:
    """Orders of the driver that excite: those of the file's excitation and of the limits."""
    found: list[float] = []
    shaken = session.study.point.excitation
    if shaken is not None and shaken.orders:
        found += [one.order for one in shaken.orders]
    elif shaken is not None and shaken.order is not None:
        found.append(float(np.ravel(shaken.order)[0]))
    for name in session.study.constraints.names:
        kind, _, place = optimize.study.split_name(name)[0].partition(":")
        if kind in ("order_distance", "order_margin"):
            found.append(float(place))
    return sorted(set(found)) or [_USUAL_ORDER]
