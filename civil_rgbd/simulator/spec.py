"""What to simulate: the frozen description from which everything else follows."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields, replace
from typing import Final
from urllib.parse import parse_qsl

from civil_rgbd.errors import UsageError
from civil_rgbd.resources import nearest

BRIDGES: Final = ("demo", "B1", "B2", "B3", "B4", "B5", "mesh")
"""The bridges that can be simulated."""

PATTERNS: Final = ("rosette", "avia")
"""What the LiDAR's beams draw: the demo's plain rosette, or what the vendor's Avia does."""

PREFIX: Final = "simulated:"
"""What a location of a simulated recording starts with."""

_LIMITS: Final[dict[str, tuple[float, float]]] = {
    "seconds": (0.2, 3600.0),
    "seed": (0, 2**32 - 1),
    "image_rate_hz": (0.5, 60.0),
    "image_scale": (0.05, 1.0),
    "jpeg_quality": (1, 100),
    "point_rate_hz": (600, 240_000),
    "range_noise_m": (0.0, 1.0),
    "false_return_share": (0.0, 0.5),
    "min_range_m": (0.0, 10.0),
    "max_range_m": (10.0, 450.0),
    "camera_time_offset_s": (-1e6, 1e6),
    "speed_m_s": (0.0, 3.0),
    "moving": (0, 1),
    "scene_seed": (0, 2**32 - 1),
    "range_at_10_percent_m": (0.0, 450.0),
    "beam_width_deg": (0.0, 1.0),
    "stands_s": (0.0, 60.0),
    "starts_m": (0.0, 1000.0),
    "sway": (0.0, 3.0),
    "imu_noise": (0.0, 100.0),
    "drift_m_per_root_s": (0.0, 1.0),
    "yaw_drift_deg_per_root_s": (0.0, 10.0),
    "exposure_settles_s": (0.0, 10.0),
    "exposure_s": (0.0, 0.1),
}

_YOUNGER: Final = frozenset(
    {
        "moving", "scene_seed", "pattern", "range_at_10_percent_m", "beam_width_deg", "stands_s",
        "starts_m", "sway", "imu_noise", "drift_m_per_root_s", "yaw_drift_deg_per_root_s",
        "exposure_settles_s", "exposure_s", "mesh",
    }
)  # fmt: skip
"""Settings that a spec's text leaves out at their defaults: elder specs keep their hashes."""


