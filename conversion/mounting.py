"""Where camera and LiDAR sit on the body that the poses move: tf, overridden by a rig file."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.frame_tree import FrameTree
from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import RecordingError

BODIES = ("camera", "lidar", "imu")
"""What ``--pose-of`` may name."""


@dataclass(frozen=True, slots=True)
class Frames:
    """The recording's own names of what a rig file calls lidar, camera, imu and body.

    Attributes:
        map: parent frame of the poses; empty when not named.
        body: child frame of the poses; empty when not named.
        lidar: frame of the point clouds.
        camera: frame of the images.
        imu: frame of the IMU messages; empty without any.
        pose_of: which sensor the body is, when the user says so.
        scanner: where the clouds are in the map frame, the frame of the LiDAR that took them; empty
            when not known.
    """

    map: str
    body: str
    lidar: str
    camera: str
    imu: str = ""
    pose_of: str | None = None
    scanner: str = ""

    @property
    def in_map(self) -> bool:
        """The clouds are in the frame that the poses are relative to."""
        return bool(self.map) and self.lidar == self.map

    @property
    def body_name(self) -> str:
        """The body, in the recording's own words."""
        return self.body if self.body and not self.pose_of else str(self.pose_of or "body")

    def named(self, role: str) -> str:
        """Return the frame id behind lidar, camera, imu or body; empty when there is none."""
        if role == "body" and self.pose_of:
            role = self.pose_of
        return {
            "body": self.body,
            "lidar": self.scanner if self.in_map else self.lidar,
            "camera": self.camera,
            "imu": self.imu,
        }[role]


@dataclass(frozen=True, slots=True, eq=False)
class Mounting:
    """The two transforms that a rig needs, (4, 4) each."""

    T_body_camera: NDArray[np.float64]
    T_body_lidar: NDArray[np.float64]


def mount(frames: Frames, tf: FrameTree, rig: RigFile, *, where: object) -> Mounting:
    """Find camera and LiDAR on the body.

    What the rig file says comes first; tf adds only links between sensors that the rig file does
    not already connect, so that it never contradicts it.

    Args:
        frames: the recording's names.
        tf: its static transforms.
        rig: what the user says.
        where: the file, for errors.

    Raises:
        RecordingError: camera or LiDAR are not linked to the body.
    """
    roles = FrameTree()
    for (a, b), T_a_b in rig.extrinsics.items():
        roles.link(a, b, T_a_b)
    if roles.find("body", "lidar") is None and roles.find("body", "camera") is None:
        _say_what_the_body_is(roles, frames)
    for a, b in [("body", "lidar"), ("body", "camera"), ("lidar", "camera"), ("body", "imu")]:
        if roles.find(a, b) is None and frames.named(a) and frames.named(b):
            found = tf.find(frames.named(a), frames.named(b))
            if found is not None:
                roles.link(a, b, found)
    T_body_camera, T_body_lidar = roles.find("body", "camera"), roles.find("body", "lidar")
    if T_body_lidar is None and frames.in_map:
        # Points in the map are not moved by it: it only says where the sensor was that they are
        # in range of. Unless tf or rig know better, that is where the body was.
        T_body_lidar = np.eye(4)
    if T_body_camera is None or T_body_lidar is None:
        raise _no_link("camera" if T_body_camera is None else "lidar", frames, tf, where)
    return Mounting(T_body_camera, T_body_lidar)


def _say_what_the_body_is(roles: FrameTree, frames: Frames) -> None:
    if frames.pose_of:
        roles.link("body", frames.pose_of, np.eye(4))
        return
    # A LiDAR with an IMU inside often gives both the same frame id; clouds are in that frame.
    for sensor in ("lidar", "camera", "imu"):
        if frames.body and frames.named(sensor) == frames.body:
            roles.link("body", sensor, np.eye(4))
            return


def _no_link(role: str, frames: Frames, tf: FrameTree, where: object) -> RecordingError:
    sensor = frames.lidar if role == "lidar" else frames.camera
    known = ", ".join(map(repr, tf.frames)) or "none"
    return RecordingError(
        f"nothing links the {role} frame {sensor!r} to the body of the poses, "
        f"{frames.body_name!r}; frames known from tf: {known}",
        where=where,
        fix=f"give T_body_{role}, T_lidar_camera or T_imu_{role} in a rig file (--rig), and say "
        "what the poses are of with --pose-of camera|lidar|imu where the body is one of them",
    )
