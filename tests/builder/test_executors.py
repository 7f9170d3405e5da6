"""The same bytes from every executor, and one failing bridge beside others that come out."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from importlib import import_module
from pathlib import Path

import pytest

from civil_rgbd.builder import cluster_address, cluster_probe
from civil_rgbd.builder.bridge_build import Order
from civil_rgbd.builder.cluster import connect, differences
from civil_rgbd.builder.executors import require_dask
from civil_rgbd.builder.run import BuildOptions, build_bridge, build_bridges
from civil_rgbd.cli import main
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording
from civil_rgbd.errors import (
    BridgeFailedError,
    BuildError,
    MissingExtraError,
    RecordingError,
    UsageError,
)
from civil_rgbd.format.layout import BRIDGES
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.recording import SimulatedRecording

from .conftest import INFO, contents


@pytest.fixture(autouse=True)
def importable(monkeypatch: pytest.MonkeyPatch) -> None:
    """Workers find the faulty recordings by name, as they would a user's converter."""
    monkeypatch.syspath_prepend(str(Path(__file__).parent))


def faulty(name: str, recording: SimulatedRecording) -> Recording:
    kind = getattr(import_module("faulty_recordings"), name)
    made: Recording = kind(recording.spec)
    return made


def cannot_open() -> Recording:
    raise RecordingError("the recording is damaged", where="c.mcap", fix="fetch it again")


@pytest.fixture(scope="module")
def every(recipe: Recipe) -> Recipe:
    """No image is left out for being near another one: image 20 is among them."""
    return replace(recipe, select=replace(recipe.select, min_displacement_m=0.0))


@pytest.fixture(scope="module")
def built(
    recording: SimulatedRecording, recipe: Recipe, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, bytes]:
    dataset = tmp_path_factory.mktemp("built")
    build_bridge(recording, recipe, dataset, INFO, BuildOptions())
    return contents(dataset)


def orders_with(bad: Recording, good: Recording) -> list[Order]:
    return [
        Order(BridgeInfo("bad", licence="CC0-1.0"), open=lambda: bad),
        Order(BridgeInfo("closed", licence="CC0-1.0"), open=cannot_open),
        Order(INFO, open=lambda: good),
    ]


def test_a_bridge_that_fails_does_not_stop_the_others(
    recording: SimulatedRecording, every: Recipe, tmp_path: Path
) -> None:
    alone, told = tmp_path / "alone", []
    build_bridge(recording, every, alone, INFO, BuildOptions())
    options = BuildOptions(workers=1, on_progress=lambda done, total: told.append((done, total)))

    report = build_bridges(
        orders_with(faulty("RaisesAtImage20", recording), recording),
        every,
        tmp_path / "out",
        options,
    )

    bad, closed, good = report.outcomes
    assert [outcome.bridge_id for outcome in report.failed] == ["bad", "closed"]
    assert isinstance(bad.error, BridgeFailedError)
    assert "failed 3 times, each time: ZeroDivisionError: division by zero (faulty" in str(
        bad.error
    )
    assert "frames 0 to 44" in str(bad.error)
    assert str(closed.error).startswith("the recording is damaged")
    assert good.report is not None
    assert contents(tmp_path / "out" / BRIDGES / "B9") == contents(alone / BRIDGES / "B9")
    assert {path.name for path in (tmp_path / "out" / BRIDGES).iterdir()} == {"B9"}
    assert sum(done for done, _ in told) == 45  # what the failed bridge had told is taken back
    assert "1 of 3 bridges" in report.to_text()
    assert report.to_document()["failed"] == ["bad", "closed"]


@pytest.mark.slow
@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_a_chunk_that_always_kills_its_worker_fails_its_bridge_only(
    recording: SimulatedRecording, every: Recipe, tmp_path: Path, executor: str
) -> None:
    options = BuildOptions(workers=2, executor=executor)

    report = build_bridges(
        orders_with(faulty("DiesAtImage20", recording), recording), every, tmp_path, options
    )

    bad, _, good = report.outcomes
    assert "failed 3 times" in str(bad.error)
    assert "its worker" in str(bad.error)
    assert good.report is not None
    assert (tmp_path / BRIDGES / "B9" / "manifest.json").exists()
    assert not (tmp_path / BRIDGES / "bad").exists()


