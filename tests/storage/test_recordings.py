"""Recordings on object storage: read by range, each byte once, and hashed on the way."""

from __future__ import annotations

import base64
import hashlib
import itertools
import json
import pickle
from datetime import datetime, tzinfo
from pathlib import Path
from typing import BinaryIO

import numpy as np
import pytest
from botocore.auth import S3SigV4Auth
from botocore.awsrequest import AWSRequest
from botocore.credentials import Credentials
from mcap.reader import make_reader
from mcap.writer import Writer

from civil_rgbd.cli import main
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.errors import RecordingError, StorageError, UsageError
from civil_rgbd.simulator.recorder import write_recording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.storage import range_file
from civil_rgbd.storage.range_file import forget_ranges
from civil_rgbd.storage.remote_path import RemotePath

from .conftest import Server

SPEC = ScanSpec(seconds=3.0, image_scale=0.1, point_rate_hz=12_000, image_rate_hz=15.0)


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scan") / "scan.mcap"
    whole = path.with_name("whole.mcap")
    write_recording(whole, SPEC, overwrite=False)
    with whole.open("rb") as source, path.open("wb") as file:
        in_small_chunks(source, file)
    return path


def in_small_chunks(source: BinaryIO, file: BinaryIO) -> None:
    """Write a recording again, in many chunks."""
    writer = Writer(file, chunk_size=1 << 15)
    writer.start()
    schemas: dict[int, int] = {}
    channels: dict[int, int] = {}
    for schema, channel, message in make_reader(source).iter_messages(log_time_order=False):
        assert schema is not None
        if schema.id not in schemas:
            schemas[schema.id] = writer.register_schema(schema.name, schema.encoding, schema.data)
        if channel.id not in channels:
            channels[channel.id] = writer.register_channel(
                channel.topic, channel.message_encoding, schemas[schema.id]
            )
        writer.add_message(
            channels[channel.id], message.log_time, message.data, message.publish_time
        )
    writer.finish()


@pytest.fixture
def remote(scan: Path, bucket: RemotePath, monkeypatch: pytest.MonkeyPatch) -> RemotePath:
    """The same scan in a bucket, in blocks so small that there are many."""
    monkeypatch.setattr(range_file, "BLOCK_BYTES", 1 << 14)
    monkeypatch.setattr(range_file, "KEPT_BLOCKS", 4096)
    forget_ranges()
    path = bucket / "scan.mcap"
    path.write_bytes(scan.read_bytes())
    return path


def fetched(server: Server, before: int) -> list[tuple[int, int]]:
    """First and last byte of every range since, in order."""
    spans = [s for method, path, s in server.since(before) if method == "GET" and "scan" in path]
    assert all(span.startswith("bytes=") for span in spans)
    ends = [span.removeprefix("bytes=").split("-") for span in spans]
    return sorted((int(first), int(last)) for first, last in ends)


def test_a_remote_recording_is_the_local_one(scan: Path, remote: RemotePath) -> None:
    ours, theirs = open_recording(remote.url), open_recording(scan)

    assert ours.sources == theirs.sources
    assert np.array_equal(ours.image_stamps_ns, theirs.image_stamps_ns)
    a, b = ours.read_scan(5), theirs.read_scan(5)
    assert np.array_equal(a.points, b.points)
    assert np.array_equal(ours.read_image(7).rgb, theirs.read_image(7).rgb)


def test_each_byte_travels_once_a_process_hash_included(
    scan: Path, remote: RemotePath, s3: Server
) -> None:
    before = len(s3.requests())

    recording = open_recording(remote.url)
    for index in range(len(recording.scan_stamps_ns)):
        recording.read_scan(index)

    ranges = fetched(s3, before)
    assert ranges[0][0] == 0
    assert ranges[-1][1] == scan.stat().st_size - 1
    assert all(b[0] == a[1] + 1 for a, b in itertools.pairwise(ranges))
    assert recording.sources[0].sha256 == hashlib.sha256(scan.read_bytes()).hexdigest()


def test_a_worker_fetches_only_what_it_reads(remote: RemotePath, scan: Path, s3: Server) -> None:
    sent = pickle.dumps(open_recording(remote.url))
    forget_ranges()
    before = len(s3.requests())

    pickle.loads(sent).read_scan(3)  # noqa: S301  # our own

    assert sum(last - first for first, last in fetched(s3, before)) < scan.stat().st_size / 2


def test_a_hash_that_was_taken_is_not_taken_again_until_the_object_changes(
    remote: RemotePath, scan: Path, s3: Server
) -> None:
    taken = open_recording(remote.url).sources[0].sha256
    (kept,) = [
        file
        for file in (s3.log.parent / "cache/sha256").iterdir()
        if remote.url in file.read_text("utf-8")
    ]
    kept.write_text(kept.read_text("utf-8").replace(str(taken), "c" * 64), "utf-8")

    assert open_recording(remote.url).sources[0].sha256 == "c" * 64
    remote.write_bytes(scan.read_bytes()[:-8] + b"changed!")
    assert open_recording(remote.url, RecordingOptions(salvage=True)).sources[0].sha256 not in {
        taken,
        "c" * 64,
    }
    kept.unlink()


