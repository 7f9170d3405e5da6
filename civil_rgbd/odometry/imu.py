"""The IMU as engines want it: in m/s2, in order of time, without doubles; and what was odd."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.motion import ImuReadings
from civil_rgbd.errors import RecordingError

STANDARD_GRAVITY_M_S2: Final = 9.80665

# A hand-held walk averages gravity out within some percent; the two units are a factor 9.8 apart.
_UNITS: Final = {"g": (0.8, 1.2, STANDARD_GRAVITY_M_S2), "m/s2": (8.0, 12.0, 1.0)}
_MIN_RATE_HZ: Final = 50.0
_LONGEST_GAP_S: Final = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class SteadyImu:
    """Readings in strictly ascending order of time.

    Attributes:
        stamps_ns: (M,) int64.
        rates_rad_s: (M, 3) float64.
        forces_m_s2: (M, 3) float64.
        unit: what the recording's forces were in: ``g`` or ``m/s2``.
        remarks: what was odd, in words.
    """

    stamps_ns: NDArray[np.int64]
    rates_rad_s: NDArray[np.float64]
    forces_m_s2: NDArray[np.float64]
    unit: str
    remarks: tuple[str, ...] = ()


def steady_imu(readings: ImuReadings, *, where: object) -> SteadyImu:
    """Put readings in order and in SI units.

    The unit is told from the size of gravity: the median length of the specific force is near 1
    or near 9.8 whatever the sensor's attitude.

    Raises:
        RecordingError: there are too few, they are not finite, or their size fits neither unit.
    """
    remarks: list[str] = []
    finite = np.isfinite(readings.rates_rad_s).all(axis=1) & np.isfinite(readings.forces).all(
        axis=1
    )
    if not finite.all():
        remarks.append(f"{int((~finite).sum())} IMU readings are not finite and are left out")
    kept = np.flatnonzero(finite)
    order = kept[np.argsort(readings.stamps_ns[kept], kind="stable")]
    moved = int((order != kept).sum())
    if moved:
        remarks.append(f"{moved} IMU readings were out of order and are put in order")
    stamps = readings.stamps_ns[order]
    first = np.ones(len(stamps), dtype=np.bool_)
    first[1:] = np.diff(stamps) > 0
    if not first.all():
        remarks.append(f"{int((~first).sum())} IMU readings repeat a stamp and are left out")
    order, stamps = order[first], stamps[first]
    _require_rate(stamps, where)
    unit, factor = _unit(readings.forces[order], where)
    gaps_s = np.diff(stamps) / NS_PER_S
    if gaps_s.max() > _LONGEST_GAP_S:
        at = int(np.argmax(gaps_s))
        remarks.append(
            f"{int((gaps_s > _LONGEST_GAP_S).sum())} gaps in the IMU, the longest "
            f"{gaps_s[at]:.2f} s after {(int(stamps[at]) - int(stamps[0])) / NS_PER_S:.2f} s"
        )
    return SteadyImu(
        stamps, readings.rates_rad_s[order], readings.forces[order] * factor, unit, tuple(remarks)
    )


def _require_rate(stamps_ns: NDArray[np.int64], where: object) -> None:
    span_s = (int(stamps_ns[-1]) - int(stamps_ns[0])) / NS_PER_S if len(stamps_ns) else 0.0
    rate_hz = (len(stamps_ns) - 1) / span_s if span_s > 0 else 0.0
    if rate_hz < _MIN_RATE_HZ:
        raise RecordingError(
            f"the IMU has {len(stamps_ns)} readings in {span_s:.2f} s ({rate_hz:.1f} Hz); "
            f"odometry needs {_MIN_RATE_HZ:.0f} Hz or more",
            where=where,
            fix="record the IMU at its full rate, or choose another with --imu-topic",
        )


def _unit(forces: NDArray[np.float64], where: object) -> tuple[str, float]:
    size = float(np.median(np.sqrt((forces**2).sum(axis=1))))
    for unit, (low, high, factor) in _UNITS.items():
        if low <= size <= high:
            return unit, factor
    raise RecordingError(
        f"the IMU's specific force has a median length of {size:.3g}: neither gravity in g (1.0) "
        "nor in m/s2 (9.8)",
        where=where,
        fix="choose another IMU with --imu-topic; one that takes gravity out cannot be used",
    )
