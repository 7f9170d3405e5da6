"""Constants that two floors share, each with its meaning underneath."""

from typing import Final

FORMAT_VERSION: Final = "1.0"
"""The on-disk format that this release writes: major.minor."""

NO_DEPTH_M: Final = 0.0
"""Depth of a pixel that no LiDAR point reached."""

NS_PER_S: Final = 1_000_000_000
"""Nanoseconds in a second."""

BRIDGE_ID_PATTERN: Final = r"^[A-Za-z0-9][A-Za-z0-9_-]{0,63}$"
"""What a bridge id looks like; unique in a dataset ignoring case."""

MAX_POINT_TIME_OFFSET_NS: Final = NS_PER_S
"""A point's stamp lies within this of its message's header stamp, else the units are wrong."""

MAX_CLOCK_OFFSET_S: Final = 4e9
"""How far two clocks may differ: one counts from power-on, the other from 1970 or 2036.

The sum with any stamp of a message, at most 2^32 s, stays in int64 nanoseconds.
"""
