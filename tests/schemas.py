"""Documents of commands held to their schemas."""

import functools
import json

from jsonschema import Draft202012Validator

from beltjax.commands.reports.schema import FOLDER, documents


@functools.cache
def validator(command):
    return Draft202012Validator(json.loads((FOLDER / f"{command}.json").read_text()))


def documented(command, document):
    """Every key has its place in the description, and the installed schema admits the document."""
    documents()[command].model_validate_json(json.dumps(document), strict=True)
    validator(command).validate(document)
    assert next(iter(document)) == "schema"