@dataclass(frozen=True, slots=True)
class ScanSpec:
    """One scan of one bridge. The defaults are the demo's: exact ranges, calibrated sensors.

    Attributes:
        bridge: one of :data:`BRIDGES`.
        seconds: length of the walk.
        seed: of everything random.
        image_rate_hz: images a second.
        image_scale: image size / 1280x720.
        jpeg_quality: of the raw images.
        point_rate_hz: LiDAR points a second, returns or not; a multiple of 60.
        range_noise_m: standard deviation of ranges; with ``range_at_10_percent_m``, of those to
            concrete that faces the sensor 20 m away.
        false_return_share: share of returns that lie in front of the surface, tagged as noise.
        min_range_m: nearer surfaces give no return.
        max_range_m: further surfaces give no return.
        camera_time_offset_s: to be added to image stamps to reach the LiDAR clock.
        extrinsic_error_deg: how wrong the recording states the camera's rotation, about the
            camera's x, y and z.
        extrinsic_error_m: how wrong it states the camera's place, along the camera's x, y and z.
        map_offset_m: where the scene's origin lies in the map; large for UTM-like maps.
        speed_m_s: of the walk where it is fastest; 0 stands still.
        moving: 1 = cars and people move about, 0 = they are left out.
        scene_seed: of plants, cars and people.
        pattern: one of :data:`PATTERNS`.
        range_at_10_percent_m: how far a surface that faces the sensor and throws 10 % of the light
            back may be for half of the pulses to return; pulses from surfaces that are darker,
            further or slanting get lost and noisy. 0: no pulse does.
        beam_width_deg: height of the beam's footprint, which at edges mixes two ranges into one;
            the Avia's is 0.28. 0: a ray.
        stands_s: how long the walker stands still before setting off.
        starts_m: how far along the way the walk begins.
        sway: how much of the walker's looking around and swaying, 1 = as a person does.
        imu_noise: noise and biases of the IMU, 1 = those of the Avia's.
        drift_m_per_root_s: random walk of the recorded poses, on each axis: after T seconds they
            are off by this times the root of T, 1 sigma.
        yaw_drift_deg_per_root_s: random walk of their heading.
        exposure_settles_s: how long after the start images are visibly over-exposed. 0: never.
        exposure_s: how long the shutter is open, which blurs. 0: an instant.
        mesh: of the bridge ``mesh``, the OBJ file to read, or a folder of them; metres, z up.
    """

    bridge: str = "demo"
    seconds: float = 7.0
    seed: int = 0
    image_rate_hz: float = 10.0
    image_scale: float = 1.0
    jpeg_quality: int = 90
    point_rate_hz: int = 240_000
    range_noise_m: float = 0.0
    false_return_share: float = 0.0
    min_range_m: float = 1.0
    max_range_m: float = 200.0
    camera_time_offset_s: float = 0.0
    extrinsic_error_deg: tuple[float, float, float] = (0.0, 0.0, 0.0)
    extrinsic_error_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    map_offset_m: tuple[float, float, float] = (0.0, 0.0, 0.0)
    speed_m_s: float = 1.3
    moving: int = 1
    scene_seed: int = 0
    pattern: str = "rosette"
    range_at_10_percent_m: float = 0.0
    beam_width_deg: float = 0.0
    stands_s: float = 0.0
    starts_m: float = 0.0
    sway: float = 1.0
    imu_noise: float = 0.0
    drift_m_per_root_s: float = 0.0
    yaw_drift_deg_per_root_s: float = 0.0
    exposure_settles_s: float = 0.0
    exposure_s: float = 0.0
    mesh: str = ""

    def __post_init__(self) -> None:
        if self.bridge not in BRIDGES:
            raise ValueError(f"no bridge is called {self.bridge!r}")
        if (self.bridge == "mesh") != bool(self.mesh):
            raise ValueError("the bridge 'mesh', and no other, is read from a file: mesh=PATH")
        if self.pattern not in PATTERNS:
            raise ValueError(f"pattern is {self.pattern!r}, not one of {', '.join(PATTERNS)}")
        for name, (low, high) in _LIMITS.items():
            value = getattr(self, name)
            if not (math.isfinite(value) and low <= value <= high):
                raise ValueError(f"{name} is {value!r}, not between {low:g} and {high:g}")
        if self.point_rate_hz % 60:
            raise ValueError(
                f"point_rate_hz is {self.point_rate_hz}, not a multiple of 60, such as "
                f"{max(1, round(self.point_rate_hz / 60)) * 60} (10 messages a second, 6 lines)"
            )
        for name in ("extrinsic_error_deg", "extrinsic_error_m", "map_offset_m"):
            if not all(map(math.isfinite, getattr(self, name))):
                raise ValueError(f"{name} is {getattr(self, name)!r}, not finite")

    def document(self) -> dict[str, object]:
        """Return all of it as plain JSON values."""
        younger = {f.name: f.default for f in fields(self) if f.name in _YOUNGER}
        said = {k: v for k, v in asdict(self).items() if k not in younger or v != younger[k]}
        return json.loads(json.dumps(said))  # type: ignore[no-any-return]  # tuples become lists

    def text(self) -> str:
        """Return all of it as JSON text; equal specs give equal text."""
        return json.dumps(self.document(), sort_keys=True)

    def sha256(self) -> str:
        """Return the hash of :meth:`text`, lower-case hex."""
        return hashlib.sha256(self.text().encode()).hexdigest()