def test_a_hash_that_the_storage_keeps_is_taken_for_the_files(
    remote: RemotePath, scan: Path, s3: Server
) -> None:
    data = scan.read_bytes() + b"kept"
    digest = hashlib.sha256(data).digest()
    bucket = remote.parent.name
    s3.client().put_object(
        Bucket=bucket,
        Key="kept.mcap",
        Body=data,
        ChecksumAlgorithm="SHA256",
    )
    from civil_rgbd.storage.stored_checksum import stored_sha256

    assert stored_sha256((remote.parent / "kept.mcap").pin()) == digest.hex()
    assert stored_sha256(remote.pin()) is None
    with pytest.raises(RecordingError, match="written down is"):
        open_recording(
            (remote.parent / "kept.mcap").url, RecordingOptions(sha256=("0" * 64,), salvage=True)
        )


def test_a_hash_of_parts_is_no_hash_of_the_file() -> None:
    from civil_rgbd.storage.stored_checksum import _from_headers

    whole = base64.b64encode(bytes(32)).decode()
    assert _from_headers({"x-amz-checksum-sha256": whole}) == "00" * 32
    assert _from_headers({"x-amz-checksum-sha256": f"{whole}-3"}) is None
    composite = {"x-amz-checksum-sha256": whole, "x-amz-checksum-type": "COMPOSITE"}
    assert _from_headers(composite) is None
    assert _from_headers({"x-amz-checksum-sha256": "bm90IGEgaGFzaA=="}) is None


def test_our_signature_is_that_of_amazons_own_client(monkeypatch: pytest.MonkeyPatch) -> None:
    from civil_rgbd.storage import stored_checksum

    class Noon(datetime):
        @classmethod
        def now(cls, tz: tzinfo | None = None) -> datetime:
            return datetime(2026, 11, 22, 12, tzinfo=tz)

        utcnow = now

    url = "https://s3.eu-north-1.amazonaws.com/raw-scans/a%20b/scan.mcap"
    headers = {"host": "s3.eu-north-1.amazonaws.com", "x-amz-checksum-mode": "ENABLED"}
    monkeypatch.setattr(stored_checksum, "datetime", Noon)
    identity = {"key": "AKIA0", "secret": "s3cret", "token": "t0ken"}
    ours = stored_checksum._signed(url, headers, identity, "eu-north-1")

    theirs = AWSRequest("HEAD", url, headers=dict(headers))
    signer = S3SigV4Auth(Credentials("AKIA0", "s3cret", "t0ken"), "s3", "eu-north-1")
    theirs.context["timestamp"] = ours["x-amz-date"]
    theirs.headers["X-Amz-Security-Token"] = "t0ken"
    theirs.headers["X-Amz-Date"] = ours["x-amz-date"]
    theirs.headers["X-Amz-Content-SHA256"] = ours["x-amz-content-sha256"]
    text = signer.string_to_sign(theirs, signer.canonical_request(theirs))
    assert ours["authorization"].endswith(f"Signature={signer.signature(text, theirs)}")


def test_a_stated_hash_is_believed_and_none_can_be_wanted(remote: RemotePath) -> None:
    stated = open_recording(remote.url, RecordingOptions(sha256=("a" * 64,)))
    assert stated.sources[0].sha256 == "a" * 64

    unproved = open_recording(remote.url, RecordingOptions(source_hash=False))
    assert unproved.sources[0].sha256 is None
    assert unproved.sources[0].etag == (remote.stat().etag or "").strip('"')


def test_an_object_that_is_replaced_is_refused(remote: RemotePath, scan: Path) -> None:
    recording = open_recording(remote.url)
    remote.write_bytes(scan.read_bytes()[:-1] + b"\0")
    forget_ranges()

    with pytest.raises(RecordingError, match="not the one that was opened"):
        pickle.loads(pickle.dumps(recording)).read_scan(0)  # noqa: S301  # our own


def test_what_cannot_be_read_by_range_says_what_to_do(bucket: RemotePath) -> None:
    for name, words in [
        ("scan.db3", "read from this machine's disk only"),
        ("scan.lvx", "read from this machine's disk only"),
        ("scan.pcd", "read from this machine's disk only"),
        ("scans/", "no converter opens 'scans'"),
    ]:
        (bucket / name.rstrip("/") / "x").write_bytes(b"")
        with pytest.raises(UsageError, match=words):
            open_recording((bucket / name).url)
    (bucket / "scan.mcap.zstd").write_bytes(b"")
    with pytest.raises(RecordingError, match="compressed as a whole") as caught:
        open_recording((bucket / "scan.mcap.zstd").url)
    assert "zstd -d" in caught.value.fix


def test_what_is_not_there_is_named(bucket: RemotePath) -> None:
    with pytest.raises(RecordingError, match="there is no such recording"):
        open_recording((bucket / "scan.mcap").url)
    with pytest.raises(StorageError, match="no such bucket"):
        open_recording("s3://no-such-bucket/scan.mcap")


def test_a_recording_is_inspected_where_it_lies(
    remote: RemotePath, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["inspect-recording", remote.url, "--json"]) == 0

    assert json.loads(capsys.readouterr().out)["name"] == "scan.mcap"


def test_a_link_is_read_too(remote: RemotePath, s3: Server, scan: Path) -> None:
    s3.client().put_object_acl(Bucket=remote.parent.name, Key=remote.name, ACL="public-read")
    link = f"{s3.endpoint}/{remote.parent.name}/scan.mcap"

    assert open_recording(link).sources == open_recording(scan).sources
