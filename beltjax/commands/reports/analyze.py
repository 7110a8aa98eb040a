"""The work of `beltjax analyze`: it turns a drive file into a report."""

import os
from typing import Annotated, Any

import jax
import numpy as np
from pydantic import Field

from beltjax.analysis.linearization import has_inertias
from beltjax.analysis.modes import Modes
from beltjax.analysis.sensitivity import (
    Gradient,
    Sensitivities,
    canonical_sensitivities,
    in_names_of,
)
from beltjax.analysis.steady import SteadyState
from beltjax.commands.reports import states
from beltjax.commands.reports.analyze_tables import analyze_tables
from beltjax.commands.reports.cushioned import CushionPart, cushion_part
from beltjax.commands.reports.diagnosis import diagnose
from beltjax.commands.reports.documents import (
    Document,
    Maybe,
    Number,
    Part,
    Row,
    meaning,
    model_flags,
    plain,
)
from beltjax.commands.reports.duties import (
    DutyPart,
    WorstPart,
    duties_document,
    duty_failure,
    duty_warnings,
)
from beltjax.commands.reports.report import Report
from beltjax.commands.reports.units import TableUnits
from beltjax.commands.reports.vibrating import MOST_VIBRATING, require_few_pulleys, require_inertias
from beltjax.commands.reports.warnings import file_warnings, modes_left_out, steady_warnings
from beltjax.compiling.kept_programs import run_kept
from beltjax.draw.labels import mode_labels
from beltjax.drive.bodies import single_arm
from beltjax.drive.canonical import canonical
from beltjax.drive.files import load_runs
from beltjax.drive.numbers import named_numbers
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.numerics.bases import AbstractBasis, Legendre
from beltjax.results import RESULTS, succeeded

MODES = 8
_FUNCTIONS = 40  # a span: frequencies to 1e-6 for any bending stiffness, and mostly to 1e-10
_COORDINATES = 500  # of all spans, whose modes are found in some seconds


class SpanPart(Part):
    """A span of the path."""

    name: str = meaning("between its pulleys' names, in listed order")
    length: Maybe = meaning("m")


class LayoutPart(Part):
    """The path of the belt at rest."""

    spans: list[SpanPart]
    wraps_deg: Row = meaning("of each pulley")
    path_length: Maybe = meaning("m")
    alignment_angles_deg: Annotated[list[float], Field(min_length=2, max_length=2)] | None = (
        meaning("beta_in and beta_out; null unless one arm carries one pulley")
    )


class ReferencePart(Part):
    """The belt at rest with the torques."""

    tensions: Row = meaning("N, of each span")
    unstretched_length: Maybe = meaning("m, of the belt")
    arm_angle: Maybe = meaning("rad, direction of the arm")
    arm_turn: Maybe = meaning("rad, by which torques turned the arm from where it is drawn")
    free_angle: Maybe = meaning("rad, with its spring relaxed; whole turns count")
    tensioner_effectiveness: Maybe | Row = meaning(
        "eta; null without a tensioner; of several belts a list"
    )


class GroupsPart(Part):
    """The drive in pure numbers, and what they are measured in."""

    bending: Maybe = meaning("eps")
    speed: Maybe = meaning("s")
    stretch: Maybe = meaning("gamma")
    spring: Maybe = meaning("k_s; null without a tensioner")
    tensions: Row = meaning("of each span at rest, over the tension without torques")
    length: Maybe = meaning("m, mean of the spans")
    time: Maybe = meaning("s, unit of time")


class SteadyPart(Part):
    """The running drive."""

    tension_change: Maybe | Row = meaning("T, over the tension at rest without torques")
    tensions: Row = meaning("N, of each span")
    arm_rotation: Maybe = meaning("rad, from where it is at rest with the torques")
    coupling: Row = meaning("Gamma of each span")
    stiffness_ratios: Row = meaning("sqrt(EI/T)/radius of each pulley")
    coupling_total: Maybe = meaning("Gamma")


class ModesPart(Part):
    """The lowest modes, each list by mode."""

    dimensionless: Row = meaning("frequencies in the unit of time")
    hertz: Row = meaning("Hz")
    labels: list[str] = meaning("what moves")
    error: Row = meaning("relative, estimated")


