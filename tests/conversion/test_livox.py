"""Livox CustomMsg, point by point against what was written."""

from __future__ import annotations

import struct

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from civil_rgbd.conversion.cdr import CdrError, ContentError
from civil_rgbd.conversion.livox import scan_from_livox

from . import messages

STAMP = 1_700_000_000_000_000_123
floats = st.floats(-300, 300, width=32)
bytes_ = st.integers(0, 255)
points_drawn = st.lists(
    st.tuples(st.integers(0, 10**9), floats, floats, floats, bytes_, bytes_, bytes_), max_size=5
)


@given(points_drawn, st.text("livox_frame/", max_size=9), st.sampled_from("<>"))
def test_any_message_comes_out_as_written(
    points: list[tuple[int, float, float, float, int, int, int]], frame: str, order: str
) -> None:
    payload = messages.custom_msg(STAMP, points, frame=frame, order=order)
    scan = scan_from_livox(memoryview(payload), in_map=False)

    assert scan.stamp_ns == STAMP
    assert scan.points.dtype == np.float32
    assert scan.points.tolist() == [list(point[1:4]) for point in points]
    assert scan.point_stamps_ns.tolist() == [STAMP + point[0] for point in points]
    assert scan.noise.tolist() == [point[5] & 0x0F != 0 for point in points]


def test_the_bytes_lie_where_the_driver_puts_them() -> None:
    # By hand, from the message definition: frame "livox_frame" puts the points at byte 48.
    payload = b"\x00\x01\x00\x00" + struct.pack("<iII", 1_700_000_000, 5, 12) + b"livox_frame\0"
    payload += struct.pack("<QII4xI", 1_700_000_000_000_000_005, 2, 1, 2)[:20]
    payload = payload[:28] + struct.pack("<QI4BI", 1_700_000_000_000_000_005, 2, 1, 0, 0, 0, 2)
    payload += struct.pack("<IfffBBB", 0, 1.0, 2.0, 3.0, 9, 0x10, 0) + b"\xff"
    payload += struct.pack("<IfffBBB", 4167, 4.0, 5.0, 6.0, 9, 0x04, 1)
    assert len(payload) == 48 + 20 + 19

    scan = scan_from_livox(memoryview(payload), in_map=False)
    assert scan.points.tolist() == [[1, 2, 3], [4, 5, 6]]
    assert np.diff(scan.point_stamps_ns).tolist() == [4167]
    assert scan.noise.tolist() == [False, True]


POINT = (0, 1.0, 2.0, 3.0, 0, 0, 0)


@pytest.mark.parametrize(
    ("lies", "says"),
    [
        ({"point_num": 3}, "point_num is 3, but 2 points follow"),
        ({"point_num": 9, "count": 9}, "9 points need 179 bytes, 39 are left"),
        ({"point_num": 1, "count": 1}, "1 points are claimed, but 20 bytes follow"),
        ({"point_num": 2**32 - 1, "count": 2**32 - 1}, "bytes, 39 are left"),
    ],
)
def test_counts_that_lie_are_refused(lies: dict[str, int], says: str) -> None:
    payload = messages.custom_msg(STAMP, [POINT, POINT], **lies)
    with pytest.raises(CdrError, match=says):
        scan_from_livox(memoryview(payload), in_map=False)


def test_a_point_a_sweep_away_is_refused() -> None:
    payload = messages.custom_msg(STAMP, [(10**9 + 1, 1.0, 2.0, 3.0, 0, 0, 0)])
    with pytest.raises(CdrError, match="'offset_time' spans") as caught:
        scan_from_livox(memoryview(payload), in_map=False)
    assert not isinstance(caught.value, ContentError)  # --point-time would not help


def test_bytes_added_to_round_up_are_no_points() -> None:
    payload = messages.custom_msg(STAMP, [POINT]) + b"\0"
    assert len(scan_from_livox(memoryview(payload), in_map=False).points) == 1
