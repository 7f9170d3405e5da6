"""A web server on this machine that answers ranges, and misbehaves on request."""

from __future__ import annotations

import re
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer


@dataclass
class Shelf:
    """What the server offers, and how it behaves.

    Attributes:
        files: bytes by path.
        ranges: it answers ranges.
        cut_after: bytes of a body after which it hangs up; popped one an answer.
        statuses: answered instead of a file; popped one an answer.
        claims_length: it says how long the body is.
        asked: the Range header of each request, None without.
    """

    files: dict[str, bytes] = field(default_factory=dict)
    ranges: bool = True
    cut_after: list[int] = field(default_factory=list)
    statuses: list[int] = field(default_factory=list)
    claims_length: bool = True
    asked: list[str | None] = field(default_factory=list)


@contextmanager
def serving(shelf: Shelf) -> Iterator[str]:
    """Serve a shelf on loopback; give its address."""

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            shelf.asked.append(self.headers.get("Range"))
            data = shelf.files.get(self.path)
            if shelf.statuses or data is None:
                self.send_error(shelf.statuses.pop(0) if shelf.statuses else 404)
                return
            start = _start(self.headers.get("Range")) if shelf.ranges else None
            if start is not None and start >= len(data):
                self.send_error(416)
                return
            body = data[start or 0 :]
            self.send_response(200 if start is None else 206)
            if start is not None:
                self.send_header("Content-Range", f"bytes {start}-{len(data) - 1}/{len(data)}")
            if shelf.claims_length:
                self.send_header("Content-Length", str(len(body)))
            self.end_headers()
            self.wfile.write(body[: shelf.cut_after.pop(0)] if shelf.cut_after else body)

        def log_message(self, *_: object) -> None:
            """Say nothing."""

    class Server(ThreadingHTTPServer):
        def handle_error(self, *_: object) -> None:
            """Say nothing: clients hang up when they have heard enough."""

    with Server(("127.0.0.1", 0), Handler) as server:
        threading.Thread(target=server.serve_forever, args=(0.01,), daemon=True).start()
        try:
            yield f"http://127.0.0.1:{server.server_address[1]}"
        finally:
            server.shutdown()


def _start(header: str | None) -> int | None:
    match = re.fullmatch(r"bytes=([0-9]+)-", header or "")
    return int(match[1]) if match else None
