"""What a whole scan costs: beside its length, the codecs' work, other scripts, and ten times it.

    python benchmarks/whole_scan.py [--recording scan180.mcap] [--parts speed,peers,growth]

Without a recording it simulates three minutes at the paper's rates (30 Hz 1280x720 JPEG, 24,000
points at 10 Hz, 200 Hz poses), which takes a quarter of an hour. Every build runs in a process of
its own, so that memory is each build's own. ``growth`` builds one minute of the recording and the
same minute ten times over. Times are of the clock: run it on a quiet machine.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec

sys.path.insert(0, str(Path(__file__).resolve().parent))
from codec_work import codec_seconds
from long_scan import repeat_scan

SCAN_SECONDS = 180.0
MB = 1e6


def main() -> None:
    """Parse, run the parts, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--recording", type=Path, help="use this one and simulate none")
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--parts", default="speed,peers,growth")
    parser.add_argument("--peer-frames", type=int, default=150)
    parser.add_argument("--times", type=int, default=10, help="how often growth repeats the minute")
    parser.add_argument("--scratch", type=Path, help="a folder on the disk to be measured")
    parser.add_argument("--child", nargs=4, help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.child:
        _child(*arguments.child)
        return
    with tempfile.TemporaryDirectory(dir=arguments.scratch) as scratch:
        folder = Path(scratch)
        source = arguments.recording or _simulate(folder / "scan.mcap")
        _build(source, "demo", folder / "warm", workers=1)  # compiles the kernels, once a machine
        for part in arguments.parts.split(","):
            {"speed": _speed, "peers": _peers, "growth": _growth}[part](source, folder, arguments)


def _simulate(path: Path) -> Path:
    print(f"simulating {SCAN_SECONDS:g} s at the paper's rates ...", flush=True)
    write_recording(path, ScanSpec(seconds=SCAN_SECONDS, image_rate_hz=30.0, range_noise_m=0.01))
    return path


def _speed(source: Path, folder: Path, arguments: argparse.Namespace) -> None:
    workers = arguments.workers
    recording = open_recording(source)
    scan_s = float(recording.trajectory.end_ns - recording.trajectory.start_ns) / 1e9
    every = _build(source, "250k-all", folder / "all", workers=workers)
    kept = _build(source, "250k", folder / "kept", workers=workers)
    codec_s = codec_seconds(
        source, "250k-all", folder / "all" / "bridges" / "bench", workers=workers
    )
    _line(
        f"250k-all, {every['frames']} frames, {workers} workers: {every['seconds']:.1f} s;",
        "the scan lasted",
        scan_s / every["seconds"],
        "times as long",
        at_least=2.0,
    )
    _line(
        f"codec work alone on {workers} cores {codec_s:.1f} s;",
        "250k-all takes",
        every["seconds"] / codec_s,
        "times as long",
        at_most=1.25,
    )
    share = every["images"] / kept["frames"]
    faster = every["seconds"] / kept["seconds"]
    _line(
        f"250k, {kept['frames']} of {kept['images']} images: {kept['seconds']:.1f} s;",
        f"250k-all takes {faster:.2f} times as long, that is", faster / share,
        "of images / kept frames", at_least=0.75,
    )  # fmt: skip


def _peers(source: Path, folder: Path, arguments: argparse.Namespace) -> None:
    from peer_build import build_by_script, by_numpy, by_open3d, valid_share

    if hasattr(os, "sched_setaffinity"):
        before = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {min(before)})
    part = folder / "part.mcap"
    frames = arguments.peer_frames
    repeat_scan(source, part, times=1, seconds=2.5 + frames / 30)
    ours = _build(part, "250k-all", folder / "ours", workers=1)
    mine_ms = 1e3 * ours["seconds"] / ours["frames"]
    print(f"whole build, 250k-all, one core: ours {mine_ms:.1f} ms a frame ({ours['frames']})")
    for name, render in (("numpy minimum.at", by_numpy), ("Open3D", by_open3d)):
        started = time.perf_counter()
        out = folder / name.split()[0]
        try:
            made = build_by_script(
                open_recording(part), load_recipe("250k-all"), out, render, frames=frames
            )
        except ImportError:
            print(f"  a script with {name}: not installed, so not compared")
            continue
        peer_ms = 1e3 * (time.perf_counter() - started) / made
        print(
            f"  a script with {name}: {peer_ms:.1f} ms a frame ({made}), {peer_ms / mine_ms:.2f} "
            f"times ours; {valid_share(out):.1%} of its pixels have depth"
        )
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, before)


def _growth(source: Path, folder: Path, arguments: argparse.Namespace) -> None:
    times = arguments.times
    minute, long = folder / "minute.mcap", folder / "long.mcap"
    repeat_scan(source, minute, times=1, seconds=60)
    repeat_scan(source, long, times=times, seconds=60)
    short_build = _build(minute, "250k-all", folder / "short", workers=arguments.workers)
    long_build = _build(long, "250k-all", folder / "long", workers=arguments.workers)
    frames = long_build["frames"] / short_build["frames"]
    _line(
        f"{short_build['frames']} frames {short_build['seconds']:.1f} s, {long_build['frames']} "
        f"frames {long_build['seconds']:.1f} s;",
        f"{frames:.2f} times the frames take", long_build["seconds"] / short_build["seconds"],
        "times as long", at_most=1.05 * frames,
    )  # fmt: skip
    small, large = short_build["worker_bytes"], long_build["worker_bytes"]
    _line(
        f"peak memory of a worker {small / MB:.0f} MB and {large / MB:.0f} MB;",
        "the long scan takes", large / small, "times as much", at_most=1.1,
    )  # fmt: skip
    _line(
        f"the parent's {short_build['parent_bytes'] / MB:.0f} and "
        f"{long_build['parent_bytes'] / MB:.0f} MB;",
        "a worker needs", large / MB, "MB", at_most=700,
    )  # fmt: skip


def _line(
    before: str,
    words: str,
    figure: float,
    after: str,
    *,
    at_least: float | None = None,
    at_most: float | None = None,
) -> None:
    met = (at_least is None or figure >= at_least) and (at_most is None or figure <= at_most)
    limit = f"at least {at_least:g}" if at_least is not None else f"at most {at_most:g}"
    verdict = "met" if met else "MISSED"
    print(f"{before} {words} {figure:.2f} {after} (target {verdict}: {limit})", flush=True)


def _build(source: Path, recipe: str, out: Path, *, workers: int) -> dict[str, float]:
    command = [sys.executable, __file__, "--child", str(source), recipe, str(out), str(workers)]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    result: dict[str, float] = json.loads(done.stdout.splitlines()[-1])
    return result


def _child(source: str, recipe: str, out: str, workers: str) -> None:
    started = time.perf_counter()
    report = build_bridge(
        open_recording(source),
        load_recipe(recipe),
        Path(out),
        BridgeInfo("bench"),
        BuildOptions(workers=int(workers)),
    )
    seconds = time.perf_counter() - started
    # On Linux a child's peak begins with what its parent had when it was started: the figure of a
    # worker is too large rather than too small.
    per_unit = 1 if sys.platform == "darwin" else 1024
    peaks = {
        name: resource.getrusage(who).ru_maxrss * per_unit
        for name, who in (
            ("parent_bytes", resource.RUSAGE_SELF),
            ("worker_bytes", resource.RUSAGE_CHILDREN),
        )
    }
    counts = report.counts
    frames = {"frames": counts.frames_kept, "images": counts.images_seen}
    print(json.dumps({"seconds": seconds} | frames | peaks))


if __name__ == "__main__":
    main()
