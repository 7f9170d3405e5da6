"""Where a Dask scheduler listens, and whether it is one: looked at before Dask speaks to it.

Dask's client believes whoever answers: it takes the first bytes for a length, and waits for, or
makes room for, that many. A web server at the port (the scheduler's own dashboard, a proxy) would
have it wait for minutes or run out of memory.
"""

from __future__ import annotations

import json
import socket
import struct
import time
from pathlib import Path
from typing import Final

from distributed.comm.addressing import parse_address, parse_host_port

from civil_rgbd.errors import UsageError

_ANSWER_S: Final = 5.0
_LENGTH: Final = struct.Struct("<Q")
_LONGEST_GREETING: Final = 1 << 16
_GREETING: Final = b"pickle-protocol"
FIX: Final = "compare the address with what the scheduler printed when it started: tcp://HOST:8786"


def address_of(scheduler: str) -> str:
    """Return the address of a scheduler that is given by itself, or by the file that it wrote.

    Args:
        scheduler: ``tcp://host:port``, or a path that ends with ``.json``.

    Raises:
        UsageError: there is no such file, or it names no scheduler.
    """
    if not scheduler.endswith(".json"):
        return scheduler
    try:
        document = json.loads(Path(scheduler).read_text("utf-8"))
    except OSError as error:
        raise UsageError(
            f"the scheduler file cannot be read: {error.strerror or error}",
            where=scheduler,
            fix=FIX,
        ) from error
    except ValueError as error:
        raise UsageError(
            f"the scheduler file is no JSON: {error}",
            where=scheduler,
            fix="start the scheduler with --scheduler-file FILE, which writes it; or give its "
            "address: tcp://HOST:8786",
        ) from error
    address = document.get("address") if isinstance(document, dict) else None
    if not isinstance(address, str) or not address:
        raise UsageError(
            "the scheduler file names no address",
            where=scheduler,
            fix="start the scheduler with --scheduler-file FILE, which writes it; or give its "
            "address: tcp://HOST:8786",
        )
    return address


def refuse_stranger(address: str, *, where: str) -> None:
    """Refuse a port where something other than Dask listens; a scheduler speaks first.

    Args:
        address: of the scheduler. Only tcp is looked at: other protocols greet by themselves.
        where: as the user gave it.

    Raises:
        UsageError: nobody listens there, or somebody else.
    """
    try:
        protocol, location = parse_address(address)
        if protocol != "tcp":
            return
        place = parse_host_port(location)
    except ValueError as error:
        raise _refusal(str(error), where) from error
    try:
        with socket.create_connection(place, timeout=_ANSWER_S) as stream:
            greeting = _greeting(stream)
    except OSError as error:
        raise _refusal(error.strerror or str(error), where) from error
    if _GREETING not in greeting:
        raise UsageError(
            "something listens there, but it is no Dask scheduler",
            where=where,
            fix=f"{FIX}; port 8787 is its dashboard",
        )


def _greeting(stream: socket.socket) -> bytes:
    """Read the message that a scheduler begins with; b"" when it is not one."""
    until = time.monotonic() + _ANSWER_S
    try:
        (length,) = _LENGTH.unpack(_read(stream, _LENGTH.size, until))
        return _read(stream, length, until) if length <= _LONGEST_GREETING else b""
    except (TimeoutError, EOFError):
        return b""


def _read(stream: socket.socket, size: int, until: float) -> bytes:
    data = bytearray()
    while len(data) < size:
        stream.settimeout(max(until - time.monotonic(), 0.01))
        part = stream.recv(size - len(data))
        if not part:
            raise EOFError
        data += part
    return bytes(data)


def _refusal(words: str, where: str) -> UsageError:
    return UsageError(f"no Dask scheduler answers: {words}", where=where, fix=FIX)
