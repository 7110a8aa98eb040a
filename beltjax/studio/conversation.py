"""What is said between a page and its session: messages in, answers out, all plain data."""

import time
from collections.abc import Callable, Iterator
from typing import Any

from beltjax.files.errors import FileError
from beltjax.studio import described
from beltjax.studio.opened import Opened
from beltjax.studio.session import Session

_CURVES_EVERY = 0.1  # [s], at least, while moves wait

Tell = Callable[[dict[str, Any]], None]


class Conversation:
    """The messages of one page, answered by its own session.

    `answers` yields what each message has as answers; errors are answers, too. A message is a
    dictionary with the key "do".
    """

    def __init__(self, opened: Opened):
        self.session = Session(opened)
        self._tell: Tell = lambda answer: None
        self._curves_at = 0.0

    def listen(self, tell: Tell) -> None:
        """Have what is not an answer to a message sent by `tell`, from any thread."""
        self._tell = tell

    def may_skip(self) -> bool:
        """Whether curves may be left out because a newer move waits."""
        return time.monotonic() - self._curves_at < _CURVES_EVERY

    def stop(self) -> None:
        """Stop a search that runs."""

    def close(self) -> None:
        """End what runs, since the page is closed."""
        self.stop()

    def answers(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """The answers to a message, each when it is found."""
        try:
            act = _ACTS.get(str(message.get("do")))
            if act is None:
                raise ValueError(f"there is nothing to do for {message.get('do')!r}")
            yield from act(self, message)
        except (ValueError, KeyError, TypeError, FileError) as error:
            yield {"is": "error", "text": str(error.args[0] if error.args else error)}

    def _hello(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        yield {"is": "drive"} | described.drive_of(self.session)
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

    def _shown(self, message: dict[str, Any]) -> Iterator[dict[str, Any]]:
        """The state and, after it, the curves over speed."""
        begun = time.monotonic()
        answer = self.session.answer()
        took = 1e3 * (time.monotonic() - begun)
        moving = message.get("do") == "move"
        about = {"case": self.session.case, "of": message.get("number"), "took": took}
        yield {"is": "answer", "moving": moving} | about | answer
        if answer["fault"] and not moving:
            text = self.session.diagnosis()
            if text:
                yield {"is": "diagnosis", "text": text}
        if not answer["fault"]:
            self._curves_at = time.monotonic()
            curves = self.session.over_speed(str(message.get("handle", "")))
            if curves is not None:
                yield {"is": "curves", "handle": message.get("handle", "")} | curves


def _numbers(message: dict[str, Any]) -> dict[str, float]:
    values = message["values"]
    if not isinstance(values, dict) or not values:
        raise ValueError("give numbers by their keys")
    return {str(name): float(value) for name, value in values.items()}


_ACTS: dict[str, Callable[[Conversation, dict[str, Any]], Iterator[dict[str, Any]]]] = {
    "hello": Conversation._hello,
    "begin": Conversation._begin,
    "move": Conversation._move,
    "end": Conversation._end,
    "set": Conversation._set,
    "undo": Conversation._undo,
    "redo": Conversation._redo,
    "case": Conversation._case,
}
