"""Drive files: TOML in and out."""

import dataclasses
import os
from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

import numpy as np
import tomli_w

from beltjax.drive.buildable import require_possible_layout
from beltjax.drive.components import ArmSpring, Model, Tensioner, as_real
from beltjax.drive.contact_given import ContactGiven
from beltjax.drive.file_bodies import (
    BodiesOfFile,
    between,
    bodies_content,
    read_bodies,
    require_one_arm,
)
from beltjax.drive.file_grooves import grooves_checked
from beltjax.drive.file_inner_tables import inner_tables_as_numbers
from beltjax.drive.file_makers_data import in_terms_of_the_drive, pitch_offsets
from beltjax.drive.file_operation import (
    OPERATION,
    Runs,
    duties_content,
    excitation_content,
    operation_content,
    read_operation,
)
from beltjax.drive.file_origin import near_the_origin
from beltjax.drive.file_preloads import springs_as_positions
from beltjax.drive.file_pulleys import (
    Wheels,
    belts_of,
    dampers_of,
    isolators_of,
    listed_content,
    pulleys_content,
    pulleys_of,
    read_listed,
)
from beltjax.drive.file_rules import belt_lengths, installation_content, read_installation
from beltjax.drive.file_tables import DriveTable, ModelTable
from beltjax.drive.file_units import units_used
from beltjax.drive.numbers import SPEEDS
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.preloaded import require_tension
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.reading import read_toml
from beltjax.files.tables import validated
from beltjax.files.writing import write_whole

_TERMS = tuple(ModelTable.model_fields)  # of [model]


def load_drive(path: str | os.PathLike[str]) -> tuple[Drive, OperatingPoint]:
    """The drive and the operating point that a TOML file describes.

    Pulleys come belt after belt, and each tensioner after the one that it sits on; otherwise the
    order is that of the file. docs/drive_file.md.

    Args:
        path: the drive file.

    Returns:
        The drive, and the operating point with its excitation.

    Raises:
        FileError: the file is wrong or its layout impossible; one line names the file, the key,
            what was found and what to do.
        RuntimeError: JAX is in single precision.

    Examples:
        >>> drive, point = bj.load_drive("examples/three_pulley.toml")
        >>> drive.pulley_names
    """
    drive, runs = load_runs(path)
    return drive, runs.point


def load_runs(path: str | os.PathLike[str]) -> tuple[Drive, Runs]:
    """The drive of a file, its operating point and its duties; raises as `load_drive` does."""
    drive, runs, _ = _described(_content(path), path)
    return drive, runs


def load_duties(path: str | os.PathLike[str]) -> tuple[Drive, dict[str, OperatingPoint]]:
    """The drive that a TOML file describes, and every duty for which the file gives a table.

    What a duty does not state is that of [operation]. Each is an operating point like that of
    `load_drive`, and all analyses take it.

    Args:
        path: the drive file.

    Returns:
        The drive, and the operating points by the duties' names, in the order of the file; that
        of [operation], by the name "operation", where the file has no duty.

    Raises:
        FileError: as `load_drive` does.
        RuntimeError: JAX is in single precision.

    Examples:
        >>> drive, duties = bj.load_duties("examples/three_pulley.toml")
        >>> {name: bj.steady_state(drive, point) for name, point in duties.items()}
    """
    drive, runs = load_runs(path)
    return drive, runs.duties or {OPERATION: runs.point}


class Geometry(NamedTuple):
    """A file of which only the geometry is used, for `layout` and speed ratios alone."""

    drive: Drive
    point: OperatingPoint
    has_speed: bool  # false where the speed is a stand-in
    belt_lengths: dict[str, float]  # along the neutral axis [m], of the belts that the file gives
    pitch_offsets: dict[str, float]  # [m], likewise


def load_geometry(path: str | os.PathLike[str]) -> Geometry:
    """The drive of a file of which only the geometry is used.

    Stiffness, mass, installation and speed may be left out; numbers without meaning stand in.

    Args:
        path: the drive file.

    Returns:
        The drive and the operating point, and what the file gives of its belts and speeds.

    Raises:
        FileError: as `load_drive` does, for what is there.
        RuntimeError: JAX is in single precision.
    """
    content = _content(path)
    operation = content.get("operation", {})
    given = isinstance(operation, dict) and any(f"operation.{key}" in SPEEDS for key in operation)
    given = given or "duty" in content  # of which each has a speed
    drive, runs, plain = _described(content, path, lambda plain: _with_stand_ins(plain, given))
    rule, belts = plain.get("installation", {}), [belt.name for belt in drive.belts]
    lengths = belt_lengths(rule, belts, path) if isinstance(rule, dict) else {}
    return Geometry(drive, runs.point, given, lengths, pitch_offsets(content, path))


def _content(path: str | os.PathLike[str]) -> dict[str, Any]:
    """The content of a drive file, which is none of a study."""
    as_real(0.0)  # raises for a wrong precision before anything is said about the file
    content = read_toml(path)
    if "drive" in content and "belt" not in content:
        raise FileError(
            path, "drive", "is the key of a study; give its drive file, or `optimize` it"
        )
    return content


