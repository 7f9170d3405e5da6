"""A build of the tests' scan as a program of its own, for tests that kill it.

    python one_build.py OUT EXECUTOR WORKERS [SHARE]

``parts`` as the executor makes the shares 1/3 to 3/3, one after the other, and joins them.
"""

from __future__ import annotations

import sys
from pathlib import Path

from civil_rgbd.builder import plan
from civil_rgbd.builder.bridge_build import Order
from civil_rgbd.builder.finish import finish_bridges
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.run import BuildOptions, build_bridges, only_report
from civil_rgbd.builder.shares import Share
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec

SPEC = ScanSpec(seconds=3.0, image_scale=0.1, point_rate_hz=12_000, image_rate_hz=15.0)
SETTINGS = ("accumulate.points=8000",)


def build(out: Path, executor: str, workers: int, share: Share | None = None) -> None:
    """Build, with chunks so small that there are many."""
    plan.CHUNK_FRAMES = 3
    options = BuildOptions(workers=workers, executor=executor, share=share)
    order = Order(BridgeInfo("B9", licence="CC0-1.0"), open=lambda: SimulatedRecording(SPEC))
    only_report(build_bridges([order], load_recipe("250k", SETTINGS), out, options))


if __name__ == "__main__":
    print("started", flush=True)  # noqa: T201  # imports are done: from here on it is killed
    where, how, many = Path(sys.argv[1]), sys.argv[2], int(sys.argv[3])
    if how == "parts":
        for number in (1, 2, 3):
            build(where, "serial", 1, Share(number, 3))
        for outcome in finish_bridges(where).outcomes:
            if outcome.error:
                raise outcome.error
    else:
        build(where, how, many)
