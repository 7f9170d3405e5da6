"""Which clock a stamp comes from, and whether the sensors' clocks agree."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from typing import Final

import numpy as np

from civil_rgbd.constants import MAX_POINT_TIME_OFFSET_NS, NS_PER_S
from civil_rgbd.domain.inspection import Timing, TopicSummary
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.health.findings import Finding

_YEAR_S: Final = 31_557_600
_POWER_ON_S: Final = 10 * _YEAR_S
"""Stamps below ten years count from some start; no sensor of 1980 records."""


def clock_in_words(timing: Timing) -> str:
    """Say which clock stamps come from.

    >>> clock_in_words(Timing(12_500_000_000, 14_000_000_000))
    '12.500 to 14.000 s since power-on'
    """
    first_s, last_s = timing.first_ns / NS_PER_S, timing.last_ns / NS_PER_S
    if not timing.last_ns:
        return "0: no stamps"
    if last_s < _POWER_ON_S:
        return f"{first_s:.3f} to {last_s:.3f} s since power-on"
    start = datetime.fromtimestamp(timing.first_ns // NS_PER_S, tz=UTC)
    part_ms = timing.first_ns % NS_PER_S // 1_000_000
    return f"{start:%Y-%m-%d %H:%M:%S}.{part_ms:03d} UTC + {last_s - first_s:.3f} s"


def counts_from_power_on(timing: Timing) -> bool:
    """Whether a clock counts from the start of its sensor rather than from 1970."""
    return 0 < timing.last_ns < _POWER_ON_S * NS_PER_S


def clock_findings(
    lidars: tuple[TopicSummary, ...],
    images: tuple[TopicSummary, ...],
    poses: tuple[TopicSummary, ...],
    options: RecordingOptions,
) -> Iterator[Finding]:
    """Compare the ranges of the chosen sensors' stamps, as a build does.

    Args:
        lidars: the point clouds; more than one are left to the choice.
        images: the images, likewise.
        poses: the poses, likewise.
        options: rig and trajectory.
    """
    chosen = [topics[0] for topics in (lidars, images, poses) if len(topics) == 1]
    stamped = [(topic, topic.stamped) for topic in chosen if topic.stamped is not None]
    for topic, timing in stamped:
        if not timing.last_ns:
            yield Finding("stamps-zero", f"{topic.name}: every header is stamped 0")
        elif counts_from_power_on(timing):
            yield Finding("power-on-clock", f"{topic.name}: {clock_in_words(timing)}")
    offsets_ns = {
        "image": round((options.rig.camera_time_offset_s or 0.0) * NS_PER_S),
        "pose": options.pose_offset_ns,
    }
    ranges = [
        (topic.name, *_range(topic, timing, offsets_ns.get(topic.role, 0)))
        for topic, timing in stamped
    ]
    if options.trajectory is not None:
        stamps = options.trajectory.stamps_ns
        ranges.append(("the trajectory", int(stamps[0]), int(stamps[-1])))
    yield from _apart(ranges)


def _range(topic: TopicSummary, timing: Timing, offset_ns: int) -> tuple[int, int]:
    reach_ns = MAX_POINT_TIME_OFFSET_NS if topic.cloud and topic.cloud.point_time else 0
    return timing.first_ns + offset_ns, timing.last_ns + offset_ns + reach_ns


def _apart(ranges: Iterable[tuple[str, int, int]]) -> Iterator[Finding]:
    every = list(ranges)
    if len(every) < 2:
        return
    firsts = np.array([first for _, first, _ in every])
    lasts = np.array([last for _, _, last in every])
    if firsts.max() <= lasts.min():
        return
    late, early = every[int(firsts.argmax())], every[int(lasts.argmin())]
    apart_s = (late[1] - early[2]) / NS_PER_S
    yield Finding(
        "clocks-apart",
        f"{late[0]} starts {apart_s:.3f} s after {early[0]} ends: no instant has both",
    )
