"""A headless Chromium, driven over its debugging pipe: open, look, and see what it asked of the network."""

import base64
import fcntl
import io
import json
import os
import shutil
import signal
import subprocess
import tempfile
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from lacking import require
from numpy.typing import NDArray
from PIL import Image

PROGRAMS = ("chromium", "chromium-browser", "google-chrome")
OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--no-first-run",
    "--disable-gpu",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--disable-extensions",
    "--hide-scrollbars",
    "--use-angle=swiftshader",  # WebGL without a graphics card
    "--enable-unsafe-swiftshader",
    "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
    "--remote-debugging-pipe",
)
WIDTH, HEIGHT = 1280, 800
ABOVE_OTHERS = 20

Picture = NDArray[np.int64]
"""Red, green and blue of each pixel, shape (rows, columns, 3)."""


def program() -> str:
    """Where Chromium is; without it the test is skipped."""
    found = [path for name in PROGRAMS if (path := shutil.which(name)) is not None]
    require([] if found else ["chromium"], "apt-get install chromium, to look at pages")
    return found[0]


class Browser:
    """One page of one browser."""

    def __init__(self) -> None:
        self.requests: list[str] = []
        """What the page asked for."""
        self._loaded = 0
        chromium = program()
        self._folder = tempfile.TemporaryDirectory(prefix="vibrohil-browser-", ignore_cleanup_errors=True)
        command = [chromium, *OPTIONS, f"--user-data-dir={self._folder.name}"]
        pairs = os.pipe(), os.pipe()
        # Chromium reads from descriptor 3 and writes to 4, whatever the pipes' own numbers are.
        theirs = [fcntl.fcntl(end, fcntl.F_DUPFD, ABOVE_OTHERS) for end in (pairs[0][0], pairs[1][1])]

        def place() -> None:
            os.dup2(theirs[0], 3)
            os.dup2(theirs[1], 4)

        self._process = subprocess.Popen(
            command,
            preexec_fn=place,  # noqa: PLW1509  # no thread of the tests holds a lock that this needs
            pass_fds=(3, 4),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        )
        for end in (*theirs, pairs[0][0], pairs[1][1]):
            os.close(end)
        self._write, self._read = pairs[0][1], pairs[1][0]
        self._buffer = b""
        self._number = 0
        self._session: str | None = None
        target = self.call("Target.createTarget", url="about:blank")["targetId"]
        self._session = self.call("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        self.call("Page.enable")
        self.call("Network.enable")
        screen = {"width": WIDTH, "height": HEIGHT, "deviceScaleFactor": 1, "mobile": False}
        self.call("Emulation.setDeviceMetricsOverride", **screen)

    def close(self) -> None:
        """End the browser with all its processes."""
        os.close(self._write)
        os.close(self._read)
        os.killpg(self._process.pid, signal.SIGKILL)
        self._process.wait(10.0)
        self._folder.cleanup()

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Ask one thing and wait for the answer; what happens meanwhile is noted."""
        self._number += 1
        message = {"id": self._number, "method": method, "params": parameters}
        if self._session is not None:
            message["sessionId"] = self._session
        os.write(self._write, json.dumps(message).encode() + b"\0")
        while True:
            answer = self._receive()
            self._note(answer.get("method", ""), answer.get("params", {}))
            if answer.get("id") == self._number:
                assert "error" not in answer, answer
                result: dict[str, Any] = answer["result"]
                return result

    def _note(self, event: str, what: dict[str, Any]) -> None:
        if event == "Network.requestWillBeSent":
            self.requests.append(what["request"]["url"])
        self._loaded += event == "Page.loadEventFired"

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._buffer:
            chunk = os.read(self._read, 1 << 20)
            assert chunk, "the browser has ended"
            self._buffer += chunk
        line, self._buffer = self._buffer.split(b"\0", 1)
        answer: dict[str, Any] = json.loads(line)
        return answer

    def open(self, url: str, dark: bool = False) -> None:
        """Go to a page, as one who prefers a dark or a light screen."""
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.call("Emulation.setEmulatedMedia", features=[scheme])
        self.requests.clear()
        loaded = self._loaded
        self.call("Page.navigate", url=url)
        self._wait_for_load(loaded)

    def follow(self, selector: str) -> None:
        """Click a link and wait for the page that it leads to."""
        loaded = self._loaded
        self.evaluate(f"setTimeout(() => document.querySelector('{selector}').click(), 0)")
        self._wait_for_load(loaded)

    def _wait_for_load(self, loaded: int) -> None:
        while self._loaded == loaded:
            answer = self._receive()
            self._note(answer.get("method", ""), answer.get("params", {}))

    def evaluate(self, expression: str) -> Any:
        """What a JavaScript expression is on the page."""
        return self.call("Runtime.evaluate", expression=expression, returnByValue=True)["result"].get("value")

    def wait_for(self, expression: str, timeout_s: float = 20.0) -> None:
        """Wait until a JavaScript expression is true."""
        deadline = time.monotonic() + timeout_s
        while not self.evaluate(expression):
            assert time.monotonic() < deadline, f"not within {timeout_s} s: {expression}"
            time.sleep(0.1)

    def look(self) -> Picture:
        """What is on the screen."""
        data = base64.b64decode(self.call("Page.captureScreenshot")["data"])
        return np.asarray(Image.open(io.BytesIO(data)).convert("RGB"), dtype=np.int64)

    def look_until(self, seen: Callable[[Picture], bool], timeout_s: float = 90.0) -> Picture:
        """Look again and again until what is wanted is on the screen."""
        deadline = time.monotonic() + timeout_s
        while not seen(picture := self.look()):
            assert time.monotonic() < deadline, "what was to be seen did not appear"
            time.sleep(0.5)
        return picture


def near(picture: Picture, rgb: tuple[int, int, int], tolerance: int = 30) -> int:
    """How many pixels have about this colour."""
    return int(np.count_nonzero((np.abs(picture - np.array(rgb)) < tolerance).all(axis=-1)))


def drawn_in(picture: Picture, rgb: tuple[int, int, int], tolerance: int = 12) -> NDArray[np.bool_]:
    """Where this colour was laid over a dark ground, at half its strength or more. Shape (rows, columns).

    A line one pixel wide falls between two rows of pixels, so none of them holds its whole colour.
    """
    colour = np.array(rgb)
    strongest = int(colour.argmax())
    strength = picture[..., strongest] / colour[strongest]
    off = np.abs(picture - strength[..., None] * colour)
    return np.asarray((strength > 0.5) & (off < tolerance).all(axis=-1))
