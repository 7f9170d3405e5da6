"""A recording of any length: one simulated scan, over and over, its clocks running on.

    python benchmarks/long_scan.py scan.mcap long.mcap --seconds 60 --times 10

To simulate ten minutes at the sensors' full rates takes an hour; what they cost to build does not
depend on what is in the pictures. Every message is copied as it is but for its stamps. Where one
turn ends and the next begins the poses jump back to the start of the walk, within one step of 5 ms.
"""

from __future__ import annotations

import argparse
import struct
from pathlib import Path

from mcap.reader import make_reader
from mcap.writer import CompressionType, Writer

NS_PER_S = 1_000_000_000
ONCE = ("/civil_rgbd/origin", "/tf_static")
CHUNK_BYTES = 4 << 20


def repeat_scan(source: Path, out: Path, *, times: int, seconds: float | None = None) -> None:
    """Write the recording ``source``, as the simulator made it, ``times`` times into one file.

    Args:
        source: MCAP with summary, poses in ``/odometry``.
        out: the file to write.
        times: how often.
        seconds: take so much of its beginning; None takes all.
    """
    with source.open("rb") as reading, out.open("wb") as writing:
        reader = make_reader(reading)
        summary = reader.get_summary()
        if summary is None or summary.statistics is None:
            raise SystemExit(f"{source}: no summary; simulate it with `civil-rgbd simulate`")
        # Poses lie 5 ms apart: the first of a turn follows the last of the turn before by as much.
        poses = [message.log_time for _, _, message in reader.iter_messages(topics=["/odometry"])]
        end_ns = poses[-1] if seconds is None else poses[0] + round(seconds * NS_PER_S) - 1
        turn_ns = max(pose for pose in poses if pose <= end_ns) - poses[0] + 5_000_000
        writer = Writer(writing, chunk_size=CHUNK_BYTES, compression=CompressionType.ZSTD)
        writer.start(profile="ros2", library="civil_rgbd simulator")
        channels: dict[int, int] = {}
        for turn in range(times):
            for schema, channel, message in reader.iter_messages(end_time=end_ns + 1):
                if schema is None or (turn and channel.topic in ONCE):
                    continue
                if channel.id not in channels:
                    known = writer.register_schema(schema.name, schema.encoding, schema.data)
                    channels[channel.id] = writer.register_channel(
                        channel.topic, channel.message_encoding, known
                    )
                later_ns = turn * turn_ns
                data = message.data
                if channel.topic not in ONCE:
                    data = later(data, later_ns, livox=schema.name.endswith("/CustomMsg"))
                log_time_ns = message.log_time + later_ns
                writer.add_message(channels[channel.id], log_time_ns, data, log_time_ns)
        writer.finish()


def later(cdr: bytes, by_ns: int, *, livox: bool) -> bytes:
    """Return a CDR message that begins with a header, its stamp (and Livox time base) moved on."""
    changed = bytearray(cdr)
    seconds, nanoseconds = struct.unpack_from("<iI", changed, 4)
    stamp_ns = seconds * NS_PER_S + nanoseconds + by_ns
    struct.pack_into("<iI", changed, 4, *divmod(stamp_ns, NS_PER_S))
    if livox:
        (text_bytes,) = struct.unpack_from("<I", changed, 12)
        at = 4 + -(-(12 + text_bytes) // 8) * 8  # aligned to 8 after the 4-byte encapsulation
        (timebase_ns,) = struct.unpack_from("<Q", changed, at)
        struct.pack_into("<Q", changed, at, timebase_ns + by_ns)
    return bytes(changed)


def main() -> None:
    """Parse, write."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("source", type=Path)
    parser.add_argument("out", type=Path)
    parser.add_argument("--times", type=int, default=10)
    parser.add_argument("--seconds", type=float, help="of its beginning; default: all")
    arguments = parser.parse_args()
    repeat_scan(arguments.source, arguments.out, times=arguments.times, seconds=arguments.seconds)
    print(f"{arguments.out}: {arguments.out.stat().st_size / 1e6:.0f} MB")


if __name__ == "__main__":
    main()
