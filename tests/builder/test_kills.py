"""Killed at any moment, a build goes on to the same bytes; whatever dies, nothing is lost."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import psutil
import pytest

from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.format.layout import BRIDGES, PARTIAL
from civil_rgbd.simulator.recording import SimulatedRecording

from .conftest import INFO, contents

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(os.name == "nt", reason="signals of POSIX"),
]
SCRIPT = Path(__file__).parent / "one_build.py"
KILLS = 5
EXECUTORS = [("serial", 1), ("processes", 2), ("dask", 2), ("parts", 1)]


@pytest.fixture(scope="module")
def built(
    recording: SimulatedRecording, recipe: Recipe, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, bytes]:
    """What has to come out: made by one process, from beginning to end."""
    dataset = tmp_path_factory.mktemp("built")
    build_bridge(recording, recipe, dataset, INFO, BuildOptions())
    return contents(dataset)


def start(out: Path, executor: str, workers: int) -> subprocess.Popen[str]:
    """Start a build, and wait until its imports are done."""
    process = subprocess.Popen(
        [sys.executable, str(SCRIPT), str(out), executor, str(workers)],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        # A suite that runs in the background hands on that interrupts are ignored.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),  # noqa: PLW1509  # no threads here
    )
    assert process.stdout is not None
    assert process.stdout.readline() == "started\n"
    return process


def left_of(group: int) -> list[psutil.Process]:
    """The processes that a build left behind."""
    left = []
    for process in psutil.process_iter():
        try:
            if os.getpgid(process.pid) == group and process.status() != psutil.STATUS_ZOMBIE:
                left.append(process)
        except (ProcessLookupError, psutil.Error):
            continue
    return left


def workers_of(parent: int) -> list[psutil.Process]:
    """The workers of a build; helpers of Python's are none."""
    try:
        children = psutil.Process(parent).children(recursive=True)
        return [child for child in children if "spawn_main" in " ".join(child.cmdline())]
    except psutil.Error:
        return []  # one of them just died, or the build ended


def wait_until_alone(group: int) -> None:
    """Wait until the children of a killed build have noticed."""
    deadline = time.monotonic() + 30
    while left_of(group):
        assert time.monotonic() < deadline, f"outlived their parent: {left_of(group)}"
        time.sleep(0.05)


def finish(out: Path, executor: str, workers: int) -> float:
    """Build to the end; return how long it took."""
    started = time.monotonic()
    process = start(out, executor, workers)
    _, said = process.communicate(timeout=120)
    assert process.returncode == 0, said
    return time.monotonic() - started


@pytest.mark.parametrize(("executor", "workers"), EXECUTORS)
def test_a_build_killed_at_random_moments_ends_with_the_same_bytes(
    executor: str, workers: int, built: dict[str, bytes], tmp_path: Path
) -> None:
    dice = random.Random(f"kill {executor}")  # noqa: S311  # no secret
    whole_s = finish(tmp_path / "timed", executor, workers)
    assert contents(tmp_path / "timed") == built
    out = tmp_path / "out"

    for _ in range(KILLS):
        process = start(out, executor, workers)
        time.sleep(dice.uniform(0.0, whole_s))
        process.kill()
        process.communicate()
        wait_until_alone(process.pid)
        bridge = out / BRIDGES / "B9"
        assert not bridge.exists() or (bridge / "manifest.json").exists()
    finish(out, executor, workers)

    assert contents(out) == built
    assert {path.name for path in out.iterdir()} == {BRIDGES, "dataset.json"}


@pytest.mark.parametrize("executor", ["processes", "dask"])
def test_workers_killed_again_and_again_cost_their_chunks_only(
    executor: str, built: dict[str, bytes], tmp_path: Path
) -> None:
    # As the kernel does when memory runs out. Never the same chunk three times: that gives it up.
    process = start(tmp_path / "out", executor, 2)
    killed = 0
    while process.poll() is None and killed < 2:
        workers = workers_of(process.pid)
        if len(list((tmp_path / "out").rglob("done/*.json"))) > 2 * killed and workers:
            os.kill(workers[killed % len(workers)].pid, signal.SIGKILL)
            killed += 1
        time.sleep(0.05)
    _, said = process.communicate(timeout=120)

    assert process.returncode == 0, said
    assert killed
    assert contents(tmp_path / "out") == built


@pytest.mark.parametrize(("executor", "workers"), EXECUTORS)
def test_an_interrupt_stops_the_build_and_its_workers(
    executor: str, workers: int, built: dict[str, bytes], tmp_path: Path
) -> None:
    process = start(tmp_path / "out", executor, workers)
    while not list((tmp_path / "out").rglob("done/*.json")):
        time.sleep(0.02)
    os.killpg(process.pid, signal.SIGINT)  # as a terminal does: to the whole group
    _, said = process.communicate(timeout=60)

    assert process.returncode in {1, -signal.SIGINT, 130}
    assert said.count("Traceback") == 1, said  # the script's own; no worker complains
    assert "KeyboardInterrupt" in said
    wait_until_alone(process.pid)
    finish(tmp_path / "out", executor, workers)
    assert contents(tmp_path / "out") == built


def test_what_was_never_synced_may_be_lost(built: dict[str, bytes], tmp_path: Path) -> None:
    # A power cut keeps what was synced: records of chunks. Of pictures it may leave anything.
    dice = random.Random("power")  # noqa: S311  # no secret
    out = tmp_path / "out"
    process = start(out, "serial", 1)
    while len(list((out / PARTIAL / "B9/done").glob("*.json"))) < 4:
        time.sleep(0.02)
    process.kill()
    process.communicate()
    for picture in sorted((out / PARTIAL / "B9/bridge").rglob("*.*")):
        match dice.randrange(4):
            case 0:
                picture.write_bytes(b"")
            case 1:
                picture.unlink()
            case 2:
                picture.write_bytes(picture.read_bytes()[:-100] + bytes(100))

    finish(out, "serial", 1)

    assert contents(out) == built
