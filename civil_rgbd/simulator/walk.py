"""The inspector's walk, and how the sensors hang on the frame that is carried."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.geometry.transforms import (
    compose,
    matrix_from_quaternion,
    quaternion_from_matrix,
    rotate,
    transform_from,
    unit_quaternion,
)
from civil_rgbd.simulator.catalogue import site_for
from civil_rgbd.simulator.gait import Carrying, carried, setting_off
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.waves import chain_turns, cosine, sine, turn_about, turn_towards

START_NS: Final = 1_700_000_000 * NS_PER_S
"""The instant at which every walk starts, LiDAR clock."""

POSE_RATE_HZ: Final = 200

# A long, narrow oval past and under the southern span: there on the sidewalk, back on the lane.
_HALF_LENGTH_M = 14.0
_HALF_WIDTH_M = 1.0
_MIDDLE_Y_M = -6.9
_START_TURNS = 0.102  # of the oval: some 11 m before the middle of the bridge
_CHEST_M = 1.45

_DIFFERENCE_NS = 1_000_000
_GRID_NS = 100_000  # within it a carried sensor moves and turns evenly
_GRAVITY_M_S2 = 9.80665


def imu_poses(
    spec: ScanSpec, stamps_ns: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return where the IMU is: the true poses, in closed form.

    Args:
        spec: the scan.
        stamps_ns: (N,) int64, LiDAR clock.

    Returns:
        translations (N, 3) float64 metres, map frame; quaternions (N, 4) float64, xyzw, unit,
        w >= 0: ``T_map_imu``.
    """
    t = (stamps_ns - START_NS).astype(np.float64) / NS_PER_S
    how = Carrying(spec.speed_m_s, spec.stands_s, spec.sway, spec.seed, spec.starts_m)
    path = site_for(spec).path
    place, quaternions = _stroll(t, how) if path is None else carried(path, how, t)
    return place + np.asarray(spec.map_offset_m), unit_twice(quaternions)


