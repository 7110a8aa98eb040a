"""JSON documents: their fixed keys, and the description that each key carries."""

import json
import math
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from beltjax.drive.system import Drive

# The version of all documents. Raised where a key goes or changes its meaning; new keys keep it.
VERSION = "1"
Maybe = float | None
Row = list[Maybe]
Number = Maybe | Row | list[Row]


def meaning(text: str, **more: Any) -> Any:
    """A key of a document, with what it holds in words."""
    return Field(description=text, **more)


class Part(BaseModel):
    """A part of a document: no key but those named."""

    model_config = ConfigDict(extra="forbid")


class WarningPart(Part):
    """A limit of the trust in a success."""

    code: str = meaning(
        "`number_without_unit`, `belt_stiff_on_pulley`, `tensioner_moves_far`, "
        "`load_outside_table`, `span_slackens`, `orbit_unstable`, `span_slack_in_motion`, "
        "`slope_too_large`, `belt_slips_in_motion`, `grazing`, `friction_blurred` "
        "(members of `bj.RESULTS`), "
        "`tension_above_allowable`, `belt_slips`, `damper_on_given_motion`, "
        "`damping_joins_clutch`, `cushion_left_out` or `modes_left_out`"
    )
    text: str = meaning("the same in words, with names and numbers")


class ModelPart(Part):
    """Which terms that Kong (2003) leaves out are counted."""

    arm_curvature: bool
    stretching_arcs: bool
    belt_inertia: bool


class Document(Part):
    """The keys that every document has."""

    schema_: Annotated[Literal["1"], Field(alias="schema", description="version of the document")]
    warnings: list[WarningPart] = meaning("empty where nothing limits the trust")
    model: ModelPart = meaning("of the drive file")


class PointDocument(Document):
    """The keys of a document that answers at one of a file's operating points."""

    drive: str
    at: str = meaning("`[operation]` or the duty; empty where the file has no [[duty]]")


def plain(value: Any) -> Any:
    """An array as a number or nested lists; what is not finite becomes None."""
    if value is None:
        return None
    number = np.asarray(value).tolist()
    if isinstance(number, list):
        return [plain(item) for item in number]
    return number if math.isfinite(number) else None


def model_flags(drive: Drive) -> dict[str, bool]:
    """Which terms that the source leaves out are counted."""
    names = "arm_curvature", "stretching_arcs", "belt_inertia"
    return {name: bool(float(getattr(drive.model, name))) for name in names}


def complete(document: dict[str, Any]) -> dict[str, Any]:
    """A command's document with what all of them have: its version, and its warnings if none."""
    return {"schema": VERSION, "warnings": []} | document


def json_bytes(document: dict[str, Any]) -> bytes:
    """A JSON file of one object."""
    return (json_text(document) + "\n").encode()


def json_text(document: dict[str, Any]) -> str:
    """`document` as JSON text."""
    return json.dumps(document, indent=2, allow_nan=False)
