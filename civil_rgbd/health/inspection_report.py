"""An inspected recording, told on one screen or as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict, dataclass
from typing import Final

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.inspection import NOT_OPENED, CloudFacts, RecordingSummary, TopicSummary
from civil_rgbd.geometry.words import extrinsics_in_words
from civil_rgbd.health.clocks import clock_in_words
from civil_rgbd.health.findings import Finding

_ROLES: Final = ("lidar", "image", "camera_info", "pose", "imu", "tf")
_SHOWN_TOPICS: Final = 12
_SHOWN_OF_A_KIND: Final = 3
_SHOWN_FIELDS: Final = 6
_WIDEST_NAME: Final = 38
_PROMPT_NS: Final = NS_PER_S // 1000
_ANOTHER_CLOCK_NS: Final = 1000 * NS_PER_S  # no message travels a quarter of an hour


@dataclass(frozen=True, slots=True)
class InspectionReport:
    """What a recording holds and what it lacks.

    Attributes:
        summary: what it holds.
        findings: what it lacks or what is odd, errors first.
        files: how many it was split into.
    """

    summary: RecordingSummary
    findings: tuple[Finding, ...]
    files: int = 1

    @property
    def errors(self) -> int:
        """How many findings keep a build from starting."""
        return sum(finding.level == "error" for finding in self.findings)

    def to_document(self) -> dict[str, object]:
        """Return all of it for machines."""
        summary = self.summary
        T = summary.T_lidar_camera
        return {
            "name": summary.name,
            "files": self.files,
            "converter": summary.converter,
            "size_bytes": summary.size_bytes,
            "messages": summary.messages,
            "logged": asdict(summary.logged) if summary.logged else None,
            "topics": [asdict(topic) for topic in summary.topics],
            "fixed_links": [list(link) for link in summary.fixed_links],
            "moving_links": [list(link) for link in summary.moving_links],
            "damage": list(summary.damage),
            "remarks": list(summary.remarks),
            "T_lidar_camera": None if T is None else T.tolist(),
            "build_can_start": not self.errors,
            "build_warnings": list(summary.warnings),
            "findings": [finding.to_document() for finding in self.findings],
        }

    def to_text(self) -> str:
        """Return it for people: one screen."""
        return "\n".join(
            [
                _headline(self.summary, self.files),
                *_topic_lines(self.summary),
                *_clock_lines(self.summary),
                *_frame_lines(self.summary),
                *_finding_lines(self.findings),
                self._verdict(),
            ]
        )

    def _verdict(self) -> str:
        if not self.errors:
            return "a build can start"
        things = "1 thing is" if self.errors == 1 else f"{self.errors} things are"
        return f"no build can start yet: {things} in its way"


def _headline(summary: RecordingSummary, files: int) -> str:
    more = "1 more file" if files == 2 else f"{files - 1} more files"
    name = summary.name if files == 1 else f"{summary.name} and {more}"
    if summary.converter == NOT_OPENED:
        return f"{name}: {NOT_OPENED}, so nothing is known of what it holds"
    logged = summary.logged
    span_s = (logged.last_ns - logged.first_ns) / NS_PER_S if logged else 0.0
    return (
        f"{name}: {summary.converter}, {_size(summary.size_bytes)}, {_amount(summary)} "
        f"over {span_s:.1f} s, {'damaged' if summary.damage else 'whole'}"
    )


def _amount(summary: RecordingSummary) -> str:
    if not summary.lidar_only:
        topics = f"{len(summary.topics)} topic{'s' * (len(summary.topics) != 1)}"
        return f"{summary.messages} messages in {topics}"
    roles = (("lidar", "scan"), ("imu", "IMU reading"))
    counts = [(sum(t.messages for t in summary.of_role(role)), what) for role, what in roles]
    said = [f"{count} {what}{'s' * (count != 1)}" for count, what in counts if count]
    return " and ".join(said) or "no scans"


def _size(size_bytes: int) -> str:
    for unit, bytes_of in (("GB", 1e9), ("MB", 1e6), ("kB", 1e3)):
        if size_bytes >= bytes_of:
            return f"{size_bytes / bytes_of:.1f} {unit}"
    return f"{size_bytes} bytes"


def _topic_lines(summary: RecordingSummary) -> Iterator[str]:
    used = [topic for role in _ROLES for topic in summary.of_role(role)]
    shown = used[:_SHOWN_TOPICS]
    if shown:
        named = "sensor" if summary.lidar_only else "topic"
        width = max(len(named), *(len(_clipped(topic.name)) for topic in shown))
        kinds = max(4, *(len(_kind(topic)) for topic in shown))
        yield f"  {named:{width}}  {'type':{kinds}} messages     rate  holds"
        for topic in shown:
            yield (
                f"  {_clipped(topic.name):{width}}  {_kind(topic):{kinds}} {topic.messages:8} "
                f"{_rate(topic):>8}  {_holds(topic)}"
            ).rstrip()
    if len(used) > len(shown):
        yield f"  ... and {len(used) - len(shown)} more of these kinds (--json lists them)"
    others = [topic for topic in summary.topics if topic not in used]
    if others:
        names = ", ".join(f"{topic.name} ({_kind(topic)})" for topic in others[:_SHOWN_OF_A_KIND])
        more = f", ... and {len(others) - _SHOWN_OF_A_KIND} more"
        yield f"  not read by a build: {names}{more if len(others) > _SHOWN_OF_A_KIND else ''}"


def _clipped(name: str) -> str:
    return name if len(name) <= _WIDEST_NAME else f"...{name[3 - _WIDEST_NAME :]}"


def _kind(topic: TopicSummary) -> str:
    return topic.type_name.rpartition("/")[2]


def _rate(topic: TopicSummary) -> str:
    timing = topic.stamped or topic.logged
    return f"{timing.rate_hz:.1f} Hz" if timing and timing.period_ns and topic.role != "tf" else ""


def _holds(topic: TopicSummary) -> str:
    if topic.fault is not None:
        return "broken messages"
    if topic.cloud is not None:
        return _cloud_in_words(topic.cloud)
    if topic.image is not None:
        size = f" {topic.image.width_px}x{topic.image.height_px}" if topic.image.width_px else ""
        return f"{topic.image.encoding}{size}{'' if topic.image.photograph else ' (depth)'}"
    if topic.camera is not None:
        said = topic.camera.model if topic.camera.calibrated else "not calibrated"
        return f"{topic.camera.width_px}x{topic.camera.height_px} {said}"
    if topic.role == "pose":
        child = next((name for name in topic.children if name), "?")
        return f"{topic.frames[0] if topic.frames else '?'} -> {child}"
    return ""


def _cloud_in_words(cloud: CloudFacts) -> str:
    time_field = (cloud.point_time or "").partition(",")[0]
    names = [name for name, _ in cloud.fields if name != time_field]
    more = f" +{len(names) - _SHOWN_FIELDS}" if len(names) > _SHOWN_FIELDS else ""
    times = f"times: {cloud.point_time}" if cloud.point_time else "no point times"
    if cloud.unclear_time:
        times = "times unclear"
    return f"{cloud.points} points: {' '.join(names[:_SHOWN_FIELDS])}{more}; {times}"


def _clock_lines(summary: RecordingSummary) -> Iterator[str]:
    """One line for each clock reading; topics that say the same share it."""
    said: dict[str, list[str]] = {}
    for role in ("lidar", "image", "pose", "imu"):
        for topic in summary.of_role(role):
            if topic.stamped is not None:
                words = clock_in_words(topic.stamped) + _lateness(topic)
                said.setdefault(words, []).append(_clipped(topic.name))
    for number, (words, names) in enumerate(list(said.items())[:_SHOWN_TOPICS]):
        start = "  clocks  " if not number else "          "
        listed = ", ".join(names[:_SHOWN_OF_A_KIND])
        more = f", {len(names) - _SHOWN_OF_A_KIND} more" if len(names) > _SHOWN_OF_A_KIND else ""
        yield f"{start}{words}: {listed}{more}"
    if len(said) > _SHOWN_TOPICS:
        yield f"          ... and {len(said) - _SHOWN_TOPICS} more (--json lists them)"


def _lateness(topic: TopicSummary) -> str:
    if topic.log_minus_stamp_ns is None:
        return ""
    least_ns, middle_ns, most_ns = topic.log_minus_stamp_ns
    if max(abs(least_ns), abs(most_ns)) < _PROMPT_NS:
        return ""
    if abs(middle_ns) > _ANOTHER_CLOCK_NS:
        return ", the recorder's clock is another"
    return f", recorded {middle_ns / NS_PER_S:.3f} s later (at most {most_ns / NS_PER_S:.3f})"


def _frame_lines(summary: RecordingSummary) -> Iterator[str]:
    for start, links in (("tf", summary.fixed_links), ("moving", summary.moving_links)):
        if links:
            listed = ", ".join(f"{parent} -> {child}" for parent, child in links[:4])
            more = f", {len(links) - 4} more" if len(links) > 4 else ""
            yield f"  {start:8}{listed}{more}"
    if summary.T_lidar_camera is not None:
        sits, _, looks = extrinsics_in_words(summary.T_lidar_camera).partition(", looks")
        yield f"  rig     {sits},"
        yield f"          looks{looks}"


def _finding_lines(findings: tuple[Finding, ...]) -> Iterator[str]:
    codes = list(dict.fromkeys(finding.code for finding in findings))
    for code in codes:
        same = [finding for finding in findings if finding.code == code]
        for finding in same[:_SHOWN_OF_A_KIND]:
            yield f"{finding.level}: {finding.code}: {finding.message}"
        if len(same) > _SHOWN_OF_A_KIND:
            yield f"  ... and {len(same) - _SHOWN_OF_A_KIND} more (--json lists them)"
        yield f"  {'fix' if same[0].level == 'error' else 'note'}: {same[0].fix}"
