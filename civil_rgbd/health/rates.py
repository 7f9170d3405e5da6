"""Does every sensor deliver what it should? Rates, missing messages, silences, drifting clocks."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.inspection import RecordingSummary, Timing, TopicSummary
from civil_rgbd.health.checks import CHECKS, Figure

_CODES: Final = {
    # rate, missing, silence
    "lidar": ("lidar-rate", "scans-dropped", "lidar-gap"),
    "image": ("image-rate", "images-dropped", "image-gap"),
    "imu": ("imu-rate", "imu-dropped", "imu-gap"),
    "pose": ("pose-rate", "", "pose-gap"),
}
_NAMES: Final = {"lidar": "the LiDAR", "image": "the camera", "imu": "the IMU"}


def rate_figures(role: str, stamps_ns: NDArray[np.int64]) -> Iterator[Figure]:
    """Judge when a sensor's messages were stamped.

    Args:
        role: lidar, image, imu or pose.
        stamps_ns: (M,) int64 header stamps.
    """
    rate, missing, silence = _CODES[role]
    ordered = np.unique(stamps_ns)
    if len(ordered) < 3:
        few = f"only {len(ordered)} messages"
        yield from (Figure(code, None, few) for code in (rate, missing, silence) if code)
        return
    steps = np.diff(ordered)
    period = float(np.median(steps))
    yield Figure(rate, NS_PER_S / period, f"{len(ordered)} over {_seconds(steps.sum())}")
    lost = np.maximum(np.rint(steps / period) - 1, 0)
    if missing:
        share = 100 * float(lost.sum() / (len(ordered) + lost.sum()))
        yield Figure(missing, share, f"{int(lost.sum())} of {len(ordered) + int(lost.sum())}")
    longest = int(steps.argmax())
    at = f"{_seconds(ordered[longest] - ordered[0])} after the first"
    yield Figure(silence, float(steps[longest]) / NS_PER_S, at)


def timing_figures(role: str, messages: int, timing: Timing) -> Iterator[Figure]:
    """Judge a sensor by the summary of its stamps alone, as of topics that are not read.

    Args:
        role: lidar, image, imu or pose.
        messages: how many there are.
        timing: of their header stamps.
    """
    rate, missing, silence = _CODES[role]
    if messages < 3 or not timing.period_ns:
        few = f"only {messages} messages"
        yield from (Figure(code, None, few) for code in (rate, missing, silence) if code)
        return
    span_ns = timing.last_ns - timing.first_ns
    yield Figure(rate, timing.rate_hz, f"{messages} over {_seconds(span_ns)}")
    whole = round(span_ns / timing.period_ns) + 1
    lost = max(0, whole - messages)
    if missing:
        yield Figure(missing, 100 * lost / (messages + lost), f"{lost} of {messages + lost}")
    at = f"{_seconds(timing.longest_gap_at_ns - timing.first_ns)} after the first"
    yield Figure(silence, timing.longest_gap_ns / NS_PER_S, at)


def _seconds(ns: float) -> str:
    return f"{ns / NS_PER_S:.1f} s"


def drift_figure(summary: RecordingSummary | None, chosen: dict[str, TopicSummary]) -> Figure:
    """Compare how header stamps run against the recorder's clock, sensor by sensor.

    Args:
        summary: None where the source knows no log times.
        chosen: the topics by role; the LiDAR's clock is the one that others are compared with.
    """
    lidar = chosen.get("lidar")
    if summary is None or lidar is None or lidar.lateness_drift_ns is None:
        return Figure("clock-drift", None, "too few log times to compare stamps with")
    worst: tuple[float, float, str] | None = None
    for role, name in _NAMES.items():
        topic = chosen.get(role)
        if topic is None or role == "lidar" or topic.lateness_drift_ns is None:
            continue
        drift = topic.lateness_drift_ns[0] - lidar.lateness_drift_ns[0]
        doubt = float(np.hypot(topic.lateness_drift_ns[1], lidar.lateness_drift_ns[1]))
        if worst is None or abs(drift) > abs(worst[0]):
            worst = drift, doubt, name
    if worst is None:
        return Figure("clock-drift", None, "no other sensor has log times")
    drift_ms, doubt_ms = worst[0] / 1e6, worst[1] / 1e6
    sense = "falls behind" if drift_ms > 0 else "runs ahead of"
    said = f"{worst[2]}'s clock {sense} the LiDAR's"
    if doubt_ms > CHECKS["clock-drift"].limit / 3:
        return Figure(
            "clock-drift", None, f"messages are logged too unevenly: +- {doubt_ms:.0f} ms"
        )
    return Figure("clock-drift", abs(drift_ms), said, sigma=doubt_ms)
