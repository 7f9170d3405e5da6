"""A build from and into object storage as a program of its own, for tests that kill it.

python remote_build.py SOURCE OUT WORKERS
"""

from __future__ import annotations

import sys

from civil_rgbd.builder import plan
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.bridge import BridgeInfo
from civil_rgbd.storage.places import place_of

if __name__ == "__main__":
    plan.CHUNK_FRAMES = 2
    recording = open_recording(sys.argv[1])
    print("started", flush=True)  # noqa: T201  # from here on it is killed
    build_bridge(
        recording,
        load_recipe("250k", ["accumulate.points=8000"]),
        place_of(sys.argv[2]),
        BridgeInfo("B9", licence="CC0-1.0"),
        BuildOptions(workers=int(sys.argv[3])),
    )
