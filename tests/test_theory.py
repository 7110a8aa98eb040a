"""The code cites the theory by page and equation: both exist, and nothing else is cited."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]
THEORY = ROOT / "docs" / "theory"
CODE = [
    path
    for folder in ("beltjax", "optimize", "tests", "benchmarks", "examples", "docs")
    for path in sorted((ROOT / folder).rglob("*"))
    if path.suffix in (".py", ".pyi", ".toml", ".md")
]
WRITTEN = {"verdicts.md"}  # by the validation
NUMBER = r"\([A-Z]\d+\)"
CITATION = re.compile(rf"docs/theory/(\w+)\.md((?:(?:,| and| to| below)* ?{NUMBER})*)")


def flat(path):
    """The text of a file as one line, without the marks of comments."""
    return re.sub(r"\s*\n\s*#? ?", " ", path.read_text())


def numbers_of(page):
    return re.findall(rf"\\qquad \\text{{({NUMBER})}}", page.read_text())


def test_equations_of_a_page_are_numbered_from_one_on():
    letters = set()
    for page in sorted(THEORY.glob("*.md")):
        numbers = numbers_of(page)
        if numbers:
            letter = numbers[0][1]
            assert letter not in letters, page
            letters.add(letter)
            assert numbers == [f"({letter}{i + 1})" for i in range(len(numbers))], page
            listed = rf"\({page.name}\) \| \({letter}1\) to \({letter}{len(numbers)}\)"
            assert re.search(listed, (THEORY / "index.md").read_text()), page


def test_every_citation_names_a_page_and_an_equation_that_exist():
    cited = set()
    for path in CODE:
        for page, equations in CITATION.findall(flat(path)):
            assert (THEORY / f"{page}.md").is_file(), path
            known = numbers_of(THEORY / f"{page}.md")
            assert set(re.findall(NUMBER, equations)) <= set(known), (path, equations)
            cited |= {(page, equation) for equation in re.findall(NUMBER, equations)}
    assert len({page for page, _ in cited}) >= 6, "the theory is cited from all over the code"


@pytest.mark.parametrize("page", sorted(THEORY.glob("*.md")), ids=lambda page: page.stem)
def test_pages_refer_to_each_other_s_equations_that_exist(page):
    known = {number for other in THEORY.glob("*.md") for number in numbers_of(other)}
    assert set(re.findall(NUMBER, page.read_text())) <= known


def test_nothing_cites_a_page_that_is_not_in_the_repository():
    here = {path.name for path in [*CODE, *ROOT.glob("*.md")]} | WRITTEN
    for path in CODE:
        cited = set(re.findall(r"([\w.-]+\.md)\b", path.read_text()))
        assert {Path(name).name for name in cited} <= here, path
