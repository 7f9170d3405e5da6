"""Messages as an MCAP file of ROS 2."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import IO, Final

from mcap.writer import CompressionType, Writer

from civil_rgbd.simulator.ros_schemas import ros2_name, schema_text

LIBRARY: Final = "civil_rgbd simulator"
"""What the header of the file says who wrote it."""

_CHUNK_BYTES: Final = 4 << 20


def write_mcap(
    stream: IO[bytes], topics: Mapping[str, str], messages: Iterable[tuple[int, str, bytes]]
) -> None:
    """Write messages, compressed and with checksums.

    Args:
        stream: where to.
        topics: their types, ``package/Type``.
        messages: log time, topic and CDR payload, in order.
    """
    writer = Writer(
        stream,
        chunk_size=_CHUNK_BYTES,
        compression=CompressionType.ZSTD,
        enable_crcs=True,
        enable_data_crcs=True,
    )
    writer.start(profile="ros2", library=LIBRARY)
    writer.add_metadata("civil_rgbd", {"origin": "simulated"})
    channels = {
        topic: writer.register_channel(
            topic,
            "cdr",
            writer.register_schema(ros2_name(kind), "ros2msg", schema_text(kind).encode()),
        )
        for topic, kind in topics.items()
    }
    counts = dict.fromkeys(topics, 0)
    for log_time_ns, topic, payload in messages:
        writer.add_message(
            channels[topic], log_time_ns, payload, log_time_ns, sequence=counts[topic]
        )
        counts[topic] += 1
    writer.finish()
