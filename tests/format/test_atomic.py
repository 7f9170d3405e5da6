"""Whole or absent, whatever happens in between."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from civil_rgbd.errors import OutputError
from civil_rgbd.format import atomic
from civil_rgbd.format.atomic import (
    folder_lock,
    publish_folder,
    recover_folder,
    sync_tree,
    whole_file,
)

posix_only = pytest.mark.skipif(os.name == "nt", reason="signals and file limits of POSIX")

HOLD = """
import sys, time
from pathlib import Path
from civil_rgbd.format.atomic import folder_lock
with folder_lock(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(60)
"""

HOLD_AND_FORK = """
import os, sys, time
from pathlib import Path
from civil_rgbd.format.atomic import folder_lock
with folder_lock(Path(sys.argv[1])):
    child = os.fork()
    if child:
        print(child, flush=True)
    time.sleep(60)
"""


def holder(script: str, folder: Path) -> tuple[subprocess.Popen[str], str]:
    process = subprocess.Popen(
        [sys.executable, "-c", script, str(folder)],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
    )
    assert process.stdout is not None
    return process, process.stdout.readline().strip()


def hold(folder: Path, *, wait_s: float = 0.0) -> None:
    with folder_lock(folder, wait_s=wait_s):
        pass


def end(process: subprocess.Popen[str]) -> None:
    process.kill()
    process.wait()
    assert process.stdout is not None
    process.stdout.close()


def test_a_file_appears_with_its_whole_content(tmp_path: Path) -> None:
    path = tmp_path / "a.json"

    with whole_file(path) as scratch:
        scratch.write_text("new")
        assert not path.exists()

    assert path.read_text() == "new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.json"]


def test_a_failure_leaves_the_old_file_and_no_scratch(tmp_path: Path) -> None:
    path = tmp_path / "a.json"
    path.write_text("old")

    with pytest.raises(ZeroDivisionError, match="division"), whole_file(path) as scratch:
        _ = scratch.write_text("half") // 0

    assert path.read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.json"]


def test_a_refusal_of_the_system_is_an_output_error(tmp_path: Path) -> None:
    path = tmp_path / "missing" / "a.json"

    with (
        pytest.raises(OutputError, match="cannot write: No such file") as caught,
        whole_file(path) as scratch,
    ):
        scratch.write_text("x")

    assert caught.value.where == str(path)
    assert "write elsewhere" in caught.value.fix


@posix_only
def test_a_full_disk_is_an_output_error_and_leaves_nothing(tmp_path: Path) -> None:
    # A limit on the file size is the one refusal in the middle of writing that needs no root.
    script = """
import resource, signal, sys
from pathlib import Path
import numpy as np
from civil_rgbd.errors import OutputError
from civil_rgbd.format.atomic import whole_file
from civil_rgbd.format.depth_exr import write_depth
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
folder = Path(sys.argv[1])
depth_m = np.random.default_rng(0).random((64, 64), dtype=np.float32)
size = len(write_depth(folder / "a.exr", depth_m))
(folder / "a.exr").unlink()
resource.setrlimit(resource.RLIMIT_FSIZE, (size - 1, size - 1))
try:
    with whole_file(folder / "a.txt") as scratch:
        scratch.write_bytes(bytes(size))
except OutputError as error:
    print(error.what)
try:
    write_depth(folder / "a.exr", depth_m)
except OutputError as error:
    print(error.what)
"""
    run = subprocess.run(
        [sys.executable, "-c", script, str(tmp_path)], capture_output=True, text=True, check=True
    )

    file_line, depth_line = run.stdout.strip().splitlines()[:2]
    assert file_line == "cannot write: File too large"
    assert depth_line.startswith("cannot write")
    assert list(tmp_path.iterdir()) == []


def make_folder(path: Path, text: str) -> Path:
    (path / "rgb").mkdir(parents=True)
    (path / "rgb" / "a.jpg").write_text(text)
    return path


def test_a_folder_is_published_by_one_rename(tmp_path: Path) -> None:
    partial = make_folder(tmp_path / ".partial" / "B1", "new")
    sync_tree(partial)

    publish_folder(partial, tmp_path / "bridges" / "B1", replace=False)

    assert (tmp_path / "bridges" / "B1" / "rgb" / "a.jpg").read_text() == "new"
    assert not partial.exists()


def test_an_existing_folder_stays_without_overwrite(tmp_path: Path) -> None:
    partial, old = make_folder(tmp_path / "p", "new"), make_folder(tmp_path / "B1", "old")

    with pytest.raises(OutputError, match="exists already") as caught:
        publish_folder(partial, old, replace=False)

    assert "--overwrite" in caught.value.fix
    assert (old / "rgb" / "a.jpg").read_text() == "old"
    assert partial.exists()


def test_an_existing_folder_is_replaced_without_a_trace(tmp_path: Path) -> None:
    partial, old = make_folder(tmp_path / "p", "new"), make_folder(tmp_path / "B1", "old")

    publish_folder(partial, old, replace=True)

    assert (old / "rgb" / "a.jpg").read_text() == "new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["B1"]


def test_a_failed_replacement_brings_the_old_folder_back(tmp_path: Path) -> None:
    old = make_folder(tmp_path / "B1", "old")

    with pytest.raises(OutputError, match="cannot write"):
        publish_folder(tmp_path / "not there", old, replace=True)

    assert (old / "rgb" / "a.jpg").read_text() == "old"


def test_a_kill_between_the_renames_is_undone(tmp_path: Path) -> None:
    make_folder(tmp_path / ".B1.replaced", "old")

    recover_folder(tmp_path / "B1")

    assert (tmp_path / "B1" / "rgb" / "a.jpg").read_text() == "old"
    assert [entry.name for entry in tmp_path.iterdir()] == ["B1"]


def test_a_kill_after_the_renames_keeps_the_new_folder(tmp_path: Path) -> None:
    make_folder(tmp_path / ".B1.replaced", "old")
    make_folder(tmp_path / "B1", "new")

    recover_folder(tmp_path / "B1")

    assert (tmp_path / "B1" / "rgb" / "a.jpg").read_text() == "new"
    assert [entry.name for entry in tmp_path.iterdir()] == ["B1"]


def test_publishing_first_undoes_an_earlier_kill(tmp_path: Path) -> None:
    partial = make_folder(tmp_path / "p", "new")
    make_folder(tmp_path / ".B1.replaced", "old")

    with pytest.raises(OutputError, match="exists already"):
        publish_folder(partial, tmp_path / "B1", replace=False)

    assert (tmp_path / "B1" / "rgb" / "a.jpg").read_text() == "old"


@posix_only
def test_a_lock_file_that_was_just_deleted_is_no_lock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Its holder deletes it between our opening and our locking: somebody may make a new one.
    lock_now = atomic._lock
    deletions = iter([True])

    def delete_then_lock(handle: int, *, shared: bool) -> None:
        if next(deletions, False):
            (tmp_path / ".B1.lock").unlink()
        lock_now(handle, shared=shared)

    monkeypatch.setattr(atomic, "_lock", delete_then_lock)
    with folder_lock(tmp_path / "B1", wait_s=1.0):
        assert (tmp_path / ".B1.lock").exists()
        process, words = holder(HOLD, tmp_path / "B1")
        end(process)
    assert words == ""


def test_the_second_holder_in_one_process_is_refused(tmp_path: Path) -> None:
    with folder_lock(tmp_path / "B1"):
        with pytest.raises(OutputError, match="this very process is writing"):
            hold(tmp_path / "B1")
        with folder_lock(tmp_path / "B2"):
            pass


def test_a_lock_leaves_nothing_behind(tmp_path: Path) -> None:
    with folder_lock(tmp_path / ".partial"):
        assert [entry.name for entry in tmp_path.iterdir()] == [".partial.lock"]
    with folder_lock(tmp_path / ".partial"):
        pass

    assert list(tmp_path.iterdir()) == []


def test_another_process_is_named_and_waited_for(tmp_path: Path) -> None:
    process, _ = holder(HOLD, tmp_path / "B1")
    try:
        with pytest.raises(
            OutputError, match=rf"process {process.pid} on \S+ is writing here"
        ) as caught:
            hold(tmp_path / "B1")
        assert "wait for it to finish" in caught.value.fix
        started = time.monotonic()
        with pytest.raises(OutputError, match="is writing here"):
            hold(tmp_path / "B1", wait_s=0.3)
        assert time.monotonic() - started >= 0.3
    finally:
        end(process)


def test_a_dead_holder_holds_nothing(tmp_path: Path) -> None:
    process, _ = holder(HOLD, tmp_path / "B1")
    end(process)

    with folder_lock(tmp_path / "B1", wait_s=1.0):
        pass


@posix_only
def test_workers_that_outlive_a_killed_holder_hold_nothing(tmp_path: Path) -> None:
    process, child = holder(HOLD_AND_FORK, tmp_path / "B1")
    process.kill()
    process.wait()
    try:
        with folder_lock(tmp_path / "B1", wait_s=1.0):
            pass
    finally:
        os.kill(int(child), signal.SIGKILL)
        assert process.stdout is not None
        process.stdout.close()


def test_sharers_hold_a_folder_together_and_nobody_holds_it_alone_meanwhile(tmp_path: Path) -> None:
    sharing = HOLD.replace("sys.argv[1])", "sys.argv[1]), shared=True")
    first, _ = holder(sharing, tmp_path / "B1")
    second, said = holder(sharing, tmp_path / "B1")
    try:
        assert said == "held"
        with pytest.raises(OutputError, match="one of several parts, process") as caught:
            hold(tmp_path / "B1")
        assert "wait for it to finish" in caught.value.fix
        with folder_lock(tmp_path / "B1", shared=True):
            end(first)
        with pytest.raises(OutputError, match="is writing here"):
            hold(tmp_path / "B1")
    finally:
        end(first)
        end(second)
    hold(tmp_path / "B1")
    assert list(tmp_path.iterdir()) == []


def test_a_sharer_waits_for_who_holds_it_alone(tmp_path: Path) -> None:
    process, _ = holder(HOLD, tmp_path / "B1")
    try:
        with (
            pytest.raises(OutputError, match="is writing here"),
            folder_lock(tmp_path / "B1", shared=True),
        ):
            pass
    finally:
        end(process)


@posix_only
def test_a_lock_that_went_while_it_was_taken_is_taken_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    lock_file, really = tmp_path / "sets/.B1.lock", atomic._lock
    left = [lock_file.parent]

    def after_its_last_holder(handle: int, *, shared: bool) -> None:
        if left:
            lock_file.unlink()
            left.pop().rmdir()
        really(handle, shared=shared)

    monkeypatch.setattr(atomic, "_lock", after_its_last_holder)

    with folder_lock(tmp_path / "sets/B1"):  # does not wait, and need not
        assert lock_file.is_file()