def test_every_bridge_holds_its_own_frames(
    recording: SimulatedRecording, recipe: Recipe, built: dict[str, bytes], tmp_path: Path
) -> None:
    other = SimulatedRecording(replace(recording.spec, seed=7))
    orders = [
        Order(BridgeInfo("north", licence="CC0-1.0"), open=lambda: other),
        Order(INFO, open=lambda: recording),
    ]

    build_bridges(orders, recipe, tmp_path, BuildOptions(workers=2))

    ours = {path: data for path, data in contents(tmp_path).items() if "bridges/B9/" in path}
    assert ours == {path: data for path, data in built.items() if "bridges/B9/" in path}
    assert (tmp_path / BRIDGES / "north" / "manifest.json").exists()


def test_dask_that_is_not_installed_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("civil_rgbd.builder.executors.find_spec", lambda _name: None)

    with pytest.raises(MissingExtraError, match="distributed") as caught:
        require_dask()

    assert caught.value.fix == 'pip install "civil-rgbd[dask]"'


# --- a Dask cluster that somebody else started ---------------------------------------------------


def dask(*arguments: str, **environment: str) -> subprocess.Popen[bytes]:
    # In another folder than the build: relative paths lead elsewhere there.
    return subprocess.Popen(
        [sys.executable, "-m", "dask", *arguments, "--no-dashboard"],
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        env=os.environ | environment,
        cwd="/",
    )


