"""What every key of the commands' JSON documents holds: the one description of them.

From it come the JSON Schemas of `schemas/`, for other programs and languages, and the tables of
docs/documents.md, for people; tests hold both to it, and every document that they see to the
schemas. After a change: python -m beltjax.commands.schema
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

# The version of all documents. Raised where a key goes or changes its meaning; new keys keep it.
VERSION = "1"
FOLDER = Path(__file__).parent / "schemas"

Maybe = float | None
Row = list[Maybe]
Number = Maybe | Row | list[Row]
MARK = "<!-- keys: written by python -m beltjax.commands.schema -->\n"


def _of(text: str, **more: Any) -> Any:
    """What a key means."""
    return Field(description=text, **more)


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Warned(_Part):
    """What limits the trust in a success."""

    code: str = _of(
        "`belt_stiff_on_pulley`, `span_slackens` (members of `bj.RESULTS`) or `modes_left_out`"
    )
    text: str = _of("the same in words, with names and numbers")


class Document(_Part):
    """What every document has."""

    schema_: Annotated[Literal["1"], Field(alias="schema", description="version of the document")]
    warnings: list[Warned] = _of("empty where nothing limits the trust")


class SpanLength(_Part):
    """A span of the path."""

    name: str = _of("between its pulleys' names, in listed order")
    length: Maybe = _of("m")


class Layout(_Part):
    """The path of the belt at rest."""

    spans: list[SpanLength]
    wraps_deg: Row = _of("of each pulley")
    path_length: Maybe = _of("m")
    alignment_angles_deg: Annotated[list[float], Field(min_length=2, max_length=2)] | None = _of(
        "beta_in and beta_out; null without a tensioner"
    )


class Reference(_Part):
    """The belt at rest with the torques."""

    tensions: Row = _of("N, of each span")
    unstretched_length: Maybe = _of("m, of the belt")
    arm_angle: Maybe = _of("rad, direction of the arm")
    arm_turn: Maybe = _of("rad, by which torques turned the arm from where it is drawn")
    free_angle: Maybe = _of("rad, with its spring relaxed; whole turns count")
    tensioner_effectiveness: Maybe = _of("eta; null without a tensioner")


class Groups(_Part):
    """The drive in pure numbers, and what they are measured in."""

    bending: Maybe = _of("eps")
    speed: Maybe = _of("s")
    stretch: Maybe = _of("gamma")
    spring: Maybe = _of("k_s; null without a tensioner")
    tensions: Row = _of("of each span at rest, over the tension without torques")
    length: Maybe = _of("m, mean of the spans")
    time: Maybe = _of("s, unit of time")


class Steady(_Part):
    """The running drive."""

    tension_change: Maybe = _of("T, over the tension at rest without torques")
    tensions: Row = _of("N, of each span")
    arm_rotation: Maybe = _of("rad, from where it is at rest with the torques")
    coupling: Row = _of("Gamma of each span")
    stiffness_ratios: Row = _of("sqrt(EI/T)/radius of each pulley")
    coupling_total: Maybe = _of("Gamma")


class ModeTable(_Part):
    """The lowest modes, each list by mode."""

    dimensionless: Row = _of("frequencies in the unit of time")
    hertz: Row = _of("Hz")
    labels: list[str] = _of("what moves")
    error: Row = _of("relative, estimated")


class Slopes(_Part):
    """Derivatives with respect to every number of the file, by its key, SI."""

    coupling_total: dict[str, Number] = _of("of Gamma; a point has two")
    frequencies: dict[str, Number] | None = _of("of each mode's frequency [rad/s]")


class Analyze(Document):
    """`beltjax analyze`."""

    drive: str = _of("name of the drive")
    pulleys: list[str] = _of("names in listed order")
    success: bool
    layout: Layout
    reference: Reference | None = _of("null where none was found")
    groups: Groups | None
    steady: Steady | None = _of("null where the drive does not run")
    modes: ModeTable | None = _of("null without inertias")
    sensitivities: Slopes | None


class VeeringFound(_Part):
    """Two modes that come close and exchange their shapes."""

    value: float = _of("of the swept number, SI")
    modes: list[int] = _of("counted from 1")
    gap_hertz: float = _of("Hz, least distance")
    resolved: bool = _of("false: the gap is an upper bound")


class Sweep(Document):
    """`beltjax sweep`: rows by value, columns by mode."""

    drive: str
    success: bool = _of("whether any point succeeded")
    over: str = _of("key of the swept number")
    unit: str = _of("SI; empty for a pure number")
    values: list[float] = _of("of the swept number, with those inserted")
    hertz: list[Row] = _of("Hz; null where a mode is absent")
    dimensionless: list[Row]
    labels: list[str] = _of("what moves most in each mode")
    error: list[Row] = _of("relative, of the frequencies")
    mac: list[Row] = _of("agreement of shapes with the last good point")
    coupling: list[Row] = _of("Gamma of each span")
    coupling_total: Row = _of("Gamma")
    veerings: list[VeeringFound]
    failures: list[str | None] = _of("why each point failed")


class Swing(_Part):
    """A complex amplitude over the speeds."""

    amplitude: Row | list[Row] = _of("zero to peak")
    phase: Row | list[Row] = _of("rad")


class Peak(_Part):
    """An amplitude over the speeds."""

    amplitude: list[Row] = _of("zero to peak")


class ForcedResponse(Document):
    """`beltjax response`: rows by speed, columns by pulley or span."""

    drive: str
    success: bool = _of("whether any speed succeeded")
    order: float = _of("of the excitation, per rotation of the driver")
    driver_speed_rpm: list[float] = _of("rpm")
    hertz: list[float] = _of("Hz, of the excitation")
    pulleys: list[str] = _of("names of the columns")
    spans: list[str] = _of("names of the columns")
    pulley_rotation: Swing = _of("rad")
    arm_rotation: Swing | None = _of("rad; null without a tensioner")
    span_peak: Peak = _of("m, largest deflection of each span")
    tension: Swing = _of("N, fluctuation of each span's tension")
    hub_load: Peak = _of("N, on each pulley")
    slack_factor: Row = _of(
        "part of the excitation from which on each span goes slack; null: none does"
    )
    failures: list[str | None] = _of("why each speed failed")


class TouchedPulley(_Part):
    """A pulley and the belt on it."""

    name: str
    wrap_deg: Maybe = _of("negative where the belt would have to bend back")
    slip_deg: Maybe
    adhesion_deg: Maybe = _of("wrap less slip")
    moment: Maybe = _of("N m, taken from the belt; the driver's is negative")
    speed: Maybe = _of("rad/s")
    contact_radius: Maybe = _of(
        "of the belt at contact over the pulley's; 1 unless it touches at one point"
    )


class FreeSpan(_Part):
    """A free span, start and end in the direction of travel."""

    name: str
    length: Maybe = _of("m, stretched")
    unstretched_length: Maybe = _of("m")
    tension_start: Maybe = _of("N")
    tension_mid: Maybe = _of("N")
    tension_end: Maybe = _of("N")
    speed_start: Maybe = _of("m/s")
    speed_end: Maybe = _of("m/s")
    angle_start_deg: Maybe = _of("direction of the belt, from the line of centers")
    angle_end_deg: Maybe = _of("likewise")


class Contact(Document):
    """`beltjax contact`: numbers are null where no state was found."""

    drive: str
    feasible: bool = _of("whether the state found can be: nothing slips fully, nothing leaves")
    pulleys: list[TouchedPulley] | None
    spans: list[FreeSpan] | None
    unstretched_length: Maybe = _of("m, of the belt")
    efficiency: Maybe = _of("power taken over power given")
    driver_moment: Maybe = _of("N m")
    driven_moment: Maybe = _of("N m; of two pulleys only")
    torque_factor: Maybe = _of("on the torques of the file; 1 without --maximum")
    string_tension: Maybe = _of("N, that this belt would have as a string in the drawn layout")
    arm_angle: Maybe = _of("rad")
    free_angle: Maybe = _of("rad")
    unstretched_speed: Maybe = _of("m/s, of the unstretched belt")
    mass_flow: Maybe = _of("kg/s")
    message: str = _of("why it is not feasible, or empty")


class Objective(_Part):
    """The objective before and after."""

    initial: Maybe = _of("null where the study's own drive does not run")
    final: Maybe


class Limit(_Part):
    """A limit and the quantity it holds, SI and rad."""

    quantity: str
    value: Maybe = _of("the part closest to its limit")
    lower: Maybe
    upper: Maybe
    multiplier: Maybe = _of("what the next unit of the limit would buy; null: no optimum")
    active: bool
    violation: Maybe


class Start(_Part):
    """How one start ended."""

    final: Maybe
    result: str


class Conditions(_Part):
    """Conditions of an optimum at the design, checked numerically in the scaled problem."""

    residual: float = _of("largest of the next three")
    stationarity: float
    violation: float
    complementarity: float
    curvature: Maybe = _of("least, along the active limits: above 0 at a strict minimum")


class OptimumFound(_Part):
    """A design in which starts ended."""

    values: dict[str, float] = _of("of the variables, SI")
    objective: float
    starts: int = _of("that ended there")
    residual: float


class Iterations(_Part):
    """Every iteration of every start."""

    objective: list[Row]
    violation: list[Row]


class ChosenOption(_Part):
    """The best design with one combination of choices."""

    labels: dict[str, str]
    numbers: dict[str, float]
    objective: Maybe
    design: dict[str, float]
    success: bool


class AsDrawn(_Part):
    """Values without the tolerances."""

    objective: Maybe
    constraints: dict[str, Maybe]


class Scattered(_Part):
    """What a study counts of its tolerances."""

    counted: str
    numbers: list[str]
    as_drawn: AsDrawn


class Optimize(Document):
    """`beltjax optimize`."""

    design: dict[str, float] = _of("of the variables, SI")
    objective: Objective
    constraints: list[Limit] = _of("those of the study")
    implied_constraints: list[Limit] = _of("those of every drive that can be built")
    success: bool
    starts: list[Start]
    active_bounds: dict[str, float] = _of("what the next unit of a variable's bound would buy")
    conflicts: list[str] = _of("limits that cannot be met together")
    optimality: Conditions | None = _of("null where the design is no optimum")
    optima: list[OptimumFound] = _of("the best first")
    scales: dict[str, float] = _of("in which residuals are measured")
    history: Iterations
    choices: list[ChosenOption] = _of("only of a study with choices", default=[])
    robust: Scattered | None = _of("only of a study with tolerances", default=None)


class Designed(_Part):
    """A design of the front."""

    objectives: dict[str, float]
    design: dict[str, float] = _of("of the variables, SI")
    residual: Maybe = _of("of the conditions of an optimum")


class Pareto(Document):
    """`beltjax pareto`."""

    objectives: list[str] = _of("names")
    points: list[Designed]
    success: bool


class Extreme(_Part):
    """An extreme and the design that has it."""

    value: Maybe
    at: dict[str, float]


class Explored(_Part):
    """A quantity over all designs."""

    name: str
    unit: str
    found: int = _of("designs that have it")
    least: Extreme | None
    mean: Maybe = _of("null for a quantity of parts")
    greatest: Extreme | None


class Ended(_Part):
    """How many designs ended in one way."""

    result: str = _of("a member of `bj.RESULTS`")
    designs: int
    text: str


class Explore(Document):
    """`beltjax explore`."""

    drive: str
    store: str = _of("folder of the Zarr store")
    designs: int
    designs_before: int = _of("that the store held already")
    repaired: list[str] = _of("damage that was mended")
    seconds: float
    quantities: list[Explored]
    outcomes: list[Ended] = _of("the most frequent first")
    success: bool = _of("whether any design succeeded")


class Index(_Part):
    """Sobol indices of one tolerance."""

    first: float
    total: float


class Spread(_Part):
    """How a quantity scatters, SI."""

    name: str
    unit: str
    nominal: float
    mean: float
    deviation: float = _of("standard")
    low: float = _of("below it lies 1 - quantile")
    high: float = _of("above it lies 1 - quantile")
    linear_deviation: float = _of("by exact slopes")
    shares: dict[str, float] = _of("of the variance by slopes, by tolerance")
    indices: dict[str, Index] = _of("only with --indices", default={})


class Robust(Document):
    """`beltjax robust`."""

    drive: str
    success: bool
    samples: int
    failed: int = _of("samples in which no such drive runs; left out")
    quantile: float
    quantities: list[Spread]


DOCUMENTS: dict[str, type[Document]] = {
    "analyze": Analyze,
    "sweep": Sweep,
    "response": ForcedResponse,
    "contact": Contact,
    "optimize": Optimize,
    "pareto": Pareto,
    "explore": Explore,
    "robust": Robust,
}


def json_schema(command: str) -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of the document of `beltjax COMMAND`."""
    named = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:beltjax:{command}:{VERSION}",
    }
    return named | _open(DOCUMENTS[command].model_json_schema())


