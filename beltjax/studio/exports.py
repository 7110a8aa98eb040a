"""What the page saves: a drive file, a report, pictures, and the page itself."""

import re
import tempfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from beltjax import optimize
from beltjax.analysis.steady import steady_state
from beltjax.commands.reports.analyze import analyze_report
from beltjax.drive.files import drive_bytes
from beltjax.drive.layout import Layout
from beltjax.drive.system import Drive
from beltjax.studio.page_file import page_bytes
from beltjax.studio.session import Session

_MIME = {
    ".toml": "application/toml",
    ".html": "text/html",
    ".png": "image/png",
    ".svg": "image/svg+xml",
    ".json": "application/json",
}


class Export(NamedTuple):
    """A file to be saved."""

    name: str
    mime: str
    content: bytes


def exported(session: Session, kind: str, view: Mapping[str, Any] | None = None) -> Export:
    """The file of that kind: toml, report, png, svg, compared or page.

    Raises:
        ValueError: there is no such kind, or the design cannot be built, of which nothing but the
            page is saved.
    """
    if kind == "page":
        return _export(session, ".studio.json", page_bytes(session, view))
    if kind not in _KINDS:
        raise ValueError(f"there is no file {kind!r}; give one of page, {', '.join(_KINDS)}")
    why = session.fault()
    if why:
        raise ValueError(f"this design cannot be built, and is not saved: {why}")
    ending, make = _KINDS[kind]
    return _export(session, ending, make(session))


def _export(session: Session, ending: str, content: bytes) -> Export:
    plain = re.sub(r"[^A-Za-z0-9_-]+", "_", session.study.name).strip("_") or "drive"
    name = f"{plain}{ending}"
    return Export(name, _MIME[Path(name).suffix], content)


def _toml(session: Session) -> bytes:
    study = session.study
    duties = study.cases.duties if study.cases else {}
    return drive_bytes(study.drive, study.point if duties else session.point, duties)


def _report(session: Session) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "drive.toml")
        path.write_bytes(_toml(session))
        made = analyze_report(path, page="report.html")
    return next(content for name, content in made.files if name == "report.html")


def _picture(session: Session, kind: str) -> bytes:
    from beltjax.draw.layouts import layout_figure, picture_bytes  # slow to load

    return picture_bytes(layout_figure(session.drive, _rest(session, session.study)), f"x.{kind}")


def _compared(session: Session) -> bytes:
    from beltjax.draw.layouts import before_and_after, picture_bytes  # slow to load

    before, now = session.before or session.first, session.study
    pair: list[tuple[Drive, Layout]] = [(s.drive, _rest(session, s)) for s in (before, now)]
    return picture_bytes(before_and_after(*pair, title=session.drive.name), "x.png")


def _rest(session: Session, study: optimize.Study) -> Layout:
    """Where the drive of a study rests at the point that is shown."""
    return steady_state(study.drive, session.point, throw=False).reference.layout


_KINDS: dict[str, tuple[str, Callable[[Session], bytes]]] = {
    "toml": (".toml", _toml),
    "report": (".html", _report),
    "png": (".png", lambda session: _picture(session, "png")),
    "svg": (".svg", lambda session: _picture(session, "svg")),
    "compared": ("_before_and_after.png", _compared),
}
