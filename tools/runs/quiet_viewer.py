"""Rerun's viewer in a browser, on a page that communicates with this machine only.

The page that Rerun serves requests fonts from a font service and the newest version from GitHub, and sends
usage data to Rerun; Rerun's setting against this has no effect in a browser. This module serves the same page
with a content security policy under which the browser refuses these connections.
"""

import re
import subprocess
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager, suppress
from functools import lru_cache
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import IO
from urllib.request import urlopen

from hil.record.rrd.rerun_program import RerunError
from hil.show.window import LOOPBACK

POLICY = "; ".join(
    (
        "default-src 'self'",
        "connect-src 'self' http://127.0.0.1:* http://localhost:*",
        "script-src 'self' 'unsafe-inline' 'wasm-unsafe-eval' 'unsafe-eval'",
        "style-src 'self' 'unsafe-inline'",
        "img-src 'self' data: blob:",
        "worker-src 'self' blob:",
    )
)
FOREIGN_LINK = re.compile(rb"<link[^>]*https://[^>]*>")
"""Links to remove: in spite of the policy, a browser may connect to their targets in advance."""
SERVED = frozenset({"/", "/re_viewer.js", "/re_viewer_bg.wasm", "/favicon.ico"})
ADDRESS = re.compile(r"connect at (http://[^?\s]+)\?(\S+)")


def handler_for(viewer: str) -> type[BaseHTTPRequestHandler]:
    """A handler that serves the pages of Rerun's own server at `viewer` under the policy."""

    @lru_cache
    def page(path: str) -> tuple[str, bytes]:
        with urlopen(f"{viewer}{path}") as answer:
            return answer.headers["Content-Type"], FOREIGN_LINK.sub(b"", answer.read())

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            path = self.path.partition("?")[0]
            if path not in SERVED:
                self.send_error(404)
                return
            kind, content = page(path)
            self.send_response(200)
            self.send_header("Content-Type", kind)
            self.send_header("Content-Length", str(len(content)))
            self.send_header("Content-Security-Policy", POLICY)
            self.end_headers()
            with suppress(ConnectionError):  # the browser may have left the page
                self.wfile.write(content)

        def log_message(self, *_: object) -> None:
            """Do not print the requested pages."""

    return Handler


def address_said(output: IO[str]) -> tuple[str, str]:
    """The page's address and its query, from the output of Rerun's server; RerunError without one."""
    said = []
    for line in output:
        if found := ADDRESS.search(line):
            return found.group(1), found.group(2)
        said.append(line)
    raise RerunError(f"the viewer ended before it served anything: {''.join(said).strip()}")


@contextmanager
def served(
    command: Sequence[str], environment: Mapping[str, str]
) -> Iterator[tuple[str, subprocess.Popen[str]]]:
    """Start Rerun's server by `command`; give the address to open and the process."""
    with ExitStack() as stack:
        server = stack.enter_context(ThreadingHTTPServer((LOOPBACK, 0), BaseHTTPRequestHandler))
        page = f"http://{LOOPBACK}:{server.server_port}"
        process = stack.enter_context(
            subprocess.Popen(
                [*command, "--cors-allow-origin", page],
                env={**environment, "NO_COLOR": "1", "RUST_LOG": "info"},
                stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT,
                text=True,
            )
        )
        stack.callback(process.terminate)
        assert process.stdout is not None
        viewer, query = address_said(process.stdout)
        rest = threading.Thread(target=process.stdout.read, daemon=True)
        rest.start()
        stack.callback(rest.join)
        stack.callback(process.terminate)
        server.RequestHandlerClass = handler_for(viewer)
        threading.Thread(target=server.serve_forever, daemon=True).start()
        stack.callback(server.shutdown)
        yield f"{page}/?{query}", process
