"""A build's memory does not grow with the recording."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec

PEAK_OF_A_BUILD = """
import resource, sys
from pathlib import Path
from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.bridge import BridgeInfo
source, out = Path(sys.argv[1]), Path(sys.argv[2])
recipe = load_recipe("250k-all", ["accumulate.points=30000"])
build_bridge(open_recording(source), recipe, out, BridgeInfo("x"), BuildOptions())
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="Windows does not tell a process's peak")
def test_three_times_the_recording_takes_the_same_memory(tmp_path: Path) -> None:
    peaks_kib = {}
    for seconds in (12.0, 36.0):  # in both, more chunks than a reader keeps unpacked
        source = tmp_path / f"{seconds:g}.mcap"
        spec = ScanSpec(seconds=seconds, image_scale=0.1, point_rate_hz=120_000)
        write_recording(source, spec)
        peak = subprocess.run(
            [sys.executable, "-c", PEAK_OF_A_BUILD, str(source), str(tmp_path / f"{seconds:g}")],
            capture_output=True,
            check=True,
            text=True,
        )
        peaks_kib[seconds] = int(peak.stdout)

    assert peaks_kib[36.0] < 1.1 * peaks_kib[12.0]
