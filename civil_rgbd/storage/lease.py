"""A lock on object storage: an object that only one can create, and that dies with its holder.

The holder writes it anew every few seconds. One that was not written for a minute belongs to nobody
any more, and is taken over by a conditional write, which only one of several takers wins. A holder
on this very machine is known to be dead at once. All times are the server's.
"""

from __future__ import annotations

import contextlib
import json
import os
import platform
import secrets
import threading
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from civil_rgbd.errors import OutputError, StorageError
from civil_rgbd.storage.client import ConditionError, ask
from civil_rgbd.storage.remote_path import RemotePath

LEASE_S: Final = 60.0
"""A lock that was not renewed for so long is anybody's."""

BEAT_S: Final = 15.0
"""A living holder renews its lock so often."""

_SURE: Final = 5 / 6
"""The part of a lease in which its holder trusts in it.

Takers count in the server's whole seconds, and what the holder wrote last is still on its way when
the lease ends: so the holder gives up some seconds before anybody may take over.
"""

_POLL_S: Final = 0.5
_held: dict[str, _Lease] = {}


@contextmanager
def leased(path: RemotePath, *, wait_s: float = 0.0, shared: bool = False) -> Iterator[None]:
    """Hold the only right to write a folder, or one right of many.

    Args:
        path: the folder; it need not exist.
        wait_s: how long to wait for another holder; one that may be dead is waited for anyway.
        shared: hold it together with other sharers; nobody holds it alone meanwhile.

    Raises:
        OutputError: another process holds it.
        StorageError: the storage cannot be reached, or refuses.
    """
    lock = path.with_name(f".{path.name.lstrip('.')}.lock")
    mine = lock.with_name(f"{lock.name}.{secrets.token_hex(8)}") if shared else lock
    if lock.url in _held:
        raise _busy(path, "this very process")
    deadline = time.monotonic() + wait_s
    lease = None
    while lease is None:
        lease = _take(lock, mine, path, patient=time.monotonic() < deadline)
    _held[lock.url] = lease
    try:
        yield
    finally:
        del _held[lock.url]
        lease.release()


def refuse_lost_leases() -> None:
    """Refuse to go on when a lock that this process holds could not be renewed in time.

    Raises:
        OutputError: one could not: another process may hold it now.
    """
    for lease in _held.values():
        if lease.is_lost:
            raise OutputError(
                "the lock could not be renewed in time: another build may have taken it",
                where=lease.path,
                fix="run the same command again: what is finished is kept",
            )


class _Lease:
    """A lock object of ours, and the thread that keeps it alive."""

    def __init__(self, path: RemotePath, etag: str | None, *, asked_s: float) -> None:
        self.path = path
        self._etag, self._lost = etag, False
        self._renewed_s = asked_s  # the server wrote it later than it was asked to
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._beat, daemon=True)
        self._thread.start()

    @property
    def is_lost(self) -> bool:
        return self._lost or _now_s() - self._renewed_s > _SURE * LEASE_S

    def _beat(self) -> None:
        while not self._over.wait(BEAT_S):
            with contextlib.suppress(StorageError):  # the next beat may get through
                asked_s = _now_s()
                try:
                    self._etag = ask("write_on", self.path.url, _note(), self._etag)
                except ConditionError:
                    self._lost = True
                    return
                self._renewed_s = asked_s

    def release(self) -> None:
        self._over.set()
        self._thread.join()
        with contextlib.suppress(StorageError, FileNotFoundError):  # it dies by itself
            if not self._lost and self.path.stat().etag == self._etag:
                self.path.unlink()


@dataclass(frozen=True, slots=True)
class _Other:
    """Somebody else's lock object: whose, how old, and whether its holder still lives."""

    path: RemotePath
    holder: str
    etag: str | None
    age_s: float
    is_dead: bool


