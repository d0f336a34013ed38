"""The page's server, for this machine alone."""

from __future__ import annotations

import logging
import socket
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from bokeh.server.server import BaseServer
from bokeh.server.tornado import BokehTornado
from tornado.httpserver import HTTPServer
from tornado.ioloop import IOLoop
from tornado.netutil import bind_sockets
from tornado.routing import Matcher, Rule, RuleRouter

from piezoharvest.output import OutputError

if TYPE_CHECKING:
    from bokeh.document import Document
    from tornado.httputil import HTTPServerRequest

_LOOPBACK = "127.0.0.1"
_LARGEST = 1 << 20  # bytes of a request and of a message: a position of the sliders takes some hundred


class _FromThisPage(Matcher):
    """Requests that name this server, and come from its page or from the address bar.

    A page of another site can send requests to 127.0.0.1, and by a name of its own that resolves to it (DNS rebinding)
    read the answers: neither gets one.
    """

    def __init__(self, port: int):
        self._hosts = {f"{name}:{port}" for name in (_LOOPBACK, "localhost")}

    def match(self, request: HTTPServerRequest) -> dict[str, Any] | None:
        """An empty dictionary if the request is served."""
        headers = request.headers
        origin = headers.get("Origin")
        own = origin is None or origin in {f"http://{host}" for host in self._hosts}
        site = headers.get("Sec-Fetch-Site", "none")
        return {} if headers.get("Host") in self._hosts and own and site in ("none", "same-origin") else None


class PageServer:
    """Server of a page at a port of 127.0.0.1.

    Parameters
    ----------
    page : callable
        Draws the page into a document, once for each window that opens it.
    port : int
        0 takes any that is free.

    Raises
    ------
    OutputError
        The port is in use, or not allowed.
    """

    def __init__(self, page: Callable[[Document], None], port: int = 0):
        try:
            sockets = bind_sockets(port, _LOOPBACK, socket.AF_INET)
        except OSError as error:
            raise OutputError(f"port {port}: the page cannot be served there ({error.strerror})") from None
        self.port: int = sockets[0].getsockname()[1]
        logging.getLogger("bokeh").setLevel(logging.ERROR)  # stderr is for what concerns the user
        for name in ("access", "general", "application"):  # who asks for what, and with which token
            logging.getLogger(f"tornado.{name}").setLevel(logging.CRITICAL)
        application = BokehTornado(
            page, extra_websocket_origins=[f"{name}:{self.port}" for name in (_LOOPBACK, "localhost")],
            websocket_max_message_size_bytes=_LARGEST, use_index=False,
        )  # fmt: skip
        router = RuleRouter([Rule(_FromThisPage(self.port), application)])
        http = HTTPServer(router, max_body_size=_LARGEST, max_header_size=_LARGEST)
        http.add_sockets(sockets)
        self._loop = IOLoop.current()
        self._server = BaseServer(self._loop, application, http)

    @property
    def address(self) -> str:
        """What to open in a browser."""
        return f"http://{_LOOPBACK}:{self.port}/"

    def end(self) -> None:
        """Let `run` return; from any thread."""
        self._loop.add_callback(self._loop.stop)

    def run(self) -> None:
        """Serve until interrupted."""
        self._server.start()
        try:
            self._loop.start()
        finally:
            self._server.stop()
