"""Stamps as other programs write them."""

from __future__ import annotations

from decimal import Decimal
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from civil_rgbd.domain.stamps import ns_from_seconds, read_stamp_list
from civil_rgbd.errors import RecordingError


def listed(tmp_path: Path, text: str) -> Path:
    path = tmp_path / "timestamps.txt"
    path.write_bytes(text.encode())
    return path


@given(st.integers(-(10**18), 39 * 10**17))
def test_nine_decimals_come_back_to_the_nanosecond(ns: int) -> None:
    sign = "-" if ns < 0 else ""
    assert ns_from_seconds(f"{sign}{abs(ns) // 10**9}.{abs(ns) % 10**9:09d}") == ns


@pytest.mark.parametrize(
    ("text", "ns"),
    [
        ("1305031098.6659", 1305031098665900000),
        ("1305031526.67147303", 1305031526671473030),
        ("1.305031098665900000e+09", 1305031098665900000),
        ("+12", 12_000_000_000),
        ("0.0000000015", 2),  # beyond nanoseconds: half to even
        ("0.0000000025", 2),
        ("1e-999999999", 0),
        ("7.", 7_000_000_000),
    ],
)
def test_decimals_are_exact(text: str, ns: int) -> None:
    assert ns_from_seconds(text) == ns
    assert abs(ns - Decimal(text) * 10**9) <= Decimal("0.5")


@pytest.mark.parametrize(
    "text",
    ["1305031098665900000", "1305031098665", "1e999999999", "nan", "inf", "", "1,5", "12:30"],
)
def test_what_is_no_time_in_seconds_is_refused(text: str) -> None:
    with pytest.raises(ValueError, match=r"no time in seconds|no number"):
        ns_from_seconds(text)


@pytest.mark.parametrize(
    ("text", "names"),
    [
        ("1.5\n2.25\n", None),
        ("\ufeff# seconds\r\n\r\n1.5\r\n2.25\r\n", None),
        ("1.5\r2.25", None),
        ("a.png,1.5\nb.png,2.25", ("a.png", "b.png")),
        ("name,time\nrgb/a.png, 1.5\nrgb/b.png, 2.25,\n", ("a.png", "b.png")),
        ("1.5 rgb/a.png\n2.25 rgb/b.png\n", ("a.png", "b.png")),  # as TUM's rgb.txt
        ("000001 1.5\n000002 2.25", ("000001", "000002")),
    ],
)
def test_lists_are_read_as_people_write_them(
    tmp_path: Path, text: str, names: tuple[str, ...] | None
) -> None:
    found = read_stamp_list(listed(tmp_path, text))
    assert found.stamps_ns.tolist() == [1_500_000_000, 2_250_000_000]
    assert found.names == names


def test_whole_nanoseconds_since_1970_are_told_from_seconds(tmp_path: Path) -> None:
    found = read_stamp_list(listed(tmp_path, "1403636579763555584\n1403636579813555456\n"))
    assert found.stamps_ns.tolist() == [1403636579763555584, 1403636579813555456]


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "holds no stamp"),
        ("# nothing\n", "holds no stamp"),
        ("1.5\n1.5\n", "line 2: the stamp 1.5 is the same as"),
        ("2.5\n\n1.5\n", "line 3: the stamp 1.5 is earlier than"),
        ("1.5\n2.5 a.png\n", "line 2 has 2 columns"),
        ("1.5 a b\n2.5 a b\n", "line 1 has 3 columns"),
        ("1.5\nnan\n", "line 2: 'nan'"),
        ("1403636579763\n1403636579813\n", "beyond the year 2096"),
        ("1403636579763555584\n1403636579.8\n", "line 1: .*beyond the year 2096"),
        ("9999999999999999999\n", "64 bits"),
    ],
)
def test_a_broken_list_is_refused_with_its_line(tmp_path: Path, text: str, words: str) -> None:
    with pytest.raises(RecordingError, match=words):
        read_stamp_list(listed(tmp_path, text))


def test_what_is_no_text_or_not_there_is_refused(tmp_path: Path) -> None:
    (tmp_path / "x").write_bytes(b"\x89PNG\xff")
    with pytest.raises(RecordingError, match="is no text"):
        read_stamp_list(tmp_path / "x")
    with pytest.raises(RecordingError, match="cannot be read: No such file"):
        read_stamp_list(tmp_path / "y")
