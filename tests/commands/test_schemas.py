"""The JSON Schemas: up to date, valid, strict enough to see a wrong document, and on their page.

Every document that a command writes in any test is held to its schema by the `run` fixture.
"""

import json
from types import SimpleNamespace

import pytest
from drives import EXAMPLES
from jsonschema import Draft202012Validator, ValidationError
from schemas import documented, validator

from beltjax.commands.registry import group, registered
from beltjax.commands.reports.documents import complete
from beltjax.commands.reports.listings import quantity_page
from beltjax.commands.reports.pareto import pareto_document
from beltjax.commands.reports.schema import (
    FOLDER,
    MARK,
    QUANTITIES,
    QUANTITIES_END,
    VERSION,
    key_tables,
    schema_text,
)

FRONT = SimpleNamespace(
    names=("coupling", "-tensioner_effectiveness"),
    points=[
        SimpleNamespace(objectives=(3.1, -0.8), values={"tensioner.angle": 0.1}, residual=1e-9)
    ],
    success=True,
)


def test_every_command_has_a_schema():
    assert set(registered()) == set(group.commands)
    assert {path.stem for path in FOLDER.glob("*.json")} == set(registered())


@pytest.mark.parametrize("command", registered())
def test_schemas_are_up_to_date_and_valid(command):
    text = (FOLDER / f"{command}.json").read_text()
    assert text == schema_text(command), "python -m beltjax.commands.reports.schema"
    Draft202012Validator.check_schema(json.loads(text))
    assert json.loads(text)["properties"]["schema"]["const"] == VERSION


def test_the_page_lists_every_key():
    page = (EXAMPLES.parent / "docs" / "documents.md").read_text()
    assert page.split(MARK)[1] == "\n" + key_tables(), "python -m beltjax.commands.reports.schema"


def test_the_page_lists_every_quantity():
    page = (EXAMPLES.parent / "docs" / "optimizing.md").read_text()
    listed = page.split(QUANTITIES)[1].split(QUANTITIES_END)[0]
    assert listed == f"\n{quantity_page()}\n", "python -m beltjax.commands.reports.schema"


MODEL = dict.fromkeys(("arm_curvature", "stretching_arcs", "belt_inertia"), False)


def test_the_front_of_a_study_has_the_documented_keys_and_all_of_them():
    document = complete(pareto_document(FRONT) | {"model": MODEL})
    documented("pareto", document)
    for key in document:
        rest = {other: value for other, value in document.items() if other != key}
        (missing,) = validator("pareto").iter_errors(rest)
        assert missing.message == f"{key!r} is a required property"
    assert document["points"][0]["objectives"] == {
        "coupling": 3.1,
        "-tensioner_effectiveness": -0.8,
    }


@pytest.mark.parametrize(
    ("changes", "says"),
    [
        ({"schema": "0"}, "'1' was expected"),
        ({"success": "yes"}, "'yes' is not of type 'boolean'"),
        ({"warnings": [{"code": "span_slackens"}]}, "'text' is a required property"),
        (
            {"points": [{"objectives": {}, "design": {"radius": None}, "residual": 0}]},
            "None is not",
        ),
    ],
)
def test_a_wrong_document_is_refused(changes, says):
    with pytest.raises(ValidationError, match=says):
        validator("pareto").validate(complete(pareto_document(FRONT) | {"model": MODEL}) | changes)


def test_readers_need_not_know_keys_of_later_versions():
    validator("pareto").validate(complete(pareto_document(FRONT) | {"model": MODEL}) | {"later": 1})
    with pytest.raises(ValueError, match="later"):
        documented("pareto", complete(pareto_document(FRONT) | {"model": MODEL}) | {"later": 1})
