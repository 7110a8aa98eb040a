"""JSON Schemas and documentation of what is registered: documents of commands, quantities.

Each command's file declares what its keys hold. From that come the JSON Schemas of
`commands/schemas/`, for other programs and languages, and the tables of docs/documents.md, for
people. Tests hold both to the declarations, and every document that they see to the schemas. After
a change, run: python -m beltjax.commands.reports.schema
"""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from beltjax.commands.registry import registered
from beltjax.commands.reports.documents import VERSION, Document
from beltjax.commands.reports.listings import quantity_page

FOLDER = Path(__file__).parents[1] / "schemas"
QUANTITIES = "<!-- quantities: written by python -m beltjax.commands.reports.schema -->\n"
QUANTITIES_END = "<!-- end of quantities -->\n"
MARK = "<!-- keys: written by python -m beltjax.commands.reports.schema -->\n"


def documents() -> dict[str, type[Document]]:
    """The document of each registered command, by the command's name."""
    return {name: one.document() for name, one in registered().items()}


def json_schema(command: str) -> dict[str, Any]:
    """The JSON Schema (draft 2020-12) of the document of `beltjax COMMAND`."""
    named = {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        "$id": f"urn:beltjax:{command}:{VERSION}",
    }
    return named | _open(documents()[command].model_json_schema())


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
    for command in documents():
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
    for command in documents():
        (FOLDER / f"{command}.json").write_text(schema_text(command))
    page = Path(__file__).parents[3] / "docs" / "documents.md"
    page.write_text(page.read_text().split(MARK)[0] + MARK + "\n" + key_tables())
    page = page.with_name("optimizing.md")
    before, rest = page.read_text().split(QUANTITIES)
    after = rest.split(QUANTITIES_END)[1]
    page.write_text(before + QUANTITIES + "\n" + quantity_page() + "\n" + QUANTITIES_END + after)


if __name__ == "__main__":
    _write()
