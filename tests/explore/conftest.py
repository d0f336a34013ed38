"""Servers of pages in threads, and Chromium by its DevTools protocol."""

import asyncio
import base64
import io
import json
import queue
import re
import shutil
import subprocess
import threading
import time
import urllib.request
from contextlib import contextmanager

import matplotlib.image
import pytest


@pytest.fixture
def served():
    """Function that serves a page from a thread, and gives the server."""
    from piezoharvest.explore.server import PageServer

    running = []

    def serve(draw):
        ready = queue.Queue()

        def run():
            asyncio.set_event_loop(asyncio.new_event_loop())
            server = PageServer(draw)
            ready.put(server)
            server.run()

        thread = threading.Thread(target=run, daemon=True)
        thread.start()
        running.append((ready.get(timeout=20), thread))
        return running[-1][0]

    yield serve
    for server, thread in running:
        server.end()
        thread.join(timeout=20)
        assert not thread.is_alive()


class Page:
    """A page of a browser."""

    def __init__(self, socket, loop):
        self._socket, self._loop, self._count = socket, loop, 0

    def call(self, method, **params):
        """Result of a command of the DevTools protocol."""
        return self._loop.run_until_complete(asyncio.wait_for(self._called(method, params), 60))

    async def _called(self, method, params):
        self._count += 1
        await self._socket.write_message(json.dumps({"id": self._count, "method": method, "params": params}))
        while (answer := json.loads(await self._socket.read_message())).get("id") != self._count:
            pass
        return answer["result"]

    def run(self, script):
        """Value of an expression in the page."""
        found = self.call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found
        return found["result"].get("value")

    def wait_for(self, condition):
        """Wait until an expression holds."""
        end = time.monotonic() + 40
        while not self.run(condition):
            assert time.monotonic() < end, condition
            time.sleep(0.1)

    def resize(self, width, height):
        """Another window, on a telephone where it is narrow."""
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 500}
        self.call("Emulation.setDeviceMetricsOverride", **size)
        time.sleep(0.5)

    def picture(self):
        """What is seen, (height, width, 3) array."""
        data = base64.b64decode(self.call("Page.captureScreenshot")["data"])
        return matplotlib.image.imread(io.BytesIO(data))[..., :3]


@pytest.fixture
def opened(tmp_path):
    """Context in which an address is open in a browser."""
    from tornado.websocket import websocket_connect

    program = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
    if program is None:
        pytest.skip("chromium is not on the PATH")

    @contextmanager
    def open_page(address):
        command = [program, "--headless", "--no-sandbox", "--disable-gpu", "--hide-scrollbars", "--no-first-run",
                   f"--user-data-dir={tmp_path / 'profile'}", "--remote-debugging-port=0", "about:blank"]  # fmt: skip
        browser = subprocess.Popen(command, stderr=subprocess.PIPE, text=True)
        loop = asyncio.new_event_loop()
        try:
            port = next(found[1] for line in browser.stderr if (found := re.search(r"ws://127.0.0.1:(\d+)/", line)))
            pages = json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=20))
            target = next(page["webSocketDebuggerUrl"] for page in pages if page["type"] == "page")

            async def connect():
                return await websocket_connect(target, max_message_size=1 << 27)

            page = Page(loop.run_until_complete(connect()), loop)
            page.call("Page.navigate", url=address)
            yield page
        finally:
            browser.terminate()
            browser.wait(timeout=20)
            browser.stderr.close()
            loop.close()

    return open_page
