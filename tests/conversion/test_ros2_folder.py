"""ROS 2 folders and bare SQLite files: every storage and compression, splits, and damage."""

from __future__ import annotations

import hashlib
import pickle
import shutil
import sqlite3
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
import zstandard
from mcap.writer import CompressionType

from civil_rgbd.conversion import db3, mcap, ros2_folder
from civil_rgbd.conversion.ros2_folder import metadata_of
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import RecordingError, UsageError

from . import containers, messages, scene
from .test_bag import assert_same

SALVAGE = RecordingOptions(salvage=True)
MESSAGES = scene.flat(scene.whole())


@pytest.fixture(scope="module")
def expected(tmp_path_factory: pytest.TempPathFactory) -> Recording:
    return mcap.open_recording(scene.write(tmp_path_factory.mktemp("e") / "a.mcap", scene.whole()))


@pytest.fixture
def database(tmp_path: Path) -> Path:
    folder = containers.write_folder(tmp_path / "walk", MESSAGES)
    return folder.joinpath("walk.db3").rename(tmp_path / "walk.db3")


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
@pytest.mark.parametrize("compression", [None, "message", "file"])
def test_a_folder_of_another_writer_is_read(
    tmp_path: Path, expected: Recording, storage: str, compression: str | None
) -> None:
    if (storage, compression) == ("mcap", "message"):
        pytest.skip("the rosbags library compresses messages in SQLite only")
    folder = tmp_path / "park_street.2024"
    containers.write_folder(folder, MESSAGES, storage=storage, compression=compression)
    opened = open_recording(folder)

    assert_same(opened, expected)
    assert opened.name == "park_street.2024"
    assert opened.notes == expected.notes
    (source,) = opened.sources
    (file,) = (path for path in folder.iterdir() if path.name != "metadata.yaml")
    assert (source.name, source.converter) == (file.name, "ros2-folder")
    assert source.sha256 == hashlib.sha256(file.read_bytes()).hexdigest()
    travelled = pickle.loads(pickle.dumps(opened))  # noqa: S301 - our own bytes
    assert_same(travelled, expected)
    assert_same(ros2_folder.open_recording(folder / "metadata.yaml"), expected)


def test_a_file_without_its_folder_is_read(database: Path, expected: Recording) -> None:
    opened = open_recording(database)

    assert_same(opened, expected)
    assert opened.name == "walk"
    assert opened.sources[0].converter == "db3"
    assert [path.name for path in database.parent.glob("walk.db3*")] == ["walk.db3"]


def test_a_packed_file_without_its_folder_is_read(database: Path, expected: Recording) -> None:
    packed = database.with_name("walk.db3.zstd")
    packed.write_bytes(zstandard.compress(database.read_bytes()))
    database.unlink()
    opened = open_recording(packed)

    assert_same(opened, expected)
    assert opened.name == "walk"
    assert opened.sources[0].name == "walk.db3.zstd"


def test_an_unpacked_copy_goes_with_its_recording(
    database: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    packed = database.with_name("walk.db3.zstd")
    packed.write_bytes(zstandard.compress(database.read_bytes()))
    aside = tmp_path / "aside"
    aside.mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(aside))
    opened = db3.open_recording(packed)
    opened.read_scan(0)
    assert len(list(aside.rglob("walk.db3"))) == 1
    travelled = pickle.loads(pickle.dumps(opened))  # noqa: S301 - our own bytes
    travelled.read_scan(0)
    assert len(list(aside.rglob("walk.db3"))) == 1  # found, not unpacked again

    del opened
    assert not list(aside.iterdir())
    del travelled


