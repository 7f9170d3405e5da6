"""Every processor simulates the same bytes: the default one against a poorer one."""

from __future__ import annotations

import os
import subprocess
import sys

import cv2
import numpy as np
import pytest

PRINT_HASH = """
import hashlib
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec
recording = SimulatedRecording(ScanSpec(seconds=3, image_scale=0.5, range_noise_m=0.01))
digest = hashlib.sha256(recording.trajectory.quaternions_xyzw.tobytes())
for index in (0, 10, 20):
    digest.update(recording.read_image(index).rgb.tobytes())
    digest.update(recording.read_scan(index).points.tobytes())
print(digest.hexdigest())
"""


def _hash_with(**environment: str) -> str:
    done = subprocess.run(
        [sys.executable, "-W", "ignore", "-c", PRINT_HASH],
        env={**os.environ, **environment},
        capture_output=True,
        text=True,
        check=True,
    )
    return done.stdout


@pytest.mark.slow
def test_a_poorer_processor_simulates_the_same_bytes() -> None:
    internals = np._core._multiarray_umath  # type: ignore[attr-defined]  # numpy tells it nowhere else
    numpy_has = [f for f in internals.__cpu_dispatch__ if internals.__cpu_features__.get(f)]
    opencv_has = [f.strip("*?") for f in cv2.getCPUFeaturesLine().split() if f.startswith("*")]

    poorer = _hash_with(
        OPENBLAS_CORETYPE="Prescott",
        NPY_DISABLE_CPU_FEATURES=" ".join(numpy_has),
        OPENCV_CPU_DISABLE=",".join(opencv_has),
        JSIMD_FORCENONE="1",
        NUMBA_CPU_NAME="generic",
    )

    assert _hash_with() == poorer
