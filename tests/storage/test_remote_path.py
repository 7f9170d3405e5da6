"""A name on object storage behaves as a path does."""

from __future__ import annotations

import io
import os
import pickle
import sys
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import pytest

from civil_rgbd.errors import MissingExtraError, RecordingError, StorageError, UsageError
from civil_rgbd.storage.client import ConditionError, ask
from civil_rgbd.storage.credentials import no_credentials
from civil_rgbd.storage.places import entries_of, files_below, place_of, remove_tree
from civil_rgbd.storage.range_file import BLOCK_BYTES, KEPT_BLOCKS
from civil_rgbd.storage.remote_path import RemotePath

from .conftest import Server


def test_a_url_is_told_from_a_path_even_when_pathlib_flattened_it() -> None:
    url = RemotePath("s3://raw-scans/a/b.mcap")

    assert place_of("s3://raw-scans/a/b.mcap") == url
    assert place_of(Path("s3://raw-scans/a/b.mcap")) == url
    assert place_of(url) is url
    assert place_of("a/b.mcap") == Path("a/b.mcap")
    assert place_of("s3/b.mcap") == Path("s3/b.mcap")
    assert place_of(Path("C:/b.mcap")) == Path("C:/b.mcap")


@pytest.mark.parametrize("protocol", ["gs", "gcs", "abfs", "foo", "S3"])
def test_no_protocol_is_taken_for_a_folder(protocol: str) -> None:
    url = f"{protocol}://sets/kitchener"
    assert (
        place_of(Path(url)) == place_of(url) == RemotePath(f"{protocol.lower()}://sets/kitchener")
    )


@pytest.mark.parametrize(
    ("url", "words"),
    [("s3://", "names no bucket"), ("gs:///", "names no bucket"), ("file:///a", "no file://")],
)
def test_urls_that_name_nothing_on_a_storage_are_refused(url: str, words: str) -> None:
    for location in (url, Path(url)):
        with pytest.raises(UsageError, match=words) as caught:
            place_of(location)
        assert caught.value.fix.startswith("give ")


def test_names_are_taken_apart_as_those_of_paths() -> None:
    path = RemotePath("s3://raw-scans/a/b.mcap/")

    assert (path.name, path.stem, path.suffix) == ("b.mcap", "b", ".mcap")
    assert path.parent / "c" == path.with_name("c") == RemotePath("s3://raw-scans/a/c")
    assert path.parent.parent.parent == RemotePath("s3://raw-scans")
    assert (RemotePath("s3://x/.b").stem, RemotePath("s3://x/.b").suffix) == (".b", "")


def test_a_signature_in_a_link_is_not_shown() -> None:
    path = RemotePath("https://host/a%20b/scan.mcap?X-Amz-Signature=abc")

    assert str(path) == "https://host/a%20b/scan.mcap?..."
    assert "abc" not in repr(path)
    assert (path.name, path.suffix) == ("scan.mcap", ".mcap")


def test_what_is_written_is_read_listed_and_deleted(bucket: RemotePath) -> None:
    names = ["x/a.bin", "x/b/c d?#.bin", "xy.bin"]
    for number, name in enumerate(names):
        (bucket / name).write_bytes(bytes(number + 1))

    assert [(bucket / name).read_bytes() for name in names] == [b"\0", b"\0" * 2, b"\0" * 3]
    assert files_below(bucket / "x") == {"a.bin": 1, "b/c d?#.bin": 2}
    assert [path.name for path in entries_of(bucket / "x")] == ["a.bin", "b"]
    assert [path.name for path in (bucket / "x").glob("*.bin")] == ["a.bin"]
    assert (bucket / "x").is_dir()
    assert not (bucket / "x").is_file()
    assert (bucket / "x/a.bin").is_file()
    assert not (bucket / "x/a.bin").is_dir()
    assert not (bucket / "x/a").exists()
    remove_tree(bucket / "x")
    assert files_below(bucket) == {"xy.bin": 3}


def test_what_is_missing_is_no_error_to_ask_for_and_one_to_read(bucket: RemotePath) -> None:
    missing = bucket / "nothing"

    assert not missing.exists()
    assert entries_of(missing) == []
    missing.unlink()
    with pytest.raises(FileNotFoundError, match="nothing"):
        missing.read_bytes()
    with pytest.raises(FileNotFoundError, match="nothing"):
        missing.open()


