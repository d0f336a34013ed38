"""The explorer's server under what other programs of the machine may send it: many clients, bad requests, much work."""

import asyncio
import contextlib
import http.client
import os
import random
import re
import socket
import threading
import time
from concurrent.futures import ThreadPoolExecutor

import pytest

from piezoharvest import load_study

pytest.importorskip("bokeh", reason="bokeh is not installed (the extra explore)")

from bokeh.document import Document
from bokeh.models import Div
from bokeh.util.token import generate_jwt_token, generate_session_id
from test_study_page import STUDY
from tornado.httpclient import HTTPRequest
from tornado.websocket import WebSocketClosedError, websocket_connect

from piezoharvest.explore import study as studies
from piezoharvest.explore.study import StudyExplorer
from piezoharvest.explore.widgets import Coalesced

CLIENTS, BAD = 50, 1000


@pytest.fixture
def explorer(tmp_path):
    (tmp_path / "study.toml").write_text(STUDY)
    return StudyExplorer(load_study(tmp_path / "study.toml"))


def plain(document):
    """A page that has next to nothing."""
    document.add_root(Div(text="here"))


def status_of(server):
    """Status of the page, and its length."""
    connection = http.client.HTTPConnection("127.0.0.1", server.port, timeout=60)
    connection.request("GET", "/")
    answer = connection.getresponse()
    return answer.status, len(answer.read())


class TestClients:
    def test_fifty_open_the_page_at_once(self, served):
        """Each gets a page of its own; of a study each is computed, 0.1 to 0.3 s one after the other."""
        drawn = []

        def draw(document):
            drawn.append(document)
            plain(document)

        server, together = served(draw), threading.Barrier(CLIENTS)

        def open_page(_):
            together.wait(timeout=20)
            return status_of(server)

        with ThreadPoolExecutor(CLIENTS) as pool:
            found = list(pool.map(open_page, range(CLIENTS)))
        assert {status for status, _ in found} == {200}
        assert min(length for _, length in found) > 1000
        assert len(set(drawn)) == CLIENTS

    def test_fifty_windows_stay_connected(self, served):
        server = served(plain)

        async def all_of_them():
            sockets = await asyncio.gather(*(connected(server) for _ in range(CLIENTS)))
            first = [await asyncio.wait_for(each.read_message(), 60) for each in sockets]  # Bokeh's acknowledgement
            for each in sockets:
                each.close()
            return first

        found = asyncio.run(all_of_them())
        assert len(found) == CLIENTS
        assert all(b"ACK" in message.encode() for message in found)
        assert status_of(server)[0] == 200


async def connected(server, **headers):
    """Socket of a window of the page's own, as its script opens it."""
    token = generate_jwt_token(generate_session_id())
    request = HTTPRequest(f"ws://127.0.0.1:{server.port}/ws", headers={"Origin": server.address.rstrip("/"), **headers})
    return await websocket_connect(request, subprotocols=["bokeh", token])


class TestBadRequests:
    def test_a_thousand_are_refused_and_leave_nothing_behind(self, served, caplog):
        """Broken, foreign, too long, or for what is not there: none is served, none ends the server or stays open."""
        server, rng = served(plain), random.Random(8)
        assert status_of(server)[0] == 200
        before = threading.active_count(), len(os.listdir("/proc/self/fd")) if os.path.exists("/proc/self/fd") else 0
        answers = [answered(server.port, bad_request(rng, server.port)) for _ in range(BAD)]
        codes = {code for code in answers if code}
        assert not caplog.records  # stderr is for what concerns the user
        assert codes <= {400, 403, 404, 405, 431}, codes
        assert sum(code is not None for code in answers) > BAD // 2  # the others are closed without a word
        assert status_of(server)[0] == 200
        time.sleep(0.2)  # until what was closed here is closed there
        after = threading.active_count(), len(os.listdir("/proc/self/fd")) if before[1] else 0
        assert after[0] == before[0]
        assert after[1] <= before[1] + 8

    def test_a_client_that_says_nothing_holds_up_nobody(self, served):
        server = served(plain)
        silent = [socket.create_connection(("127.0.0.1", server.port)) for _ in range(CLIENTS)]
        for each in silent[::2]:
            each.sendall(b"GET / HTTP/1.1\r\nHost: 127")
        begin = time.monotonic()
        assert status_of(server)[0] == 200
        assert time.monotonic() - begin < 20.0
        for each in silent:
            each.close()

    def test_a_message_that_is_too_long_closes_its_window_only(self, served):
        server = served(plain)

        async def too_long():
            window, other = await connected(server), await connected(server)
            with contextlib.suppress(WebSocketClosedError):  # the server may close it before all has been written
                await window.write_message("x" * (2 << 20))
            while await asyncio.wait_for(window.read_message(), 60) is not None:
                pass  # three parts of an acknowledgement, then the end
            kept = await asyncio.wait_for(other.read_message(), 60)
            other.close()
            return kept

        assert "ACK" in asyncio.run(too_long())

    @pytest.mark.parametrize("message", ["", "{}", "[]", '{"msgtype":"PATCH-DOC"}', "\x00\xff", "x" * 1000])
    def test_a_message_without_sense_does_not_end_the_server(self, served, message):
        server = served(plain)

        async def senseless():
            window = await connected(server)
            await window.read_message()
            for _ in range(3):  # header, metadata and content of a message
                await window.write_message(message)
            window.close()

        asyncio.run(senseless())
        assert status_of(server)[0] == 200


