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

_SETTLES_S: Final = {"lidar": 1.0, "image": 1.0, "imu": 1.0, "pose": 2.0}
"""Drivers and recorders start one after another, and odometry waits for its first points."""

_NO_JITTER_NS: Final = 1_000
"""No recorder takes every message so evenly: such log times were made from the stamps."""

Span = tuple[int, int]
"""First and last instant, ns, in which a sensor is expected to measure, since others do."""


def rate_figures(
    role: str, stamps_ns: NDArray[np.int64], others: Span | None = None
) -> Iterator[Figure]:
    """Judge when a sensor's messages were stamped.

    Args:
        role: lidar, image, imu or pose.
        stamps_ns: (M,) int64 header stamps.
        others: when other sensors measured, by the same clock; None where nothing is known.
    """
    rate, missing, _ = _CODES[role]
    ordered = np.unique(stamps_ns)
    if len(ordered) < 3:
        few = f"only {len(ordered)} messages"
        yield from unknown_figures(role, few)
        return
    steps = np.diff(ordered)
    period = float(np.median(steps))
    yield Figure(rate, NS_PER_S / period, f"{len(ordered)} over {_seconds(steps.sum())}")
    lost = np.maximum(np.rint(steps / period) - 1, 0)
    if missing:
        share = 100 * float(lost.sum() / (len(ordered) + lost.sum()))
        yield Figure(missing, share, f"{int(lost.sum())} of {len(ordered) + int(lost.sum())}")
    longest = int(steps.argmax())
    span = int(ordered[0]), int(ordered[-1])
    at = _seconds(ordered[longest] - ordered[0])
    yield _silence(role, float(steps[longest]), at, _at_ends(role, span, period, others))


def timing_figures(
    role: str, messages: int, timing: Timing, others: Span | None = None
) -> Iterator[Figure]:
    """Judge a sensor by the summary of its stamps alone, as of topics that are not read.

    Args:
        role: lidar, image, imu or pose.
        messages: how many there are.
        timing: of their header stamps.
        others: when other sensors measured, by the same clock; None where nothing is known.
    """
    rate, missing, _ = _CODES[role]
    if messages < 3 or not timing.period_ns:
        few = f"only {messages} messages"
        yield from unknown_figures(role, few)
        return
    span_ns = timing.last_ns - timing.first_ns
    yield Figure(rate, timing.rate_hz, f"{messages} over {_seconds(span_ns)}")
    whole = round(span_ns / timing.period_ns) + 1
    lost = max(0, whole - messages)
    if missing:
        yield Figure(missing, 100 * lost / (messages + lost), f"{lost} of {messages + lost}")
    at = _seconds(timing.longest_gap_at_ns - timing.first_ns)
    ends = _at_ends(role, (timing.first_ns, timing.last_ns), timing.period_ns, others)
    yield _silence(role, timing.longest_gap_ns, at, ends)


def unknown_figures(role: str, why_not: str) -> Iterator[Figure]:
    """Say that nothing is known of a sensor.

    Args:
        role: lidar, image, imu or pose.
        why_not: in words.
    """
    yield from (Figure(code, None, why_not) for code in _CODES[role] if code)


def common_span(*stamps_ns: NDArray[np.int64]) -> Span | None:
    """Return when all of some sensors measured: None where they never did at the same time.

    >>> common_span(np.array([0, 50, 90]), np.array([20, 130]))
    (20, 90)
    """
    if not all(len(stamps) for stamps in stamps_ns):
        return None
    first = max(int(stamps.min()) for stamps in stamps_ns)
    last = min(int(stamps.max()) for stamps in stamps_ns)
    return (first, last) if first < last else None


def _at_ends(
    role: str, own: Span, period_ns: float, others: Span | None
) -> tuple[tuple[float, str], ...]:
    """Return the silences, ns, before the first and after the last message that are too long."""
    if others is None or own[1] < others[0] or others[1] < own[0]:
        return ()  # another clock: that is said elsewhere
    usual_ns = _SETTLES_S[role] * NS_PER_S + period_ns
    ends = ((own[0] - others[0], "at the start"), (others[1] - own[1], "at the end"))
    return tuple((float(silence), where) for silence, where in ends if silence > usual_ns)


def _silence(role: str, longest_ns: float, at: str, ends: tuple[tuple[float, str], ...]) -> Figure:
    code = _CODES[role][2]
    worst_ns, _ = max(ends, default=(0.0, ""))
    if worst_ns <= longest_ns:
        return Figure(code, longest_ns / NS_PER_S, f"{at} after the first")
    said = " and ".join(f"{_seconds(silence)} {place}" for silence, place in ends)
    return Figure(code, worst_ns / NS_PER_S, f"silent for {said}, while others record")


def _seconds(ns: float) -> str:
    return f"{ns / NS_PER_S:.1f} s"


def drift_figure(summary: RecordingSummary | None, chosen: dict[str, TopicSummary]) -> Figure:
    """Compare how header stamps run against the recorder's clock, sensor by sensor.

    Args:
        summary: None where the source knows no log times.
        chosen: the topics by role; the LiDAR's clock is the one that others are compared with.
    """
    sure_ms = CHECKS["clock-drift"].limit / 3
    logged, why_not = _by_log_times(summary, chosen)
    if not logged:
        return Figure("clock-drift", None, why_not)
    drift_ms, doubt_ms, name = max(logged, key=lambda drift: abs(drift[0]))
    if doubt_ms > sure_ms:
        return Figure(
            "clock-drift", None, f"messages are logged too unevenly: +- {doubt_ms:.0f} ms"
        )
    sense = "falls behind" if drift_ms > 0 else "runs ahead of" if drift_ms < 0 else "keeps up with"
    said = f"{name}'s clock {sense} the LiDAR's"
    return Figure("clock-drift", abs(drift_ms), said, sigma=doubt_ms)


def _by_log_times(
    summary: RecordingSummary | None, chosen: dict[str, TopicSummary]
) -> tuple[list[tuple[float, float, str]], str]:
    """Return drift and its standard error, ms, of each sensor; or why there is none."""
    lidar = chosen.get("lidar")
    if summary is None or lidar is None or lidar.lateness_drift_ns is None:
        return [], "too few log times to compare stamps with"
    drifts: list[tuple[float, float, str]] = []
    why_not = "no other sensor has log times"
    for role, name in _NAMES.items():
        topic = chosen.get(role)
        if topic is None or role == "lidar" or topic.lateness_drift_ns is None:
            continue
        if _made_of_stamps(lidar) and _made_of_stamps(topic):
            why_not = "log times follow the stamps to the microsecond: they were made from them"
            continue
        drift = topic.lateness_drift_ns[0] - lidar.lateness_drift_ns[0]
        doubt = float(np.hypot(topic.lateness_drift_ns[1], lidar.lateness_drift_ns[1]))
        drifts.append((drift / 1e6, doubt / 1e6, name))
    return drifts, why_not


def _made_of_stamps(topic: TopicSummary) -> bool:
    late = topic.log_minus_stamp_ns
    return late is not None and late[2] - late[0] <= _NO_JITTER_NS