def _open(schema: Any) -> Any:
    """A schema that admits keys of later versions; here, a key without a place is a mistake."""
    if isinstance(schema, list):
        return [_open(item) for item in schema]
    if not isinstance(schema, dict):
        return schema
    kept = {key: _open(value) for key, value in schema.items()}
    if kept.get("additionalProperties") is False:
        del kept["additionalProperties"]
    return kept


def schema_text(command: str) -> str:
    """The content of `schemas/COMMAND.json`."""
    return json.dumps(json_schema(command), indent=2) + "\n"


def key_tables() -> str:
    """The tables of docs/documents.md: every key of every document."""
    parts = []
    for command in DOCUMENTS:
        schema = json_schema(command)
        rows = "\n".join(f"| `{key}` | {kind} | {text} |" for key, kind, text in _keys(schema))
        parts.append(f"## {command}\n\n| key | holds | means |\n|---|---|---|\n{rows}\n")
    return "\n".join(parts)


def _keys(schema: dict[str, Any]) -> Iterator[tuple[str, str, str]]:
    """Key, kind and meaning of every key, those of parts behind a dot."""
    parts = schema.get("$defs", {})

    def inside(of: dict[str, Any], path: str) -> Iterator[tuple[str, str, str]]:
        for key, value in of["properties"].items():
            kind, part = _kind(value, parts)
            text = value.get("description", (part or {}).get("description", "").rstrip("."))
            yield f"{path}{key}", kind, text
            if part is not None:
                yield from inside(part, f"{path}{key}.")

    yield from inside(schema, "")