def bad_request(rng, port):
    """A request that must not be served."""
    host, line = f"Host: 127.0.0.1:{port}", "GET / HTTP/1.1"
    path = rng.choice(["/../../etc/passwd", "/static/../../../etc/passwd", "/%2e%2e/%00", "/nothing", "//", "/ws",
                       "/?" + "x" * 5000, "/autoload.js/x", "/static/js/none.js", "\u00e4"])  # fmt: skip
    kind = rng.randrange(10)
    head = {
        0: [line, f"Host: {rng.choice(['elsewhere.example', '', '127.0.0.1', f'127.0.0.1.:{port}', '[::1]'])}"],
        1: [line, host, f"Origin: {rng.choice(['null', 'http://elsewhere.example', 'file://', f'https://{host}'])}"],
        2: [line, host, f"Content-Length: {rng.choice(['-1', '2097152', 'many', '1e3', '9' * 40])}"],
        3: [f"{rng.choice(['POST', 'PUT', 'DELETE', 'PATCH', 'BREW', 'OPTIONS', ''])} / HTTP/1.1", host],
        4: [f"GET {path.replace('/?', '/none?')} HTTP/1.1", host],
        5: [line, host, "X: " + "y" * (2 << 20)],
        6: ["GET /ws HTTP/1.1", host, "Upgrade: websocket", "Connection: Upgrade", "Sec-WebSocket-Version: 13",
            "Sec-WebSocket-Key: AAAAAAAAAAAAAAAAAAAAAA==",
            f"Sec-WebSocket-Protocol: {rng.choice(['', 'bokeh', 'bokeh, x', 'bokeh, ' + 'e30' * 900])}"],
        7: [f"GET / HTTP/{rng.choice(['9.9', '', 'x', '1.1 1.1'])}", host],
        8: [line, host, rng.choice(["no colon", ": nothing", "A\x00: b", "Transfer-Encoding: chunked, chunked"])],
        9: [line, host, "Transfer-Encoding: chunked"],
    }[kind]  # fmt: skip
    data = ("\r\n".join(head) + "\r\n\r\n").encode("utf-8")
    if kind == 9:
        data += rng.choice([b"zz\r\n", b"-5\r\n", b"ffffffffffffffff\r\n", b"200000\r\n"])
    return data if rng.random() < 0.9 or kind == 5 else data[: rng.randrange(1, len(data) - 2)]


def answered(port, data):
    """Status with which raw data is answered, None where there is none, or a socket that is opened is closed again."""
    with socket.create_connection(("127.0.0.1", port), timeout=20) as connection:
        try:
            connection.sendall(data)
            connection.shutdown(socket.SHUT_WR)
            found = re.match(rb"HTTP/1\.[01] (\d+)", connection.recv(4096))
            if found and found[1] == b"101":  # the token of a page is read only then
                while connection.recv(4096):
                    pass
                return None
        except (ConnectionError, TimeoutError):
            return None
    return int(found[1]) if found else None


class TestWork:
    def test_an_answer_that_takes_too_long_is_ended_and_said(self, explorer, monkeypatch):
        """Each answer has an allowance of its own: a window cannot keep the others waiting."""
        assert explorer.answer(1, {}).response.converged
        monkeypatch.setattr(studies, "_WORK", 1000)
        response = explorer.answer(1, {"shunt.load_resistance": 1.1e6}).response
        assert not response.converged
        assert "the limit" in response.message

    def test_many_moves_are_one_answer(self):
        """However many messages arrive while one is computed."""
        document, runs = Document(), []
        update = Coalesced(document, lambda: runs.append(1))
        for _ in range(1000):
            update.request()
        assert len(document.session_callbacks) == 1
        document.session_callbacks[0].callback()
        assert runs == [1]
        update.request()
        assert len(document.session_callbacks) == 1
