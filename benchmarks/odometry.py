"""Odometry on simulated walks with known truth: how far off it is, and whether its quality says so.

``python benchmarks/odometry.py [scored|everything|set] [--engine NAME] [--environment FOLDER]``

The engine is installed first with ``civil-rgbd poses ... --create-environment``. Every second of a
walk is *bad* when the motion over it is off by more than 10 cm or 1 degree, *good* when it is off
by less than 3 cm and 0.3 degrees; it is *flagged* when a pose of it has a quality below the limit.
The limit was set on the scenes of ``set``; those of ``scored`` differ in shape,
height, walk and noise. ATE: root mean square after the best rotation and translation, no scale.

Measured on 22 November 2026, 60 s walks, 12,000 points a scan, one core:

============================  ============  ===========  =============  ==========
scored scene                  engine        ATE          bad, flagged   good, flagged
============================  ============  ===========  =============  ==========
girders                       genz-lio      0.8 cm       1 of 1         0 of 57
girders                       se3-lio       1.3 cm       0 of 0         0 of 52
girders 2                     genz-lio      0.9 cm       1 of 1         0 of 57
girders 2                     se3-lio       1.2 cm       0 of 0         1 of 57
soffit                        genz-lio      31 m         59 of 59       0 of 0
soffit                        se3-lio       7.4 m        58 of 58       0 of 0
soffit 2                      genz-lio      15 m         59 of 59       0 of 0
soffit 2                      se3-lio       14 m         57 of 57       0 of 0
tunnel                        genz-lio      716 m        59 of 59       0 of 0
tunnel                        se3-lio       31 m         56 of 56       0 of 0
tunnel 2                      genz-lio      7.7 m        59 of 59       0 of 0
tunnel 2                      se3-lio       3.4 m        42 of 42       0 of 10
slab on piers (everything)    genz-lio      1.1 m        17 of 17       0 of 31
slab on piers                 se3-lio       19 cm        7 of 7         8 of 32
ribbed, then smooth           genz-lio      1.4 m        23 of 23       0 of 25
ribbed, then smooth           se3-lio       3.6 m        33 of 33       1 of 17
============================  ============  ===========  =============  ==========

Girders, soffits and tunnels together: 0 of 114 good seconds are flagged (genz-lio), 1 of 119
(se3-lio, 0.8 %). With ``everything``: 0 of 170 and 10 of 168. The ten scenes of
``set``: 319 of 319 bad seconds and 2 of 220 good ones (genz-lio), 294 of 294 and 18 of 219.
"""

from __future__ import annotations

import argparse
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import (
    compose,
    inverse,
    matrix_from_quaternion,
    transform_from,
)
from civil_rgbd.odometry.engines import ENGINES, Engine
from civil_rgbd.odometry.environment import environment_folder, find_program
from civil_rgbd.odometry.poses import JudgedPoses, judged_poses
from civil_rgbd.odometry.quality import LOW_QUALITY
from civil_rgbd.resources import cache_folder

sys.path.insert(0, str(Path(__file__).parent))
from odometry_scenes import Trial, trials

MAIN_SCENES = ("girders", "soffit", "tunnel")
"""What the names of the trials begin with that count unless ``everything`` is asked for."""
CURVE = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.8, 1.0, 1.5, 2.0)
BAD_M, BAD_DEG, GOOD_M, GOOD_DEG = 0.10, 1.0, 0.03, 0.3
POSES_A_SECOND = 10


@dataclass(frozen=True)
class Score:
    """One walk: absolute error in metres, and the worst quality in each bad and good second."""

    name: str
    ate_m: float
    largest_m: float
    bad: NDArray[np.float64]
    good: NDArray[np.float64]

    def to_text(self) -> str:
        """Say it in one line."""
        return (
            f"{self.name:28s} ATE {self.ate_m:8.3f} m, largest {self.largest_m:8.3f} m; "
            f"{flagged_text(self.bad, self.good, LOW_QUALITY)}"
        )


