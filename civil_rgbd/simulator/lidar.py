"""A LiDAR like the Livox Avia: a rosette that does not repeat, six lines, a time for each point."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.geometry.transforms import rotate
from civil_rgbd.simulator.bridge import caster_of, scene_of
from civil_rgbd.simulator.scene import SKY
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.texture import MATERIALS
from civil_rgbd.simulator.walk import START_NS, T_IMU_LIDAR, imu_poses
from civil_rgbd.simulator.waves import cosine, sine

MESSAGE_NS: Final = NS_PER_S // 10
"""Time that one message covers."""
LINES: Final = 6
NOISE_TAG: Final = 0b10
"""Livox tag of a return that may be spatial noise."""

# Three prisms turn the beam; their deflections add up like clock hands. Speeds are those of the
# nearest published design (631.7 rpm and some -4.9 times that), with a ratio that is no fraction,
# so that the pattern never closes. Field of view: 70.4 deg wide, 77.2 deg high over six lines.
_PRISM_HZ = (631.7 / 60, -631.7 / 60 * 4.9063714, 631.7 / 60 * 0.3819660)
_PRISM_DEG = (16.3, 17.2, 1.7)
_LINE_STEP_DEG = (77.2 - 70.4) / (LINES - 1)


@dataclass(frozen=True, slots=True, eq=False)
class LivoxScan:
    """One message of the sensor, every field that it has.

    Attributes:
        stamp_ns: of the first point, LiDAR clock.
        points_lidar: (N, 3) float32 metres; (0, 0, 0) = no return.
        offset_ns: (N,) uint32, time after ``stamp_ns``.
        reflectivity: (N,) uint8.
        tag: (N,) uint8, Livox bits.
        line: (N,) uint8, 0 to 5.
    """

    stamp_ns: int
    points_lidar: NDArray[np.float32]
    offset_ns: NDArray[np.uint32]
    reflectivity: NDArray[np.uint8]
    tag: NDArray[np.uint8]
    line: NDArray[np.uint8]


def scan_stamps_ns(spec: ScanSpec) -> NDArray[np.int64]:
    """Return the header stamps of all whole messages of the walk: (S,) int64."""
    count = int(spec.seconds * NS_PER_S + 0.5) // MESSAGE_NS
    return START_NS + np.arange(count, dtype=np.int64) * MESSAGE_NS


def beam_directions(
    since_start_ns: NDArray[np.int64], line: NDArray[np.uint8]
) -> NDArray[np.float64]:
    """Return where the beams point.

    Args:
        since_start_ns: (N,) int64, time since the sensor began to turn.
        line: (N,) which of the six beams.

    Returns:
        (N, 3) float64 unit vectors, LiDAR frame.
    """
    t = since_start_ns.astype(np.float64) / NS_PER_S
    azimuth, elevation = np.zeros(len(t)), (line - (LINES - 1) / 2) * _LINE_STEP_DEG
    for hz, deg in zip(_PRISM_HZ, _PRISM_DEG, strict=True):
        azimuth = azimuth + deg * cosine(hz * t)
        elevation = elevation + deg * sine(hz * t)
    level = cosine(elevation / 360)
    return np.stack(
        [level * cosine(azimuth / 360), level * sine(azimuth / 360), sine(elevation / 360)], axis=1
    )


def simulate_scan(spec: ScanSpec, index: int) -> LivoxScan:
    """Return message ``index``: each point measured from where the sensor is at its own time."""
    count = spec.point_rate_hz // 10
    stamp_ns = int(scan_stamps_ns(spec)[index])
    offset_ns = np.arange(count, dtype=np.int64) * MESSAGE_NS // count
    line = (np.arange(count) % LINES).astype(np.uint8)
    beams = beam_directions(stamp_ns - START_NS + offset_ns, line)
    translations, quaternions = imu_poses(spec, stamp_ns + offset_ns)
    # T_IMU_LIDAR does not turn: LiDAR directions are IMU directions.
    mount = np.broadcast_to(T_IMU_LIDAR[:3, 3], beams.shape)
    origins = translations - np.asarray(spec.map_offset_m) + rotate(quaternions, mount)
    range_m, triangles = caster_of(spec.bridge).distances(origins, rotate(quaternions, beams))
    rng = np.random.default_rng([spec.seed, 1, index])
    range_m = range_m + spec.range_noise_m * rng.standard_normal(count)
    returned = (triangles != SKY) & (range_m >= spec.min_range_m) & (range_m <= spec.max_range_m)
    false = returned & (rng.random(count) < spec.false_return_share)
    range_m = np.where(false, range_m * rng.uniform(0.3, 0.95, count), range_m)
    range_m = np.where(returned & (range_m >= spec.min_range_m), range_m, 0.0)
    return LivoxScan(
        stamp_ns,
        (beams * range_m[:, np.newaxis] + 0.0).astype(np.float32),
        offset_ns.astype(np.uint32),
        _reflectivity(spec, triangles, returned),
        np.where(false, NOISE_TAG, 0).astype(np.uint8),
        line,
    )


def _reflectivity(
    spec: ScanSpec, triangles: NDArray[np.int32], returned: NDArray[np.bool_]
) -> NDArray[np.uint8]:
    scene = scene_of(spec.bridge)
    of_face = np.array([MATERIALS[face.material].reflectivity for face in scene.faces])
    return np.where(returned, of_face[scene.face_of_triangle[triangles]], 0).astype(np.uint8)
