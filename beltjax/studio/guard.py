"""Who may speak to the page: this machine's browser, from the page itself."""

from collections.abc import Awaitable, Callable
from typing import Any

Scope = dict[str, Any]
Receive = Callable[[], Awaitable[dict[str, Any]]]
Send = Callable[[dict[str, Any]], Awaitable[None]]
App = Callable[[Scope, Receive, Send], Awaitable[None]]

# The browser itself then loads nothing from elsewhere, whatever stands in a drive file.
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; "
    "img-src 'self' data: blob:; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_HEADERS = [
    (b"content-security-policy", POLICY.encode()),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
]
_NAMES = "127.0.0.1", "localhost"


class SamePageOnly:
    """An application that answers only requests to its own address, from its own pages.

    A page of another site may not open the socket, since a browser says from where it comes; a
    name of another site that is made to mean this machine is not the address asked for. A program
    that says nothing of where it comes from may read the page but not open the socket.
    """

    def __init__(self, app: App, port: int):
        self._app = app
        self.hosts = {f"{name}:{port}" for name in _NAMES}

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what may be answered."""
        if scope["type"] == "lifespan":
            return await self._app(scope, receive, send)
        if not self.admits(dict(scope["headers"]), needs_origin=scope["type"] == "websocket"):
            return await _refuse(scope, send)

        async def guarded(message: dict[str, Any]) -> None:
            if message["type"] == "http.response.start":
                message = message | {"headers": [*message.get("headers", []), *_HEADERS]}
            await send(message)

        return await self._app(scope, receive, guarded)

    def admits(self, headers: dict[bytes, bytes], needs_origin: bool) -> bool:
        """Whether a request with these headers comes from this page, to this address."""
        host = headers.get(b"host", b"").decode("latin-1").lower()
        origin = headers.get(b"origin")
        if host not in self.hosts:
            return False
        if origin is None:
            return not needs_origin
        return origin.decode("latin-1").lower() == f"http://{host}"


async def _refuse(scope: Scope, send: Send) -> None:
    if scope["type"] == "websocket":
        return await send({"type": "websocket.close", "code": 1008})
    body = b"This page answers its own browser alone."
    await send({"type": "http.response.start", "status": 403,
                "headers": [(b"content-type", b"text/plain"), *_HEADERS]})  # fmt: skip
    await send({"type": "http.response.body", "body": body})