def split(folder: Path, storage: str) -> Path:
    """A folder of three files, as `ros2 bag record --max-bag-size` leaves it."""
    folder.mkdir()
    names = []
    for i in range(3):
        some = MESSAGES[i::3]  # in any order: log times decide
        whole = containers.write_folder(folder / f"part{i}", some, storage=storage)
        (file,) = (path for path in whole.iterdir() if path.name != "metadata.yaml")
        names.append(f"{folder.name}_{i}{file.suffix}")
        file.rename(folder / names[-1])
        shutil.rmtree(whole)
    lines = ["rosbag2_bagfile_information:", f"  storage_identifier: {storage}"]
    lines += ["  relative_file_paths:", *(f"    - {name}" for name in names)]
    lines += ["  duration:", "    nanoseconds: 5"]
    (folder / "metadata.yaml").write_text("\n".join(lines) + "\n", "utf-8")
    return folder


@pytest.mark.parametrize("storage", ["sqlite3", "mcap"])
def test_splits_are_one_recording(tmp_path: Path, expected: Recording, storage: str) -> None:
    opened = open_recording(split(tmp_path / "long", storage))

    assert_same(opened, expected)
    assert [Path(source.name).stem for source in opened.sources] == ["long_0", "long_1", "long_2"]


def test_a_folder_without_metadata_is_read_by_the_names_of_its_files(
    tmp_path: Path, expected: Recording
) -> None:
    folder = split(tmp_path / "long", "sqlite3")
    (folder / "metadata.yaml").unlink()
    (folder / "long_2.db3").rename(folder / "long_10.db3")
    opened = open_recording(folder)

    assert_same(opened, expected)
    assert [source.name for source in opened.sources] == ["long_0.db3", "long_1.db3", "long_10.db3"]


def test_several_folders_are_one_recording(tmp_path: Path, expected: Recording) -> None:
    half = len(MESSAGES) // 2
    first = containers.write_folder(tmp_path / "first", MESSAGES[:half])
    second = containers.write_folder(tmp_path / "second", MESSAGES[half:])
    opened = open_recording(first, RecordingOptions(more_files=(second,)))

    assert_same(opened, expected)
    assert opened.name == "first"


def test_large_messages_are_indexed_by_their_heads(tmp_path: Path) -> None:
    parts = scene.whole()
    points = np.arange(600_000, dtype=np.float32).reshape(-1, 3)
    big = messages.xyz_cloud(scene.stamp(0), points)
    parts["scans"][0] = parts["scans"][0]._replace(payload=big)
    folder = containers.write_folder(tmp_path / "a", scene.flat(parts))
    assert np.array_equal(open_recording(folder).read_scan(0).points, points)

    squeezed = containers.write_folder(tmp_path / "b", scene.flat(parts), compression="message")
    assert np.array_equal(open_recording(squeezed).read_scan(0).points, points)


def test_what_the_recorder_had_not_yet_moved_into_the_file_is_read(
    database: Path, expected: Recording
) -> None:
    with closing(sqlite3.connect(database)) as recorder:
        recorder.execute("PRAGMA journal_mode = WAL")
        recorder.execute("PRAGMA wal_autocheckpoint = 0")
        recorder.execute("CREATE TABLE kept AS SELECT * FROM messages WHERE id > 40")
        recorder.execute("DELETE FROM messages WHERE id > 40")
        recorder.commit()
        recorder.execute("PRAGMA wal_checkpoint(TRUNCATE)")
        recorder.execute("INSERT INTO messages SELECT * FROM kept")
        recorder.commit()
        copy = database.with_name("killed.db3")
        for suffix in ("", "-wal"):
            source = database.with_name(f"{database.name}{suffix}")
            shutil.copy(source, copy.with_name(f"{copy.name}{suffix}"))

    assert_same(db3.open_recording(copy), expected)


def test_recordings_of_others_are_listed(shared_data: Path) -> None:
    bags = shared_data / "rosbags_rs" / "tests" / "test_bags"
    found = {}
    for name in ("test_bag_sqlite3", "test_bag_mcap"):
        summary = ros2_folder.inspect_recording(bags / name)
        found[name] = {topic.name: (topic.type_name, topic.messages) for topic in summary.topics}
        with pytest.raises(UsageError, match="several topics carry"):
            open_recording(bags / name)

    assert found["test_bag_sqlite3"] == found["test_bag_mcap"]
    assert len(found["test_bag_mcap"]) == 94
    assert sum(count for _, count in found["test_bag_mcap"].values()) == 188


