"""Formulas written as $...$ and $$...$$ become MathML when the site is built.

Browsers draw MathML themselves, so that a page needs no script and no network for it; other
readers of these files see the same dollar signs, and many of them draw those too.
"""

import re

from latex2mathml.converter import convert

# Code first: what stands in it is no formula.
_CODE = r"(?P<code>^```.*?^```|`[^`\n]+`)"
_BLOCK, _INLINE = r"\$\$(?P<block>.+?)\$\$", r"\$(?P<inline>[^\s$](?:[^$\n]*[^\s$])?)\$"
_PARTS = re.compile(f"{_CODE}|{_BLOCK}|{_INLINE}", flags=re.DOTALL | re.MULTILINE)


_MARKED = re.compile(r"(<p>(?=@@formula \d+@@</p>))?@@formula (\d+)@@(?(1)</p>)")


def on_page_markdown(markdown: str, page, **_: object) -> str:
    """MkDocs calls this for the text of every page: formulas are drawn and put aside."""
    page.formulas = []

    def aside(found: re.Match) -> str:
        if found["code"]:
            return found[0]
        page.formulas.append(_drawn(found))
        return f"@@formula {len(page.formulas) - 1}@@"

    return _PARTS.sub(aside, markdown)


def on_page_content(html: str, page, **_: object) -> str:
    """And this for what Markdown made of it, which would take a formula for a paragraph."""

    def put_back(found: re.Match) -> str:
        formula = page.formulas[int(found[2])]
        alone = formula.startswith("<div") or not found[1]
        return formula if alone else f"<p>{formula}</p>"

    return _MARKED.sub(put_back, html)


def _drawn(found: re.Match) -> str:
    if found["block"]:
        formula = convert(found["block"].strip(), display="block")
        return f'<div class="formula">{formula}</div>'
    return convert(found["inline"])
