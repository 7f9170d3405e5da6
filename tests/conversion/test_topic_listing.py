"""Topics listed from an index, and what happens where the index is missing or lies."""

from __future__ import annotations

import re
import struct
from pathlib import Path

import numpy as np
import pytest
from rosbags import rosbag1

from civil_rgbd.conversion import bag, db3, mcap, ros2_folder
from civil_rgbd.conversion.container import Container
from civil_rgbd.conversion.several_files import walk_files
from civil_rgbd.domain.inspection import TopicListing, timing_of
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import RecordingError, UsageError

from . import containers, scene

MESSAGES = scene.flat(scene.whole())
TIMES = {
    name: np.array([m.log_time_ns for m in MESSAGES if m.topic == name])
    for name in {m.topic for m in MESSAGES}
}


def write_bag(folder: Path, **how: object) -> Path:
    path = folder / "bridge.bag"
    path.write_bytes(containers.bag_by_hand(MESSAGES, **how))  # type: ignore[arg-type]
    return path


def assert_lists_all(listing: TopicListing, *, by_index: bool) -> None:
    assert listing.by_index is by_index
    assert {t.name: (t.messages, t.logged) for t in listing.topics} == {
        name: (len(times), timing_of(times)) for name, times in TIMES.items()
    }
    roles = {topic.name: topic.role for topic in listing.topics}
    assert roles[scene.LIDAR] == "lidar"
    assert roles[scene.CAMERA] == "image"


@pytest.mark.parametrize("compression", sorted(containers.COMPRESSORS))
def test_a_bag_of_either_writer_is_listed_from_its_index(tmp_path: Path, compression: str) -> None:
    theirs = containers.write_bag(tmp_path / "a.bag", MESSAGES, compression=compression)
    for path in (theirs, write_bag(tmp_path, compression=compression)):
        assert_lists_all(bag.list_topics(path), by_index=True)
    with rosbag1.Reader(theirs) as reader:
        expected = {name: info.msgcount for name, info in reader.topics.items()}
    assert {t.name: t.messages for t in bag.list_topics(theirs).topics} == expected


@pytest.mark.parametrize("path", ["evo_ros_bag/example-lz4.bag", "evo_ros_bag/example-bz2.bag"])
def test_bags_of_turtles_are_listed_as_a_walk_finds_them(shared_data: Path, path: str) -> None:
    listing = bag.list_topics(shared_data / path)

    assert listing.by_index
    assert sum(topic.messages for topic in listing.topics) == 8647
    inspected = bag.inspect_recording(shared_data / path)
    assert [(t.name, t.messages, t.logged) for t in listing.topics] == [
        (t.name, t.messages, t.logged) for t in inspected.topics
    ]


def test_no_message_is_read(tmp_path: Path) -> None:
    path = write_bag(tmp_path)
    data = path.read_bytes()
    starts = [m.start() - 4 for m in re.finditer(rb"\x10\0\0\0compression=none", data)]
    spoilt = bytearray(data)
    for start in starts:
        (header,) = struct.unpack_from("<I", data, start)
        (length,) = struct.unpack_from("<I", data, start + 4 + header)
        spoilt[start + 8 + header : start + 8 + header + length] = bytes(length)
    assert starts
    path.write_bytes(spoilt)

    assert_lists_all(bag.list_topics(path), by_index=True)
    with pytest.raises(RecordingError, match="has no record where one begins"):
        bag.open_recording(path)


