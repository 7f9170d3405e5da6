"""A forked process reads all the same, though the client's threads did not come along."""

from __future__ import annotations

import multiprocessing
import os
from collections.abc import Callable
from multiprocessing.connection import Connection
from typing import cast

import pytest

from civil_rgbd.errors import StorageError
from civil_rgbd.storage import relay
from civil_rgbd.storage.remote_path import RemotePath

pytestmark = pytest.mark.skipif(os.name == "nt", reason="nothing is forked there")


def in_a_fork(work: Callable[[], object]) -> object:
    """What a function returns, or how it fails, in a forked process."""
    receiver, sender = multiprocessing.Pipe(duplex=False)

    def run(sender: Connection) -> None:
        try:
            sender.send(work())
        except Exception as error:  # noqa: BLE001  # it is looked at
            sender.send(error)

    process = multiprocessing.get_context("fork").Process(target=run, args=(sender,))
    process.start()
    answered = receiver.poll(30)
    answer = receiver.recv() if answered else "no answer"
    process.kill()
    process.join()
    return answer


def test_a_fork_reads_writes_and_fails_as_its_parent_does(bucket: RemotePath) -> None:
    (bucket / "a").write_bytes(b"parent")
    assert not relay.is_needed()

    assert in_a_fork(lambda: (relay.is_needed(), (bucket / "a").read_bytes())) == (True, b"parent")
    assert in_a_fork(lambda: (bucket / "b").write_bytes(b"child")) == 5
    assert (bucket / "b").read_bytes() == b"child"
    assert isinstance(in_a_fork((bucket / "c").read_bytes), FileNotFoundError)
    failed = in_a_fork(lambda: RemotePath("s3://no-such-bucket/a").read_bytes())
    assert "no such bucket" in str(failed)


def test_a_helper_is_whoever_the_fork_is_now(
    bucket: RemotePath, monkeypatch: pytest.MonkeyPatch
) -> None:
    (bucket / "a").write_bytes(b"mine")

    def read() -> bytes:
        return RemotePath(f"{bucket.url}/a").read_bytes()

    def as_others() -> tuple[bytes, str, bytes]:
        first = read()
        monkeypatch.delenv("AWS_ACCESS_KEY_ID")
        with pytest.raises(StorageError) as caught:
            read()
        monkeypatch.setenv("AWS_ACCESS_KEY_ID", "tester")
        return first, str(caught.value), read()

    first, refused, again = cast("tuple[bytes, str, bytes]", in_a_fork(as_others))
    assert (first, again) == (b"mine", b"mine")
    assert "credentials" in refused


def test_a_helper_is_started_once(bucket: RemotePath) -> None:
    (bucket / "a").write_bytes(bytes(10_000_000))

    def twice() -> bool:
        first = len((bucket / "a").read_bytes())
        helper = relay._helper
        return first == len((bucket / "a").read_bytes()) and relay._helper is helper

    assert in_a_fork(twice) is True
