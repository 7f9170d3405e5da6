"""Frames per second of a build, beside the codec work that no build can avoid.

    python benchmarks/build.py [--seconds 30] [--recipe 250k-all]

Simulates a scan (at the sensors' full rates), builds it in this process on one core, then does on
the same frames nothing but: decode the raw image, undistort and resize it, encode it, decode it
again for its pixel hash, encode the EXR, hash files and pixels. Prints the ratio of the two times.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec

sys.path.insert(0, str(Path(__file__).resolve().parent))
from codec_work import codec_seconds

TARGET = 1.25


def main() -> None:
    """Parse, run, print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=15.0, help="length of the scan")
    parser.add_argument("--recipe", default="250k-all")
    parser.add_argument("--recording", type=Path, help="build this one and simulate none")
    parser.add_argument("--repeat", type=int, default=3, help="the best of so many is taken")
    arguments = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):
        os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        source = arguments.recording or _simulate(folder / "scan.mcap", arguments.seconds)
        recipe = load_recipe(arguments.recipe)
        _warm_up(source, recipe, folder)
        build_s, codec_s = [], []
        for turn in range(arguments.repeat):
            started = time.perf_counter()
            recording = open_recording(source)
            opened = time.perf_counter()
            report = build_bridge(
                recording, recipe, folder / f"out{turn}", BridgeInfo("bench"), BuildOptions()
            )
            build_s.append(time.perf_counter() - started)
            codec_s.append(codec_seconds(source, recipe.name, report.folder))
        frames = report.counts.frames_kept
        print(f"{frames} frames, recipe {recipe.name}, one core, best of {arguments.repeat}")
        print(f"opening (index, sha256)   {1e3 * (opened - started) / frames:8.2f} ms a frame")
        print(f"build, opening included   {1e3 * min(build_s) / frames:8.2f} ms a frame")
        print(f"unavoidable codec work    {1e3 * min(codec_s) / frames:8.2f} ms a frame")
        print(f"ratio {min(build_s) / min(codec_s):.3f} (target: at most {TARGET})")


def _simulate(path: Path, seconds: float) -> Path:
    print(f"simulating {seconds:g} s at 30 Hz 1280x720 and 240,000 points/s ...")
    write_recording(path, ScanSpec(seconds=seconds, image_rate_hz=30.0, range_noise_m=0.01))
    return path


def _warm_up(source: Path, recipe: Recipe, folder: Path) -> None:
    # The kernels are compiled once a machine, not once a build.
    build_bridge(
        open_recording(source), recipe, folder / "warm", BridgeInfo("warm"), BuildOptions()
    )


if __name__ == "__main__":
    main()
