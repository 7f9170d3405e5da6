"""Same pixels everywhere: the default processor against poorer ones, each in its own process."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from civil_rgbd.format.reader import read_bridge

HERE = Path(__file__).resolve().parent


def dispatched_by_numpy() -> str:
    """Processor features that this numpy has kernels for, and this processor has."""
    internals = np._core._multiarray_umath  # type: ignore[attr-defined]  # numpy tells it nowhere else
    return " ".join(f for f in internals.__cpu_dispatch__ if internals.__cpu_features__.get(f))


def dispatched_by_opencv() -> str:
    """Processor features that this OpenCV has kernels for: marked by a star, absent ones by `?`."""
    features = cv2.getCPUFeaturesLine().split()
    return ",".join(name.strip("*?") for name in features if name.startswith("*"))


POORER = {
    "openblas": {"OPENBLAS_CORETYPE": "Prescott"},
    "numpy": {"NPY_DISABLE_CPU_FEATURES": dispatched_by_numpy()},
    "opencv": {
        "OPENCV_CPU_DISABLE": dispatched_by_opencv(),
        "JSIMD_FORCENONE": "1",
    },
    "numba": {"NUMBA_CPU_NAME": "generic"},
}
POORER["all at once"] = {name: value for one in POORER.values() for name, value in one.items()}


def environment(cache: Path, **more: str) -> dict[str, str]:
    """This process's, without what a developer may have set, and with its own kernel cache."""
    ours = {name: value for name, value in os.environ.items() if not name.startswith("NUMBA_")}
    return ours | {"NUMBA_CACHE_DIR": str(cache), "PYTHONWARNINGS": "default"} | more


def printed(arguments: list[str], env: dict[str, str]) -> str:
    done = subprocess.run(
        [sys.executable, *arguments], env=env, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def by_default(tmp_path_factory: pytest.TempPathFactory) -> dict[str, list[object]]:
    env = environment(tmp_path_factory.mktemp("kernels"))
    hashes: dict[str, list[object]] = json.loads(printed([str(HERE / "pixel_hashes.py")], env))
    return hashes


@pytest.mark.slow
@pytest.mark.parametrize("poorer", list(POORER))
def test_a_poorer_processor_renders_the_same_pixels(
    poorer: str, by_default: dict[str, list[object]], tmp_path: Path
) -> None:
    env = environment(tmp_path, **POORER[poorer])

    found = json.loads(printed([str(HERE / "pixel_hashes.py")], env))

    assert len(found) == 36
    assert {name for name in found if found[name] != by_default[name]} == set()


@pytest.mark.slow
def test_the_restrictions_are_real(tmp_path: Path) -> None:
    """Otherwise the tests around this one would compare a processor with itself."""
    code = (
        "import cv2, numba, numpy\n"
        "f = numpy._core._multiarray_umath\n"
        "print(sorted(x for x in f.__cpu_dispatch__ if f.__cpu_features__.get(x)))\n"
        "print([x for x in cv2.getCPUFeaturesLine().split() if x[0] == '*' and x[-1] != '?'])\n"
        "print(numba.config.CPU_NAME)"
    )

    poor = printed(["-c", code], environment(tmp_path, **POORER["all at once"])).splitlines()

    assert poor == ["[]", "[]", "generic"]


@pytest.fixture(scope="module")
def raw_recording(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A simulated scan as MCAP: simulated once, since only what is built from it must agree."""
    from civil_rgbd.simulator.recorder import write_recording
    from civil_rgbd.simulator.spec import ScanSpec

    path = tmp_path_factory.mktemp("raw") / "scan.mcap"
    write_recording(path, ScanSpec(seconds=3.0, image_scale=0.25, point_rate_hz=12_000))
    return path


def built_hashes(raw: Path, out: Path, env: dict[str, str]) -> list[tuple[object, ...]]:
    arguments = ["build", "--recipe", "250k", "--set", "accumulate.points=10000"]
    printed(["-m", "civil_rgbd", *arguments, "--out", str(out), "--bridge", "B1", str(raw)], env)
    bridge = read_bridge(out / "bridges" / "B1")
    return [(row.frame_id, row.rgb_pixel_sha256, row.depth_pixel_sha256) for row in bridge.rows]


@pytest.mark.slow
def test_a_poorer_processor_builds_the_same_bridge(raw_recording: Path, tmp_path: Path) -> None:
    rich = built_hashes(raw_recording, tmp_path / "rich", environment(tmp_path / "kernels"))
    poor = built_hashes(
        raw_recording,
        tmp_path / "poor",
        environment(tmp_path / "poor_kernels", **POORER["all at once"]),
    )

    assert len(rich) > 3
    assert poor == rich
