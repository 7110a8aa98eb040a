"""What is said between a page and its session: messages in, answers out, all plain data."""

import base64
import copy
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import equinox as eqx

from beltjax import optimize
from beltjax.analysis.contact import contact_state
from beltjax.analysis.contact_path import belt_pieces
from beltjax.commands.reports.documents import plain
from beltjax.drive.numbers import unit_of, value_of
from beltjax.drive.system import Drive
from beltjax.files.errors import FileError
from beltjax.results import explanation, succeeded
from beltjax.studio import described
from beltjax.studio.exports import exported
from beltjax.studio.handles import turns
from beltjax.studio.opened import Opened
from beltjax.studio.page_file import open_any, open_texts
from beltjax.studio.session import Session

_CURVES_EVERY = 0.3  # [s], at least, while moves wait
_PREVIEWS_EVERY = 0.15  # [s], at least, of a search
_ARC_POINTS = 41  # of each contact arc
# What would change the design under a search.
_CHANGES = "begin", "move", "end", "set", "undo", "redo", "case", "open", "optimize"

Tell = Callable[[dict[str, Any]], None]


class Conversation:
    """The messages of one page, answered by its own session.

    `answers` yields what each message has as answers; errors are answers, too. A message is a
    dictionary with the key "do".
    """

    def __init__(self, opened: Opened, patient: bool = True):
        self._patient = patient
        self.session = self._begun(opened)
        self._tell: Tell = lambda answer: None
        self._curves_at = 0.0
        self._search: optimize.Searching | None = None
        self._thread: threading.Thread | None = None

    def _begun(self, opened: Opened) -> Session:
        session = Session(opened)
        session.judge.patient = self._patient
        return session

    def listen(self, tell: Tell) -> None:
        """Have what is not an answer to a message sent by `tell`, from any thread."""
        self._tell = tell

    def may_skip(self) -> bool:
        """Whether curves may be left out because a newer move waits."""
        return time.monotonic() - self._curves_at < _CURVES_EVERY

    @property
    def searching(self) -> bool:
        """Whether a search runs."""
        return self._thread is not None and self._thread.is_alive()

    def stop(self) -> None:
        """Stop a search that runs."""
        if self._search is not None:
            self._search.stop()

    def close(self) -> None:
        """End what runs, since the page is closed."""
        self.stop()

    def answers(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """The answers to a message, each when it is found."""
        try:
            act = _ACTS.get(str(message.get("do")))
            if act is None:
                raise ValueError(f"there is nothing to do for {message.get('do')!r}")
            if self.searching and message["do"] in _CHANGES:
                raise ValueError("a search runs: stop it first")
            yield from act(self, message)
        except (ValueError, KeyError, TypeError, FileError) as error:
            yield {"is": "error", "text": str(error.args[0] if error.args else error)}
        except Exception as error:  # whatever it is, the page goes on with the last good design
            yield {"is": "error", "text": f"{type(error).__name__}: {error}"}

    def _hello(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        yield {"is": "drive"} | described.drive_of(self.session)
        yield from self._shown(message)
        if not self.session.judge.ready:
            threading.Thread(target=self._prepare, args=(self.session,), daemon=True).start()

    def _prepare(self, session: Session) -> None:
        """Compile what judges a session's designs, and have the page ask for it."""
        try:
            session.judge.prepare(session.canonical_study())
        except Exception as error:  # the page goes on without limits
            self._tell({"is": "error", "text": f"limits: {type(error).__name__}: {error}"})
            return
        self._tell({"is": "ready"})

    def _show(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        yield from self._shown(message)

    def _begin(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        self.session.begin()
        yield from ()

    def _move(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        self.session.move(_numbers(message))
        yield from self._shown(message)

    def _end(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        self.session.end(str(message.get("what", "dragged")))
        yield from self._shown(message)

    def _set(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        self.session.set_numbers(_numbers(message), str(message.get("what", "")))
        yield from self._shown(message)

    def _undo(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        self.session.undo()
        yield from self._shown(message)

    def _redo(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        self.session.redo()
        yield from self._shown(message)

    def _case(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        self.session.show(int(message["case"]))
        yield from self._shown(message)

    def _bands(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        self.session.show_bands(dict(message.get("sizes") or {}) if message["on"] else None)
        yield from self._shown(message)

    def _contact(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        yield {"is": "status", "text": "finding contact arcs"}
        state = contact_state(self.session.drive, self.session.point, throw=False)
        if not bool(succeeded(state.result)):
            yield {"is": "error", "text": f"contact arcs: {explanation(state.result)}"}
            return
        arcs = [one for one in belt_pieces(state, _ARC_POINTS) if one.zone != "span"]
        pieces = [{"zone": one.zone, "points": plain(one.positions)} for one in arcs]
        yield {"is": "contact", "pieces": pieces}
        yield {"is": "status", "text": "contact arcs found"}

    def _save(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        yield {"is": "status", "text": "preparing the file"}
        made = exported(self.session, str(message.get("kind")), message.get("view"))
        content = base64.b64encode(made.content).decode()
        yield {"is": "file", "name": made.name, "mime": made.mime, "content": content}

    def _open(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        texts = {str(name): str(text) for name, text in dict(message["files"]).items()}
        self.session = self._begun(_opened(texts))
        yield from self._hello(message)

    def _optimize(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        session = self.session
        if not session.opened.is_study:
            raise ValueError("open a study: it says what may change and what must hold")
        why = session.fault()
        if why:
            raise ValueError(f"begin from a design that can be built: {why}")
        session.before = session.study
        turned = turns(session.drive, session.first.drive, session.handles)
        self._search = optimize.Searching(
            optimize.from_here(session.study, turned),
            session.opened.own_constraints,
            _Told(session, self._tell),
            lambda stage, done, total: self._tell(
                {"is": "search", "state": "running", "text": f"{stage} {done or ''}".strip()}
            ),
        )
        yield {"is": "search", "state": "begun", "text": "compiling"}
        work = self._searched, (self._search, turned, bool(message.get("all")))
        self._thread = threading.Thread(target=work[0], args=work[1], daemon=True)
        self._thread.start()

    def _searched(
        self, search: optimize.Searching, turned: dict[str, float], everywhere: bool
    ) -> None:
        """The work of a search's thread."""
        told: dict[str, Any] = {"is": "search", "state": "ended"}
        try:
            design = search.run(everywhere)
        except optimize.Stopped:
            self._tell(told | {"text": "stopped before there was a design"})
            return
        except Exception as error:  # whatever it is, the page must not wait for ever
            self._tell(told | {"text": f"the search failed: {error}"})
            return
        session = self.session
        if design.final is not None:
            session.take(design.drive, "optimized from here")
        self._thread = None
        path = plain(design.history.objective[:, 0]) if not everywhere else []
        self._tell(
            told
            | {
                "text": _ended(design, search.stopped),
                "success": design.success and not search.stopped,
                "values": _before_after(session, design, turned),
                "path": [one for one in path if one is not None],
            }
        )
        for answer in self._shown({"do": "optimized"}):
            self._tell(answer)

    def _answer(self, message: dict[str, Any], moving: bool) -> dict[str, Any]:
        begun = time.monotonic()
        answer = self.session.answer(moving)
        took = 1e3 * (time.monotonic() - begun)
        about = {"case": self.session.case, "of": message.get("number"), "took": took}
        return {"is": "answer", "moving": moving} | about | answer

    def _shown(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """The state and, after it, the curves over speed."""
        moving = message.get("do") == "move"
        if self.session.judge.slow and not moving:
            yield self._answer(message, moving=True)
        answer = self._answer(message, moving)
        yield answer
        if answer["fault"] and not answer["fault"]["key"] and not moving:
            text = self.session.diagnosis()
            if text:
                yield {"is": "diagnosis", "text": text}
        if not answer["fault"]:
            self._curves_at = time.monotonic()
            curves = self.session.over_speed(str(message.get("handle", "")))
            if curves is not None:
                yield {"is": "curves", "handle": message.get("handle", "")} | curves


class _Told:
    """Tells the page of the designs on the way, as fast as they can be drawn."""

    def __init__(self, session: Session, tell: Tell):
        # A session of its own: the page's design is where it was until the search ends.
        self._twin, self._tell, self._at = copy.copy(session), tell, 0.0

    def __call__(self, drive: Drive, path: list[float]) -> None:
        text = f"iteration {len(path)}: objective {path[-1]:.6g}"
        self._tell({"is": "search", "state": "running", "text": text, "path": path})
        if time.monotonic() - self._at < _PREVIEWS_EVERY:
            return
        twin = self._twin
        twin.study = eqx.tree_at(lambda s: s.drive, twin.study, drive)
        self._tell({"is": "answer", "moving": True, "case": twin.case, "of": None, "took": 0.0}
                   | twin.answer())  # fmt: skip
        self._at = time.monotonic()


def _ended(design: optimize.Design, stopped: bool) -> str:
    """How a search ended, in words."""
    ends = f"objective {_short(design.initial)} before, {_short(design.final)} after"
    if stopped:
        return f"stopped, and no optimum yet: {ends}"
    if not design.success:
        missed = [one.quantity for one in design.constraints if one.violation]
        text = explanation(design.result).rstrip(".")
        return f"no optimum: {text}" + (f"; missed: {', '.join(missed)}" if missed else "")
    active = [one.quantity for one in design.constraints if one.active]
    active += [f"bound of {name}" for name in design.bounds]
    held = f"; held back by {', '.join(active)}" if active else ""
    return f"an optimum: {ends}{held}"


def _short(objective: float | None) -> str:
    return "–" if objective is None else f"{objective:.6g}"


def _before_after(
    session: Session, design: optimize.Design, turned: dict[str, float]
) -> list[dict[str, Any]]:
    """Each variable before and after a search; angles as the study's file counts them."""
    before = session.before
    assert before is not None  # the search began from it
    return [
        {
            "name": name,
            "unit": unit_of(session.drive, name),
            "before": float(value_of(before.drive, name)) + turned.get(name, 0.0),
            "after": float(value) + turned.get(name, 0.0),
        }
        for name, value in design.values.items()
    ]


def _opened(texts: dict[str, str]) -> Opened:
    """The files that a page sends: one, or a study and its drive file."""
    if not texts:
        raise ValueError("give a file")
    page = next((name for name in texts if name.lower().endswith(".json")), None)
    if page is not None:
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder, "page.json")
            path.write_text(texts[page], "utf-8")
            return open_any(path)
    # A study names its drive file; it is the one that has no belt.
    first = next((name for name in texts if "[belt]" not in texts[name]
                  and "[[belt]]" not in texts[name]), next(iter(texts)))  # fmt: skip
    return open_texts(texts, first, first)


def _numbers(message: dict[str, Any]) -> dict[str, float]:
    values = message["values"]
    if not isinstance(values, dict) or not values:
        raise ValueError("give numbers by their keys")
    return {str(name): float(value) for name, value in values.items()}


_ACTS: dict[str, Callable[[Conversation, dict[str, Any]], Iterator[dict[str, Any]]]] = {
    "hello": Conversation._hello,
    "show": Conversation._show,
    "begin": Conversation._begin,
    "move": Conversation._move,
    "end": Conversation._end,
    "set": Conversation._set,
    "undo": Conversation._undo,
    "redo": Conversation._redo,
    "case": Conversation._case,
    "bands": Conversation._bands,
    "contact": Conversation._contact,
    "save": Conversation._save,
    "open": Conversation._open,
    "optimize": Conversation._optimize,
}
