"""sensor_msgs/PointCloud2 to a scan: any field order, type, padding and byte order."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.conversion.cdr import CdrError, CdrReader, ContentError
from civil_rgbd.conversion.point_time import PointTime, point_stamps_ns, settled
from civil_rgbd.domain.scan import LidarScan

DATATYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4", 7: "f4", 8: "f8"}
"""sensor_msgs/PointField's constants as numpy types."""

NOISE_BITS: Final = 0x0F
"""Livox tag: bits 0-1 spatial noise, 2-3 intensity noise; 0 in both = a clean return."""

_TAG: Final = ("tag", "u1")


@dataclass(frozen=True, slots=True, eq=False)
class Cloud:
    """A PointCloud2 taken apart; its points are not touched yet.

    Attributes:
        stamp_ns: header stamp.
        frame: header frame id, without a leading slash.
        height: rows.
        width: points in a row.
        fields: name to (byte offset, numpy type without byte order); the first of equal names.
        order: byte order of the points, ``<`` or ``>``.
        point_step: bytes from point to point.
        row_step: bytes from row to row.
        data: the points.
    """

    stamp_ns: int
    frame: str
    height: int
    width: int
    fields: dict[str, tuple[int, str]]
    order: str
    point_step: int
    row_step: int
    data: memoryview

    @property
    def count(self) -> int:
        """How many points there are."""
        return self.height * self.width

    @property
    def types(self) -> dict[str, str]:
        """Field name to numpy type."""
        return {name: code for name, (_, code) in self.fields.items()}


def parse_cloud(payload: memoryview, read: type[CdrReader] = CdrReader) -> Cloud:
    """Take a PointCloud2 apart, down to its bytes.

    Args:
        payload: the message.
        read: reads its encoding.

    Raises:
        CdrError: it breaks its layout.
    """
    reader = read(payload)
    stamp_ns, frame = reader.header()
    height, width = reader.uint32(), reader.uint32()
    fields: dict[str, tuple[int, str]] = {}
    for _ in range(reader.count(smallest_bytes=13)):
        name, offset, datatype = reader.text(), reader.uint32(), reader.uint8()
        reader.uint32()  # count: 1 for every field that is read here, 0 from some writers
        fields.setdefault(name, (offset, DATATYPES.get(datatype, f"datatype {datatype}")))
    order = ">" if reader.uint8() else "<"
    point_step, row_step = reader.uint32(), reader.uint32()
    cloud = Cloud(
        stamp_ns, frame, height, width, fields, order, point_step, row_step, reader.octets()
    )
    return _with_true_rows(cloud)


def _with_true_rows(cloud: Cloud) -> Cloud:
    """Check the claimed sizes against the data; settle on a row step."""
    packed = cloud.width * cloud.point_step
    row_step = cloud.row_step
    # One row needs no step; some writers leave it 0 for packed rows.
    if cloud.height <= 1 or (row_step < packed and len(cloud.data) == packed * cloud.height):
        row_step = packed
    if row_step < packed:
        raise CdrError(f"row_step is {row_step}, less than {cloud.width} points of a row take")
    needed = (cloud.height - 1) * row_step + packed if cloud.count else 0
    if cloud.count and not cloud.point_step:
        raise CdrError(f"{cloud.count} points are claimed with a point_step of 0")
    if len(cloud.data) < needed:
        raise CdrError(
            f"{cloud.width} x {cloud.height} points of {cloud.point_step} bytes need {needed} "
            f"bytes, its data has {len(cloud.data)}"
        )
    return replace(cloud, row_step=row_step)


def column(cloud: Cloud, name: str) -> NDArray[np.generic]:
    """Return one field as a view of the data.

    Args:
        cloud: any.
        name: one of its fields.

    Returns:
        (height, width) in the recorded type and byte order.

    Raises:
        ContentError: the cloud has no such field.
        CdrError: the field reaches over the point's end.
    """
    if name not in cloud.fields:
        known = ", ".join(map(repr, cloud.fields)) or "none at all"
        raise ContentError(
            f"it has no field {name!r}, only {known}",
            "choose another topic with --lidar-topic; a point cloud has fields x, y and z",
        )
    offset, code = cloud.fields[name]
    if code not in DATATYPES.values():
        raise CdrError(f"field {name!r} has {code}, which is none of 1 to 8")
    dtype = np.dtype(cloud.order + code)
    if offset + dtype.itemsize > cloud.point_step:
        raise CdrError(
            f"field {name!r} at byte {offset} reaches over its point of {cloud.point_step} bytes"
        )
    return np.ndarray(
        (cloud.height, cloud.width),
        dtype,
        buffer=cloud.data,
        offset=offset,
        strides=(cloud.row_step, cloud.point_step),
    )


def points_of(cloud: Cloud) -> NDArray[np.floating]:
    """Return the coordinates.

    Returns:
        (N, 3) metres; float32, or float64 when any coordinate needs it, so that map coordinates
        keep their digits.

    Raises:
        ContentError: x, y or z is missing.
        CdrError: it is misplaced.
    """
    if not cloud.count:
        return np.zeros((0, 3), dtype=np.float32)
    columns = [column(cloud, name) for name in "xyz"]
    dtype = np.result_type(np.float32, *columns)
    points = np.empty((cloud.height, cloud.width, 3), dtype=dtype)
    with np.errstate(invalid="ignore"):  # a signalling NaN is as good as any
        for axis, values in enumerate(columns):
            points[:, :, axis] = values
    return points.reshape(-1, 3)


def with_unit(cloud: Cloud, rule: PointTime | None) -> PointTime | None:
    """Settle the unit of a cloud's point times, where its returns tell it.

    Raises:
        ContentError: a field is missing.
        CdrError: a field is misplaced.
    """
    if rule is None or rule.unit is not None or not cloud.count:
        return rule
    times = column(cloud, rule.field).reshape(-1)
    return settled(rule, times, header_ns=cloud.stamp_ns, points=points_of(cloud))


def scan_from_cloud(
    payload: memoryview,
    point_time: PointTime | None,
    *,
    in_map: bool,
    read: type[CdrReader] = CdrReader,
) -> LidarScan:
    """Decode one PointCloud2.

    Args:
        payload: the message.
        point_time: how its time field is to be read; None = its points have none.
        in_map: the points are in the map frame already.
        read: reads its encoding.

    Raises:
        CdrError: it breaks its layout.
        ContentError: a field is missing, or its point times are not near its header.
    """
    cloud = parse_cloud(payload, read)
    points = points_of(cloud)
    stamps_ns = noise = None
    if point_time is not None:
        stamps_ns = np.full(0, cloud.stamp_ns, dtype=np.int64)
        if cloud.count:
            stamps_ns = point_stamps_ns(
                column(cloud, point_time.field).reshape(-1),
                point_time,
                header_ns=cloud.stamp_ns,
                points=points,
            )
    if cloud.count and cloud.types.get(_TAG[0]) == _TAG[1]:
        tags = column(cloud, _TAG[0]).reshape(-1).view(np.uint8)
        noise = (tags & NOISE_BITS) != 0
    return LidarScan(cloud.stamp_ns, points, stamps_ns, noise, in_map)
