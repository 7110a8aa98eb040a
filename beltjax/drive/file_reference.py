"""The tables of docs/drive_file.md, made from the descriptions beside the keys of a drive file.

`python -m beltjax.drive.file_reference` writes them between their marks in the page.
"""

from pathlib import Path

from beltjax.drive.file_tables import (
    ArmSpringTable,
    ArmTable,
    BeltTable,
    DamperTable,
    DriveTable,
    ExcitationTable,
    IsolatorTable,
    LinearTable,
    LoadTable,
    ModelTable,
    OperationTable,
    OrderTable,
    PulleyTable,
    RotaryTable,
    RuleTable,
    TwinArmTable,
)
from beltjax.files.tables import Table

PAGE = Path(__file__).parents[2] / "docs" / "drive_file.md"
_TABLES: dict[str, tuple[type[Table], ...]] = {
    "top level": (DriveTable,),
    "model": (ModelTable,),
    "belt": (BeltTable,),
    "pulley": (PulleyTable,),
    "one tensioner": (ArmTable,),
    "tensioners": (RotaryTable, LinearTable, TwinArmTable),
    "arm springs": (ArmSpringTable,),
    "isolators": (IsolatorTable,),
    "dampers": (DamperTable,),
    "installation": (RuleTable,),
    "operation": (OperationTable,),
    "load": (LoadTable,),
    "excitation": (ExcitationTable,),
    "orders": (OrderTable,),
}
_KINDS = {RotaryTable: "rotary", LinearTable: "linear", TwinArmTable: "twin-arm"}


def key_table(*tables: type[Table]) -> str:
    """Keys, units and meanings of some tables of one name, as Markdown.

    The row of a key that not all tables have, or that has several meanings, names its tables.
    """
    rows: dict[str, dict[tuple[str, str], list[type[Table]]]] = {}
    for table in tables:
        for name, field in table.model_fields.items():
            extra = field.json_schema_extra
            if field.description is None or not isinstance(extra, dict):
                continue  # a table inside the table
            means = field.description, str(extra["unit"])
            rows.setdefault(field.alias or name, {}).setdefault(means, []).append(table)
    lines = ["| key | unit | means |", "|---|---|---|"]
    for key, meanings in rows.items():
        for (doc, unit), held in meanings.items():
            of = (
                ""
                if len(held) == len(tables)
                else ", ".join(_KINDS[table] for table in held) + ": "
            )
            lines.append(f"| `{key}` | {unit.replace('^2', '²')} | {of}{doc} |")
    return "\n".join(lines)


def with_tables(page: str) -> str:
    """`page` with each table of keys as it should be, between its marks."""
    for name, tables in _TABLES.items():
        mark, end = f"<!-- keys: {name} -->", "<!-- end of keys -->"
        start = page.index(mark) + len(mark)
        page = f"{page[:start]}\n\n{key_table(*tables)}\n\n{page[page.index(end, start) :]}"
    return page


if __name__ == "__main__":
    PAGE.write_text(with_tables(PAGE.read_text()))
