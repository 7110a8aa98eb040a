"""What every key of the commands' JSON documents holds: the one description of them.

From it come the JSON Schemas of `schemas/`, for other programs and languages, and the tables of
docs/documents.md, for people; tests hold both to it, and every document that they see to the
schemas. After a change: python -m beltjax.report.schema
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
MARK = "<!-- keys: written by python -m beltjax.report.schema -->\n"


def _of(kind: Any, text: str, **more: Any) -> Any:
    """A key of this kind, with what it means."""
    return Annotated[kind, Field(description=text, **more)]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid")


class Warned(_Part):
    """What limits the trust in a success."""

    code: _of(str, "a member of `bj.RESULTS`: `belt_stiff_on_pulley`, `span_slackens`")
    text: _of(str, "the same in words, with names and numbers")


class Document(_Part):
    """What every document has."""

    schema_: Annotated[Literal["1"], Field(alias="schema", description="version of the document")]
    warnings: _of(list[Warned], "empty where nothing limits the trust")


class SpanLength(_Part):
    """A span of the path."""

    name: _of(str, "between its pulleys' names, in listed order")
    length: _of(Maybe, "m")


class Layout(_Part):
    """The path of the belt at rest."""

    spans: list[SpanLength]
    wraps_deg: _of(Row, "of each pulley")
    path_length: _of(Maybe, "m")
    alignment_angles_deg: _of(
        Annotated[list[float], Field(min_length=2, max_length=2)] | None,
        "beta_in and beta_out; null without a tensioner",
    )


class Reference(_Part):
    """The belt at rest with the torques."""

    tensions: _of(Row, "N, of each span")
    unstretched_length: _of(Maybe, "m, of the belt")
    arm_angle: _of(Maybe, "rad, direction of the arm")
    free_angle: _of(Maybe, "rad, with its spring relaxed; whole turns count")
    tensioner_effectiveness: _of(Maybe, "eta; null without a tensioner")


class Groups(_Part):
    """The drive in pure numbers, and what they are measured in."""

    bending: _of(Maybe, "eps")
    speed: _of(Maybe, "s")
    stretch: _of(Maybe, "gamma")
    spring: _of(Maybe, "k_s; null without a tensioner")
    tensions: _of(Row, "of each span at rest, over the tension without torques")
    length: _of(Maybe, "m, mean of the spans")
    time: _of(Maybe, "s, unit of time")


class Steady(_Part):
    """The running drive."""

    tension_change: _of(Maybe, "T, over the tension at rest without torques")
    tensions: _of(Row, "N, of each span")
    arm_rotation: _of(Maybe, "rad, from where it is at rest with the torques")
    coupling: _of(Row, "Gamma of each span")
    stiffness_ratios: _of(Row, "sqrt(EI/T)/radius of each pulley")
    coupling_total: _of(Maybe, "Gamma")


class ModeTable(_Part):
    """The lowest modes, each list by mode."""

    dimensionless: _of(Row, "frequencies in the unit of time")
    hertz: _of(Row, "Hz")
    labels: _of(list[str], "what moves")
    error: _of(Row, "relative, estimated")


class Slopes(_Part):
    """Derivatives with respect to every number of the file, by its key, SI."""

    coupling_total: _of(dict[str, Number], "of Gamma; a point has two")
    frequencies: _of(dict[str, Number] | None, "of each mode's frequency [rad/s]")


class Analyze(Document):
    """`beltjax analyze`."""

    drive: _of(str, "name of the drive")
    pulleys: _of(list[str], "names in listed order")
    success: bool
    layout: Layout
    reference: _of(Reference | None, "null where none was found")
    groups: Groups | None
    steady: _of(Steady | None, "null where the drive does not run")
    modes: _of(ModeTable | None, "null without inertias")
    sensitivities: Slopes | None


class VeeringFound(_Part):
    """Two modes that come close and exchange their shapes."""

    value: _of(float, "of the swept number, SI")
    modes: _of(list[int], "counted from 1")
    gap_hertz: _of(float, "Hz, least distance")
    resolved: _of(bool, "false: the gap is an upper bound")


class Sweep(Document):
    """`beltjax sweep`: rows by value, columns by mode."""

    drive: str
    success: _of(bool, "whether any point succeeded")
    over: _of(str, "key of the swept number")
    unit: _of(str, "SI; empty for a pure number")
    values: _of(list[float], "of the swept number, with those inserted")
    hertz: _of(list[Row], "Hz; null where a mode is absent")
    dimensionless: list[Row]
    labels: _of(list[str], "what moves most in each mode")
    error: _of(list[Row], "relative, of the frequencies")
    mac: _of(list[Row], "agreement of shapes with the last good point")
    coupling: _of(list[Row], "Gamma of each span")
    coupling_total: _of(Row, "Gamma")
    veerings: list[VeeringFound]
    failures: _of(list[str | None], "why each point failed")


class Swing(_Part):
    """A complex amplitude over the speeds."""

    amplitude: _of(Row | list[Row], "zero to peak")
    phase: _of(Row | list[Row], "rad")


class Peak(_Part):
    """An amplitude over the speeds."""

    amplitude: _of(list[Row], "zero to peak")


class ForcedResponse(Document):
    """`beltjax response`: rows by speed, columns by pulley or span."""

    drive: str
    success: _of(bool, "whether any speed succeeded")
    order: _of(float, "of the excitation, per rotation of the driver")
    driver_speed_rpm: _of(list[float], "rpm")
    hertz: _of(list[float], "Hz, of the excitation")
    pulleys: _of(list[str], "names of the columns")
    spans: _of(list[str], "names of the columns")
    pulley_rotation: _of(Swing, "rad")
    arm_rotation: _of(Swing | None, "rad; null without a tensioner")
    span_peak: _of(Peak, "m, largest deflection of each span")
    tension: _of(Swing, "N, fluctuation of each span's tension")
    hub_load: _of(Peak, "N, on each pulley")
    slack_factor: _of(
        Row, "part of the excitation from which on each span goes slack; null: none does"
    )
    failures: _of(list[str | None], "why each speed failed")


class TouchedPulley(_Part):
    """A pulley and the belt on it."""

    name: str
    wrap_deg: _of(Maybe, "negative where the belt would have to bend back")
    slip_deg: Maybe
    adhesion_deg: _of(Maybe, "wrap less slip")
    moment: _of(Maybe, "N m, taken from the belt; the driver's is negative")
    speed: _of(Maybe, "rad/s")
    contact_radius: _of(
        Maybe, "of the belt at contact over the pulley's; 1 unless it touches at one point"
    )


class FreeSpan(_Part):
    """A free span, start and end in the direction of travel."""

    name: str
    length: _of(Maybe, "m, stretched")
    unstretched_length: _of(Maybe, "m")
    tension_start: _of(Maybe, "N")
    tension_mid: _of(Maybe, "N")
    tension_end: _of(Maybe, "N")
    speed_start: _of(Maybe, "m/s")
    speed_end: _of(Maybe, "m/s")
    angle_start_deg: _of(Maybe, "direction of the belt, from the line of centers")
    angle_end_deg: _of(Maybe, "likewise")


class Contact(Document):
    """`beltjax contact`: numbers are null where no state was found."""

    drive: str
    feasible: _of(bool, "whether the state found can be: nothing slips fully, nothing leaves")
    pulleys: list[TouchedPulley] | None
    spans: list[FreeSpan] | None
    unstretched_length: _of(Maybe, "m, of the belt")
    efficiency: _of(Maybe, "power taken over power given")
    driver_moment: _of(Maybe, "N m")
    driven_moment: _of(Maybe, "N m; of two pulleys only")
    torque_factor: _of(Maybe, "on the torques of the file; 1 without --maximum")
    string_tension: _of(Maybe, "N, that this belt would have as a string in the drawn layout")
    arm_angle: _of(Maybe, "rad")
    free_angle: _of(Maybe, "rad")
    unstretched_speed: _of(Maybe, "m/s, of the unstretched belt")
    mass_flow: _of(Maybe, "kg/s")
    message: _of(str, "why it is not feasible, or empty")


class Objective(_Part):
    """The objective before and after."""

    initial: _of(Maybe, "null where the study's own drive does not run")
    final: Maybe


class Limit(_Part):
    """A limit and the quantity it holds, SI and rad."""

    quantity: str
    value: _of(Maybe, "the part closest to its limit")
    lower: Maybe
    upper: Maybe
    multiplier: _of(Maybe, "what the next unit of the limit would buy; null: no optimum")
    active: bool
    violation: Maybe


class Start(_Part):
    """How one start ended."""

    final: Maybe
    result: str


class Conditions(_Part):
    """Conditions of an optimum at the design, checked numerically in the scaled problem."""

    residual: _of(float, "largest of the next three")
    stationarity: float
    violation: float
    complementarity: float
    curvature: _of(Maybe, "least, along the active limits: above 0 at a strict minimum")


class OptimumFound(_Part):
    """A design in which starts ended."""

    values: _of(dict[str, float], "of the variables, SI")
    objective: float
    starts: _of(int, "that ended there")
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

    design: _of(dict[str, float], "of the variables, SI")
    objective: Objective
    constraints: _of(list[Limit], "those of the study")
    implied_constraints: _of(list[Limit], "those of every drive that can be built")
    success: bool
    starts: list[Start]
    active_bounds: _of(dict[str, float], "what the next unit of a variable's bound would buy")
    conflicts: _of(list[str], "limits that cannot be met together")
    optimality: _of(Conditions | None, "null where the design is no optimum")
    optima: _of(list[OptimumFound], "the best first")
    scales: _of(dict[str, float], "in which residuals are measured")
    history: Iterations
    choices: _of(list[ChosenOption], "only of a study with choices", default=[])
    robust: _of(Scattered | None, "only of a study with tolerances", default=None)


class Designed(_Part):
    """A design of the front."""

    objectives: dict[str, float]
    design: _of(dict[str, float], "of the variables, SI")
    residual: _of(Maybe, "of the conditions of an optimum")


class Pareto(Document):
    """`beltjax pareto`."""

    objectives: _of(list[str], "names")
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
    found: _of(int, "designs that have it")
    least: Extreme | None
    mean: _of(Maybe, "null for a quantity of parts")
    greatest: Extreme | None


class Ended(_Part):
    """How many designs ended in one way."""

    result: _of(str, "a member of `bj.RESULTS`")
    designs: int
    text: str


class Explore(Document):
    """`beltjax explore`."""

    drive: str
    store: _of(str, "folder of the Zarr store")
    designs: int
    designs_before: _of(int, "that the store held already")
    repaired: _of(list[str], "damage that was mended")
    seconds: float
    quantities: list[Explored]
    outcomes: _of(list[Ended], "the most frequent first")
    success: _of(bool, "whether any design succeeded")


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
    deviation: _of(float, "standard")
    low: _of(float, "below it lies 1 - quantile")
    high: _of(float, "above it lies 1 - quantile")
    linear_deviation: _of(float, "by exact slopes")
    shares: _of(dict[str, float], "of the variance by slopes, by tolerance")
    indices: _of(dict[str, Index], "only with --indices", default={})


class Robust(Document):
    """`beltjax robust`."""

    drive: str
    success: bool
    samples: int
    failed: _of(int, "samples in which no such drive runs; left out")
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
