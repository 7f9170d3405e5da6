"""A lock on object storage has one holder, and dies with it."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time

import pytest

from civil_rgbd.errors import OutputError
from civil_rgbd.storage import lease
from civil_rgbd.storage.client import ask
from civil_rgbd.storage.lease import leased, refuse_lost_leases
from civil_rgbd.storage.places import files_below
from civil_rgbd.storage.remote_path import RemotePath

HOLD = """
import sys, time
from civil_rgbd.storage.lease import leased
from civil_rgbd.storage.remote_path import RemotePath
with leased(RemotePath(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""


def held_elsewhere(folder: RemotePath) -> subprocess.Popen[str]:
    """Let another process hold the lock."""
    process = subprocess.Popen(
        [sys.executable, "-c", HOLD, folder.url], stdout=subprocess.PIPE, text=True
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "held\n"
    return process


def end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()
    assert process.stdout is not None
    process.stdout.close()


def of_another_machine(folder: RemotePath) -> RemotePath:
    """Leave the lock of a process that cannot be asked whether it lives."""
    note = {"holder": "process 1 on elsewhere", "machine": "elsewhere", "process": 1}
    lock = folder.with_name(f".{folder.name}.lock")
    ask("write_on", lock.url, json.dumps(note).encode(), None)
    return lock


def test_a_lock_goes_with_its_block(bucket: RemotePath) -> None:
    folder = bucket / "set/B1"

    for _ in range(2):
        with leased(folder):
            assert list(files_below(bucket)) == ["set/.B1.lock"]
            with pytest.raises(OutputError, match="this very process"), leased(folder):
                pass
            refuse_lost_leases()
        assert files_below(bucket) == {}


def test_a_lock_of_a_living_process_holds_and_of_a_dead_one_does_not(bucket: RemotePath) -> None:
    folder = bucket / "set/B1"
    other = held_elsewhere(folder)
    try:
        with (
            pytest.raises(OutputError, match=f"process {other.pid} on .* is writing"),
            leased(folder),
        ):
            pass
        with pytest.raises(OutputError, match="is writing"), leased(folder, shared=True):
            pass
    finally:
        end(other)

    with leased(folder):
        assert list(files_below(bucket)) == ["set/.B1.lock"]
    assert files_below(bucket) == {}


def test_a_lock_from_elsewhere_holds_until_nobody_renews_it(
    bucket: RemotePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = bucket / "B1"
    of_another_machine(folder)

    with (
        pytest.raises(OutputError, match="process 1 on elsewhere is writing") as caught,
        leased(folder),
    ):
        pass
    assert "60 s" in caught.value.fix
    monkeypatch.setattr(lease, "LEASE_S", 1.5)
    monkeypatch.setattr(lease, "BEAT_S", 0.4)  # so that half a lease without a beat is suspicious
    started = time.monotonic()
    with leased(folder, wait_s=1.5):
        assert time.monotonic() - started < 8
        refuse_lost_leases()
    assert files_below(bucket) == {}


@pytest.mark.skipif(not hasattr(signal, "SIGSTOP"), reason="processes cannot be stopped here")
def test_a_stopped_holder_of_this_machine_is_named_and_not_waited_for(
    bucket: RemotePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = bucket / "set/B1"
    other = held_elsewhere(folder)
    monkeypatch.setattr(lease, "LEASE_S", 1.5)
    monkeypatch.setattr(lease, "BEAT_S", 0.4)
    try:
        other.send_signal(signal.SIGSTOP)
        time.sleep(3.0)  # longer than a lease; the server counts whole seconds
        with (
            pytest.raises(OutputError, match=f"process {other.pid} on .* is writing"),
            leased(folder),
        ):
            pass
    finally:
        end(other)


def test_what_this_process_left_behind_dies_as_any_other_lock(
    bucket: RemotePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = bucket / "set/B1"
    monkeypatch.setattr(lease, "LEASE_S", 1.5)
    monkeypatch.setattr(lease, "BEAT_S", 0.4)
    ask("write_on", (bucket / "set/.B1.lock").url, lease._note(), None)

    with leased(folder, wait_s=10.0):
        refuse_lost_leases()
    assert files_below(bucket) == {}


def test_sharers_bar_those_who_want_it_alone(bucket: RemotePath) -> None:
    folder = bucket / "B1"

    with leased(folder, shared=True):
        other = subprocess.run(
            [sys.executable, "-c", HOLD, folder.url], capture_output=True, text=True, check=False
        )
        assert "is writing here" in other.stderr
        shared = HOLD.replace("argv[1])", "argv[1]), shared=True").replace("sleep(60)", "sleep(0)")
        other = subprocess.run(
            [sys.executable, "-c", shared, folder.url], capture_output=True, text=True, check=False
        )
        assert other.stdout == "held\n"
    with leased(folder):
        pass
    assert files_below(bucket) == {}


def test_a_holder_gives_up_before_anybody_may_take_over(
    bucket: RemotePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s = [1000.0]
    monkeypatch.setattr(lease, "_now_s", lambda: now_s[0])
    asked = ask

    def slow_to_answer(verb: str, url: str, *arguments: object) -> object:
        now_s[0] += 5.0 * (verb == "write_on")
        return asked(verb, url, *arguments)

    monkeypatch.setattr(lease, "ask", slow_to_answer)
    with leased(bucket / "B1"):
        now_s[0] = 1000.0 + 49.0
        refuse_lost_leases()
        now_s[0] = 1000.0 + 51.0  # counted from the question, and less than a whole lease
        with pytest.raises(OutputError, match="could not be renewed"):
            refuse_lost_leases()


def test_a_holder_keeps_its_lock_alive_and_notices_its_loss(
    bucket: RemotePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(lease, "BEAT_S", 0.1)
    lock = bucket / ".B1.lock"

    with leased(bucket / "B1"):
        first = lock.stat().etag
        time.sleep(0.5)
        assert lock.stat().etag != first
        refuse_lost_leases()
        lock.write_bytes(b"{}")
        time.sleep(0.5)
        with pytest.raises(OutputError, match="could not be renewed"):
            refuse_lost_leases()
    assert lock.read_bytes() == b"{}"  # it is another's now
