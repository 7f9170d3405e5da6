"""From LiDAR and IMU to a trajectory: write the bag, run the engine, judge its answer."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.errors import OdometryError
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.odometry.engines import END, Engine, EngineFiles
from civil_rgbd.odometry.imu import SteadyImu, steady_imu
from civil_rgbd.odometry.input_bag import WrittenScans, write_input
from civil_rgbd.odometry.processes import run_program
from civil_rgbd.odometry.settings import settings_text
from civil_rgbd.odometry.tum import read_engine_poses

Step = Callable[[str, float, float], object]
"""Called with what is going on, how far it is, and how far it goes (0: nobody knows)."""

_ROUNDING_NS: Final = 2_000
"""Engines hold and print seconds as float64, or with six digits."""
_LATE_START_NS: Final = 5 * NS_PER_S
_EARLY_END_NS: Final = NS_PER_S
_LEAST_SHARE: Final = 0.5


@dataclass(frozen=True, slots=True, eq=False)
class PoseEstimate:
    """What an engine found.

    Attributes:
        trajectory: ``T_map_imu``; each pose holds at its own stamp, LiDAR clock.
        scan_indices: (P,) int64, the recording's scan that each pose belongs to.
        imu: as the engine was given it.
        dropped: scans that the engine was not given, by reason.
        remarks: what was odd, in words.
    """

    trajectory: Trajectory
    scan_indices: NDArray[np.int64]
    imu: SteadyImu
    dropped: dict[str, int]
    remarks: tuple[str, ...]


def estimate_poses(
    recording: MotionRecording,
    engine: Engine,
    program: Path,
    *,
    T_imu_lidar: NDArray[np.float64],
    scratch: Path,
    timeout_s: float,
    on_step: Step = lambda _what, _done, _total: None,
) -> PoseEstimate:
    """Run an engine over a recording.

    Args:
        recording: LiDAR and IMU.
        engine: which one.
        program: where it is installed.
        T_imu_lidar: (4, 4), LiDAR frame to IMU frame.
        scratch: an empty folder; the bag (as large as the LiDAR's part of the recording), the
            settings and the engine's files go there.
        timeout_s: the engine is stopped after this.
        on_step: told how far it is.

    Raises:
        RecordingError: LiDAR or IMU do not fit together.
        OdometryError: the engine fails, or its answer cannot be right.
    """
    imu = steady_imu(recording.imu, where=recording.name)
    files = EngineFiles(scratch / "in" / "scan.bag", scratch / "settings.yaml", scratch / "out")
    files.bag.parent.mkdir(parents=True)
    files.out.mkdir()
    files.settings.write_text(settings_text(engine, T_imu_lidar), encoding="utf-8")
    done = 0

    def on_scan(count: int, total: int) -> None:
        nonlocal done
        done += count
        on_step("reading scans", done, total)

    scans = write_input(files.bag, recording, imu, engine, on_progress=on_scan)
    words = run_program(
        [program, *engine.arguments(files)],
        what=f"{engine.name} {engine.version}",
        folder=scratch,
        timeout_s=timeout_s,
        fix="try another engine with --engine; --keep FOLDER keeps its input and settings",
        on_tick=lambda seconds: on_step(f"{engine.name} is running", seconds, 0),
    )
    (scratch / "engine.log").write_text(words + "\n", encoding="utf-8")
    answer = read_engine_poses(_one_answer(files.out, engine, words))
    trajectory, found = _at_their_instants(answer, scans, engine)
    remarks = (*imu.remarks, *_judge(trajectory, found, scans, engine))
    return PoseEstimate(trajectory, scans.indices[found], imu, scans.dropped, remarks)


def _one_answer(out: Path, engine: Engine, words: str) -> Path:
    found = sorted(path for path in out.rglob("*") if path.name.endswith(("tum.txt", ".tum")))
    if len(found) != 1:
        raise OdometryError(
            f"{engine.name} ended well but left {len(found)} trajectories; "
            f"its last words:\n{words}",
            where=out.name,
            fix="try another engine with --engine; --keep FOLDER keeps what it wrote",
        )
    return found[0]


def _at_their_instants(
    answer: Trajectory, scans: WrittenScans, engine: Engine
) -> tuple[Trajectory, NDArray[np.intp]]:
    """Give each pose the stamp at which it holds; tell which written scan it belongs to."""
    # Times of a scan that holds the stamp: an engine may leave out the first and last returns.
    found = np.searchsorted(scans.ends_ns + _ROUNDING_NS, answer.stamps_ns)
    found = np.minimum(found, len(scans.ends_ns) - 1)
    before_start = answer.stamps_ns < scans.starts_ns[found] - _ROUNDING_NS
    after_end = answer.stamps_ns > scans.ends_ns[found] + _ROUNDING_NS
    if (before_start | after_end).any() or (np.diff(found) <= 0).any():
        raise OdometryError(
            f"the poses of {engine.name} do not belong to the scans that it was given: "
            f"{int((before_start | after_end).sum())} of {len(found)} lie outside of all, "
            f"{int((np.diff(found) <= 0).sum())} share one with another",
            where=engine.name,
            fix="try another engine with --engine; --keep FOLDER keeps its input and its answer",
        )
    named = (scans.ends_ns if engine.stamps_name == END else scans.starts_ns)[found]
    hold = (scans.ends_ns if engine.poses_hold_at == END else scans.starts_ns)[found]
    off = answer.stamps_ns - named
    # An engine that leaves out the last returns ends its scans a little earlier: it knows better.
    stamps = hold + np.where(np.abs(off) <= _ROUNDING_NS, 0, off)
    moved = Trajectory(stamps, answer.translations_m, answer.quaternions_xyzw)
    return moved, found


def _judge(
    trajectory: Trajectory, found: NDArray[np.intp], scans: WrittenScans, engine: Engine
) -> list[str]:
    first_ns, last_ns = int(scans.starts_ns[0]), int(scans.ends_ns[-1])
    late_ns, early_ns = trajectory.start_ns - first_ns, last_ns - trajectory.end_ns
    share = len(found) / len(scans.indices)
    if late_ns > _LATE_START_NS or early_ns > _EARLY_END_NS or share < _LEAST_SHARE:
        raise OdometryError(
            f"the poses of {engine.name} do not cover the scan: they begin {late_ns / 1e9:.2f} s "
            f"after it, end {early_ns / 1e9:.2f} s before it does, and {share:.0%} of the scans "
            "have one",
            where=engine.name,
            fix="stand still for two seconds at the start, and record both sensors to the end; or "
            "try another engine with --engine",
        )
    missing = int(found[-1] - found[0]) + 1 - len(found)
    remarks = [
        (
            f"poses begin {late_ns / 1e9:.2f} s after the first point and end "
            f"{early_ns / 1e9:.2f} s before the last: what lies outside has none"
        )
    ]
    if missing:
        remarks.append(f"{engine.name} gave no pose for {missing} scans in between")
    return remarks
