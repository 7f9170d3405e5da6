"""Full disks and power cuts: what is written is whole, and what counts is synced first."""

from __future__ import annotations

import os
import random
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.format.layout import BRIDGES
from civil_rgbd.simulator.recording import SimulatedRecording

from .conftest import INFO, contents

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif(sys.platform != "linux", reason="mount, strace, file limits of Linux"),
]
SCRIPT = Path(__file__).parent / "one_build.py"


@pytest.fixture(scope="module")
def built(
    recording: SimulatedRecording, recipe: Recipe, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, bytes]:
    dataset = tmp_path_factory.mktemp("built")
    build_bridge(recording, recipe, dataset, INFO, BuildOptions())
    return contents(dataset)


@pytest.fixture
def small_disk(tmp_path: Path) -> Iterator[Path]:
    """A file system in memory, of its own; `mount -o remount,size=` gives it another size."""
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=64m", "none", str(disk)],  # noqa: S607  # by PATH
        capture_output=True,
        check=False,
    )
    if mounted.returncode:
        pytest.skip(f"may not mount a file system: {mounted.stderr.decode().strip()}")
    yield disk
    subprocess.run(["umount", str(disk)], check=True)  # noqa: S607  # by PATH


def run(out: Path, executor: str, workers: int) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        [sys.executable, str(SCRIPT), str(out), executor, str(workers)],
        capture_output=True,
        text=True,
        check=False,
        timeout=120,
    )


@pytest.mark.parametrize(("executor", "workers"), [("serial", 1), ("processes", 2), ("parts", 1)])
def test_a_disk_that_is_full_at_any_write_costs_nothing(
    executor: str, workers: int, built: dict[str, bytes], small_disk: Path
) -> None:
    dice = random.Random(f"full {executor}")  # noqa: S311  # no secret
    needed = sum(map(len, built.values()))
    refused = 0
    for _ in range(5):
        for left in small_disk.iterdir():
            shutil.rmtree(left)
        size = dice.randrange(needed // 20, needed)
        remount = ["mount", "-o", f"remount,size={size}", str(small_disk)]
        subprocess.run(remount, check=True)

        done = run(small_disk / "out", executor, workers)

        if done.returncode:
            refused += 1
            assert "OutputError: cannot write" in done.stderr
            assert not (small_disk / "out" / BRIDGES / "B9" / "manifest.json").exists()
    assert refused >= 3
    subprocess.run(["mount", "-o", "remount,size=64m", str(small_disk)], check=True)  # noqa: S607  # by PATH

    done = run(small_disk / "out", executor, workers)

    assert done.returncode == 0, done.stderr
    assert contents(small_disk / "out") == built


def test_a_file_that_may_not_grow_is_said_and_gone_on_with(
    built: dict[str, bytes], tmp_path: Path
) -> None:
    # Where nothing can be mounted, a limit on the size of files refuses in the middle of a write.
    largest = max(map(len, built.values()))
    limited = (
        "import resource, signal, sys\n"
        f"sys.path.insert(0, {str(SCRIPT.parent)!r})\n"
        "from pathlib import Path\nfrom one_build import build\n"
        f"build(Path({str(tmp_path / 'warm')!r}), 'serial', 1)\n"  # kernels are kept on disk, too
        "signal.signal(signal.SIGXFSZ, signal.SIG_IGN)\n"
        f"resource.setrlimit(resource.RLIMIT_FSIZE, ({largest - 1}, {largest - 1}))\n"
        f"build(Path({str(tmp_path / 'out')!r}), 'serial', 1)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", limited], capture_output=True, text=True, check=False
    )
    assert "OutputError: cannot write" in done.stderr
    assert not (tmp_path / "out" / BRIDGES).exists()

    assert run(tmp_path / "out", "serial", 1).returncode == 0

    assert contents(tmp_path / "out") == built


# --- power cuts: the order of writes, syncs and renames, as the kernel sees them ------------------

_CALL = re.compile(r"(?P<call>\w+)\((?P<rest>.*)\)\s+= (?P<result>-?\d+)")
_BEGUN = " <unfinished ...>"
_ENDED = re.compile(r"^\s*<\.\.\. \w+ resumed>")


def calls_of(trace: Path) -> Iterator[tuple[str, list[str]]]:
    """Successful calls in the order in which they ended: name, and the paths in it."""
    begun: dict[str, str] = {}  # by thread: strace tells of calls at once in two halves
    for line in trace.read_text().splitlines():
        thread, _, said = line.partition(" ")
        if said.endswith(_BEGUN):
            begun[thread] = said.removesuffix(_BEGUN)
            continue
        found = _CALL.search(_ENDED.sub(lambda _, thread=thread: begun.pop(thread), said))
        if found and not found["result"].startswith("-"):
            call, rest = found["call"], found["rest"]
            opened = re.match(r"\d+<([^>]+)>", rest)
            yield call, [opened[1]] if opened else re.findall(r'"([^"]+)"', rest)


@pytest.mark.parametrize("executor", ["serial", "parts"])
def test_nothing_appears_before_all_of_it_is_on_the_disk(executor: str, tmp_path: Path) -> None:
    if shutil.which("strace") is None:
        pytest.skip("needs strace to see what is synced")
    trace, out = tmp_path / "trace", tmp_path / "out"
    traced = "trace=write,pwrite64,fsync,rename,renameat,renameat2"
    strace = ["strace", "-f", "-y", "-s", "300", "-e", traced, "-o", str(trace)]
    done = subprocess.run(
        [*strace, sys.executable, str(SCRIPT), str(out), executor, "1"],
        capture_output=True,
        text=True,
        check=False,
        timeout=300,
    )
    if "Operation not permitted" in done.stderr:
        pytest.skip("may not trace processes")
    assert done.returncode == 0, done.stderr

    unsynced: dict[str, set[str]] = {}  # what a power cut may lose: files, and names in folders
    published = None
    for call, paths in calls_of(trace):
        inside = [path for path in paths if path.startswith(str(out))]
        if not inside:
            continue
        if call in {"write", "pwrite64"}:
            unsynced.setdefault(inside[0], set()).add("bytes")
        elif call == "fsync":
            unsynced.pop(inside[0], None)
        else:
            source, target = inside[0], inside[-1]
            if target == str(out / BRIDGES / "B9"):
                bridge = {path for path in unsynced if path.startswith(source)}
                assert bridge == set(), "published before it was on the disk"
                published = True
            if target.endswith("bridge/manifest.json"):
                others = {p for p in unsynced if "/bridge/" in p or p.endswith("/bridge")}
                assert others == set(), "the manifest came before what it vouches for"
            if "bytes" in unsynced.pop(source, set()):
                unsynced.setdefault(target, set()).add("bytes")
            unsynced.setdefault(os.path.dirname(target), set()).add("names")  # noqa: PTH120  # text
    assert published
    assert str(out / BRIDGES) not in unsynced, "the bridge's own name was not synced"
    assert str(out) not in unsynced, "the name of dataset.json was not synced"
