"""Pages of reports: one HTML file each that needs nothing beside it, on screens and on paper."""

import io
import re
from typing import Any

import jinja2
from matplotlib.figure import Figure


def rendered(template: str, **values: Any) -> bytes:
    """A page from a template of this folder."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("beltjax.commands.reports", ""),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters["short"] = _short
    return environment.get_template(template).render(**values).encode()


def inline_svg(figure: Figure) -> str:
    """A figure as an SVG element that takes the width of the page."""
    content = io.StringIO()
    # Fixed, so that one study gives one page: no date, no random names.
    figure.savefig(content, format="svg", metadata={"Date": None}, bbox_inches="tight")
    svg = content.getvalue()
    svg = re.sub("<metadata>.*?</metadata>", "", svg[svg.index("<svg") :], flags=re.DOTALL)
    return re.sub(r'<svg([^>]*?) width="[^"]*"', r"<svg\1", re.sub(r' height="[\d.]+pt"', "", svg))


def _short(value: float | None) -> str:
    return "–" if value is None else f"{value:.5g}"
