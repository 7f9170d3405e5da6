"""How the messages of a channel are encoded, and what reads them."""

from __future__ import annotations

from typing import Final

from civil_rgbd.conversion.cdr import CdrReader
from civil_rgbd.conversion.ros1 import Ros1Reader

READERS: Final[dict[str, type[CdrReader]]] = {"cdr": CdrReader, "ros1": Ros1Reader}
"""What reads each message encoding, by the name that MCAP and rosbag2 give it."""
