"""The server behind the page: files of the page, and one socket for each page that is open."""

import asyncio
import contextlib
import json
import socket
import webbrowser
from collections.abc import Callable
from pathlib import Path
from typing import Any

import uvicorn
from starlette.applications import Starlette
from starlette.routing import Mount, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.websockets import WebSocket, WebSocketDisconnect

from beltjax.studio.conversation import Conversation
from beltjax.studio.guard import SamePageOnly

PAGE = Path(__file__).parent / "page"
_LARGEST = 8 * 2**20  # of a message: files that are opened


class Connection:
    """One open page: its messages in order, of moves but the newest."""

    def __init__(self, socket: WebSocket, talk: Conversation):
        self._socket, self._talk = socket, talk
        self._waiting: list[dict[str, Any]] = []
        self._come = asyncio.Event()
        self._writing = asyncio.Lock()

    async def run(self) -> None:
        """Answer until the page is closed."""
        await self._socket.accept()
        self._talk.listen(self._from_thread(asyncio.get_running_loop()))
        reading = asyncio.create_task(self._read())
        working = asyncio.create_task(self._work())
        try:
            await asyncio.wait({reading, working}, return_when=asyncio.FIRST_COMPLETED)
        finally:
            self._talk.close()
            for task in (reading, working):
                task.cancel()
                with contextlib.suppress(asyncio.CancelledError, WebSocketDisconnect, RuntimeError):
                    await task

    async def _read(self) -> None:
        while True:
            try:
                message = await self._socket.receive_json()
            except (ValueError, KeyError):  # no message of this page: it is closed
                return
            if not isinstance(message, dict):
                continue
            last = self._waiting[-1] if self._waiting else {}
            if message.get("do") == last.get("do") == "move":
                self._waiting[-1] = message
            elif message.get("do") == "stop":
                self._talk.stop()
            else:
                self._waiting.append(message)
            self._come.set()

    async def _work(self) -> None:
        await self._answer({"do": "hello"})
        while True:
            await self._come.wait()
            if not self._waiting:
                self._come.clear()
                continue
            await self._answer(self._waiting.pop(0))

    async def _answer(self, message: dict[str, Any]) -> None:
        """Everything that a message has as answers, each sent as soon as it is there."""
        answers = self._talk.answers(message)
        while True:
            # Computing waits for XLA outside of Python: other pages go on meanwhile.
            answer = await asyncio.to_thread(next, answers, None)
            if answer is None:
                return
            await self._send(answer)
            if self._waiting and message.get("do") == "move" and self._talk.may_skip():
                return

    async def _send(self, answer: dict[str, Any]) -> None:
        async with self._writing:
            await self._socket.send_text(json.dumps(answer, allow_nan=False))

    def _from_thread(self, loop: asyncio.AbstractEventLoop) -> Callable[[dict[str, Any]], None]:
        """A function by which threads send."""

        def tell(answer: dict[str, Any]) -> None:
            with contextlib.suppress(RuntimeError):  # the loop is closed
                asyncio.run_coroutine_threadsafe(self._send(answer), loop)

        return tell


def application(talk: Callable[[], Conversation], port: int) -> SamePageOnly:
    """The application on this port; `talk` begins the conversation with a page that opens."""

    async def speak(socket: WebSocket) -> None:
        await Connection(socket, talk()).run()

    routes = [
        WebSocketRoute("/socket", speak),
        Mount("/", StaticFiles(directory=PAGE, html=True)),
    ]
    return SamePageOnly(Starlette(routes=routes), port)  # pyright: ignore[reportArgumentType]


class _Server(uvicorn.Server):
    """A server that says when it is ready."""

    def __init__(self, config: uvicorn.Config, ready: Callable[[], None]):
        super().__init__(config)
        self._ready = ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        await super().startup(sockets)
        if self.started:
            self._ready()


def bound(port: int) -> socket.socket:
    """A socket of this machine alone, on that port or for 0 on a free one; raises `OSError`."""
    found = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    found.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        found.bind(("127.0.0.1", port))
        found.listen()  # else another server could take the port before this one begins
    except OSError:
        found.close()
        raise
    return found


def serve(talk: Callable[[], Conversation], at: socket.socket, browser: bool) -> None:
    """Serve on a bound socket until Ctrl-C; says where, and opens a browser if wanted."""
    port = at.getsockname()[1]
    address = f"http://127.0.0.1:{port}"

    def ready() -> None:
        print(f"serving {address}", flush=True)
        if browser:
            webbrowser.open(address)

    config = uvicorn.Config(
        application(talk, port),  # pyright: ignore[reportArgumentType]
        log_level="warning",
        lifespan="off",
        ws="websockets-sansio",
        ws_max_size=_LARGEST,
        ws_ping_interval=None,  # on one machine nothing is lost but while something compiles
        timeout_graceful_shutdown=1,
        server_header=False,
    )
    with contextlib.suppress(KeyboardInterrupt), at:
        _Server(config, ready).run(sockets=[at])
