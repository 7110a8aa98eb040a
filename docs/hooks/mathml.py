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


def on_page_markdown(markdown: str, **_: object) -> str:
    """MkDocs calls this for the text of every page."""
    return _PARTS.sub(_drawn, markdown)


def _drawn(found: re.Match) -> str:
    if found["code"]:
        return found[0]
    if found["block"]:
        formula = convert(found["block"].strip(), display="block")
        return f'<div class="formula">{formula}</div>'
    return convert(found["inline"])