def _kind(value: dict[str, Any], parts: dict[str, Any]) -> tuple[str, dict[str, Any] | None]:
    """In words what a value is, and the part whose keys it has, if any."""
    if "$ref" in value:
        return "object", parts[value["$ref"].rsplit("/", 1)[1]]
    if "const" in value:
        return f'`"{value["const"]}"`', None
    if "anyOf" in value:
        kinds = [_kind(one, parts) for one in value["anyOf"]]
        words = list(dict.fromkeys(word for word, _ in kinds))
        return " or ".join(words), next((part for _, part in kinds if part), None)
    if value["type"] == "array":
        word, part = _kind(value["items"], parts)
        return f"list of ({word})" if " or " in word else f"list of {word}", part
    if "properties" not in value and value["type"] == "object":
        word, part = _kind(value["additionalProperties"], parts)
        return f"({word}) by name" if " or " in word else f"{word} by name", part
    return value["type"], None


def _write() -> None:
    """Make the schemas and the tables of the documentation anew, in a checkout."""
    FOLDER.mkdir(exist_ok=True)
    for command in DOCUMENTS:
        (FOLDER / f"{command}.json").write_text(schema_text(command))
    page = Path(__file__).parents[2] / "docs" / "documents.md"
    page.write_text(page.read_text().split(MARK)[0] + MARK + "\n" + key_tables())


if __name__ == "__main__":
    _write()