def test_conditions_hold(bucket: RemotePath) -> None:
    url = (bucket / "lock").url
    etag = ask("write_on", url, b"one", None)

    with pytest.raises(ConditionError, match=r"exists|condition"):
        ask("write_on", url, b"two", None)
    with pytest.raises(ConditionError, match="condition"):
        ask("write_on", url, b"two", '"0123"')
    assert (bucket / "lock").read_bytes() == b"one"
    assert ask("write_on", url, b"two", etag) != etag
    assert (bucket / "lock").read_bytes() == b"two"


def test_ranges_are_those_of_a_file_and_each_travels_once(bucket: RemotePath, s3: Server) -> None:
    data = os.urandom(3 * BLOCK_BYTES + 1000)
    path = bucket / "scan.bin"
    path.write_bytes(data)
    before = len(s3.requests())
    file, twin = path.open(), io.BytesIO(data)

    for at, length in [(0, 10), (BLOCK_BYTES - 3, 7), (5, 2 * BLOCK_BYTES), (len(data) - 2, 9)]:
        file.seek(at)
        twin.seek(at)
        assert file.read(length) == twin.read(length)
    file.seek(-10, 2)
    assert file.read() == data[-10:]
    assert path.open().read() == data
    spans = [span for method, _, span in s3.since(before) if method == "GET"]
    starts = [int(span.removeprefix("bytes=").partition("-")[0]) for span in spans]
    ends = [int(span.rpartition("-")[2]) for span in spans]
    assert min(starts) == 0
    assert all(a > b for a, b in zip(sorted(starts)[1:], sorted(ends), strict=False))


def test_memory_holds_a_bounded_number_of_blocks(bucket: RemotePath) -> None:
    from civil_rgbd.storage import range_file

    path = bucket / "long.bin"
    path.write_bytes(bytes((KEPT_BLOCKS + 3) * BLOCK_BYTES))
    with path.open() as file:
        while file.read(BLOCK_BYTES):
            pass

    assert len(range_file._kept) == KEPT_BLOCKS


def test_an_object_that_changes_while_it_is_open_is_refused(bucket: RemotePath) -> None:
    path = bucket / "scan.bin"
    path.write_bytes(bytes(2 * BLOCK_BYTES))
    pinned = pickle.loads(pickle.dumps(path.pin()))  # noqa: S301  # our own
    path.write_bytes(b"\1" * 2 * BLOCK_BYTES)

    with pytest.raises(RecordingError, match="not the one that was opened"):
        pinned.open().read(10)


@pytest.mark.usefixtures("s3")
def test_a_bucket_that_is_not_there_is_named() -> None:
    missing = RemotePath("s3://no-such-bucket/scan.mcap")

    for ask_it in (missing.read_bytes, missing.is_dir, lambda: missing.write_bytes(b"")):
        with pytest.raises(StorageError, match="no such bucket") as caught:
            ask_it()
        assert "s3://no-such-bucket/scan.mcap" in caught.value.where
        assert "AWS_ENDPOINT_URL" in caught.value.fix


def test_a_server_that_is_not_there_is_said_so_soon(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("AWS_ENDPOINT_URL", "http://127.0.0.1:9")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "tester")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")

    with pytest.raises(StorageError, match="cannot be reached") as caught:
        RemotePath("s3://raw-scans/scan.mcap").stat()
    assert "AWS_ENDPOINT_URL" in caught.value.fix


def test_a_process_that_is_nobody_is_told_how_to_be_somebody(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "credentials"))
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "config"))
    monkeypatch.setenv("AWS_EC2_METADATA_DISABLED", "true")

    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    with pytest.raises(StorageError, match="AWS_SECRET_ACCESS_KEY is set, AWS_ACCESS_KEY_ID is"):
        RemotePath("s3://raw-scans/scan.mcap").stat()
    monkeypatch.delenv("AWS_SECRET_ACCESS_KEY")
    with pytest.raises(StorageError, match="no credentials") as caught:
        RemotePath("s3://raw-scans/scan.mcap").stat()
    assert "AWS_ACCESS_KEY_ID" in caught.value.fix
    monkeypatch.setenv("AWS_PROFILE", "field")
    with pytest.raises(StorageError, match="no profile 'field'"):
        RemotePath("s3://raw-scans/scan.mcap").stat()


