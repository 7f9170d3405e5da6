"""ROS 2 messages as CDR bytes, written by hand: the other side of what conversion reads."""

from __future__ import annotations

import struct
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

IDENTITY = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0)
NUMPY_TO_DATATYPE = {"i1": 1, "u1": 2, "i2": 3, "u2": 4, "i4": 5, "u4": 6, "f4": 7, "f8": 8}


class Cdr:
    """Appends values, each aligned to its own size, counted after the four bytes in front."""

    def __init__(self, order: str = "<") -> None:
        self.order = order
        self._bytes = bytearray([0, 1 if order == "<" else 0, 0, 0])

    def put(self, code: str, *values: float) -> Cdr:
        size = struct.calcsize(code)
        for value in values:
            self._bytes += bytes(-(len(self._bytes) - 4) % size)
            self._bytes += struct.pack(self.order + code, value)
        return self

    def text(self, value: str) -> Cdr:
        encoded = value.encode() + b"\0"
        self.put("I", len(encoded))
        self._bytes += encoded
        return self

    def octets(self, value: bytes) -> Cdr:
        self.put("I", len(value))
        self._bytes += value
        return self

    def header(self, stamp_ns: int, frame: str) -> Cdr:
        return self.put("i", stamp_ns // 10**9).put("I", stamp_ns % 10**9).text(frame)

    def done(self) -> bytes:
        return bytes(self._bytes)


def point_cloud(
    stamp_ns: int,
    points: NDArray[np.void],
    *,
    frame: str = "lidar",
    height: int = 1,
    row_padding: int = 0,
    order: str = "<",
    **lies: int,
) -> bytes:
    """PointCloud2 from a structured array; ``lies`` replace width, point_step, row_step."""
    dtype = points.dtype
    assert dtype.fields is not None
    width = len(points) // height
    step = dtype.itemsize
    cdr = Cdr(order).header(stamp_ns, frame)
    cdr.put("I", height, lies.get("width", width), len(dtype.fields))
    big = False
    for name, (kind, offset, *_) in dtype.fields.items():
        big = big or kind.byteorder == ">"
        code = NUMPY_TO_DATATYPE[kind.str[1:]]
        cdr.text(name).put("I", offset).put("B", code).put("I", 1)
    cdr.put("B", int(big))
    cdr.put("I", lies.get("point_step", step), lies.get("row_step", width * step + row_padding))
    rows = [points[i * width : (i + 1) * width].tobytes() for i in range(height)]
    return cdr.octets(b"".join(row + b"\xee" * row_padding for row in rows)).put("B", 1).done()


def xyz_cloud(stamp_ns: int, xyz: NDArray[np.float32], *, frame: str = "lidar") -> bytes:
    points = np.zeros(len(xyz), dtype=[("x", "<f4"), ("y", "<f4"), ("z", "<f4")])
    points["x"], points["y"], points["z"] = xyz.T
    return point_cloud(stamp_ns, points, frame=frame)


def custom_msg(
    stamp_ns: int,
    points: Sequence[tuple[int, float, float, float, int, int, int]],
    *,
    frame: str = "livox_frame",
    order: str = "<",
    timebase_ns: int | None = None,
    point_num: int | None = None,
    count: int | None = None,
) -> bytes:
    """Livox CustomMsg; points are offset_time x y z reflectivity tag line."""
    cdr = Cdr(order).header(stamp_ns, frame)
    cdr.put("Q", stamp_ns if timebase_ns is None else timebase_ns)
    cdr.put("I", len(points) if point_num is None else point_num).put("B", 1, 0, 0, 0)
    cdr.put("I", len(points) if count is None else count)
    for offset_ns, x, y, z, reflectivity, tag, line in points:
        cdr.put("I", offset_ns).put("f", x, y, z).put("B", reflectivity, tag, line)
    return cdr.done()


def compressed_image(
    stamp_ns: int, data: bytes, *, name: str = "jpeg", frame: str = "camera"
) -> bytes:
    return Cdr().header(stamp_ns, frame).text(name).octets(data).done()


def raw_image(
    stamp_ns: int,
    data: bytes,
    width: int,
    height: int,
    encoding: str,
    step: int,
    *,
    frame: str = "camera",
) -> bytes:
    cdr = Cdr().header(stamp_ns, frame).put("I", height, width).text(encoding)
    return cdr.put("B", 0).put("I", step).octets(data).done()


def camera_info(
    stamp_ns: int = 0,
    *,
    size: tuple[int, int] = (64, 48),
    model: str = "plumb_bob",
    d: Sequence[float] = (0.0,) * 5,
    k: Sequence[float] = (50, 0, 31.5, 0, 50, 23.5, 0, 0, 1),
    p: Sequence[float] = (40, 0, 30, 0, 0, 41, 22, 0, 0, 0, 1, 0),
    binning: tuple[int, int] = (0, 0),
    roi: tuple[int, int, int, int] = (0, 0, 0, 0),
    frame: str = "camera",
) -> bytes:
    """``roi`` is left, top, width, height; the message orders them otherwise."""
    cdr = Cdr().header(stamp_ns, frame).put("I", size[1], size[0]).text(model)
    cdr.put("I", len(d)).put("d", *d).put("d", *k)
    cdr.put("d", 1, 0, 0, 0, 1, 0, 0, 0, 1).put("d", *p).put("I", *binning)
    return cdr.put("I", roi[0], roi[1], roi[3], roi[2]).put("B", 0).done()


def odometry(
    stamp_ns: int,
    pose: Sequence[float] = IDENTITY,
    *,
    frame: str = "odom",
    child: str = "lidar",
) -> bytes:
    cdr = Cdr().header(stamp_ns, frame).text(child).put("d", *pose)
    return cdr.put("d", *[0.0] * (36 + 6 + 36)).done()


def pose_stamped(stamp_ns: int, pose: Sequence[float] = IDENTITY, *, frame: str = "odom") -> bytes:
    return Cdr().header(stamp_ns, frame).put("d", *pose).done()


def path(
    stamp_ns: int, poses: Sequence[tuple[int, Sequence[float]]], *, frame: str = "odom"
) -> bytes:
    cdr = Cdr().header(stamp_ns, frame).put("I", len(poses))
    for pose_stamp_ns, pose in poses:
        cdr.header(pose_stamp_ns, frame).put("d", *pose)
    return cdr.done()


def transforms(links: Sequence[tuple[int, str, str, Sequence[float]]]) -> bytes:
    """TFMessage; links are stamp, parent, child, pose."""
    cdr = Cdr().put("I", len(links))
    for stamp_ns, parent, child, pose in links:
        cdr.header(stamp_ns, parent).text(child).put("d", *pose)
    return cdr.done()


def imu(stamp_ns: int, *, frame: str = "imu") -> bytes:
    return Cdr().header(stamp_ns, frame).put("d", *[0.0] * 37).done()
