"""Scenes and walks with known truth for ``odometry.py``: girders, and where geometry ends."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.motion import ImuReadings
from civil_rgbd.domain.recording import RecordingNotes, SourceFile
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.geometry.transforms import rotate, unit_quaternion
from civil_rgbd.simulator.bridge import GirderBridge, girder_bridge
from civil_rgbd.simulator.lidar import LINES, beam_directions
from civil_rgbd.simulator.scene import SKY, Face, RayCaster, Scene, box, prism
from civil_rgbd.simulator.walk import T_IMU_LIDAR
from civil_rgbd.simulator.waves import chain_turns, sine, turn_about

START_NS = 1_700_000_000 * NS_PER_S
SCAN_NS = NS_PER_S // 10
POINTS_A_SCAN = 12_000
IMU_RATE_HZ = 200
STANDS_S = 2.0  # engines take gravity and gyroscope bias from the first moments

# A BMI088, as inside the Avia: its data sheet's noise densities times the square root of 100 Hz.
GYRO_NOISE_RAD_S, GYRO_BIAS_RAD_S = 0.0024, 0.003
FORCE_NOISE_M_S2, FORCE_BIAS_M_S2 = 0.017, 0.03
RANGE_NOISE_M = 0.015
GRAVITY_M_S2 = 9.80665
_STEP_NS = 1_000_000

Walk = Callable[[NDArray[np.float64]], tuple[NDArray[np.float64], NDArray[np.float64]]]
"""Seconds (N,) to places (N, 3) in metres and turns (N, 4), xyzw: the IMU in the scene."""


@dataclass(frozen=True)
class Trial:
    """One scene walked through; fits :class:`civil_rgbd.domain.motion.MotionRecording`."""

    name: str
    scene: Scene
    walk: Walk
    seconds: float = 60.0
    seed: int = 0

    @property
    def sources(self) -> tuple[SourceFile, ...]:
        """None: nothing was read."""
        return ()

    @property
    def notes(self) -> RecordingNotes:
        """It is simulated."""
        return RecordingNotes(simulated=True)

    @property
    def is_livox(self) -> bool:
        """The sensor is an Avia."""
        return True

    @property
    def T_imu_lidar(self) -> NDArray[np.float64]:
        """The Avia's own."""
        return T_IMU_LIDAR

    @cached_property
    def scan_stamps_ns(self) -> NDArray[np.int64]:
        """(S,) of the first points."""
        return START_NS + np.arange(int(self.seconds * 10), dtype=np.int64) * SCAN_NS

    @cached_property
    def _caster(self) -> RayCaster:
        return RayCaster(self.scene)

    def truth(
        self, stamps_ns: NDArray[np.int64]
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Where the IMU truly is: (N, 3) metres and (N, 4) xyzw."""
        return self.walk((stamps_ns - START_NS) / NS_PER_S)

    @cached_property
    def imu(self) -> ImuReadings:
        """Differences of the truth, with noise and a bias each; forces in g, as Livox has it."""
        count = int(self.seconds * IMU_RATE_HZ) + 1
        stamps = START_NS + np.arange(count, dtype=np.int64) * (NS_PER_S // IMU_RATE_HZ)
        (p0, q0), (p1, q1), (p2, q2) = (
            self.truth(stamps + shift) for shift in (-_STEP_NS, 0, _STEP_NS)
        )
        step_s = _STEP_NS / NS_PER_S
        turned = unit_quaternion(chain_turns(q0 * [-1.0, -1.0, -1.0, 1.0], q2))
        force = (p2 - 2 * p1 + p0) / step_s**2 + [0.0, 0.0, GRAVITY_M_S2]
        force = rotate(q1 * [-1.0, -1.0, -1.0, 1.0], force)
        rng = np.random.default_rng([self.seed, 2])
        rate = turned[:, :3] / step_s + rng.normal(0, GYRO_BIAS_RAD_S, 3)
        force = force + rng.normal(0, FORCE_BIAS_M_S2, 3)
        return ImuReadings(
            stamps,
            rate + rng.normal(0, GYRO_NOISE_RAD_S, rate.shape),
            (force + rng.normal(0, FORCE_NOISE_M_S2, force.shape)) / GRAVITY_M_S2,
            "imu",
        )

    def read_scan(self, index: int) -> LidarScan:
        """Cast the rays of one scan, each from where the sensor is at its own time."""
        start = int(self.scan_stamps_ns[index])
        offsets = np.arange(POINTS_A_SCAN, dtype=np.int64) * SCAN_NS // POINTS_A_SCAN
        line = (np.arange(POINTS_A_SCAN) % LINES).astype(np.uint8)
        beams = beam_directions(start - START_NS + offsets, line)
        places, turns = self.truth(start + offsets)
        origins = places + rotate(turns, np.broadcast_to(T_IMU_LIDAR[:3, 3], beams.shape))
        range_m, hit = self._caster.distances(origins, rotate(turns, beams))
        rng = np.random.default_rng([self.seed, 1, index])
        range_m = range_m + RANGE_NOISE_M * rng.standard_normal(POINTS_A_SCAN)
        range_m = np.where((hit != SKY) & (range_m > 1.0) & (range_m < 200.0), range_m, 0.0)
        points = (beams * range_m[:, np.newaxis]).astype(np.float32)
        return LidarScan(start, points, start + offsets, np.zeros(POINTS_A_SCAN, dtype=np.bool_))


def along(
    start_m: tuple[float, float, float],
    *,
    length_m: float,
    up_deg: float,
    yaw_deg: float = 0.0,
    speed_m_s: float = 1.2,
    sway: float = 1.0,
) -> Walk:
    """Stand, then walk along x and back again, looking around a little."""

    def walk(t: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        moving = np.clip((t - STANDS_S) / 3.0, 0.0, 1.0)
        moving = moving**3 * (10 - 15 * moving + 6 * moving**2)  # starts without a jerk
        # There and back as a sine of the way: it slows down where it turns round.
        half = length_m / 2
        since = np.maximum(t - STANDS_S - 1.5, 0.0) * moving
        phase = since * speed_m_s / half / (2 * np.pi)
        x = start_m[0] + half * (1 - sine(phase + 0.25))
        gait = 1.8 * t
        y = start_m[1] + 0.3 * moving * sine(phase * 2) + 0.012 * moving * sine(gait / 2)
        z = start_m[2] + 0.018 * moving * sine(gait)
        yaw = np.radians(yaw_deg + sway * moving * 14 * sine(t / 9.7))
        up = np.radians(up_deg + sway * moving * 6 * sine(t / 5.3))
        roll = 0.015 + 0.012 * moving * sine(gait / 2 + 0.4)
        turns = chain_turns(turn_about(2, yaw), turn_about(1, -up), turn_about(0, roll))
        return np.stack([x, y, z], axis=1), unit_quaternion(turns)

    return walk


def _soffit(height_m: float) -> list[Face]:
    return box("soffit", "slab", (-400, -400, height_m), (400, 400, height_m + 1))


def _box_tunnel(width_m: float, height_m: float) -> list[Face]:
    half, far = width_m / 2, 900.0
    return [
        *box("floor", "road", (-far, -half, -1), (far, half, 0)),
        *box("roof", "slab", (-far, -half, height_m), (far, half, height_m + 1)),
        *box("wall", "wall", (-far, half, 0), (far, half + 1, height_m)),
        *box("wall", "wall", (-far, -half - 1, 0), (far, -half, height_m)),
    ]


def _round_tunnel(radius_m: float, *, sides: int = 24) -> list[Face]:
    angles = 2 * np.pi * np.arange(sides) / sides
    outline = np.stack([np.cos(angles), np.sin(angles) + 0.6], axis=1) * radius_m
    return prism("lining", "slab", outline, along=0, start_m=-900.0, end_m=900.0)[2:]


def _ribs(first_x_m: float, last_x_m: float, *, width_m: float, height_m: float) -> list[Face]:
    faces: list[Face] = []
    for x in np.arange(first_x_m, last_x_m, 2.7):
        for side in (-1, 1):
            low, high = sorted((side * width_m / 2, side * (width_m / 2 - 0.3)))
            faces += box("rib", "girder", (x, low, 0.0), (x + 0.4, high, height_m))
    return faces


def _slab_bridge(width_m: float, span_m: float, height_m: float) -> list[Face]:
    half = width_m / 2
    faces = box("road", "road", (-130, -60, -1), (130, 60, 0))
    faces += box("slab", "slab", (-half, -span_m - 1, height_m), (half, span_m + 1, height_m + 0.8))
    for side in (-1, 1):
        low, high = sorted((side * span_m, side * (span_m + 1)))
        faces += box("abutment", "wall", (-half, low, 0), (half, high, height_m))
        faces += box("parapet", "slab", (side * half - 0.15, -span_m - 9, height_m + 0.8),
                     (side * half + 0.15, span_m + 9, height_m + 1.8))  # fmt: skip
    for x in (-half * 0.6, 0.0, half * 0.6):
        faces += box("pier", "wall", (x - 0.4, -0.4, 0), (x + 0.4, 0.4, height_m))
    return faces


_Plan = list[tuple[str, list[Face], Walk]]


def _scenes_to_set() -> _Plan:
    other = GirderBridge(
        deck_width_m=12.0, abutment_y_m=11.0, abutment_height_m=4.2, girder_count=5,
        girder_spacing_m=2.6, girder_depth_m=1.3, column_x_m=(-4.0, 0.0, 4.0),
    )  # fmt: skip
    return [
        ("girders", girder_bridge(other, name="other").faces,
         along((-16, -7.5, 1.5), length_m=30, up_deg=14, yaw_deg=12)),
        ("soffit", _soffit(6.5), along((0, 0, 1.4), length_m=40, up_deg=64)),
        ("tunnel", _round_tunnel(4.0), along((0, 0, 1.5), length_m=40, up_deg=6)),
        ("slab on piers", _slab_bridge(11, 8, 4.6),
         along((-10, -4.5, 1.5), length_m=18, up_deg=12, yaw_deg=14)),
        ("ribbed tunnel, then smooth",
         _box_tunnel(8, 6) + _ribs(-30, 14, width_m=8, height_m=6),
         along((0, 0.4, 1.5), length_m=60, up_deg=8, yaw_deg=20)),
        ("girders 2", girder_bridge(GirderBridge(), name="demo").faces,
         along((-13, -6.9, 1.45), length_m=26, up_deg=10, yaw_deg=18)),
        ("soffit 2", _soffit(5.0), along((0, 0, 1.5), length_m=50, up_deg=58)),
        ("tunnel 2", _box_tunnel(7, 5), along((0, -0.5, 1.6), length_m=50, up_deg=10)),
        ("slab on piers 2", _slab_bridge(9, 9, 5.2),
         along((-9, -5.5, 1.5), length_m=16, up_deg=15, yaw_deg=20)),
        ("ribbed tunnel, then smooth 2",
         _round_tunnel(4.6) + _ribs(-40, 10, width_m=7.4, height_m=5),
         along((0, -0.3, 1.6), length_m=50, up_deg=5, yaw_deg=-15)),
    ]  # fmt: skip


def _scored_scenes() -> _Plan:
    wide = GirderBridge(
        deck_width_m=10.0, abutment_y_m=9.0, abutment_height_m=3.6, girder_count=4,
        girder_spacing_m=2.5, girder_depth_m=1.1, column_x_m=(-3.0, 3.0),
    )  # fmt: skip
    deep = GirderBridge(
        deck_width_m=14.0, abutment_y_m=12.5, abutment_height_m=4.8, girder_count=6,
        girder_spacing_m=2.4, girder_depth_m=1.5, column_x_m=(-5.0, 0.0, 5.0),
    )  # fmt: skip
    return [
        ("girders", girder_bridge(wide, name="wide").faces,
         along((-14, -5.8, 1.55), length_m=28, up_deg=18, yaw_deg=-10, speed_m_s=1.0)),
        ("soffit", _soffit(4.3), along((0, 0, 1.55), length_m=36, up_deg=52, speed_m_s=0.9)),
        ("tunnel", _round_tunnel(3.3), along((0, 0.4, 1.4), length_m=44, up_deg=9, yaw_deg=8)),
        ("girders 2", girder_bridge(deep, name="deep").faces,
         along((-15, -8.4, 1.4), length_m=32, up_deg=22, yaw_deg=20, speed_m_s=1.3)),
        ("soffit 2", _soffit(7.6), along((0, 0, 1.6), length_m=44, up_deg=68)),
        ("tunnel 2", _box_tunnel(9.5, 5.6),
         along((0, 1.2, 1.5), length_m=38, up_deg=14, yaw_deg=-12, speed_m_s=0.8)),
        ("slab on piers", _slab_bridge(10, 10, 4.9),
         along((-9.5, -6.2, 1.5), length_m=17, up_deg=13, yaw_deg=17, speed_m_s=1.0)),
        ("ribbed tunnel, then smooth",
         _box_tunnel(6.4, 4.6) + _ribs(-34, 12, width_m=6.4, height_m=4.6),
         along((0, 0.2, 1.45), length_m=54, up_deg=7, yaw_deg=12)),
    ]  # fmt: skip


def trials(part: str, *, seconds: float = 60.0) -> list[Trial]:
    """Return the trials that thresholds are set on (``set``) or that are scored (``scored``)."""
    if part == "set":
        plan, seeds = _scenes_to_set(), [*range(100, 105), *range(200, 205)]
    else:
        plan, seeds = _scored_scenes(), [*range(300, 308)]
    return [
        Trial(name, Scene(name, tuple(faces)), walk, seconds, seed)
        for (name, faces, walk), seed in zip(plan, seeds, strict=True)
    ]