def _stroll(
    t: NDArray[np.float64], how: Carrying
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    # Who stands still neither bobs nor looks around.
    moving: float | NDArray[np.float64] = min(how.speed_m_s, 1.0) * how.sway
    if how.stands_s:
        t, share = setting_off(t, how.stands_s)
        moving = moving * share
    # One metre of the way is one along the oval's long sides.
    begin = _START_TURNS + how.starts_m / _HALF_LENGTH_M / (2 * math.pi)
    oval = begin + t * (how.speed_m_s / _HALF_LENGTH_M / (2 * math.pi))
    sin, cos = sine(oval), cosine(oval)
    gait = 1.8 * t  # steps a second
    x = -_HALF_LENGTH_M * cos
    y = _MIDDLE_Y_M - _HALF_WIDTH_M * sin + 0.012 * moving * sine(gait / 2)
    z = _CHEST_M + 0.018 * moving * sine(gait)
    ahead = turn_towards(_HALF_LENGTH_M * sin, -_HALF_WIDTH_M * cos)
    yaw = 0.34 + moving * (0.30 * sine(t / 9.7) + 0.008 * sine(gait / 2 + 0.1))
    up = 0.16 + moving * (0.11 * sine(t / 5.3 - 0.25) + 0.005 * sine(gait + 0.3))
    roll = 0.015 + 0.012 * moving * sine(gait / 2 + 0.4)
    turns = chain_turns(ahead, turn_about(2, yaw), turn_about(1, -up), turn_about(0, roll))
    return np.stack([x, y, z], axis=1), turns


def dense_imu_poses(
    spec: ScanSpec, stamps_ns: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return :func:`imu_poses` at stamps that follow each other closely, several times as fast.

    Args:
        spec: the scan.
        stamps_ns: (N,) int64, ascending, LiDAR clock.

    Returns:
        as :func:`imu_poses` does, the same within 1e-8 m and 1e-8 rad.
    """
    since, first = stamps_ns - stamps_ns[0], int(stamps_ns[0])
    grid = first + np.arange(since[-1] // _GRID_NS + 2, dtype=np.int64) * _GRID_NS
    places, turns = imu_poses(spec, grid)
    before, rest = np.divmod(since, _GRID_NS)
    share = (rest / _GRID_NS)[:, np.newaxis]
    # w may change its sign between two poses of the grid, which are next to each other.
    ahead = np.where((turns[:-1] * turns[1:]).sum(axis=1, keepdims=True) < 0, -turns[1:], turns[1:])
    steps = np.diff(places, axis=0), ahead - turns[:-1]
    between = turns[before] + share * steps[1][before]
    return places[before] + share * steps[0][before], unit_twice(between)


def imu_readings(
    spec: ScanSpec, stamps_ns: NDArray[np.int64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return what the IMU measures, by differences of the true poses.

    Args:
        spec: the scan.
        stamps_ns: (N,) int64, LiDAR clock.

    Returns:
        angular velocity (N, 3) rad/s; specific force (N, 3) in g, as Livox gives it; IMU frame.
    """
    (p0, q0), (p1, q1), (p2, q2) = (
        imu_poses(spec, stamps_ns + shift) for shift in (-_DIFFERENCE_NS, 0, _DIFFERENCE_NS)
    )
    step_s = _DIFFERENCE_NS / NS_PER_S
    conjugate = q0 * np.array([-1.0, -1.0, -1.0, 1.0])
    turned = unit_quaternion(chain_turns(conjugate, q2))
    force = (p2 - 2 * p1 + p0) / step_s**2 + np.array([0.0, 0.0, _GRAVITY_M_S2])
    unturn = q1 * np.array([-1.0, -1.0, -1.0, 1.0])
    return turned[:, :3] / step_s, rotate(unturn, force) / _GRAVITY_M_S2


def pose_stamps_ns(spec: ScanSpec) -> NDArray[np.int64]:
    """Return the stamps of the recorded poses and of the IMU: (P,) int64, both ends included."""
    count = math.floor(spec.seconds * POSE_RATE_HZ + 1e-9) + 1
    return START_NS + np.arange(count, dtype=np.int64) * (NS_PER_S // POSE_RATE_HZ)


def image_instants_ns(spec: ScanSpec) -> NDArray[np.int64]:
    """Return when the images are truly taken: (I,) int64, LiDAR clock."""
    count = math.floor(spec.seconds * spec.image_rate_hz + 1e-9)
    seconds = (np.arange(count) + 0.5) / spec.image_rate_hz
    instants = START_NS + np.rint(seconds * NS_PER_S).astype(np.int64)
    taken: NDArray[np.int64] = instants[instants <= pose_stamps_ns(spec)[-1]]
    return taken


def camera_poses(spec: ScanSpec, stamps_ns: NDArray[np.int64]) -> NDArray[np.float64]:
    """Return the true ``T_map_camera`` (N, 4, 4) float64 at (N,) stamps, LiDAR clock."""
    translations, quaternions = imu_poses(spec, stamps_ns)
    T_map_imu = transform_from(matrix_from_quaternion(quaternions), translations)
    return compose(T_map_imu, T_IMU_LIDAR, T_LIDAR_CAMERA)


def stated_mount(spec: ScanSpec) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the camera's pose in the LiDAR frame as the recording states it, errors and all.

    Returns:
        translation (3,) metres; quaternion (4,), xyzw.
    """
    if not any((*spec.extrinsic_error_deg, *spec.extrinsic_error_m)):
        return _MOUNT_M, _MOUNT_XYZW
    angles = np.radians(np.asarray(spec.extrinsic_error_deg))
    error = chain_turns(*(turn_about(axis, angles[axis : axis + 1]) for axis in range(3)))
    T_camera_stated = transform_from(matrix_from_quaternion(error[0]), spec.extrinsic_error_m)
    return compose(T_LIDAR_CAMERA, T_camera_stated)[:3, 3], unit_twice(
        chain_turns(_MOUNT_XYZW, error[0])
    )


def stated_T_lidar_camera(spec: ScanSpec) -> NDArray[np.float64]:
    """Return :func:`stated_mount` as a (4, 4) transform."""
    translation_m, quaternion_xyzw = stated_mount(spec)
    return transform_from(matrix_from_quaternion(quaternion_xyzw), translation_m)


def unit_twice(quaternions_xyzw: NDArray[np.float64]) -> NDArray[np.float64]:
    """Scale quaternions (..., 4) so that scaling them to norm 1 again changes no bit."""
    return unit_quaternion(unit_quaternion(quaternions_xyzw))


def _mount_xyzw() -> NDArray[np.float64]:
    # Optical axes in a body that looks along x: right = -y, down = -z, forward = x.
    axes = quaternion_from_matrix([[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]])
    tilts = [turn_about(2, np.array([-0.021])), turn_about(1, np.array([-0.049]))]
    return unit_twice(chain_turns(*tilts, turn_about(0, np.array([0.014])), axes[np.newaxis])[0])


_MOUNT_M: Final = np.array([0.021, 0.034, 0.093])
_MOUNT_XYZW: Final = _mount_xyzw()

# The Avia's LiDAR in its own IMU: Livox Avia user manual; no rotation.
T_IMU_LIDAR: Final = transform_from(np.eye(3), [0.04165, 0.02326, -0.0284])
T_LIDAR_CAMERA: Final = transform_from(matrix_from_quaternion(_MOUNT_XYZW), _MOUNT_M)
"""The true mount: the camera 9 cm above the LiDAR, tilted a little about all three axes."""
