"""The file of a page: what was opened, what was changed and what is shown, to be opened again."""

import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
from pydantic import Field, ValidationError

from beltjax import optimize
from beltjax.commands.reports.documents import (
    Document,
    Part,
    complete,
    json_bytes,
    meaning,
    model_flags,
)
from beltjax.commands.reports.warnings import file_warnings
from beltjax.drive.numbers import SPEEDS, is_relative, number_names, number_value
from beltjax.drive.operation import OperatingPoint
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.files.reading import read_json
from beltjax.studio.opened import Opened, open_file
from beltjax.studio.session import Session

_REMEDY = "give the file of a page, which the page saves"
_DEEP = 4  # folders above a study in which its drive file may lie


class ViewPart(Part):
    """What the page shows beside the design."""

    shown: dict[str, bool] = meaning("boxes that are ticked")
    snap: str = meaning("grid of a drag in mm and degrees; 0: none")
    orders: list[float] = meaning("of the driver, over its speed")
    idle: float = meaning("rpm")


class StudioDocument(Document):
    """The file of a page, which `beltjax studio` opens again."""

    drive: str = meaning("name of the drive")
    files: dict[str, str] = meaning("text of the files that were opened, the first one first")
    numbers: dict[str, float] = meaning("of the drive that were changed, SI, by their keys")
    operation: list[dict[str, float]] = meaning("likewise of each operating point")
    case: int = Field(ge=0, description="place of the operating point that is shown")
    view: ViewPart | None = meaning("null: as a page begins")


def page_bytes(session: Session, view: Mapping[str, Any] | None) -> bytes:
    """The file of a page."""
    opened, study, first = session.opened, session.study, session.first
    document = {
        "drive": study.drive.name,
        "model": model_flags(study.drive),
        "warnings": file_warnings(study.drive),
        "files": opened.texts,
        "numbers": _changed(_plain(study.drive), _plain(first.drive)),
        "operation": [
            _changed(_running(study, k), _running(first, k)) for k in range(len(session.cases))
        ],
        "case": session.case,
        "view": dict(view) if view else None,
    }
    checked = StudioDocument.model_validate(complete(document))
    return json_bytes(checked.model_dump(by_alias=True))


def _plain(drive: Drive) -> dict[str, float]:
    """The numbers of a drive that follow from no others."""
    names = [n for n in number_names(drive) if not (is_relative(n) or n.startswith("operation."))]
    point = OperatingPoint(belt_speed=0.0)
    return {name: float(number_value(drive, point, name)) for name in names}


def _running(study: optimize.Study, case: int) -> dict[str, float]:
    """The numbers of an operating point."""
    point = jax.tree.map(lambda x: x[case], study.operating.points)
    speed = SPEEDS[0] if point.driver_speed is None else SPEEDS[1]
    names = [n for n in number_names(study.drive) if n.startswith("operation.torque.")]
    return {n: float(number_value(study.drive, point, n)) for n in (speed, *names)}


def _changed(now: dict[str, float], before: dict[str, float]) -> dict[str, float]:
    return {name: value for name, value in now.items() if value != before.get(name)}


def open_any(path: str | os.PathLike[str]) -> Opened:
    """A drive file, a study file or the file of a page; raises `FileError` for what is wrong."""
    if Path(path).suffix.lower() != ".json":
        return open_file(path)
    try:
        document = StudioDocument.model_validate(read_json(path, _REMEDY))
    except ValidationError as error:
        first = error.errors()[0]
        key = ".".join(map(str, first["loc"]))
        message = f"{first['msg'].lower()}; {_REMEDY}"
        raise FileError(path, key, message) from error
    if not document.files:
        raise FileError(path, "files", f"is empty; {_REMEDY}")
    opened = open_texts(document.files, path)._replace(
        kept={
            "numbers": document.numbers,
            "operation": document.operation,
            "case": document.case,
            "view": document.view.model_dump() if document.view else None,
        }
    )
    try:
        Session(opened)  # whether what was done can be done
    except ValueError as error:
        raise FileError(path, "", f"{error}; {_REMEDY}") from error
    return opened


def open_texts(texts: Mapping[str, str], path: object, first: str | None = None) -> Opened:
    """Files whose texts are at hand, of which the `first` one names the others.

    `path` is what the user knows them by. Raises `FileError`.
    """
    with tempfile.TemporaryDirectory() as folder:
        top = Path(folder).resolve()
        base = top.joinpath(*"x" * _DEEP)
        base.mkdir(parents=True)
        for name, text in texts.items():
            target = (base / name).resolve()
            if not target.is_relative_to(top) or target == top:
                raise FileError(
                    path, "files", f"{name}: lies elsewhere; give a name without a path"
                )
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_text(text, "utf-8")
        own = first or next(iter(texts))
        try:
            return open_file(base / own)
        except FileError as error:
            # The user knows nothing of the folder in which the texts stand here.
            name, _, rest = str(error).replace(f"{base}{os.sep}", "").partition(": ")
            raise FileError(name, "", rest) from error
