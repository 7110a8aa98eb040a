"""Documents and tables of sweeps and of forced vibration."""

from typing import Any

import numpy as np
from rich.console import Group
from rich.markup import escape

from beltjax.analysis.response import Response
from beltjax.analysis.sweep import Sweep
from beltjax.drive.system import Drive
from beltjax.report.curves import RPM
from beltjax.report.documents import plain, span_label
from beltjax.report.tables import number, plain_table
from beltjax.report.warnings import response_warnings, sweep_warnings, warning_lines
from beltjax.results import explanations

_ROWS = 13  # of a sweep's table; every row is in the JSON and the NetCDF file
_COLUMNS = 8  # of them, to fit the width of a page


def sweep_document(drive: Drive, found: Sweep) -> dict[str, Any]:
    """A sweep; rows by value, columns by mode, modes counted from 1, null where absent."""
    veerings = [
        {
            "value": veering.value,
            "modes": [mode + 1 for mode in veering.modes],
            "gap_hertz": veering.gap / (2 * np.pi),
            "resolved": veering.resolved,
        }
        for veering in found.veerings
    ]
    return {
        "drive": drive.name,
        "success": bool(found.good.any()),
        "warnings": sweep_warnings(drive, found),
        "over": found.name,
        "unit": found.unit,
        "values": plain(found.values),
        "hertz": plain(found.frequencies / (2 * np.pi)),
        "dimensionless": plain(found.dimensionless),
        "labels": [span_label(drive, label) for label in found.labels],
        "error": plain(found.error),
        "mac": plain(found.mac),
        "coupling": plain(found.coupling),
        "coupling_total": plain(np.sum(found.coupling, axis=1)),
        "veerings": veerings,
        "failures": [text or None for text in found.outcomes],
    }


def sweep_tables(document: dict[str, Any]) -> Group:
    """Some rows and columns of a sweep, all its modes and its veerings."""
    parts = [*warning_lines(document), _sweep_table(document), _modes_table(document)]
    if document["veerings"]:
        parts.append(_veering_table(document))
    failed = sum(text is not None for text in document["failures"])
    if failed:
        why = next(text for text in document["failures"] if text)
        parts.append(f"{failed} of {len(document['values'])} points failed; the first: {why}")
    return Group(*parts)


def _sweep_table(document: dict[str, Any]) -> Any:
    shown = min(len(document["labels"]), _COLUMNS)
    factor, unit = _shown_in(document)
    title = f"{document['drive']}: natural frequencies (Hz) over {document['over']}"
    columns = ["Gamma", *(str(k + 1) for k in range(shown))]
    table = plain_table(escape(title), f"at ({unit})" if unit else "at", *columns)
    count = len(document["values"])
    for p in np.unique(np.linspace(0, count - 1, min(count, _ROWS)).round().astype(int)):
        row = document["hertz"][p][:shown]
        gamma = number(document["coupling_total"][p], 4)
        table.add_row(f"{factor * document['values'][p]:.6g}", gamma, *(number(x, 2) for x in row))
    return table


def _shown_in(document: dict[str, Any]) -> tuple[float, str]:
    """Factor and unit in which people read the swept number."""
    return (RPM, "rpm") if document["unit"] == "rad/s" else (1.0, document["unit"])


def _modes_table(document: dict[str, Any]) -> Any:
    table = plain_table("Modes, each followed by its shape", "mode", "moves most", "least MAC")
    agreement = np.array(document["mac"], dtype=float)
    for k, label in enumerate(document["labels"]):
        followed = agreement[:, k][agreement[:, k] > 0]  # nan and 0: not there before
        least = number(float(followed.min()), 4) if len(followed) else "-"
        table.add_row(str(k + 1), escape(label), least)
    return table


def _veering_table(document: dict[str, Any]) -> Any:
    factor, unit = _shown_in(document)
    at = f"at ({unit})" if unit else "at"
    table = plain_table("Veerings", "modes", at, "gap (Hz)", "")
    for veering in document["veerings"]:
        modes = " and ".join(map(str, veering["modes"]))
        note = "" if veering["resolved"] else "not resolved: an upper bound"
        table.add_row(
            modes, f"{factor * veering['value']:.6g}", number(veering["gap_hertz"], 3), note
        )
    return table


def response_document(
    drive: Drive, order: float, speeds: np.ndarray, found: Response
) -> dict[str, Any]:
    """Amplitudes (zero to peak) and phases over the driver's speed; null where it failed."""
    failures = [text or None for text in explanations(found.result)]
    good = np.array([text is None for text in failures])

    def kept(table: Any) -> np.ndarray:
        table = np.asarray(table)
        return np.where(good.reshape(-1, *[1] * (table.ndim - 1)), table, np.nan)

    def complex_of(table: Any) -> dict[str, Any]:
        table = kept(table)
        return {"amplitude": plain(np.abs(table)), "phase": plain(np.angle(table))}

    arm = drive.tensioner is not None
    return {
        "drive": drive.name,
        "success": bool(good.any()),
        "warnings": response_warnings(drive, found),
        "order": order,
        "driver_speed_rpm": plain(speeds * RPM),
        "hertz": plain(order * speeds / (2 * np.pi)),
        "pulleys": list(drive.pulley_names),
        "spans": list(drive.span_names),
        "pulley_rotation": complex_of(found.rotations),
        "arm_rotation": complex_of(found.arm_rotation) if arm else None,
        "span_peak": {"amplitude": plain(kept(found.span_peaks))},
        "tension": complex_of(found.tensions),
        "hub_load": {"amplitude": plain(kept(found.hub_loads))},
        "slack_factor": plain(np.min(kept(found.slack_factors)[good], axis=0, initial=np.inf)),
        "failures": failures,
    }


def response_curves(document: dict[str, Any]) -> dict[str, dict[str, np.ndarray]]:
    """Amplitude curves by what they measure and by part, in units for people."""
    pulleys, spans = document["pulleys"], document["spans"]
    kinds = {
        "pulley rotation (deg)": ("pulley_rotation", pulleys, 180 / np.pi),
        "arm rotation (deg)": ("arm_rotation", ["arm"], 180 / np.pi),
        "span deflection (mm)": ("span_peak", spans, 1e3),
        "tension fluctuation (N)": ("tension", spans, 1.0),
        "hub load (N)": ("hub_load", pulleys, 1.0),
    }
    curves = {}
    for kind, (key, names, factor) in kinds.items():
        if document[key] is not None:
            table = factor * np.array(document[key]["amplitude"], dtype=float)
            columns = table.reshape(len(table), -1).T
            curves[kind] = dict(zip(names, columns, strict=True))
    return curves


def response_tables(document: dict[str, Any]) -> Group:
    """The largest amplitude of every part, and at which speed."""
    table = plain_table(
        escape(f"{document['drive']}: peaks of the response to order {document['order']:g}"),
        "of",
        "zero to peak",
        "at (rpm)",
        "at (Hz)",
    )
    for kind, curves in response_curves(document).items():
        for name, curve in curves.items():
            if np.isfinite(curve).any():
                at = int(np.nanargmax(curve))
                rpm, hertz = document["driver_speed_rpm"][at], document["hertz"][at]
                row = f"{curve[at]:.4g}", number(rpm, 0), number(hertz, 1)
                table.add_row(escape(f"{kind}, {name}"), *row)
    lines = warning_lines(document)
    failed = [text for text in document["failures"] if text]
    if not failed:
        return Group(*lines, table)
    count = len(document["failures"])
    return Group(*lines, table, f"{len(failed)} of {count} speeds failed; the first: {failed[0]}")
