"""Messages as a bag of ROS 1."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import IO

from civil_rgbd.ros1.bag_writer import Ros1BagWriter
from civil_rgbd.simulator.ros_schemas import ros1_type


def write_bag(
    stream: IO[bytes], topics: Mapping[str, str], messages: Iterable[tuple[int, str, bytes]]
) -> None:
    """Write messages, indexed, without compression.

    Args:
        stream: where to.
        topics: their types, ``package/Type``.
        messages: log time, topic and payload as ROS 1 encodes it, in order.
    """
    types = {topic: ros1_type(kind) for topic, kind in topics.items()}
    with Ros1BagWriter(stream, types) as bag:
        for log_time_ns, topic, payload in messages:
            bag.write(topic, log_time_ns, payload)