@pytest.fixture(scope="module")
def scheduler(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The file that a running scheduler wrote; two workers with two threads each."""
    file = tmp_path_factory.mktemp("cluster") / "scheduler.json"
    started = dask("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    worker = dask("worker", "--scheduler-file", str(file), "--nworkers", "2", "--nthreads", "2")
    deadline = time.monotonic() + 60
    while not file.exists():
        assert time.monotonic() < deadline
        time.sleep(0.1)
    yield str(file)
    for process in (worker, started):
        process.terminate()
        process.wait(timeout=30)


@pytest.mark.slow
def test_a_running_cluster_gives_the_same_bytes(
    recording: SimulatedRecording,
    recipe: Recipe,
    built: dict[str, bytes],
    scheduler: str,
    tmp_path: Path,
) -> None:
    options = BuildOptions(workers=None, scheduler=scheduler)

    build_bridge(recording, recipe, tmp_path, INFO, options)

    assert contents(tmp_path) == built


@pytest.mark.slow
def test_relative_paths_lead_to_the_same_files_on_a_cluster(
    recording: SimulatedRecording,
    scheduler: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    write_recording(Path("scan.mcap"), recording.spec)
    build = ["build", "--set", "accumulate.points=8000", "scan.mcap", "--out"]

    assert main([*build, "there", "--scheduler", scheduler]) == 0
    assert main([*build, "here", "--workers", "1"]) == 0

    assert contents(tmp_path / "there") == contents(tmp_path / "here")


@pytest.mark.slow
def test_a_cluster_that_sees_another_recording_is_refused(
    recording: SimulatedRecording, recipe: Recipe, scheduler: str, tmp_path: Path
) -> None:
    # The worker looks for the file by its path: here it is another one by then.
    source = tmp_path / "raw.mcap"
    source.write_bytes(b"old")

    def open_and_replace() -> Recording:
        source.write_bytes(b"something else")
        return recording

    order = Order(INFO, open=open_and_replace, files=(source,))

    with pytest.raises(BuildError, match="do not see the recordings") as caught:
        build_bridges([order], recipe, tmp_path / "out", BuildOptions(scheduler=scheduler))

    assert "mount at the same path" in caught.value.fix
    assert not (tmp_path / "out" / BRIDGES).exists()


@pytest.mark.slow
def test_a_cluster_with_other_versions_is_refused(
    recording: SimulatedRecording,
    recipe: Recipe,
    tmp_path: Path,
) -> None:
    # A worker that finds an older numpy's metadata first: as if it had that version.
    (tmp_path / "numpy-1.0.dist-info").mkdir()
    metadata = "Metadata-Version: 2.1\nName: numpy\nVersion: 1.0\n"
    (tmp_path / "numpy-1.0.dist-info" / "METADATA").write_text(metadata)
    file = tmp_path / "scheduler.json"
    started = dask("scheduler", "--host", "127.0.0.1", "--port", "0", "--scheduler-file", str(file))
    worker = dask("worker", "--scheduler-file", str(file), PYTHONPATH=str(tmp_path))
    try:
        while not file.exists():
            time.sleep(0.1)
        options = BuildOptions(scheduler=str(file))
        with pytest.raises(BuildError, match=r"numpy 1.0 \(here ") as caught:
            build_bridge(recording, recipe, tmp_path / "out", INFO, options)
        assert "same versions" in caught.value.fix
        assert not (tmp_path / "out").exists()
    finally:
        for process in (worker, started):
            process.terminate()
            process.wait(timeout=30)


def test_a_worker_of_another_commit_than_the_manifest_claims_differs(
    tmp_path: Path,
) -> None:
    (tmp_path / "civil_rgbd-0.1.0.dist-info").mkdir()
    metadata = "Metadata-Version: 2.1\nName: civil-rgbd\nVersion: 0.1.0\n"
    (tmp_path / "civil_rgbd-0.1.0.dist-info/METADATA").write_text(metadata)
    (tmp_path / "civil_rgbd").mkdir()
    (tmp_path / "civil_rgbd/source_commit.txt").write_text("abc-dirty\n")
    probe = Path(cluster_probe.__file__)
    code = "import json, cluster_probe as p; print(json.dumps(p.installed(['civil-rgbd'])))"
    run, settings = [sys.executable, "-c", code], os.environ | {"PYTHONPATH": str(probe.parent)}
    told = subprocess.run(run, cwd=tmp_path, env=settings, capture_output=True, check=True)
    theirs = json.loads(told.stdout)

    assert differences(theirs, theirs | {cluster_probe.COMMIT: None}) == []
    assert differences(theirs | {cluster_probe.COMMIT: None}, theirs) == [
        "civil-rgbd of commit unknown (here abc-dirty)"
    ]
    assert differences(theirs, theirs | {cluster_probe.COMMIT: "def"}) == [
        "civil-rgbd of commit abc-dirty (here def)"
    ]


@pytest.fixture
def stranger() -> Iterator[socket.socket]:
    """A port where something other than Dask listens."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        yield listener


@pytest.mark.parametrize("greeting", [b"HTTP/1.1 400 Bad Request\r\n\r\n", b"\x04", b""])
def test_a_port_of_something_else_than_dask_is_said(
    stranger: socket.socket, greeting: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(cluster_address, "_ANSWER_S", 0.3)
    address = f"tcp://127.0.0.1:{stranger.getsockname()[1]}"
    opened = []

    def greet() -> None:
        connection, _ = stranger.accept()
        connection.sendall(greeting)
        opened.append(connection)  # and is not closed: it stays mute

    thread = threading.Thread(target=greet)
    thread.start()
    with pytest.raises(UsageError, match="it is no Dask scheduler") as caught:
        connect(address, workers=1, stack=ExitStack())
    thread.join()
    opened[0].close()
    assert caught.value.where == address
    assert "8787 is its dashboard" in caught.value.fix


@pytest.mark.parametrize(
    ("text", "words"),
    [("{", "is no JSON"), ("[]", "names no address"), ('{"address": 3}', "names no address")],
)
def test_a_file_that_names_no_scheduler_is_said(text: str, words: str, tmp_path: Path) -> None:
    file = tmp_path / "scheduler.json"
    file.write_text(text)

    with pytest.raises(UsageError, match=words) as caught:
        connect(str(file), workers=1, stack=ExitStack())

    assert caught.value.where == str(file)
    assert "--scheduler-file" in caught.value.fix


@pytest.mark.slow
def test_a_scheduler_out_of_reach_is_said_within_seconds(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    started = time.monotonic()
    for address in ("tcp://127.0.0.1:9", "gibberish://x", str(tmp_path / "none.json")):
        with pytest.raises(UsageError, match="scheduler") as caught:
            build_bridge(recording, recipe, tmp_path / "out", INFO, BuildOptions(scheduler=address))
        assert caught.value.where == address
        assert "tcp://HOST:8786" in caught.value.fix
    assert time.monotonic() - started < 30
    assert not (tmp_path / "out").exists()


def test_a_local_cluster_leaves_the_port_of_dashboards_to_others() -> None:
    with ExitStack() as stack:
        holder = stack.enter_context(socket.socket())
        with suppress(OSError):  # some other cluster of this machine holds it already
            holder.bind(("127.0.0.1", 8787))
            holder.listen()

        client = connect(None, workers=1, stack=stack)  # a warning of Dask's would be an error

        assert len(client.nthreads()) == 1
