"""A process of our own that asks the storage on behalf of a forked one.

A fork copies memory, but no threads. The clients of object storage work by threads: one that a
forked process inherits waits for them for ever. So a process that was forked after the first
request (a worker of a PyTorch loader) starts a fresh one, and asks it through a pipe.
"""

from __future__ import annotations

import atexit
import os
import pickle
import struct
import subprocess
import sys
import threading
from typing import Any, BinaryIO, Final

from civil_rgbd.errors import StorageError

_LENGTH: Final = struct.Struct("<Q")
_guard = threading.Lock()
_threads_of: int | None = None  # the process that holds the client's threads
_helper: tuple[int, subprocess.Popen[bytes]] | None = None  # and the process that started it


def note_threads() -> None:
    """Remember that from now on this process, and no fork of it, has the client's threads."""
    global _threads_of  # noqa: PLW0603  # a fact of the process
    _threads_of = os.getpid()


def is_needed() -> bool:
    """Tell whether this process was forked from one that had made requests."""
    return _threads_of not in (None, os.getpid())


def ask(verb: str, url: str, arguments: tuple[object, ...]) -> Any:  # noqa: ANN401  # as client.ask
    """Have a request made by the helper; as :func:`civil_rgbd.storage.client.ask`."""
    from civil_rgbd.storage.client import SETTINGS

    with _guard:
        process = _running()
        if process.stdin is None or process.stdout is None:
            raise RuntimeError("the helper was started without pipes")
        settings = {k: v for k, v in os.environ.items() if k.startswith(SETTINGS)}
        try:
            _send(process.stdin, (verb, url, arguments, settings))
            raised, answer = _receive(process.stdout)
        except (OSError, EOFError) as error:
            process.kill()
            raise StorageError(
                "the process that reads from the object storage died",
                where=url,
                fix="look for the kernel's out-of-memory killer, and start again",
            ) from error
    if raised:
        raise answer
    return answer


def _running() -> subprocess.Popen[bytes]:
    global _helper  # noqa: PLW0603  # one a process
    if _helper is None or _helper[0] != os.getpid() or _helper[1].poll() is not None:
        process = subprocess.Popen(
            [sys.executable, "-c", "from civil_rgbd.storage.relay import serve; serve()"],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )
        atexit.register(process.kill)
        _helper = os.getpid(), process
    return _helper[1]


def serve() -> None:
    """Answer requests from the standard input until it ends."""
    from civil_rgbd.storage.client import SETTINGS, perform

    questions, answers = sys.stdin.buffer, os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what a library prints is no answer
    while True:
        try:
            verb, url, arguments, settings = _receive(questions)
        except EOFError:
            return
        for gone in [k for k in os.environ if k.startswith(SETTINGS) and k not in settings]:
            del os.environ[gone]
        os.environ.update(settings)
        try:
            answer = False, perform(verb, url, arguments)
        except Exception as error:  # noqa: BLE001  # it is raised where it was asked
            answer = True, error
        _send(answers, answer)


def _send(stream: BinaryIO | Any, message: object) -> None:  # noqa: ANN401  # a pipe's end
    data = pickle.dumps(message)
    stream.write(_LENGTH.pack(len(data)) + data)
    stream.flush()


def _receive(stream: BinaryIO | Any) -> Any:  # noqa: ANN401  # a pipe's end
    head = stream.read(_LENGTH.size)
    if len(head) < _LENGTH.size:
        raise EOFError
    (length,) = _LENGTH.unpack(head)
    data = stream.read(length)
    if len(data) < length:
        raise EOFError
    return pickle.loads(data)  # noqa: S301  # of our own process
