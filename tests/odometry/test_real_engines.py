"""The engines themselves, where somebody has installed them: right, and at the instant we state."""

from __future__ import annotations

import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.errors import MissingExtraError
from civil_rgbd.odometry.engines import ENGINES
from civil_rgbd.odometry.environment import environment_folder, find_program
from civil_rgbd.odometry.poses import judged_poses
from civil_rgbd.resources import cache_folder

BENCHMARKS = Path(__file__).resolve().parents[2] / "benchmarks"

pytestmark = pytest.mark.slow


def benchmark(name: str) -> ModuleType:
    spec = importlib.util.spec_from_file_location(name, BENCHMARKS / f"{name}.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module  # dataclasses look their module up
    spec.loader.exec_module(module)
    return module


def program_of(name: str) -> Path:
    engine = ENGINES[name]
    try:
        return find_program(engine, environment_folder(cache_folder(), engine))
    except MissingExtraError as error:
        pytest.skip(f"{name} is not installed here: {error.fix}")


@pytest.mark.parametrize("name", ["genz-lio", "se3-lio"])
def test_among_girders_poses_are_right_and_hold_at_their_stamps(name: str, tmp_path: Path) -> None:
    program = program_of(name)
    scenes, scoring = benchmark("odometry_scenes"), benchmark("odometry")
    (trial,) = (t for t in scenes.trials("scored", seconds=20) if t.name == "girders")

    found = judged_poses(trial, ENGINES[name], program, scratch=tmp_path)

    path = found.trajectory

    def off_m(shift_ms: int) -> float:
        places, _ = trial.truth(path.stamps_ns + shift_ms * 1_000_000)
        distance: NDArray[np.float64] = scoring.aligned_distance(path.translations_m, places)
        return float(np.sqrt((distance**2).mean()))

    assert off_m(0) < 0.03
    assert off_m(0) < min(off_m(-20), off_m(20))
    # An engine may jolt before it has found its feet, and then that is no false alarm.
    assert all(stretch.to_s < 1.0 for stretch in found.weak)
