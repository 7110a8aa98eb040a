"""The server of the page, without a drive: who is answered, in which order, and with what."""

import http.client
import json
import re
import threading
import time

import pytest
import uvicorn
from websockets.exceptions import InvalidStatus
from websockets.sync.client import connect

from beltjax.studio.guard import POLICY, SamePageOnly
from beltjax.studio.server import PAGE, application, bound


class Talk:
    """A conversation that takes its time, and keeps what it heard."""

    def __init__(self):
        self.heard, self.stopped, self.closed = [], threading.Event(), threading.Event()

    def listen(self, tell):
        self.tell = tell

    def answers(self, message):
        self.heard.append(message)
        time.sleep(0.03)
        yield {"is": "answer", "of": message.get("number"), "do": message["do"]}
        yield {"is": "curves", "of": message.get("number")}

    def may_skip(self):
        return True

    def stop(self):
        self.stopped.set()

    def close(self):
        self.closed.set()


@pytest.fixture(scope="module")
def served():
    """The server in a thread; its port and the conversations that it began."""
    talks, at = [], bound(0)

    def talk():
        talks.append(Talk())
        return talks[-1]

    port = at.getsockname()[1]
    config = uvicorn.Config(application(talk, port), log_level="error", lifespan="off",
                            ws="websockets-sansio", timeout_graceful_shutdown=1)  # fmt: skip
    server = uvicorn.Server(config)
    thread = threading.Thread(target=server.run, kwargs={"sockets": [at]}, daemon=True)
    thread.start()
    while not server.started:
        time.sleep(0.01)
    yield port, talks
    server.should_exit = True
    thread.join(10)
    at.close()


def opened(port, origin=None):
    return connect(f"ws://127.0.0.1:{port}/socket", origin=origin or f"http://127.0.0.1:{port}")


def heard(socket, last):
    """What the server says until the answer to that number."""
    found = []
    while not found or found[-1].get("of") != last:
        found.append(json.loads(socket.recv(timeout=20)))
    return found


def test_of_moves_that_wait_only_the_newest_is_answered_and_nothing_else_is_left_out(served):
    port, talks = served
    with opened(port) as socket:
        heard(socket, None)
        for number in range(1, 31):
            socket.send(json.dumps({"do": "move", "number": number}))
        socket.send(json.dumps({"do": "end", "number": 31}))
        socket.send(json.dumps({"do": "undo", "number": 32}))
        answers = [one for one in heard(socket, 32) if one["is"] == "answer"]
    numbers = [one["of"] for one in answers if one["do"] == "move"]
    assert numbers[-1] == 30
    assert len(numbers) < 10
    assert numbers == sorted(numbers)
    assert [one["do"] for one in answers[-2:]] == ["end", "undo"]
    assert talks[-1].closed.wait(5)


def test_a_stop_does_not_wait_behind_work(served):
    port, talks = served
    with opened(port) as socket:
        heard(socket, None)
        for number in range(20):
            socket.send(json.dumps({"do": "undo", "number": number}))
        socket.send(json.dumps({"do": "stop"}))
        assert talks[-1].stopped.wait(5)
        assert len(talks[-1].heard) < 15


def test_each_page_has_a_conversation_of_its_own_and_hears_its_threads(served):
    port, talks = served
    with opened(port) as one, opened(port) as two:
        heard(one, None)
        heard(two, None)
        first, second = talks[-2:]
        threading.Thread(target=first.tell, args=({"is": "status", "of": "one"},)).start()
        threading.Thread(target=second.tell, args=({"is": "status", "of": "two"},)).start()
        assert heard(one, "one")[-1]["is"] == "status"
        assert heard(two, "two")[-1]["is"] == "status"


@pytest.mark.parametrize("origin", ["http://evil.example", "null", "http://127.0.0.1:1"])
def test_pages_of_other_sites_cannot_open_the_socket(served, origin):
    port, talks = served
    count = len(talks)
    with pytest.raises(InvalidStatus, match="403"), opened(port, origin):
        pass
    assert len(talks) == count


def test_only_this_address_is_answered_and_nothing_outside_the_page(served):
    port, _ = served

    def status(path, host, **headers):
        connection = http.client.HTTPConnection("127.0.0.1", port, timeout=20)
        connection.putrequest("GET", path, skip_host=True)
        for name, value in {"Host": host, **headers}.items():
            connection.putheader(name, value)
        connection.endheaders()
        with connection.getresponse() as answer:
            answer.read()
        connection.close()
        return answer.status, answer.getheader("Content-Security-Policy")

    own = f"127.0.0.1:{port}"
    assert status("/", own) == (200, POLICY)
    assert status("/main.js", f"localhost:{port}") == (200, POLICY)
    for host in ("evil.example", f"evil.example:{port}", "127.0.0.1", f"127.0.0.1:{port}.evil"):
        assert status("/", host)[0] == 403
    assert status("/", own, Origin="http://evil.example")[0] == 403
    for path in ("/../session.py", "/%2e%2e/%2e%2e/session.py", "/..%2fguard.py", "/session.py"):
        assert status(path, own)[0] == 404


def test_a_program_without_an_origin_may_read_but_not_speak():
    guard = SamePageOnly(None, 80)
    own = {b"host": b"127.0.0.1:80"}
    assert guard.admits(own, needs_origin=False)
    assert not guard.admits(own, needs_origin=True)
    assert guard.admits(own | {b"origin": b"http://127.0.0.1:80"}, needs_origin=True)
    # A page under the other name of this machine is another origin.
    assert not guard.admits(own | {b"origin": b"http://localhost:80"}, needs_origin=True)


def test_it_listens_on_this_machine_alone():
    with bound(0) as at:
        assert at.getsockname()[0] == "127.0.0.1"
        with pytest.raises(OSError, match="in use"):
            bound(at.getsockname()[1])


def test_the_page_names_nothing_that_is_elsewhere():
    for path in PAGE.iterdir():
        text = path.read_text().replace("http://www.w3.org/2000/svg", "")
        assert not re.search(r"https?:|//[a-z]+\.[a-z]|@import|url\(", text), path
    named = re.findall(r'(?:src|href)="([^"]+)"', (PAGE / "index.html").read_text())
    files = {path.name for path in PAGE.iterdir()}
    assert {name for name in named if not name.startswith("data:")} <= files
