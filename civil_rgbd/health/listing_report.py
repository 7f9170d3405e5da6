"""The topics of a recording, told on one screen or as JSON."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import asdict

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.inspection import TopicListing, TopicSummary


def listing_text(listing: TopicListing) -> str:
    """Return a listing for people."""
    return "\n".join(_lines(listing))


def listing_document(listing: TopicListing) -> dict[str, object]:
    """Return a listing for machines."""
    known = ("name", "type_name", "role", "encoding", "messages", "logged")
    return {
        "name": listing.name,
        "converter": listing.converter,
        "size_bytes": listing.size_bytes,
        "by_index": listing.by_index,
        "topics": [{key: asdict(topic)[key] for key in known} for topic in listing.topics],
        "damage": list(listing.damage),
        "remarks": list(listing.remarks),
    }


def _lines(listing: TopicListing) -> Iterator[str]:
    logged = [topic.logged for topic in listing.topics if topic.logged]
    first, last = (
        min((timing.first_ns for timing in logged), default=0),
        max((timing.last_ns for timing in logged), default=0),
    )
    how = "by its index: no message was read" if listing.by_index else "by looking at every message"
    yield (
        f"{listing.name}: {listing.converter}, {listing.size_bytes / 1e6:,.1f} MB, "
        f"{sum(topic.messages for topic in listing.topics)} messages in {len(listing.topics)} "
        f"topics over {(last - first) / NS_PER_S:.1f} s, {how}"
    )
    width = max((len(topic.name) for topic in listing.topics), default=0)
    kinds = max((len(topic.type_name) for topic in listing.topics), default=0)
    for topic in listing.topics:
        line = f"  {topic.name:{width}}  {topic.type_name:{kinds}} {topic.messages:8}"
        yield f"{line} {_rate(topic):>9}  {_gaps(topic)}".rstrip()
    yield from (f"damage: {what}" for what in listing.damage)
    yield from (f"note: {what}" for what in listing.remarks)


def _rate(topic: TopicSummary) -> str:
    return f"{topic.logged.rate_hz:.1f} Hz" if topic.logged and topic.logged.period_ns else ""


def _gaps(topic: TopicSummary) -> str:
    logged = topic.logged
    if logged is None or not logged.gaps:
        return ""
    return f"longest gap {logged.longest_gap_ns / NS_PER_S:.2f} s"
