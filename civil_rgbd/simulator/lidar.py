"""A LiDAR like the Livox Avia: a rosette that does not repeat, six lines, a time for each point."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.geometry.transforms import rotate
from civil_rgbd.simulator.avia import LINES as AVIA_LINES
from civil_rgbd.simulator.avia import avia_directions
from civil_rgbd.simulator.catalogue import caster_for
from civil_rgbd.simulator.returns import range_sigma_m, return_probability, signal
from civil_rgbd.simulator.scene import SKY
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.site_rays import Hits
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.simulator.texture import MATERIALS
from civil_rgbd.simulator.walk import START_NS, T_IMU_LIDAR, dense_imu_poses, imu_poses
from civil_rgbd.simulator.waves import cosine, sine

MESSAGE_NS: Final = NS_PER_S // 10
"""Time that one message covers."""
LINES: Final = AVIA_LINES
NOISE_TAG: Final = 0b10
"""Livox tag of a return that may be spatial noise."""

# The demo's rosette. Three prisms turn the beam; their deflections add up like clock hands. Speeds
# are those of the nearest published design (631.7 rpm and some -4.9 times that), with a ratio that
# is no fraction, so that the pattern never closes. Field of view: 70.4 deg wide, 77.2 deg high over
# six lines.
_PRISM_HZ = (631.7 / 60, -631.7 / 60 * 4.9063714, 631.7 / 60 * 0.3819660)
_PRISM_DEG = (16.3, 17.2, 1.7)
_LINE_STEP_DEG = (77.2 - 70.4) / (LINES - 1)

# At an edge two echoes of one pulse run together unless they lie further apart than it is long,
# about 10 ns; the sensor notices most of what comes of it. Assumptions.
_PULSE_M = 1.5
_SMALLEST_STEP_M = 0.1
_TAGGED_SHARE = 0.8
_FOOTPRINT_WIDTH = 0.03 / 0.28  # of its height: Livox Avia user manual


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
    beams = _beams(spec, stamp_ns - START_NS + offset_ns, line)
    look = _Look(spec, stamp_ns + offset_ns)
    hits = look.along(beams)
    strength = signal(look.reflectivity(hits), np.maximum(hits.distances, 1e-3), hits.cosines)
    rng = np.random.default_rng([spec.seed, 1, index])
    range_m = hits.distances + _sigma_m(spec, hits, strength) * rng.standard_normal(count)
    returned = hits.triangles != SKY
    returned &= (range_m >= spec.min_range_m) & (range_m <= spec.max_range_m)
    noise = returned & (rng.random(count) < spec.false_return_share)
    range_m = np.where(noise, range_m * rng.uniform(0.3, 0.95, count), range_m)
    rng = np.random.default_rng([spec.seed, 5, index])  # of its own: those above stay as they were
    if spec.range_at_10_percent_m:
        share = return_probability(strength, range_at_10_percent_m=spec.range_at_10_percent_m)
        returned &= rng.random(count) < share
    if spec.beam_width_deg:
        beside = look.along(_beside(beams, spec.beam_width_deg, rng))
        range_m, tagged = _mixed(range_m, hits, beside, spec.beam_width_deg, rng)
        noise |= returned & tagged
    returned &= range_m >= spec.min_range_m
    return LivoxScan(
        stamp_ns,
        (beams * np.where(returned, range_m, 0.0)[:, np.newaxis] + 0.0).astype(np.float32),
        offset_ns.astype(np.uint32),
        np.where(returned, look.reflectivity(hits), 0).astype(np.uint8),
        np.where(returned & noise, NOISE_TAG, 0).astype(np.uint8),
        line,
    )


def _beams(
    spec: ScanSpec, since_start_ns: NDArray[np.int64], line: NDArray[np.uint8]
) -> NDArray[np.float64]:
    if spec.pattern == "avia":
        return avia_directions(since_start_ns[::LINES])  # the six fire as one
    return beam_directions(since_start_ns, line)


class _Look:
    """Where the sensor is during one message, and what it meets from there."""

    def __init__(self, spec: ScanSpec, stamps_ns: NDArray[np.int64]) -> None:
        self._caster = caster_for(spec)
        self._t_s = (stamps_ns - START_NS) / NS_PER_S
        # The demo's points keep their last bit.
        poses = imu_poses if self._caster.site.path is None else dense_imu_poses
        translations, self._quaternions = poses(spec, stamps_ns)
        # T_IMU_LIDAR does not turn: LiDAR directions are IMU directions.
        mount = np.broadcast_to(T_IMU_LIDAR[:3, 3], translations.shape)
        here = translations - np.asarray(spec.map_offset_m)
        self._origins_m = here + rotate(self._quaternions, mount)

    def along(self, beams: NDArray[np.float64]) -> Hits:
        """Cast (N, 3) directions of the LiDAR frame, each at its own time."""
        return self._caster.cast(self._origins_m, rotate(self._quaternions, beams), self._t_s)

    def reflectivity(self, hits: Hits) -> NDArray[np.float64]:
        """Return what Livox reports of (N,) hits: 0 to 255."""
        table = _reflectivities(self._caster.site)
        return np.where(hits.triangles == SKY, 0.0, table[hits.triangles])


@lru_cache(maxsize=4)
def _reflectivities(site: Site) -> NDArray[np.float64]:
    return np.array([MATERIALS[str(name)].reflectivity for name in site.materials], dtype=float)


def _sigma_m(
    spec: ScanSpec, hits: Hits, strength: NDArray[np.float64]
) -> float | NDArray[np.float64]:
    if not (spec.range_at_10_percent_m and spec.range_noise_m):
        return spec.range_noise_m
    return range_sigma_m(strength, hits.distances, hits.cosines, at_20_m=spec.range_noise_m)


def _beside(
    beams: NDArray[np.float64], height_deg: float, rng: np.random.Generator
) -> NDArray[np.float64]:
    """Return directions (N, 3), one anywhere in the footprint of each beam; not quite unit."""
    reach = height_deg / 180 * np.pi
    up = rng.uniform(-0.5, 0.5, len(beams)) * reach
    left = rng.uniform(-0.5, 0.5, len(beams)) * (reach * _FOOTPRINT_WIDTH)
    return beams + np.stack([np.zeros(len(beams)), left, up], axis=1)


def _mixed(
    range_m: NDArray[np.float64],
    hits: Hits,
    beside: Hits,
    height_deg: float,
    rng: np.random.Generator,
) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
    """Mix ranges whose footprint spans an edge: (N,) ranges, (N,) which of them are tagged."""
    step_m = beside.distances - hits.distances
    # A plane that slants spans many ranges, too, and is no edge.
    slant = (height_deg / 180 * np.pi) * hits.distances / np.maximum(hits.cosines, 1e-3)
    mixed = (hits.triangles != SKY) & (beside.triangles != SKY)
    mixed &= (np.abs(step_m) > _SMALLEST_STEP_M + slant) & (np.abs(step_m) < _PULSE_M)
    share, tagged = rng.random(len(range_m)), rng.random(len(range_m)) < _TAGGED_SHARE
    return np.where(mixed, range_m + share * step_m, range_m), mixed & tagged