class TestWithoutAnIndexToTrust:
    def test_a_bag_without_index_is_walked(self, tmp_path: Path) -> None:
        listing = bag.list_topics(write_bag(tmp_path, compression="lz4", index=False))

        assert_lists_all(listing, by_index=False)
        assert "no index" in listing.remarks[0]

    def test_a_cut_bag_is_walked_and_said_to_be_damaged(self, tmp_path: Path) -> None:
        path = write_bag(tmp_path)
        path.write_bytes(path.read_bytes()[: path.stat().st_size * 2 // 3])
        listing = bag.list_topics(path)

        assert not listing.by_index
        assert listing.damage
        found = {t.name: t.messages for t in listing.topics}
        assert 0 < found[scene.LIDAR] < scene.SCANS

    def test_a_cut_index_is_not_believed(self, tmp_path: Path) -> None:
        path = write_bag(tmp_path)
        path.write_bytes(path.read_bytes()[:-40])

        assert_lists_all(bag.list_topics(path), by_index=False)

    def test_an_index_that_leaves_a_chunk_out_is_not_believed(self, tmp_path: Path) -> None:
        path = write_bag(tmp_path)
        data = path.read_bytes()
        last = data.rindex(b"\x12\0\0\0chunk_pos=") - 4
        claimed = b"chunk_count=" + struct.pack("<I", data.count(b"\x12\0\0\0chunk_pos="))
        fewer = b"chunk_count=" + struct.pack("<I", data.count(b"\x12\0\0\0chunk_pos=") - 1)
        assert claimed in data
        path.write_bytes(data[:last].replace(claimed, fewer))

        assert_lists_all(bag.list_topics(path), by_index=False)
        (remark,) = bag.list_topics(path).remarks
        assert re.match(rf"the bag's index counts \d+ messages, {len(MESSAGES)} are", remark)
        assert bag.open_recording(path).notes.warnings[0] == remark

    @pytest.mark.parametrize("where", ["chunk info", "index record"])
    def test_a_count_that_lies_is_not_believed(self, tmp_path: Path, where: str) -> None:
        path = write_bag(tmp_path)
        data = bytearray(path.read_bytes())
        if where == "chunk info":
            data[-4] += 1  # of the last connection of the last chunk
        else:
            at = data.rindex(b"\x0a\0\0\0count=", 0, data.rindex(b"\x04\0\0\0op=\x04"))
            data[at + 10] += 1
        path.write_bytes(data)

        assert_lists_all(bag.list_topics(path), by_index=False)

    def test_an_index_record_that_is_missing_is_noticed(self, tmp_path: Path) -> None:
        path = write_bag(tmp_path)
        data = path.read_bytes()
        place = data.index(b"index_pos=") + 10
        (index_at,) = struct.unpack_from("<Q", data, place)
        lost = data.rindex(b"\x2f\0\0\0", 0, index_at)  # the last record behind the last chunk
        moved = struct.pack("<Q", lost)
        path.write_bytes(data[:place] + moved + data[place + 8 : lost] + data[index_at:])

        assert_lists_all(bag.list_topics(path), by_index=False)

    def test_an_index_position_beyond_the_file_is_not_believed(self, tmp_path: Path) -> None:
        path = write_bag(tmp_path)
        data = bytearray(path.read_bytes())
        at = data.index(b"index_pos=") + 10
        data[at : at + 8] = struct.pack("<Q", 1 << 40)
        path.write_bytes(data)

        assert not bag.list_topics(path).by_index

    def test_any_flipped_byte_of_an_index_gives_a_listing_or_an_error(self, tmp_path: Path) -> None:
        path = write_bag(tmp_path)
        data = path.read_bytes()
        (index_at,) = struct.unpack_from("<Q", data, data.index(b"index_pos=") + 10)
        rng = np.random.default_rng(7)
        for _ in range(150):
            damaged = bytearray(data)
            for at in rng.integers(index_at, len(data), rng.integers(1, 4)).tolist():
                damaged[at] ^= 1 << int(rng.integers(8))
            path.write_bytes(damaged)
            assert sum(t.messages for t in bag.list_topics(path).topics) == len(MESSAGES)

    def test_what_is_no_bag_is_refused_as_by_a_build(self, tmp_path: Path) -> None:
        path = tmp_path / "other.bag"
        path.write_bytes(b"\x89MCAP0\r\n" + bytes(50))
        with pytest.raises(RecordingError, match="no ROS 1 bag"):
            bag.list_topics(path)
        with pytest.raises(RecordingError, match="no such recording"):
            bag.list_topics(tmp_path / "missing.bag")


class TestOtherContainers:
    def test_mcap_is_listed_from_its_summary(self, tmp_path: Path) -> None:
        path = scene.write(tmp_path / "a.mcap", MESSAGES)

        assert_lists_all(mcap.list_topics(path), by_index=True)

    @pytest.mark.parametrize("how", [{"summary": False}, {"chunked": False}])
    def test_mcap_without_chunks_or_statistics_is_walked(
        self, tmp_path: Path, how: dict[str, bool]
    ) -> None:
        path = scene.write(tmp_path / "a.mcap", MESSAGES, **how)  # type: ignore[arg-type]

        assert_lists_all(mcap.list_topics(path), by_index=False)

    def test_any_flipped_byte_behind_the_chunks_gives_a_listing_or_an_error(
        self, tmp_path: Path
    ) -> None:
        path = scene.write(tmp_path / "a.mcap", MESSAGES)
        data = path.read_bytes()
        start, length = scene.chunk_places(data)[-1]
        rng = np.random.default_rng(8)
        for _ in range(150):
            damaged = bytearray(data)
            for at in rng.integers(start + length, len(data) - 8, rng.integers(1, 4)).tolist():
                damaged[at] ^= 1 << int(rng.integers(8))
            path.write_bytes(damaged)
            listing = mcap.list_topics(path)  # a walk takes the records there for messages, if so
            assert not listing.by_index or sum(t.messages for t in listing.topics) == len(MESSAGES)

    @pytest.mark.parametrize(("storage", "by_index"), [("mcap", True), ("sqlite3", False)])
    def test_a_folder_is_listed_as_its_files_are(
        self, tmp_path: Path, storage: str, by_index: bool
    ) -> None:
        folder = containers.write_folder(tmp_path / "a", MESSAGES, storage=storage)
        listing = ros2_folder.list_topics(folder)

        assert_lists_all(listing, by_index=by_index)
        assert listing.converter == "ros2-folder"
        if storage == "sqlite3":
            assert_lists_all(db3.list_topics(folder / "a.db3"), by_index=False)

    def test_files_that_follow_one_another_are_one_recording(self, tmp_path: Path) -> None:
        half = len(MESSAGES) // 2
        first, second = (
            scene.write(tmp_path / f"a_{i}.mcap", part)
            for i, part in enumerate((MESSAGES[:half], MESSAGES[half:]))
        )
        listing = mcap.list_topics(first, RecordingOptions(more_files=(second,)))

        assert_lists_all(listing, by_index=True)
        assert listing.size_bytes == first.stat().st_size + second.stat().st_size

    def test_a_recording_without_topics_says_so(self) -> None:
        from civil_rgbd.converters import list_topics

        with pytest.raises(UsageError, match="'simulated' reads have no topics") as caught:
            list_topics("simulated:demo")
        assert "--topics" in caught.value.fix


@pytest.mark.parametrize("name", ["test_bag_mcap/test_bag_mcap.mcap"])
def test_a_recording_of_94_types_is_listed_as_a_walk_finds_it(shared_data: Path, name: str) -> None:
    path = shared_data / "rosbags_rs/tests/test_bags" / name
    listing = mcap.list_topics(path)

    assert len(listing.topics) == 94
    assert {topic.messages for topic in listing.topics} == {2}
    assert walked_messages(mcap.MCAP, path) == 188


def walked_messages(container: Container, path: Path) -> int:
    found = walk_files(container, [path], lambda *_: None)
    found.payloads.close()
    return found.extent.messages