class SlopesPart(Part):
    """Derivatives with respect to every number of the file, by its key, SI."""

    coupling_total: dict[str, Number] = meaning("of Gamma; a point has two")
    frequencies: dict[str, Number] | None = meaning("of each mode's frequency [rad/s]")


class AnalyzeDocument(Document):
    """`beltjax analyze`."""

    drive: str = meaning("name of the drive")
    success: bool
    layout: LayoutPart
    reference: ReferencePart | None = meaning("null where none was found")
    groups: GroupsPart | None
    steady: SteadyPart | None = meaning("null where the drive does not run")
    coordinates: list[states.CoordinatePart] | None = meaning("of the tensioners, where they rest")
    belts: list[states.BeltPart] | None
    pulleys: list[states.PulleyPart] = meaning("in listed order")
    spans: list[states.SpanStatePart] = meaning("in listed order")
    isolators: list[states.IsolatorPart] | None
    duty: str | None = meaning("that all but the next three keys are of; null: [operation]")
    duties: list[DutyPart] | None = meaning("null where the file has none")
    worst: list[WorstPart] | None = meaning("of the duties that run, one for each quantity")
    worst_hub_loads: list[WorstPart] | None = meaning("of the duties that run, one a pulley")
    modes: ModesPart | None = meaning("null without inertias")
    cushion: CushionPart | None = meaning("null unless the belt has a cushion")
    sensitivities: SlopesPart | None