def flagged_text(bad: NDArray[np.float64], good: NDArray[np.float64], limit: float) -> str:
    """Count the bad and good seconds whose worst quality lies below a limit."""
    caught, wronged = int((bad < limit).sum()), int((good < limit).sum())
    return f"bad seconds flagged {caught}/{len(bad)}, good ones flagged {wronged}/{len(good)}"


def score(trial: Trial, found: JudgedPoses) -> Score:
    """Compare poses with the truth."""
    path = found.trajectory
    assert path.quality is not None  # noqa: S101  # judged
    places, turns = trial.truth(path.stamps_ns)
    T_estimate = transform_from(matrix_from_quaternion(path.quaternions_xyzw), path.translations_m)
    T_truth = transform_from(matrix_from_quaternion(turns), places)
    n = POSES_A_SECOND
    error = compose(
        inverse(compose(inverse(T_truth[:-n]), T_truth[n:])),
        compose(inverse(T_estimate[:-n]), T_estimate[n:]),
    )[::n]
    off_m = np.linalg.norm(error[:, :3, 3], axis=1)
    cosine = (np.trace(error[:, :3, :3], axis1=1, axis2=2) - 1) / 2
    off_deg = np.degrees(np.arccos(cosine.clip(-1, 1)))
    bad = (off_m > BAD_M) | (off_deg > BAD_DEG)
    good = (off_m < GOOD_M) & (off_deg < GOOD_DEG)
    worst = np.array([path.quality[k * n : k * n + n + 1].min() for k in range(len(off_m))])
    distance = aligned_distance(path.translations_m, places)
    return Score(
        trial.name,
        float(np.sqrt((distance**2).mean())),
        float(distance.max()),
        worst[bad],
        worst[good],
    )


def aligned_distance(
    estimate_m: NDArray[np.float64], truth_m: NDArray[np.float64]
) -> NDArray[np.float64]:
    """Return distances (P,) after the best rotation and translation, without scale (Horn 1987)."""
    a, b = estimate_m - estimate_m.mean(axis=0), truth_m - truth_m.mean(axis=0)
    u, _, vt = np.linalg.svd(b.T @ a)
    R = u @ np.diag([1.0, 1.0, np.linalg.det(u @ vt)]) @ vt
    distance: NDArray[np.float64] = np.linalg.norm(a @ R.T - b, axis=1)
    return distance


def walk(trial: Trial, engine: Engine, program: Path) -> Score:
    """Run one trial."""
    started = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        found = judged_poses(trial, engine, program, scratch=Path(folder))
    result = score(trial, found)
    print(f"{result.to_text()}  ({time.monotonic() - started:.0f} s)", flush=True)
    for stretch in found.weak[:3]:
        print(f"    {stretch.to_text()}")
    return result


def main() -> None:
    """Run the trials and sum up."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else "")
    parser.add_argument("--engine", default="genz-lio", choices=sorted(ENGINES))
    parser.add_argument(
        "part", nargs="?", default="scored", choices=["scored", "everything", "set"]
    )
    parser.add_argument("--environment", type=Path)
    parser.add_argument("--seconds", type=float, default=60.0)
    given = parser.parse_args()
    engine = ENGINES[given.engine]
    folder = given.environment or environment_folder(cache_folder(), engine)
    program = find_program(engine, folder)
    chosen = [
        trial
        for trial in trials("set" if given.part == "set" else "scored", seconds=given.seconds)
        if given.part != "scored" or trial.name.startswith(MAIN_SCENES)
    ]
    scores = [walk(trial, engine, program) for trial in chosen]
    bad = np.concatenate([one.bad for one in scores])
    good = np.concatenate([one.good for one in scores])
    print(f"{engine.name} {engine.version}, {given.part}, all together, with quality below")
    for limit in CURVE:
        print(f"    {limit:.1f}: {flagged_text(bad, good, limit)}")


if __name__ == "__main__":
    main()
