"""A real S3 server on loopback, which writes down every request: method, path, range.

    python s3_server.py LOG

Its address is the first line that it prints. It ends with its standard input.
"""

from __future__ import annotations

import logging
import sys
import threading
from collections.abc import Callable, Iterable
from typing import Any

from moto.server import DomainDispatcherApplication, create_backend_app
from werkzeug.serving import make_server

Application = Callable[[dict[str, Any], Any], Iterable[bytes]]


def logged(application: Application, path: str) -> Application:
    """Write a line for each request."""
    log = open(path, "a", encoding="utf-8", buffering=1)  # noqa: PTH123, SIM115  # as long as we live

    def answer(environ: dict[str, Any], start: Any) -> Iterable[bytes]:
        span = environ.get("HTTP_RANGE", "-")
        log.write(f"{environ['REQUEST_METHOD']} {environ['PATH_INFO']} {span}\n")
        return application(environ, start)

    return answer


if __name__ == "__main__":
    logging.getLogger("werkzeug").setLevel(logging.ERROR)
    application = logged(DomainDispatcherApplication(create_backend_app), sys.argv[1])
    server = make_server("127.0.0.1", 0, application, threaded=True)
    print(f"http://127.0.0.1:{server.server_port}", flush=True)  # noqa: T201  # our answer
    threading.Thread(target=server.serve_forever, daemon=True).start()
    sys.stdin.read()