class TestMetadata:
    @pytest.mark.parametrize(
        ("listed", "files"),
        [
            (":\n    - a_0.db3\n    - a_1.db3\n  next: 1", ("a_0.db3", "a_1.db3")),
            (":\n  - 'it''s_0.db3'\n  next: 1", ("it's_0.db3",)),
            (':\n  - "a \\u00e9.db3"', ("a \u00e9.db3",)),
            (": [a_0.db3, 'a_1.db3']", ("a_0.db3", "a_1.db3")),
            (":\n  []", ()),
            (": []", ()),
        ],
    )
    def test_the_list_of_files_in_every_writing(self, listed: str, files: tuple[str, ...]) -> None:
        text = f"x:\n  storage_identifier: sqlite3\n  relative_file_paths{listed}\n"
        assert metadata_of(text).files == files
        assert metadata_of(text).storage == "sqlite3"

    def test_early_recorders_put_the_folder_before_the_file(
        self, tmp_path: Path, expected: Recording
    ) -> None:
        folder = containers.write_folder(tmp_path / "walk", MESSAGES)
        path = folder / "metadata.yaml"
        text = path.read_text("utf-8")
        assert "- walk.db3" in text
        path.write_text(text.replace("- walk.db3", "- walk/walk.db3"))
        assert_same(open_recording(folder), expected)

    def test_a_listed_file_that_is_not_there_is_named(self, tmp_path: Path) -> None:
        folder = containers.write_folder(tmp_path / "walk", MESSAGES)
        (folder / "walk.db3").unlink()
        with pytest.raises(
            RecordingError, match=r"lists 'walk\.db3', which is not there"
        ) as caught:
            open_recording(folder)
        assert "copy" in caught.value.fix

    def test_nothing_outside_of_the_folder_is_opened(self, tmp_path: Path) -> None:
        folder = containers.write_folder(tmp_path / "walk", MESSAGES)
        (folder / "walk.db3").rename(tmp_path / "walk.db3")
        path = folder / "metadata.yaml"
        path.write_text(path.read_text("utf-8").replace("- walk.db3", "- ../walk.db3"))
        with pytest.raises(RecordingError, match="which is not there"):
            open_recording(folder)

    def test_another_storage_is_named(self, tmp_path: Path) -> None:
        (tmp_path / "metadata.yaml").write_text("storage_identifier: rocksdb\n")
        with pytest.raises(RecordingError, match="storage_identifier is 'rocksdb'") as caught:
            open_recording(tmp_path)
        assert "ros2 bag convert" in caught.value.fix

    def test_a_folder_without_metadata_says_so(self, tmp_path: Path) -> None:
        with pytest.raises(RecordingError, match=r"holds no metadata\.yaml"):
            ros2_folder.open_recording(tmp_path)


