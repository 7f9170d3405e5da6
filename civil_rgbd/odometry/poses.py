"""The whole of it: poses by an engine, the quality of each, and what to say about them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.motion import MotionRecording
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.odometry.engines import Engine
from civil_rgbd.odometry.input_bag import returns
from civil_rgbd.odometry.mount import horizontal_view_deg, lidar_on_imu
from civil_rgbd.odometry.quality import (
    LOW_QUALITY,
    Limits,
    PoseMeasures,
    measure_poses,
    quality_of,
)
from civil_rgbd.odometry.run import Step, estimate_poses
from civil_rgbd.odometry.words import WeakStretch, carried_stretches, weak_stretches

_LEAST_TIMEOUT_S, _TIMEOUT_FACTOR = 600.0, 30.0
_ALL_ROUND_DEG: Final = 270.0


@dataclass(frozen=True, slots=True, eq=False)
class JudgedPoses:
    """Poses with quality.

    Attributes:
        trajectory: ``T_map_imu`` with quality; each pose holds at its own stamp, LiDAR clock.
        measures: what the quality was made from.
        weak: stretches that cannot be trusted.
        carried: stretches where surfaces give out, yet the IMU carries the poses.
        engine: that found the poses.
        remarks: what was odd or assumed, in words.
    """

    trajectory: Trajectory
    measures: PoseMeasures
    weak: tuple[WeakStretch, ...]
    carried: tuple[WeakStretch, ...]
    engine: Engine
    remarks: tuple[str, ...]

    @property
    def header(self) -> tuple[str, ...]:
        """What the pose file says of itself."""
        return (
            f"{self.engine.name} {self.engine.version}: poses of the imu in its map (T_map_imu)",
            (
                f"each pose holds at its own stamp, which is the {self.engine.poses_hold_at} of a "
                "scan; LiDAR clock"
            ),
        )

    def details(self) -> dict[str, NDArray[np.float64]]:
        """Return the measures behind the quality, column by column."""
        return {
            "drift_m": self.measures.drift_m,
            "drift_rad": self.measures.drift_rad,
            "held_by": self.measures.held_by[:, 0],
            "residual_m": self.measures.residual_m,
            "overlap": self.measures.overlap,
            "speed_m_s": self.measures.speed_m_s,
            "turn_rad_s": self.measures.turn_rad_s,
        }

    def to_text(self, file: str) -> str:
        """Say what was found."""
        path = self.trajectory
        seconds = (path.end_ns - path.start_ns) / NS_PER_S
        steps = np.diff(path.translations_m, axis=0)
        length_m = float(np.sqrt((steps**2).sum(axis=1)).sum())
        quality = self.trajectory.quality
        assert quality is not None  # noqa: S101  # it was judged: the type cannot say so
        low = int((quality < LOW_QUALITY).sum())
        lines = [
            (
                f"{file}: {len(path.stamps_ns)} poses of the IMU over {seconds:.1f} s, "
                f"{length_m:.1f} m, by {self.engine.name} {self.engine.version}"
            ),
            *(f"  note: {remark}" for remark in self.remarks),
        ]
        if self.weak:
            lines.append(
                f"  {low} of {len(quality)} poses cannot be trusted, whatever the engine says:"
            )
            lines += [f"    {stretch.to_text()}" for stretch in self.weak]
            lines.append(f"  leave them out: --set poses.min_quality={LOW_QUALITY}")
        elif not self.carried:
            lines.append("  the surfaces hold every pose")
        if self.carried:
            lines.append("  geometry gives out, but not for long, and the IMU carries the poses:")
            lines += [f"    {stretch.to_text()}" for stretch in self.carried]
        lines.append(f"  next: civil-rgbd build --trajectory {file} ...")
        return "\n".join(lines)


def judged_poses(
    recording: MotionRecording,
    engine: Engine,
    program: Path,
    *,
    scratch: Path,
    timeout_s: float | None = None,
    limits: Limits | None = None,
    on_step: Step = lambda _what, _done, _total: None,
) -> JudgedPoses:
    """Compute poses and judge them.

    Args:
        recording: LiDAR and IMU.
        engine: which one.
        program: where it is installed.
        scratch: an empty folder, with room for the LiDAR's part of the recording.
        timeout_s: the engine is stopped after this; None asks the length of the recording.
        limits: of a walk.
        on_step: told what is going on and how far it is.

    Raises:
        RecordingError: LiDAR or IMU do not fit together.
        OdometryError: the engine fails, or its answer cannot be right.
    """
    T_imu_lidar, mounted = lidar_on_imu(recording)
    if timeout_s is None:
        timeout_s = _LEAST_TIMEOUT_S + _TIMEOUT_FACTOR * _length_s(recording)
    found = estimate_poses(
        recording,
        engine,
        program,
        T_imu_lidar=T_imu_lidar,
        scratch=scratch,
        timeout_s=timeout_s,
        on_step=on_step,
    )
    done = 0

    def on_scan(count: int, total: int) -> None:
        nonlocal done
        done += count
        on_step("judging poses", done, total)

    measures = measure_poses(
        recording,
        found.trajectory,
        found.scan_indices,
        T_imu_lidar=T_imu_lidar,
        imu=found.imu,
        on_progress=on_scan,
    )
    quality = quality_of(measures, limits)
    dropped = [f"{count} scans were left out: {reason}" for reason, count in found.dropped.items()]
    remarks = (
        mounted,
        f"the IMU's specific force is in {found.imu.unit}, as the size of gravity tells",
        *recording.notes.warnings,
        *found.remarks,
        *dropped,
        *_misfit(recording, int(found.scan_indices[0]), engine),
    )
    return JudgedPoses(
        replace(found.trajectory, quality=quality),
        measures,
        tuple(weak_stretches(measures, quality, limits)),
        tuple(carried_stretches(measures, quality)),
        engine,
        remarks,
    )


def _misfit(recording: MotionRecording, index: int, engine: Engine) -> list[str]:
    """Say so when the engine is for another kind of sensor."""
    scan = recording.read_scan(index)
    view_deg = horizontal_view_deg(scan.points[returns(scan)])
    if engine.all_round == (view_deg >= _ALL_ROUND_DEG):
        return []
    return [
        (
            f"the LiDAR sees {view_deg:.0f} of 360 degrees around it, and {engine.name} suits "
            f"{engine.suits}: compare with another --engine"
        )
    ]


def _length_s(recording: MotionRecording) -> float:
    stamps = recording.scan_stamps_ns
    return (int(stamps.max()) - int(stamps.min())) / NS_PER_S if len(stamps) else 0.0
