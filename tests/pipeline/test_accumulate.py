"""Which points a frame sees: equals the slow twin, whatever the order of messages."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from civil_rgbd.domain.recipe import AccumulateStage
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.pipeline.accumulate import PointWindow, SlidingWindow
from civil_rgbd.pipeline.prepare import MappedScan, PointCounts

from ..recordings import reach_of
from ..reference.window import seen
from ..strategies import recordings_of_scans

WINDOWS = st.sampled_from(["past", "centred", "future"])
SECOND = 10**9


def stamps_of(scan: LidarScan) -> list[int]:
    if scan.point_stamps_ns is None:
        return [scan.stamp_ns] * len(scan.points)
    return [int(stamp) for stamp in scan.point_stamps_ns]


class Reader:
    """Hands out scans whose points say where they come from: x = message, y = place in it."""

    def __init__(self, scans: Sequence[LidarScan]) -> None:
        self.scans = [stamps_of(scan) for scan in scans]
        self.headers_ns = np.array([scan.stamp_ns for scan in scans], dtype=np.int64)
        self.reach_ns = reach_of(scans)
        self.reads: Counter[int] = Counter()

    def read(self, message: int) -> MappedScan:
        self.reads[message] += 1
        stamps = np.array(self.scans[message], dtype=np.int64)
        order = np.argsort(stamps, kind="stable")
        points = np.stack([np.full(len(order), message), order, stamps[order] % 1000])
        return MappedScan(points.astype(np.float32), stamps[order], PointCounts())

    def window(self, **stage: object) -> SlidingWindow:
        return SlidingWindow(
            self.read,
            scan_stamps_ns=self.headers_ns,
            reach_ns=self.reach_ns,
            stage=AccumulateStage(**stage),  # type: ignore[arg-type]  # keys of one test
        )


def origins(window: PointWindow) -> list[tuple[int, int]]:
    return [
        (int(x), int(y)) for part in window.segments for x, y in zip(part[0], part[1], strict=True)
    ]


def every(period: int, *, points: int, messages: int) -> list[LidarScan]:
    """Messages whose points are stamped evenly over the period after the header."""
    offsets = np.arange(points, dtype=np.int64) * (period // points)
    return [
        LidarScan(i * period, np.zeros((points, 3), np.float32), offsets + i * period)
        for i in range(messages)
    ]


# --- against the twin -------------------------------------------------------------------------


@given(
    recordings_of_scans(),
    st.lists(st.integers(-20, 80), min_size=1, max_size=6).map(sorted),
    st.integers(1, 40),
    WINDOWS,
    st.sampled_from([0, 0, 1, 5, 20]),
)
def test_it_sees_what_its_slow_twin_counts_one_by_one(
    scans: list[LidarScan], asked: list[int], points: int, window: str, max_age_ns: int
) -> None:
    reader = Reader(scans)
    sliding = reader.window(points=points, window=window, max_age_s=max_age_ns / SECOND)

    for stamp_ns in asked:
        found = sliding.at(stamp_ns)

        expected = seen(reader.scans, stamp_ns, points=points, window=window, max_age_ns=max_age_ns)
        assert origins(found) == expected
        assert found.count == len(expected)
        stamps = [reader.scans[message][place] for message, place in expected]
        assert found.span_ns == (max(stamps) - min(stamps) if stamps else 0)
        away = [abs(int(stamp) - stamp_ns) for stamp in stamps]
        assert found.nearest_ns(stamp_ns) == min(away, default=0)


@given(
    recordings_of_scans(),
    st.integers(-20, 80),
    st.integers(1, 20),
    st.integers(1, 40),
    WINDOWS,
    st.sampled_from([0, 5, 20]),
)
def test_beyond_a_window_are_the_points_of_another_that_it_does_not_have(
    scans: list[LidarScan], stamp_ns: int, fewer: int, more: int, window: str, max_age_ns: int
) -> None:
    reader = Reader(scans)
    inner = reader.window(points=fewer, window=window).at(stamp_ns)
    stage = {"points": more, "window": window, "max_age_s": max_age_ns / SECOND}
    outer = reader.window(**stage).at(stamp_ns)

    rest = PointWindow(outer.beyond(inner), [], [])

    assert all(part.shape[1] for part in rest.segments)
    assert Counter(origins(rest)) == Counter(origins(outer)) - Counter(origins(inner))


def test_beyond_a_window_within_one_message_are_its_points_before_and_after() -> None:
    reader = Reader(every(20, points=20, messages=3))
    inner, outer = (reader.window(points=points, window="centred").at(30) for points in (6, 12))

    rest = PointWindow(outer.beyond(inner), [], [])

    assert origins(inner) == [(1, place) for place in range(7, 13)]
    assert origins(rest) == [(1, place) for place in (4, 5, 6, 13, 14, 15)]


@given(
    recordings_of_scans(),
    st.lists(st.integers(-20, 80), min_size=2, max_size=8).map(sorted),
    st.integers(1, 40),
    WINDOWS,
    st.sampled_from([0, 5, 20]),
)
def test_it_does_not_depend_on_the_instants_asked_before(
    scans: list[LidarScan], asked: list[int], points: int, window: str, max_age_ns: int
) -> None:
    stage = {"points": points, "window": window, "max_age_s": max_age_ns / SECOND}
    slid = Reader(scans).window(**stage)
    for stamp_ns in asked[:-1]:
        slid.at(stamp_ns)

    found, fresh = slid.at(asked[-1]), Reader(scans).window(**stage).at(asked[-1])

    assert origins(found) == origins(fresh)


# --- by hand ----------------------------------------------------------------------------------


def test_a_point_with_the_images_own_stamp_is_future() -> None:
    scans = [LidarScan(0, np.zeros((4, 3), np.float32), np.array([8, 9, 10, 11]))]

    past = Reader(scans).window(points=9, window="past").at(10)
    future = Reader(scans).window(points=9, window="future").at(10)

    assert origins(past) == [(0, 0), (0, 1)]
    assert origins(future) == [(0, 2), (0, 3)]


def test_without_point_stamps_a_whole_message_is_past_or_future() -> None:
    scans = [LidarScan(stamp, np.zeros((2, 3), np.float32)) for stamp in (10, 20, 30)]

    past = Reader(scans).window(points=9, window="past").at(20)
    future = Reader(scans).window(points=9, window="future").at(20)

    assert origins(past) == [(0, 0), (0, 1)]
    assert origins(future) == [(1, 0), (1, 1), (2, 0), (2, 1)]


def test_the_last_points_before_the_image_are_taken_and_a_scan_may_be_cut_at_both_ends() -> None:
    scans = every(100, points=10, messages=4)  # stamps 0, 10, 20 .. 390

    found = Reader(scans).window(points=15, window="past").at(255)

    assert [m * 10 + p for m, p in origins(found)] == list(range(11, 26))
    assert found.span_ns == 140


def test_centred_takes_half_from_either_side_and_the_odd_point_from_the_future() -> None:
    scans = every(100, points=10, messages=4)

    found = Reader(scans).window(points=5, window="centred").at(200)

    assert [m * 10 + p for m, p in origins(found)] == [18, 19, 20, 21, 22]


@pytest.mark.parametrize(("stamp_ns", "first", "last"), [(10, 0, 4), (390, 35, 39)])
def test_centred_is_not_topped_up_from_the_other_side(stamp_ns: int, first: int, last: int) -> None:
    # At 10 there is one past point beside four others, at 390 four past points beside one.
    scans = every(100, points=10, messages=4)

    found = Reader(scans).window(points=8, window="centred").at(stamp_ns)

    assert [m * 10 + p for m, p in origins(found)] == list(range(first, last + 1))


@pytest.mark.parametrize("window", ["past", "future", "centred"])
def test_a_message_that_comes_late_is_found(window: str) -> None:
    # Stamps 0, 30, 10, 40, 20: at 15 the first and the third are past.
    scans = [LidarScan(stamp, np.zeros((1, 3), np.float32)) for stamp in (0, 30, 10, 40, 20)]
    expected = {
        "past": [(0, 0), (2, 0)],
        "future": [(1, 0), (3, 0), (4, 0)],
        "centred": [(0, 0), (2, 0), (1, 0), (3, 0), (4, 0)],
    }

    found = Reader(scans).window(points=9, window=window).at(15)

    assert origins(found) == expected[window]


def test_stale_points_do_not_count_and_exactly_the_limit_does() -> None:
    scans = every(SECOND, points=10, messages=3)  # a point each 0.1 s

    past = Reader(scans).window(points=100, window="past", max_age_s=0.5).at(2 * SECOND)
    future = Reader(scans).window(points=100, window="future", max_age_s=0.5).at(2 * SECOND)

    assert [m * 10 + p for m, p in origins(past)] == [15, 16, 17, 18, 19]
    assert [m * 10 + p for m, p in origins(future)] == [20, 21, 22, 23, 24, 25]


def test_a_window_without_points_is_empty() -> None:
    for window in ("past", "centred", "future"):
        found = Reader([]).window(points=3, window=window).at(0)

        assert (found.count, found.span_ns, found.segments) == (0, 0, [])


# --- what it reads ----------------------------------------------------------------------------


def test_a_fresh_window_reads_back_until_it_is_full_and_no_further() -> None:
    reader = Reader(every(100, points=10, messages=1000))

    reader.window(points=25, window="past").at(90_000)

    # 25 points: scans 899, 898, 897; scan 900 starts at the instant itself.
    assert sorted(reader.reads) == [897, 898, 899]


def test_a_future_window_reads_on_until_it_is_full_and_no_further() -> None:
    reader = Reader(every(100, points=10, messages=1000))

    reader.window(points=25, window="future").at(90_000)

    # Scan 899 might, for all that headers say, reach up to 90,000 - 10.
    assert sorted(reader.reads) == [900, 901, 902]


def test_sliding_reads_every_scan_once() -> None:
    reader = Reader(every(100, points=10, messages=100))
    for window in ("past", "centred", "future"):
        reader.reads.clear()
        sliding = reader.window(points=35, window=window)
        for stamp_ns in range(0, 10_000, 30):
            sliding.at(stamp_ns)

        assert max(reader.reads.values()) == 1, window
        assert len(reader.reads) == 100, window


@pytest.mark.parametrize("window", ["past", "centred", "future"])
def test_what_it_holds_does_not_grow(window: str) -> None:
    reader = Reader(every(100, points=10, messages=500))
    sliding = reader.window(points=35, window=window)

    held = []
    for stamp_ns in range(0, 50_000, 70):
        sliding.at(stamp_ns)
        held.append(len(sliding._held))

    assert max(held) <= 6


def test_a_stale_stretch_is_not_read_at_all() -> None:
    reader = Reader(every(SECOND, points=10, messages=50))

    reader.window(points=10**6, window="past", max_age_s=1.5).at(40 * SECOND)

    assert sorted(reader.reads) == [38, 39]
