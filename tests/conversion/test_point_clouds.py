"""PointCloud2: whatever layout a writer chose, the same points come out."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from civil_rgbd.conversion.cdr import CdrError, ContentError
from civil_rgbd.conversion.point_clouds import parse_cloud, points_of, scan_from_cloud
from civil_rgbd.conversion.point_time import PointTime, PointTimeError, point_time_of

from . import messages

STAMP = 1_700_000_000_123_456_789
XYZ = [("x", "<f4"), ("y", "<f4"), ("z", "<f4")]


def decode(payload: bytes, *, option: str | None = None, in_map: bool = False):  # noqa: ANN201 - a scan
    view = memoryview(payload)
    rule = point_time_of(parse_cloud(view).types, option, where="test")
    return scan_from_cloud(view, rule, in_map=in_map)


def with_time(name: str, kind: str, values: list[float] | NDArray[np.generic]) -> NDArray[np.void]:
    points = np.zeros(len(values), dtype=[*XYZ, (name, kind)])
    points["x"], points[name] = 1.0, values
    return points


@st.composite
def layouts(draw: st.DrawFn) -> tuple[np.dtype[np.void], str]:
    """Fields in any order, of any type, with gaps; one byte order for the whole cloud."""
    order = draw(st.sampled_from("<>"))
    others = draw(
        st.lists(st.sampled_from(["intensity", "ring", "line", "rgb", "tag"]), unique=True)
    )
    names = draw(st.permutations(["x", "y", "z", *others]))
    kinds, offsets, at = [], [], draw(st.integers(0, 3))
    for name in names:
        choice = ["f4", "f8"] if name in "xyz" else list(messages.NUMPY_TO_DATATYPE)
        kinds.append(np.dtype(order + draw(st.sampled_from(choice))))
        offsets.append(at)
        at += kinds[-1].itemsize + draw(st.integers(0, 5))
    spec = {"names": names, "formats": kinds, "offsets": offsets, "itemsize": at}
    return np.dtype(spec), draw(st.sampled_from("<>"))


@given(
    layouts(),
    st.integers(0, 6),
    st.integers(1, 3),
    st.integers(0, 9),
    st.text("abc_", max_size=9),
    st.integers(0, 2**32),
)
def test_any_layout_gives_the_same_points(
    layout: tuple[np.dtype[np.void], str],
    width: int,
    height: int,
    padding: int,
    frame: str,
    seed: int,
) -> None:
    dtype, cdr_order = layout
    raw = np.random.default_rng(seed).integers(0, 256, width * height * dtype.itemsize, np.uint8)
    points = raw.view(dtype)
    payload = messages.point_cloud(
        STAMP, points, frame=frame, height=height, row_padding=padding, order=cdr_order
    )
    scan = scan_from_cloud(memoryview(payload), None, in_map=False)

    assert scan.stamp_ns == STAMP
    assert len(scan.points) == width * height
    for axis, name in enumerate("xyz"):
        with np.errstate(invalid="ignore"):  # random bytes hold signalling NaNs
            expected = points[name].astype(scan.points.dtype)
        assert np.array_equal(scan.points[:, axis], expected, equal_nan=True)
    any_double = any(dtype[name].itemsize == 8 for name in "xyz")
    assert scan.points.dtype == (np.float64 if any_double and len(points) else np.float32)
    if "tag" in dtype.names and dtype["tag"] == np.uint8 and len(points):
        assert np.array_equal(scan.noise, [(tag & 0x0F) != 0 for tag in points["tag"]])
    else:
        assert scan.noise is None


def test_map_coordinates_keep_their_digits() -> None:
    points = np.zeros(1, dtype=[("x", "<f8"), ("y", "<f8"), ("z", "<f8")])
    points["x"], points["y"] = 540_000.123456789, 4_810_000.987654321
    scan = decode(messages.point_cloud(STAMP, points), in_map=True)
    assert scan.in_map
    assert scan.points[0].tolist() == [540_000.123456789, 4_810_000.987654321, 0.0]


def test_points_without_return_pass_through() -> None:
    xyz = np.array([[0, 0, 0], [np.nan, 1, 1], [np.inf, 0, 0], [1, 2, 3]], dtype=np.float32)
    scan = decode(messages.xyz_cloud(STAMP, xyz))
    assert np.array_equal(scan.points, xyz, equal_nan=True)


def test_an_empty_cloud_is_a_scan_of_no_points() -> None:
    scan = decode(messages.xyz_cloud(STAMP, np.zeros((0, 3), np.float32)))
    assert scan.points.shape == (0, 3)
    nothing = messages.Cdr().header(STAMP, "").put("I", 0, 0, 0).put("B", 0).put("I", 0, 0, 0)
    assert decode(nothing.put("B", 1).done()).points.shape == (0, 3)


def test_a_row_step_of_zero_means_packed_rows() -> None:
    points = np.arange(12, dtype=np.float32).view(XYZ)
    scan = decode(messages.point_cloud(STAMP, points, height=2, row_step=0))
    assert scan.points[:, 0].tolist() == [0, 3, 6, 9]


@pytest.mark.parametrize(
    ("lies", "says"),
    [
        ({"width": 5}, r"5 x 1 points of 12 bytes need 60 bytes, its data has 48"),
        ({"point_step": 8}, "field 'z' at byte 8 reaches over its point of 8 bytes"),
        ({"point_step": 0}, "with a point_step of 0"),
        ({"width": 2**32 - 1}, "need 51539607540 bytes"),
    ],
)
def test_sizes_that_lie_are_refused(lies: dict[str, int], says: str) -> None:
    points = np.zeros(4, dtype=XYZ)
    with pytest.raises(CdrError, match=says):
        decode(messages.point_cloud(STAMP, points, **lies))


def test_a_short_row_step_is_refused() -> None:
    points = np.zeros(4, dtype=XYZ)
    with pytest.raises(CdrError, match="row_step is 20"):
        decode(messages.point_cloud(STAMP, points, height=2, row_padding=1, row_step=20))


def test_a_cloud_without_z_names_its_fields() -> None:
    points = np.zeros(2, dtype=[("x", "<f4"), ("y", "<f4"), ("zed", "<f4")])
    with pytest.raises(ContentError, match="no field 'z', only 'x', 'y', 'zed'") as caught:
        decode(messages.point_cloud(STAMP, points))
    assert "--lidar-topic" in caught.value.fix


def test_whole_numbers_are_coordinates_too() -> None:
    points = np.array([(1, -2, 3)], dtype=[("x", "<i2"), ("y", "<i2"), ("z", "<i2")])
    assert points_of(parse_cloud(memoryview(messages.point_cloud(STAMP, points)))).tolist() == [
        [1, -2, 3]
    ]


HEADER_S = STAMP / 1e9


@pytest.mark.parametrize(
    ("name", "kind", "option", "values", "expected_ns"),
    [
        ("t", "<u4", None, [0, 99_999_999], [0, 99_999_999]),
        ("offset_time", "<u4", None, [7, 10**9], [7, 10**9]),
        ("time", "<f4", None, [-0.0625, 0.5], [-62_500_000, 500_000_000]),
        ("stamp", "<u2", "stamp:ms:header", [0, 99], [0, 99_000_000]),
        ("stamp", "<i4", "stamp:us:header", [-5, 99], [-5_000, 99_000]),
        ("dt", "<f8", "dt:ns:header", [-1.0, 2.0], [-1, 2]),
    ],
)
def test_times_after_the_header(
    name: str, kind: str, option: str | None, values: list[float], expected_ns: list[int]
) -> None:
    scan = decode(messages.point_cloud(STAMP, with_time(name, kind, values)), option=option)
    assert scan.point_stamps_ns.tolist() == [STAMP + ns for ns in expected_ns]


def test_absolute_seconds_and_nanoseconds_are_told_by_magnitude() -> None:
    seconds = with_time("timestamp", "<f8", [1_700_000_000.25, 1_700_000_000.75])
    scan = decode(messages.point_cloud(STAMP, seconds))
    assert scan.point_stamps_ns.tolist() == [1_700_000_000_250_000_000, 1_700_000_000_750_000_000]

    nanoseconds = with_time("timestamp", "<f8", [STAMP + 1024.0, STAMP + 2048.0])
    scan = decode(messages.point_cloud(STAMP, nanoseconds))
    assert np.abs(scan.point_stamps_ns - [STAMP + 1024, STAMP + 2048]).max() <= 256  # of float64


@pytest.mark.parametrize("scale", [1.0, 1e9])
def test_junk_in_single_points_does_not_tell_the_unit(scale: float) -> None:
    times = [1_700_000_000.25, 1e18, 1_700_000_000.5, 1_700_000_000.75]
    points = with_time("timestamp", "<f8", [time * scale for time in times])
    points["x"][1] = np.nan
    scan = decode(messages.point_cloud(STAMP, points))
    offsets_ns = [250_000_000, STAMP % 10**9, 500_000_000, 750_000_000]
    assert np.abs(scan.point_stamps_ns - 17 * 10**17 - offsets_ns).max() <= 256  # of float64


@pytest.mark.parametrize("header_ns", [0, 50_000_000, 500 * 10**9])
def test_clocks_that_count_from_power_on_are_told_by_magnitude_too(header_ns: int) -> None:
    later_ns = header_ns + 90_000_000
    for values in ([header_ns, later_ns], [header_ns / 1e9, later_ns / 1e9]):
        points = with_time("timestamp", "<f8", [float(value) for value in values])
        scan = decode(messages.point_cloud(header_ns, points))
        assert scan.point_stamps_ns.tolist() == [header_ns, later_ns]


def test_epoch_option_reads_unusual_absolute_times() -> None:
    points = with_time("when", "<f8", [STAMP / 1e3 + 0.5])
    scan = decode(messages.point_cloud(STAMP, points), option="when:us:absolute")
    assert abs(int(scan.point_stamps_ns[0]) - (STAMP + 500)) <= 256


def test_times_far_from_the_header_name_both_ranges() -> None:
    points = with_time("time", "<f4", [0.0, 4.0])
    says = r"spans 1700000000\.123457 to 1700000004\.123457 s, the he"
    with pytest.raises(PointTimeError, match=says) as caught:
        decode(messages.point_cloud(STAMP, points))
    assert "--point-time time:UNIT:REFERENCE" in caught.value.fix
    assert "read as time:s:header" in caught.value.fix
    assert "--point-time none" in caught.value.fix


def test_not_a_number_is_no_time() -> None:
    with pytest.raises(PointTimeError, match="no finite point time"):
        decode(messages.point_cloud(STAMP, with_time("time", "<f4", [np.nan, np.nan])))


def test_junk_times_of_points_without_return_do_no_harm() -> None:
    points = with_time("time", "<f4", [0.0625, np.nan, 1e30])
    points["x"][1:] = [0.0, np.nan]
    scan = decode(messages.point_cloud(STAMP, points))
    assert scan.point_stamps_ns.tolist() == [STAMP + 62_500_000, STAMP, STAMP]
    assert (scan.start_ns, scan.end_ns) == (STAMP, STAMP + 62_500_000)


@pytest.mark.parametrize("reach", [(0, 10**9), (-(10**9), 10**9)])
def test_only_unsigned_offsets_cannot_reach_back(reach: tuple[int, int]) -> None:
    unsigned = reach[0] == 0
    assert PointTime("t", "ns", "header", unsigned=unsigned).reach_ns == reach
    assert PointTime("t", "ns", "epoch", unsigned=True).reach_ns == (-(10**9), 10**9)