def _with_stand_ins(content: dict[str, Any], has_speed: bool) -> dict[str, Any]:
    """`content` with stand-ins for required numbers that do not move the drawn layout."""
    belt = {"axial_stiffness": 1.0, "bending_stiffness": 0.0, "mass_per_length": 1.0}
    given = dict(content)
    given["belt"] = belts = _filled(given.get("belt", {}), belt)
    named = [table.get("name", "belt") for table in belts] if isinstance(belts, list) else []
    given["installation"] = {"tension": dict.fromkeys(named, 1.0) if len(named) > 1 else 1.0}
    if "tensioner" in given:
        given["tensioner"] = _filled(given["tensioner"], {"stiffness": 1.0})
    speed = {} if has_speed else {"driver_speed": 1.0}
    given["operation"] = _filled(given.get("operation", {}), speed)
    return given


def _filled(tables: Any, numbers: dict[str, float]) -> Any:
    """A table, or each of a list, with the numbers that it lacks."""
    if isinstance(tables, list):
        return [_filled(table, numbers) for table in tables]
    return numbers | tables if isinstance(tables, dict) else tables


def _described(
    content: dict[str, Any],
    path: str | os.PathLike[str],
    completed: Callable[[dict[str, Any]], dict[str, Any]] = dict,
) -> tuple[Drive, Runs, dict[str, Any]]:
    """The drive of a file's content, how it runs, and the content in terms of the drive.

    `completed` is that content as it is read in the end.
    """
    require_one_arm(content, path)
    near, origin = near_the_origin(content)
    near = grooves_checked(near, path)
    plain = springs_as_positions(in_terms_of_the_drive(near, path), path)
    plain = inner_tables_as_numbers(plain, path)
    file = validated(DriveTable, completed(plain), path)
    wheels = Wheels(file, path)
    of = read_bodies(file, wheels.shafts, path)
    runs = read_operation(file, wheels, path)
    listed = read_listed(file, path)
    drive = Drive(
        belts=belts_of(file, path),
        pulleys=pulleys_of(wheels, of, path),
        installation=read_installation(file, of, path),
        tensioners=_tensioners(of),
        arm_springs=_arm_springs(of),
        isolators=isolators_of(file, wheels, path),
        dampers=dampers_of(file, wheels, path),
        model=_model(file),
        contact=ContactGiven(**file.contact.model_dump()),
        name=file.name,
        gravity=file.number("gravity"),
        origin=origin if file.origin is None else (file.origin[0], file.origin[1]),
    )
    drive = dataclasses.replace(drive, units=units_used(content, drive, origin, path))
    drive = require_possible_layout(drive, listed, path)
    require_tension(drive, path)
    return drive, runs, plain


def save_drive(
    path: str | os.PathLike[str],
    drive: Drive,
    point: OperatingPoint,
    duties: Mapping[str, OperatingPoint] | None = None,
) -> None:
    """Write a drive file from which `load_drive` restores every number exactly.

    All numbers are SI; those without effect, such as the pivot of a slide, are left out. The file
    has the schema of the one that the drive came with, and is written in one move: it is complete
    or absent.

    Args:
        path: the file to write.
        drive: the drive.
        point: its operating point.
        duties: its duties by their names, as `load_duties` gives them.

    Raises:
        ValueError: no file can describe the drive.
        OSError: the file cannot be written.
    """
    write_whole(path, drive_bytes(drive, point, duties))


def drive_bytes(
    drive: Drive, point: OperatingPoint, duties: Mapping[str, OperatingPoint] | None = None
) -> bytes:
    """The content of the file that `save_drive` writes."""
    return tomli_w.dumps(drive_content(drive, point, duties)).encode()


def drive_content(
    drive: Drive, point: OperatingPoint, duties: Mapping[str, OperatingPoint] | None = None
) -> dict[str, Any]:
    """A drive file as nested dictionaries of plain numbers, absent keys left out."""
    content = {
        "schema": drive.model.schema,
        "name": drive.name,
        "listed": listed_content(drive),
        "model": _model_content(drive.model) or None,
        **pulleys_content(drive),
        **bodies_content(drive),
        "origin": list(drive.origin) if any(drive.origin) else None,
        "gravity": None if drive.gravity is None else np.asarray(drive.gravity).tolist(),
        "installation": installation_content(drive) or None,
        "operation": operation_content(point),
        "duty": duties_content(point, duties or {}) or None,
        "excitation": excitation_content(point),
        "contact": contact_content(drive) or None,
    }
    return {key: value for key, value in content.items() if value is not None}


def contact_content(drive: Drive) -> dict[str, Any]:
    """The settings of contact that differ from the defaults."""
    given, usual = drive.contact._asdict(), ContactGiven()._asdict()
    return {key: value for key, value in given.items() if value != usual[key]}


def _tensioners(of: BodiesOfFile) -> list[Tensioner]:
    names = [body.name for body in of.bodies]
    return [
        Tensioner(
            kind=body.kind,
            locked=body.locked,
            on=[float(name == body.on) for name in names],
            name=body.name,
            **body.numbers,
        )
        for body in of.bodies
    ]


def _arm_springs(of: BodiesOfFile) -> list[ArmSpring]:
    names = [body.name for body in of.bodies]
    return [
        ArmSpring(between(spring, names), spring.stiffness, spring.damping, spring.name)
        for spring in of.springs
    ]


def _model(file: DriveTable) -> Model:
    given = file.model.model_dump(exclude_none=True)
    flags = dict.fromkeys(_TERMS, file.schema_ == 2) | given
    return Model(**flags, schema=file.schema_)


def _model_content(model: Model) -> dict[str, bool]:
    """The terms of the model that a file must give: those that differ from its schema's default."""
    flags = {name: bool(np.asarray(getattr(model, name))) for name in _TERMS}
    return {name: flag for name, flag in flags.items() if flag != (model.schema == 2)}
