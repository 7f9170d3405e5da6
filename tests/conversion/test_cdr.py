"""CDR: encapsulation, alignment, lengths that lie."""

from __future__ import annotations

import pytest

from civil_rgbd.conversion.cdr import (
    CdrError,
    CdrReader,
    ContentError,
    decoding,
    read_stamp_and_frame,
)
from civil_rgbd.errors import RecordingError

from . import messages


@pytest.mark.parametrize("order", ["<", ">"])
def test_every_type_is_read_at_its_alignment(order: str) -> None:
    written = messages.Cdr(order).put("B", 7).put("d", 0.5).put("B", 8).put("I", 9).text("abc")
    reader = CdrReader(written.put("Q", 10).put("i", -11).octets(b"xyz").done())

    assert reader.uint8() == 7
    assert reader.float64s(1) == (0.5,)
    assert (reader.uint8(), reader.uint32(), reader.text()) == (8, 9, "abc")
    assert (reader.uint64(), reader.int32(), bytes(reader.octets())) == (10, -11, b"xyz")
    assert reader.left == 0


@pytest.mark.parametrize(
    ("start", "says"),
    [
        (b"\x00\x07\x00\x00", r"0x0007 \(XCDR2, little endian\)"),
        (b"\x00\x02\x00\x00", r"parameter-list"),
        (b"\xff\xff\x00\x00", r"unknown"),
        (b"\x00", "1 bytes"),
    ],
)
def test_other_representations_are_refused(start: bytes, says: str) -> None:
    with pytest.raises(CdrError, match=says):
        CdrReader(start)


def test_lengths_beyond_the_payload_are_refused() -> None:
    for written in (messages.Cdr().put("I", 99), messages.Cdr().put("I", 2**32 - 1)):
        with pytest.raises(CdrError, match="claimed"):
            CdrReader(written.done()).octets()
        with pytest.raises(CdrError, match="claimed"):
            CdrReader(written.done()).count(smallest_bytes=4)
    with pytest.raises(CdrError, match="inside a field"):
        CdrReader(messages.Cdr().done()).uint32()
    with pytest.raises(CdrError, match="frame id claims"):
        read_stamp_and_frame(memoryview(messages.Cdr().put("I", 1, 2, 3).done()))


def test_strings_without_nul_and_empty_strings_are_read() -> None:
    reader = CdrReader(messages.Cdr().octets(b"abc").put("I", 0).octets(b"\0").done())
    assert [reader.text(), reader.text(), reader.text()] == ["abc", "", ""]


def test_header_drops_a_leading_slash_of_its_frame() -> None:
    reader = CdrReader(messages.Cdr().header(12_000_000_034, "/velodyne").done())
    assert reader.header() == (12_000_000_034, "velodyne")


def test_decoding_names_message_and_place() -> None:
    with (
        pytest.raises(RecordingError, match="cloud 3 breaks its own layout: too short") as caught,
        decoding("cloud 3", where="a.mcap: /lidar"),
    ):
        raise CdrError("too short")
    assert caught.value.where == "a.mcap: /lidar"


def test_decoding_hands_on_the_remedy_of_content_that_cannot_be_used() -> None:
    with (
        pytest.raises(RecordingError, match="cloud 3: it is upside down") as caught,
        decoding("cloud 3", where="a.mcap: /lidar"),
    ):
        raise ContentError("it is upside down", "turn it")
    assert caught.value.fix == "turn it"
    assert "layout" not in caught.value.what