class TestDamage:
    @pytest.mark.parametrize("content", [b"", b"SQLite", b"#ROSBAG V2.0\n"])
    def test_something_else_is_no_database(self, tmp_path: Path, content: bytes) -> None:
        path = tmp_path / "other.db3"
        path.write_bytes(content)
        with pytest.raises(RecordingError, match="no SQLite file"):
            db3.open_recording(path)

    def test_another_database_is_no_recording(self, tmp_path: Path) -> None:
        path = tmp_path / "books.db3"
        with closing(sqlite3.connect(path)) as other:
            other.execute("CREATE TABLE books (title TEXT)")
        with pytest.raises(RecordingError, match="no such table: topics"):
            db3.open_recording(path)

    def test_a_cut_file_tells_what_is_readable_and_salvage_reads_it(self, database: Path) -> None:
        data = database.read_bytes()
        database.write_bytes(data[: len(data) * 2 // 3])
        with pytest.raises(RecordingError, match=r"damaged: .* messages over .* s are") as caught:
            db3.open_recording(database)
        assert "--salvage" in caught.value.fix
        opened = db3.open_recording(database, SALVAGE)
        count = len(opened.scan_stamps_ns)
        assert 3 < count < scene.SCANS
        assert len(opened.read_scan(count - 1).points) == 30
        assert "readable" in str(opened.notes.salvage)

    def test_rows_behind_a_hole_are_found(self, database: Path) -> None:
        data = bytearray(database.read_bytes())
        at = 4096 * (len(data) // 4096 // 2)
        data[at : at + 4096] = b"\xff" * 4096
        database.write_bytes(data)
        opened = db3.open_recording(database, SALVAGE)
        assert scene.stamp(19) in opened.scan_stamps_ns
        assert len(opened.scan_stamps_ns) + len(opened.image_stamps_ns) < 2 * scene.SCANS

    def test_a_row_of_no_topic_is_said(self, database: Path) -> None:
        with closing(sqlite3.connect(database)) as other:
            other.execute("UPDATE messages SET topic_id = 99 WHERE id = 20")
            other.commit()
        with pytest.raises(RecordingError, match="row 20 is no message"):
            db3.open_recording(database)
        assert db3.open_recording(database, SALVAGE).notes.salvage is not None

    def test_a_payload_that_is_no_bytes_is_said(self, database: Path) -> None:
        with closing(sqlite3.connect(database)) as other:
            other.execute("UPDATE messages SET data = 12345 WHERE id = 1")
            other.commit()
        with pytest.raises(RecordingError, match="in row 1:"):
            db3.open_recording(database)

    def test_an_unfinished_transaction_is_said(self, database: Path) -> None:
        database.with_name("walk.db3-journal").write_bytes(b"\xd9\xd5" * 300)
        with pytest.raises(RecordingError, match=r"walk\.db3-journal lies beside it"):
            db3.open_recording(database)

    def test_a_cut_packed_file_is_said(self, database: Path) -> None:
        packed = database.with_name("walk.db3.zstd")
        whole = zstandard.compress(database.read_bytes())
        packed.write_bytes(whole[: len(whole) // 2])
        with pytest.raises(RecordingError, match=r"damaged|no SQLite"):
            db3.open_recording(packed)

    def test_a_packed_bomb_is_refused(self, tmp_path: Path) -> None:
        packed = tmp_path / "bomb.db3.zstd"
        packed.write_bytes(zstandard.compress(bytes(64 << 20)))
        with pytest.raises(RecordingError, match="unpacks to more than"):
            db3.open_recording(packed)

    def test_a_file_that_changes_while_open_is_said(self, database: Path) -> None:
        opened = db3.open_recording(database)
        with database.open("ab") as file:
            file.write(b"more")
        with pytest.raises(RecordingError, match="not the one that was opened"):
            opened.read_scan(0)


@pytest.mark.parametrize("compression", list(CompressionType))
def test_mcap_with_ros_1_messages_is_read(
    tmp_path: Path, expected: Recording, compression: CompressionType
) -> None:
    as_ros1 = [
        message._replace(
            payload=containers.as_ros1(message), type_name=message.type_name.replace("/msg/", "/")
        )
        for message in MESSAGES
    ]
    path = scene.write(tmp_path / "a.mcap", as_ros1, encoding="ros1", compression=compression)
    assert_same(open_recording(path), expected)


def test_one_topic_in_two_encodings_is_refused(tmp_path: Path) -> None:
    old = scene.write(
        tmp_path / "old.mcap",
        [m._replace(payload=containers.as_ros1(m)) for m in MESSAGES],
        encoding="ros1",
    )
    new = scene.write(tmp_path / "new.mcap", MESSAGES)
    with pytest.raises(RecordingError, match="of ROS 1 and of ROS 2"):
        open_recording(old, RecordingOptions(more_files=(new,)))