@pytest.mark.parametrize(
    ("protocol", "words"),
    [("s3", "AWS_PROFILE"), ("gcs", "GOOGLE_APPLICATION_CREDENTIALS"), ("az", "AZURE_STORAGE_")],
)
def test_each_storage_has_credentials_of_its_own(protocol: str, words: str) -> None:
    assert words in no_credentials(f"{protocol}://sets/kitchener").fix


def test_a_profile_of_the_usual_files_is_used(
    s3: Server, bucket: RemotePath, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (bucket / "a").write_bytes(b"1")
    for name in ("AWS_ACCESS_KEY_ID", "AWS_SECRET_ACCESS_KEY", "AWS_ENDPOINT_URL", "AWS_REGION"):
        monkeypatch.delenv(name)
    keys = "aws_access_key_id = me\naws_secret_access_key = mine\n"
    (tmp_path / "credentials").write_text(f"[field]\n{keys}")
    (tmp_path / "config").write_text(
        f"[profile field]\nregion = us-east-1\nendpoint_url = {s3.endpoint}\n"
    )
    monkeypatch.setenv("AWS_SHARED_CREDENTIALS_FILE", str(tmp_path / "credentials"))
    monkeypatch.setenv("AWS_CONFIG_FILE", str(tmp_path / "config"))
    monkeypatch.setenv("AWS_PROFILE", "field")

    assert (bucket / "a").read_bytes() == b"1"


class Refuser(BaseHTTPRequestHandler):
    """A server that denies everything."""

    def do_GET(self) -> None:
        self.send_response(403)
        self.end_headers()
        self.wfile.write(b"<Error><Code>AccessDenied</Code></Error>")

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    do_HEAD = do_PUT = do_GET  # noqa: N815  # as http.server has it


def test_a_storage_that_denies_names_the_rights_that_lack(monkeypatch: pytest.MonkeyPatch) -> None:
    server = HTTPServer(("127.0.0.1", 0), Refuser)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    monkeypatch.setenv("AWS_ENDPOINT_URL", f"http://127.0.0.1:{server.server_port}")
    monkeypatch.setenv("AWS_ACCESS_KEY_ID", "tester")
    monkeypatch.setenv("AWS_SECRET_ACCESS_KEY", "secret")
    path = RemotePath("s3://raw-scans/scan.mcap")
    try:
        with pytest.raises(StorageError, match="denies it") as caught:
            path.read_bytes()
        assert "s3:GetObject" in caught.value.fix
        assert "s3:PutObject" not in caught.value.fix
        with pytest.raises(StorageError, match="denies it") as caught:
            path.write_bytes(b"")
        assert "s3:PutObject" in caught.value.fix
    finally:
        server.shutdown()
        server.server_close()


def test_protocols_that_nothing_speaks_are_named() -> None:
    with pytest.raises(UsageError, match="nothing here speaks foo://"):
        RemotePath("foo://bucket/x").stat()


def test_a_missing_extra_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    from civil_rgbd.storage import client

    client._objects_of.cache_clear()
    with monkeypatch.context() as patch:
        for name in ("obstore", "civil_rgbd.storage.obstore_face", "s3fs"):
            patch.setitem(sys.modules, name, None)
        with pytest.raises(MissingExtraError, match="not installed") as caught:
            RemotePath("s3://raw-scans/scan.mcap").stat()
    assert caught.value.fix == 'pip install "civil-rgbd[s3]"'


def test_no_request_waits_for_a_loop_in_a_thread(
    bucket: RemotePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Answers to a loop arrive from threads that may find the interpreter gone: signal 6."""

    def sync(*_arguments: object, **_more: object) -> None:
        pytest.fail("a coroutine was waited for")

    monkeypatch.setattr("fsspec.asyn.sync", sync)
    one, other = bucket / "one", bucket / "other"

    one.write_bytes(b"12345")
    assert one.read_bytes() == b"12345"
    assert ask("read", one.url, 1, 3) == b"23"
    ask("copy", one.url, other.url)
    assert [path.name for path in bucket.iterdir()] == ["one", "other"]
    assert list(files_below(bucket)) == ["one", "other"]
    other.unlink()
    assert not other.is_file()
