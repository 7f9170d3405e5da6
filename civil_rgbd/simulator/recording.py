"""A simulated scan as a recording: no file, each scan and image worked out when asked for."""

from __future__ import annotations

from dataclasses import asdict, replace
from functools import cached_property
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.motion import ImuReadings
from civil_rgbd.domain.recording import (
    CameraImage,
    RecordingNotes,
    RecordingOptions,
    SourceFile,
)
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.geometry.transforms import compose
from civil_rgbd.simulator.camera import raw_camera, simulate_jpeg
from civil_rgbd.simulator.drift import recorded_imu_poses
from civil_rgbd.simulator.imu import recorded_imu
from civil_rgbd.simulator.lidar import MESSAGE_NS, scan_stamps_ns, simulate_scan
from civil_rgbd.simulator.spec import ScanSpec, spec_from_location
from civil_rgbd.simulator.walk import (
    T_IMU_LIDAR,
    image_instants_ns,
    stated_T_lidar_camera,
)

IMU_FRAME = "imu_link"
LIDAR_FRAME = "livox_frame"
CAMERA_FRAME = "camera_color_optical_frame"
MAP_FRAME = "map"

_LIVOX_NOISE_BITS = 0x0F


class SimulatedRecording:
    """Fits :class:`civil_rgbd.domain.recording.Recording`; equal specs give equal recordings.

    Fits :class:`civil_rgbd.domain.motion.MotionRecording` as well: its poses may be asked of an
    odometry engine as if nobody knew them.

    Attributes:
        spec: what is simulated.
    """

    def __init__(self, spec: ScanSpec) -> None:
        self.spec = spec

    def __reduce__(self) -> tuple[type[SimulatedRecording], tuple[ScanSpec]]:
        return SimulatedRecording, (self.spec,)

    @property
    def name(self) -> str:
        """The bridge's name."""
        return self.spec.bridge

    @cached_property
    def sources(self) -> tuple[SourceFile, ...]:
        """The spec itself, as if it were a file."""
        size = len(self.spec.text().encode())
        name = f"{self.spec.bridge}.spec.json"
        return (SourceFile(name, size, self.spec.sha256(), "simulated"),)

    @property
    def notes(self) -> RecordingNotes:
        """It is simulated, and every point has its own time."""
        return RecordingNotes(deskew="per_point", simulated=True, map_up=(0.0, 0.0, 1.0))

    @cached_property
    def rig(self) -> Rig:
        """The sensors as the recording states them: with the spec's extrinsic error."""
        return Rig(
            camera=raw_camera(self.spec.image_scale),
            T_body_camera=compose(T_IMU_LIDAR, stated_T_lidar_camera(self.spec)),
            T_body_lidar=T_IMU_LIDAR,
            camera_time_offset_s=self.spec.camera_time_offset_s,
            body=IMU_FRAME,
            lidar_name="simulated Livox Avia",
            camera_name="simulated RealSense D455",
        )

    @cached_property
    def trajectory(self) -> Trajectory:
        """``T_map_imu``, 200 Hz: the true one, or with the spec's drift."""
        return Trajectory(*recorded_imu_poses(self.spec))

    @cached_property
    def image_stamps_ns(self) -> NDArray[np.int64]:
        """(I,) what the camera's clock says when each image is taken."""
        return stated_image_stamps_ns(self.spec)

    @cached_property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        """(S,) stamp of each message's first point."""
        return scan_stamps_ns(self.spec)

    @property
    def is_livox(self) -> bool:
        """Its LiDAR is a Livox Avia's."""
        return True

    @cached_property
    def imu(self) -> ImuReadings:
        """Everything that the IMU measured: forces in g, as Livox gives them."""
        return ImuReadings(*recorded_imu(self.spec), IMU_FRAME)

    @property
    def T_imu_lidar(self) -> NDArray[np.float64]:
        """(4, 4), LiDAR frame to IMU frame, as the recording's tf states it."""
        return T_IMU_LIDAR

    @property
    def point_reach_ns(self) -> tuple[int, int]:
        """Points follow their message's stamp by up to a tenth of a second."""
        return 0, MESSAGE_NS

    def read_scan(self, index: int) -> LidarScan:
        """Simulate one LiDAR message."""
        scan = simulate_scan(self.spec, index)
        return LidarScan(
            scan.stamp_ns,
            scan.points_lidar,
            scan.stamp_ns + scan.offset_ns.astype(np.int64),
            (scan.tag & _LIVOX_NOISE_BITS) != 0,
        )

    def read_image(self, index: int) -> CameraImage:
        """Take one image: rendered, compressed and decoded again, as from a file."""
        jpeg = np.frombuffer(simulate_jpeg(self.spec, index), dtype=np.uint8)
        bgr = cv2.imdecode(jpeg, cv2.IMREAD_COLOR)
        rgb = cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB)
        return CameraImage(index, int(self.image_stamps_ns[index]), rgb)


def stated_image_stamps_ns(spec: ScanSpec) -> NDArray[np.int64]:
    """Return the (I,) int64 stamps that the images carry, camera clock."""
    # The offset is added to image stamps to reach the LiDAR clock, so it is missing from them.
    return image_instants_ns(spec) - round(spec.camera_time_offset_s * 1e9)


def open_recording(
    location: str | Path, options: RecordingOptions | None = None
) -> SimulatedRecording:
    """Open a simulated recording.

    Args:
        location: ``simulated:BRIDGE``, or with settings ``simulated:demo?seconds=6&seed=1``.
        options: none fits, as there are no topics to choose from.

    Raises:
        UsageError: the bridge or a setting is unknown, a value or an option does not fit.
    """
    # Whether to hash files says nothing of the recording; here there are none.
    plain = options is None or asdict(replace(options, source_hash=True)) == asdict(
        RecordingOptions()
    )
    if not plain:
        raise UsageError(
            "a simulated recording has no topics, rig file or damage to choose options for",
            where=location,
            fix="leave these options out, or write the recording with `civil-rgbd simulate` first",
        )
    return SimulatedRecording(spec_from_location(str(location)))


def open_motion(
    location: str | Path, options: RecordingOptions | None = None
) -> SimulatedRecording:
    """Open LiDAR and IMU of a simulated recording, for odometry; as :func:`open_recording`."""
    return open_recording(location, options)
