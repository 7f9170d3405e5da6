"""Extrinsics from tf and rig file: who wins, and what follows from what."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray

from civil_rgbd.conversion.frame_tree import FrameTree
from civil_rgbd.conversion.mounting import Frames, mount
from civil_rgbd.errors import RecordingError
from civil_rgbd.trajectories.rig import RigFile


def at(x: float, y: float = 0.0, z: float = 0.0) -> NDArray[np.float64]:
    """A quarter turn about z, and a place: order and direction both show."""
    return np.array([[0.0, -1, 0, x], [1, 0, 0, y], [0, 0, 1, z], [0, 0, 0, 1]])


def tree(*links: tuple[str, str, NDArray[np.float64]]) -> FrameTree:
    made = FrameTree()
    for a, b, T_a_b in links:
        made.link(a, b, T_a_b)
    return made


def rig(**extrinsics: NDArray[np.float64]) -> RigFile:
    named = {}
    for name, T in extrinsics.items():
        _, a, b = name.split("_")
        named[a, b] = T
    return RigFile(extrinsics=named)


FRAMES = Frames(map="odom", body="base", lidar="velodyne", camera="optical")
INV = np.linalg.inv


def test_tf_alone_is_enough() -> None:
    tf = tree(("base", "velodyne", at(1)), ("velodyne", "optical", at(0, 2)))
    made = mount(FRAMES, tf, RigFile(), where="")
    assert np.allclose(made.T_body_lidar, at(1))
    assert np.allclose(made.T_body_camera, at(1) @ at(0, 2))


def test_rig_file_wins_over_tf_between_lidar_and_camera() -> None:
    tf = tree(("base", "velodyne", at(1)), ("velodyne", "optical", at(0, 2)))
    made = mount(FRAMES, tf, rig(T_lidar_camera=at(9)), where="")
    assert np.allclose(made.T_body_camera, at(1) @ at(9))


def test_rig_file_reaches_the_lidar_through_the_camera() -> None:
    made = mount(FRAMES, tree(("base", "optical", at(1))), rig(T_lidar_camera=at(9)), where="")
    assert np.allclose(made.T_body_camera, at(1))
    assert np.allclose(made.T_body_lidar, at(1) @ INV(at(9)))


def test_body_transforms_need_nothing_else() -> None:
    made = mount(FRAMES, FrameTree(), rig(T_body_camera=at(1), T_body_lidar=at(2)), where="")
    assert np.allclose(made.T_body_camera, at(1))
    assert np.allclose(made.T_body_lidar, at(2))


@pytest.mark.parametrize(
    ("pose_of", "T_body_imu"),
    [("imu", np.eye(4)), ("lidar", INV(at(2))), ("camera", INV(at(1)))],
)
def test_imu_extrinsics_serve_poses_of_any_sensor(
    pose_of: str, T_body_imu: NDArray[np.float64]
) -> None:
    frames = Frames("odom", "body", "velodyne", "optical", pose_of=pose_of)
    made = mount(frames, FrameTree(), rig(T_imu_camera=at(1), T_imu_lidar=at(2)), where="")
    assert np.allclose(made.T_body_camera, T_body_imu @ at(1))
    assert np.allclose(made.T_body_lidar, T_body_imu @ at(2))


def test_a_child_frame_that_is_the_imus_needs_no_option() -> None:
    frames = Frames("odom", "imu_link", "velodyne", "optical", imu="imu_link")
    made = mount(frames, FrameTree(), rig(T_imu_camera=at(1), T_imu_lidar=at(2)), where="")
    assert np.allclose(made.T_body_camera, at(1))


def test_imu_extrinsics_join_tf_at_the_imu() -> None:
    frames = Frames("odom", "base", "velodyne", "optical", imu="imu_link")
    tf = tree(("base", "imu_link", at(5)))
    made = mount(frames, tf, rig(T_imu_camera=at(1), T_imu_lidar=at(2)), where="")
    assert np.allclose(made.T_body_camera, at(5) @ at(1))


def test_a_frame_shared_by_lidar_and_imu_is_the_lidars() -> None:
    frames = Frames("odom", "livox", "livox", "optical", imu="livox")
    made = mount(frames, FrameTree(), rig(T_imu_camera=at(1), T_imu_lidar=at(2)), where="")
    assert np.allclose(made.T_body_lidar, np.eye(4))


def test_poses_of_the_lidar_need_only_lidar_to_camera() -> None:
    frames = Frames("odom", "", "velodyne", "optical", pose_of="lidar")
    made = mount(frames, FrameTree(), rig(T_lidar_camera=at(4)), where="")
    assert np.allclose(made.T_body_camera, at(4))


def test_registered_clouds_need_no_lidar_mount() -> None:
    frames = Frames("world", "", "world", "optical", pose_of="camera")
    made = mount(frames, FrameTree(), RigFile(), where="")
    assert np.allclose(made.T_body_camera, np.eye(4))


def test_registered_clouds_know_their_sensors_place_where_tf_or_rig_do() -> None:
    frames = Frames("world", "base", "world", "optical", scanner="velodyne")
    tf = tree(("base", "velodyne", at(1, 2)), ("base", "optical", at(3)))
    assert np.allclose(mount(frames, tf, RigFile(), where="").T_body_lidar, at(1, 2))
    known = rig(T_body_lidar=at(5), T_body_camera=at(6))
    assert np.allclose(mount(frames, FrameTree(), known, where="").T_body_lidar, at(5))
    assert np.allclose(mount(frames, tf, known, where="").T_body_lidar, at(5))


def test_a_missing_lidar_mount_is_named() -> None:
    with pytest.raises(RecordingError, match="the lidar frame 'velodyne'") as caught:
        mount(FRAMES, tree(("base", "optical", at(1))), RigFile(), where="")
    assert "T_body_lidar" in caught.value.fix