_FIELD: Final[dict[str, str | float]] = {
    "seconds": 30.0,
    "image_rate_hz": 30.0,
    "range_noise_m": 0.02,
    "false_return_share": 0.001,
    "speed_m_s": 1.0,
    "pattern": "avia",
    "range_at_10_percent_m": 190.0,
    "stands_s": 2.0,
    "imu_noise": 1.0,
    "drift_m_per_root_s": 0.01,
    "yaw_drift_deg_per_root_s": 0.02,
}
# Noise, range and its 10 % target: Livox Avia user manual. Drift: an assumption; LiDAR odometry
# that goes well is off by 1 cm within the second that fills a frame, and by 0.1 m a minute.


def usual_spec(bridge: str, *, mesh: str = "") -> ScanSpec:
    """Return how a bridge is scanned unless the user says otherwise.

    The demo is exact; the others are scanned as in the field: the vendor's pattern, noise, pulses
    that get lost, an IMU that errs and poses that drift.

    Raises:
        ValueError: there is no such bridge.

    >>> usual_spec("demo") == ScanSpec()
    True
    """
    settings = {} if bridge == BRIDGES[0] else _FIELD
    return ScanSpec(bridge, mesh=mesh, **settings)  # type: ignore[arg-type]  # by name


def spec_from_settings(settings: Mapping[str, str | float], *, where: object) -> ScanSpec:
    """Turn what a user typed into a spec.

    Args:
        settings: fields of :class:`ScanSpec` by name; text or numbers.
        where: what the user typed them into, for the error.

    Raises:
        UsageError: a name is unknown, or a value does not fit.

    >>> spec_from_settings({"seconds": "2"}, where="--seconds").seconds
    2.0
    """
    # Tuples cannot be typed into one option or location; a program sets them.
    kinds = {f.name: type(f.default) for f in fields(ScanSpec) if not isinstance(f.default, tuple)}
    values: dict[str, str | float] = {}
    for name, given in settings.items():
        if name not in kinds:
            raise UsageError(
                f"no setting of the simulator is called {name!r}",
                where=where,
                fix=nearest(name, kinds),
            )
        if name == "bridge" and given not in BRIDGES:
            raise UsageError(
                f"no simulated bridge is called {given!r}",
                where=where,
                fix=nearest(str(given), BRIDGES),
            )
        values[name] = _converted(name, given, kinds[name], where=where)
    try:
        usual = usual_spec(str(values.get("bridge", BRIDGES[0])), mesh=str(values.get("mesh", "")))
        return replace(usual, **values)  # type: ignore[arg-type]  # converted field by field above
    except ValueError as error:
        raise UsageError(str(error), where=where, fix="choose such a value") from error


def _converted(name: str, given: str | float, kind: type, *, where: object) -> str | float:
    try:
        value: str | float = kind(given)
    except (ValueError, OverflowError) as error:
        words = {int: "a whole number", float: "a number"}[kind]
        raise UsageError(
            f"{name} is {given!r}, not {words}", where=where, fix=f"give {words}"
        ) from error
    return value


def spec_from_location(location: str) -> ScanSpec:
    """Read a location such as ``simulated:demo?seconds=6&seed=1``.

    Raises:
        UsageError: the bridge or a setting is unknown, or a value does not fit.

    >>> spec_from_location("simulated:demo?seconds=6&seed=1").seed
    1
    """
    bridge, _, query = location.removeprefix(PREFIX).partition("?")
    settings: dict[str, str | float] = {"bridge": bridge or "demo"}
    try:
        settings.update(parse_qsl(query, strict_parsing=True) if query else [])
    except ValueError as error:
        raise UsageError(
            f"the settings {query!r} are not of the form name=value&name=value",
            where=location,
            fix="for example `simulated:demo?seconds=6&seed=1`",
        ) from error
    return spec_from_settings(settings, where=location)
