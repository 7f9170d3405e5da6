"""LVX and LVX2 files as Livox Viewer writes them, with every knob that differs."""

from __future__ import annotations

import struct
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

INTERVAL_NS = 4167
AVIA, MID_360 = 7, 9


@dataclass(frozen=True)
class Packet:
    stamp: int | bytes
    payload: bytes
    kind: int = 2
    device: int = 0
    stamp_type: int = 0

    def lvx(self) -> bytes:
        stamp = self.stamp if isinstance(self.stamp, bytes) else struct.pack("<Q", self.stamp)
        head = struct.pack("<BBBBBIBB", self.device, 5, 1, 1, 0, 0, self.stamp_type, self.kind)
        return head + stamp + self.payload

    def lvx2(self) -> bytes:
        assert isinstance(self.stamp, int)
        return (
            struct.pack("<BIBBQ", 0, self.device, 0, self.stamp_type, self.stamp)
            + struct.pack("<HBIB4x", 7, self.kind, len(self.payload), 3)
            + self.payload
        )


def device(
    *,
    index: int = 0,
    kind: int = AVIA,
    code: str = "3JEDK380010Z39",
    extrinsics: Sequence[float] | None = None,
    second: bool = False,
) -> bytes:
    layout = "<16s16sIBBB6f" if second else "<16s16sBBB6f"
    numbers = (extrinsics is not None, *(extrinsics or (0.0,) * 6))
    ids = (index, 0, kind) if second else (index, kind)
    return struct.pack(layout, code.encode(), b"", *ids, *numbers)


def file_bytes(
    frames: Sequence[Sequence[Packet]],
    *,
    devices: Sequence[bytes] = (),
    second: bool = False,
    version: tuple[int, int] | None = None,
) -> bytes:
    devices = devices or [device(second=second, kind=MID_360 if second else AVIA)]
    major, minor = version or ((2, 0) if second else (1, 1))
    data = struct.pack("<16s4BI", b"livox_tech", major, minor, 0, 0, 0xAC0EA767)
    data += struct.pack("<IB", 50, len(devices)) + b"".join(devices)
    for number, packets in enumerate(frames):
        body = b"".join(p.lvx2() if second else p.lvx() for p in packets)
        data += struct.pack("<QQQ", len(data), len(data) + 24 + len(body), number) + body
    return data


def frame_starts(data: bytes) -> list[int]:
    """Where the header of each frame lies in a whole file."""
    at, found = 29 + data[28] * (63 if data[16] == 2 else 59), []
    while at < len(data):
        found.append(at)
        at = struct.unpack_from("<Q", data, at + 8)[0]
    return found


def mm(xyz_m: NDArray[np.floating]) -> NDArray[np.int32]:
    return np.rint(np.asarray(xyz_m, dtype=np.float64) * 1000).astype(np.int32)


def cartesian(xyz_m: NDArray[np.floating], tags: Sequence[int] | None = None) -> bytes:
    """Data types 2, 4 and 7 (and 1 of LVX2): one return after the other."""
    items = np.zeros(
        len(xyz_m), np.dtype([("xyz", "<i4", 3), ("reflectivity", "u1"), ("tag", "u1")])
    )
    items["xyz"], items["reflectivity"] = mm(xyz_m), 10
    if tags is not None:
        items["tag"] = tags
    return items.tobytes()


def frames_of_scan(
    xyz_m: NDArray[np.floating], stamps_ns: NDArray[np.int64], *, per_frame: int
) -> list[list[Packet]]:
    """Cut a scan into packets of 96 points, stamped as their first."""
    packets = [
        Packet(int(stamps_ns[at]), cartesian(xyz_m[at : at + 96]))
        for at in range(0, len(xyz_m), 96)
    ]
    return [packets[at : at + per_frame] for at in range(0, len(packets), per_frame)]