def _take(lock: RemotePath, mine: RemotePath, path: RemotePath, *, patient: bool) -> _Lease | None:
    """Take the lock; None when it is worth trying again."""
    found = _look(lock)
    etag = None
    if found is not None and found.is_dead and mine == lock:
        etag = found.etag
    elif found is not None and not found.is_dead:
        _refuse_or_wait(found, path, patient=patient)
        return None
    asked_s = _now_s()
    try:
        etag = ask("write_on", mine.url, _note(), etag)
    except ConditionError:
        return None  # somebody was quicker
    # Written first and looked after: of two that come at once at most one finds itself alone.
    others = _sharers(lock) if mine == lock else filter(None, [_look(lock)])
    living = next((other for other in others if not other.is_dead), None)
    if living is None:
        return _Lease(mine, etag, asked_s=asked_s)
    mine.unlink()
    _refuse_or_wait(living, path, patient=patient)
    return None


def _refuse_or_wait(other: _Other, path: RemotePath, *, patient: bool) -> None:
    # Between the two it may be dead, and will be anybody's soon. Who lives on beyond is stopped.
    if not patient and not 2 * BEAT_S <= other.age_s <= LEASE_S:
        raise _busy(path, other.holder)
    time.sleep(_POLL_S)


def _busy(path: RemotePath, holder: str) -> OutputError:
    return OutputError(
        f"{holder} is writing here",
        where=path,
        fix=f"wait for it to finish or end it; its lock goes at the latest {LEASE_S:.0f} s after "
        "its end",
    )


def _sharers(lock: RemotePath) -> Iterator[_Other]:
    for neighbour in lock.parent.iterdir():
        if neighbour.name.startswith(f"{lock.name}."):
            other = _look(neighbour)
            if other is not None and other.is_dead:
                neighbour.unlink()
            elif other is not None:
                yield other


def _look(lock: RemotePath) -> _Other | None:
    """Read somebody's lock object; None when there is none."""
    try:
        stat, note = lock.stat(), json.loads(lock.read_bytes())
    except FileNotFoundError:
        return None
    except ValueError:
        note = None
    note = note if isinstance(note, dict) else {}  # not ours, or cut
    age_s = _server_time_s(lock) - stat.st_mtime_ns / 1e9
    dead = age_s > LEASE_S
    # What this very process left behind, for the storage was out of reach, dies by its age alone.
    if note.get("machine") == _machine() and note.get("process") != os.getpid():
        dead = _started(note.get("process", 0)) != note.get("started")
    return _Other(lock, str(note.get("holder", "another process")), stat.etag, age_s, dead)


def _server_time_s(lock: RemotePath) -> float:
    """Ask the storage for its time, by writing something: clocks of other machines may be off."""
    probe = lock.with_name(f".clock.{secrets.token_hex(8)}")
    probe.write_bytes(b"")
    try:
        return probe.stat().st_mtime_ns / 1e9
    finally:
        probe.unlink()


def _now_s() -> float:
    """Count seconds that never go back, those of a machine that sleeps among them."""
    clock = getattr(time, "CLOCK_BOOTTIME", None)  # of Linux, whose other clocks sleep, too
    return time.monotonic() if clock is None else time.clock_gettime(clock)


def _note() -> bytes:
    note = {
        "holder": f"process {os.getpid()} on {platform.node()}",
        "machine": _machine(),
        "process": os.getpid(),
        "started": _started(os.getpid()),
        "beat": secrets.token_hex(8),  # so that the ETag, a hash of the bytes, changes
    }
    return json.dumps(note).encode()


def _machine() -> str:
    """Name what process numbers are counted in: a machine since its start, or a container."""
    try:
        boot = Path("/proc/sys/kernel/random/boot_id").read_text(encoding="ascii").strip()
        return f"{platform.node()} {boot} {Path('/proc/self/ns/pid').readlink()}"
    except OSError:
        return f"{platform.node()} {uuid.getnode()}"


def _started(process: int) -> str | None:
    """Tell when a process of this machine began; None when there is none."""
    try:
        text = Path(f"/proc/{process}/stat").read_text(encoding="utf-8", errors="replace")
        return text.rpartition(")")[2].split()[19]
    except FileNotFoundError:
        return None if Path("/proc/self/stat").exists() else "unknown"
    except OSError:
        return None