def analyze_report(
    path: str | os.PathLike[str],
    figure: str | None = None,
    si: bool = False,
    page: str | None = None,
) -> Report:
    """Analyze one drive file, and draw its modes where `figure` names a picture.

    Tables are in the units of the file, or in SI. `page` names a report in HTML.

    Raises `FileError` where the file describes no possible drive.
    """
    drive, (point, duties) = load_runs(path)
    if figure:
        require_inertias(drive, path, "modes to draw need")
        require_few_pulleys(drive, path, "modes to draw")
    numbers = canonical(drive, point)
    pulleys = len(drive.pulleys)
    few = pulleys <= MOST_VIBRATING
    basis = Legendre(min(_FUNCTIONS, max(_COORDINATES // pulleys, 1)))
    count = MODES if few else 0
    found, read = jax.device_get(run_kept(_analyzed, *numbers, count, basis))
    found = in_names_of(drive, point, found)
    why = diagnose(drive, point, found.steady)
    if why and why.impossible:
        raise FileError(path, why.key, why.message)
    failure = str(FileError(path, why.key, why.message)) if why else ""
    document = analyze_document(drive, point, found, read)
    if duties:
        document |= duties_document(drive, point, duties)
        document["warnings"] = duty_warnings(document)
        failure = failure or duty_failure(document["duties"], path)
    document["cushion"], soft = (None, []) if failure else cushion_part(drive, point)
    document["warnings"] = [*file_warnings(drive), *document["warnings"], *soft]
    document["success"] = not failure
    if has_inertias(drive) and not few:
        document["warnings"].append(modes_left_out(drive, MOST_VIBRATING))
    sizes, units = plain_numbers(drive, point), TableUnits(drive, si)
    tables = analyze_tables(document, sizes, units)
    files: list[tuple[str, bytes]] = []
    if figure and found.modes and not failure:
        from beltjax.draw.layouts import mode_shapes, picture_bytes  # slow to load

        picture = mode_shapes(drive, point, found.modes)
        files.append((figure, picture_bytes(picture, figure)))
    if page:
        from beltjax.commands.reports.analyze_page import analyze_page  # slow to load

        content = analyze_page(drive, point, found, document, sizes, failure, units)
        files.append((page, content))
    return Report(document, tables, failure, tuple(files))


def _analyzed(
    drive: Drive, point: OperatingPoint, count: int, basis: AbstractBasis
) -> tuple[Sensitivities, states.Readings]:
    """All that is computed of a drive: one program."""
    found = canonical_sensitivities(drive, point, count, basis)
    return found, states.readings(drive, point, found.steady)


def analyze_document(
    drive: Drive, point: OperatingPoint, found: Sensitivities, read: states.Readings
) -> dict[str, Any]:
    """Layout, reference state, groups, steady state, modes and sensitivities of one drive.

    What does not apply is None: the arm of a drive without tensioner, the states beyond one
    that failed.
    """
    steady = found.steady
    running = bool(succeeded(steady.result))
    rested = bool(succeeded(steady.reference.result))
    rests = rested or bool(steady.reference.result == RESULTS.span_slack)
    return {
        "drive": drive.name,
        "model": model_flags(drive),
        "success": running,
        "warnings": steady_warnings(drive, point, steady, read),
        "layout": _layout(drive, steady, read),
        "reference": _reference(drive, steady, rested) if rests else None,
        "groups": _groups(steady) if rested else None,
        "steady": _steady(drive, steady) if running else None,
        "coordinates": states.coordinates(drive, steady, running) if rests else None,
        "belts": states.belts(drive, steady, running) if rests else None,
        "pulleys": states.pulleys(drive, steady, read, running),
        "spans": states.spans(drive, steady, read, running),
        "isolators": states.isolators(drive, steady) if rests else None,
        **dict.fromkeys(("duty", "duties", "worst", "worst_hub_loads")),
        "modes": _modes(drive, found.modes) if running and found.modes else None,
        "cushion": None,
        "sensitivities": _sensitivities(drive, found) if running else None,
    }


def plain_numbers(
    drive: Drive, point: OperatingPoint, of: tuple[Drive, OperatingPoint] | None = None
) -> dict[str, Any]:
    """The numbers of a drive, or of a gradient by those `of` one, by their keys in the file."""
    return {name: plain(value) for name, value in named_numbers(drive, point, of).items()}


def _layout(drive: Drive, steady: SteadyState, read: states.Readings) -> dict[str, Any]:
    at = steady.reference.layout
    lengths = plain(at.span_lengths)
    spans = [
        {"name": name, "length": length}
        for name, length in zip(drive.span_names, lengths, strict=True)
    ]
    return {
        "spans": spans,
        "wraps_deg": plain(np.degrees(at.wraps)),
        "path_length": plain(at.path_length),
        "alignment_angles_deg": plain(np.degrees(read.alignment_angles[0]))
        if single_arm(drive)
        else None,
    }


def _reference(drive: Drive, steady: SteadyState, rested: bool) -> dict[str, Any]:
    reference = steady.reference
    arm = single_arm(drive)
    effective = rested and len(drive.tensioners) > 0
    eta = np.asarray(steady.effectiveness)
    own = np.diagonal(eta) if eta.ndim else eta  # of several belts, what its own speed does to each
    return {
        "tensions": plain(reference.tensions),
        "unstretched_length": plain(reference.unstretched_length),
        "arm_angle": plain(reference.arm_angle) if arm else None,
        "arm_turn": plain(reference.coordinates[0]) if arm else None,  # from drawn
        "free_angle": plain(reference.free_angle) if arm else None,
        "tensioner_effectiveness": plain(own) if effective else None,
    }


def _groups(steady: SteadyState) -> dict[str, Any]:
    groups, scales = steady.groups, steady.scales
    return {
        "bending": plain(groups.bending),
        "speed": plain(groups.speed),
        "stretch": plain(groups.stretch),
        "spring": plain(groups.spring) if len(groups.units) == 1 else None,
        "tensions": plain(groups.tensions),
        "length": plain(scales.length),
        "time": plain(scales.time),
    }


def _steady(drive: Drive, steady: SteadyState) -> dict[str, Any]:
    return {
        "tension_change": plain(steady.tension_change),
        "tensions": plain(steady.running_tensions),
        "arm_rotation": plain(steady.arm_rotation) if single_arm(drive) else None,
        "coupling": plain(steady.coupling),
        "stiffness_ratios": plain(steady.stiffness_ratios),
        "coupling_total": plain(np.sum(steady.coupling)),
    }


def _modes(drive: Drive, modes: Modes) -> dict[str, Any]:
    return {
        "dimensionless": plain(modes.dimensionless),
        "hertz": plain(np.asarray(modes.frequencies) / (2 * np.pi)),
        "labels": list(mode_labels(drive, modes)),
        "error": plain(modes.error),
    }


def _sensitivities(drive: Drive, found: Sensitivities) -> dict[str, Any]:
    def named(gradient: Gradient) -> dict[str, Any]:
        # The point of a gradient has the numbers that the drive's own has.
        return plain_numbers(*gradient, of=(drive, gradient[1]))

    frequencies = found.frequencies
    return {
        "coupling_total": named(found.coupling),
        "frequencies": None if frequencies is None else named(frequencies),
    }
