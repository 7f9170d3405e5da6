"""How points lie in the packets of Livox's LVX and LVX2 files.

Layouts: "LVX Specifications" 1.1 and "LVX2 Specifications" 1.0 of Livox; lengths by data type are
those of Livox's ROS driver (lds.h, data_type_info_pair_table). All is little endian.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np

IMU: Final = 6
"""Data type of an IMU packet in LVX 1.1."""

IMU_LVX2: Final = 0
"""Data type of an IMU packet of the newer sensors; the specification of LVX2 has none."""

_MM: Final = np.float32(1000)
_CM: Final = np.float32(100)


@dataclass(frozen=True, slots=True)
class DataType:
    """How the points of one data type lie in a packet.

    Attributes:
        item: of one return; of spherical types what follows the angles.
        returns: how many returns a point has; they share its time (and angles).
        unit: length units in a metre.
        points: in a packet; 0 = the packet says how many bytes it has.
        spherical: distances, with one pair of angles a point.
    """

    item: np.dtype[np.void]
    returns: int
    unit: np.float32
    points: int
    spherical: bool = False

    @property
    def point_bytes(self) -> int:
        """Bytes of one point with all its returns."""
        angles = 4 if self.spherical and self.returns > 1 else 0
        return angles + self.returns * self.item.itemsize


def _item(*fields: tuple[str, str]) -> np.dtype[np.void]:
    return np.dtype([*fields])


def _xyz(code: str, *, tag: bool = True) -> np.dtype[np.void]:
    fields = [("x", code), ("y", code), ("z", code), ("reflectivity", "u1")]
    return _item(*fields, *([("tag", "u1")] if tag else []))


_ANGLES: Final = (("theta", "<u2"), ("phi", "<u2"))
_DEPTH, _REFLECTIVITY, _TAG = ("depth", "<u4"), ("reflectivity", "u1"), ("tag", "u1")

LVX_TYPES: Final = {
    0: DataType(_xyz("<i4", tag=False), 1, _MM, 100),
    1: DataType(_item(_DEPTH, *_ANGLES, _REFLECTIVITY), 1, _MM, 100, spherical=True),
    2: DataType(_xyz("<i4"), 1, _MM, 96),
    3: DataType(_item(_DEPTH, *_ANGLES, _REFLECTIVITY, _TAG), 1, _MM, 96, spherical=True),
    4: DataType(_xyz("<i4"), 2, _MM, 48),
    5: DataType(_item(_DEPTH, _REFLECTIVITY, _TAG), 2, _MM, 48, spherical=True),
    7: DataType(_xyz("<i4"), 3, _MM, 30),
    8: DataType(_item(_DEPTH, _REFLECTIVITY, _TAG), 3, _MM, 30, spherical=True),
}
"""Data types of LVX 1.1 with points (type 6 is the IMU)."""

LVX2_TYPES: Final = {1: DataType(_xyz("<i4"), 1, _MM, 0), 2: DataType(_xyz("<i2"), 1, _CM, 0)}
"""Data types of LVX2."""

IMU_BYTES: Final = 24
"""Six float32: angular velocity in rad/s, specific force in g."""
