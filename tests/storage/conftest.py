"""A real S3 server for the tests of this room."""

from __future__ import annotations

import itertools
import os
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import boto3
import pytest

from civil_rgbd.storage.range_file import forget_ranges
from civil_rgbd.storage.remote_path import RemotePath

HERE = Path(__file__).parent
_numbers = itertools.count()


@dataclass(frozen=True)
class Server:
    """The server, and what it was asked."""

    endpoint: str
    log: Path

    def requests(self) -> list[tuple[str, str, str]]:
        """Method, path and range of every request so far."""
        lines = self.log.read_text("utf-8").splitlines()
        found = []
        for line in lines:
            method, _, rest = line.partition(" ")
            path, _, span = rest.rpartition(" ")
            found.append((method, path, span))
        return found

    def since(self, count: int) -> list[tuple[str, str, str]]:
        """Requests after the first ``count``."""
        return self.requests()[count:]

    def client(self) -> boto3.client:
        """Another client than ours, to look and to meddle."""
        return boto3.client("s3", endpoint_url=self.endpoint)


@pytest.fixture(scope="session")
def s3(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Server]:
    folder = tmp_path_factory.mktemp("s3")
    log = folder / "requests"
    log.touch()
    process = subprocess.Popen(
        [sys.executable, str(HERE / "s3_server.py"), str(log)],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    )
    assert process.stdin is not None
    assert process.stdout is not None
    endpoint = process.stdout.readline().strip()
    settings = {
        "AWS_ENDPOINT_URL": endpoint,
        "AWS_ACCESS_KEY_ID": "tester",
        "AWS_SECRET_ACCESS_KEY": "secret",
        "AWS_REGION": "us-east-1",
        "CIVIL_RGBD_CACHE": str(folder / "cache"),
        "AWS_EC2_METADATA_DISABLED": "true",
        "NO_PROXY": "127.0.0.1",
    }
    with pytest.MonkeyPatch.context() as patch:
        for name, value in settings.items():
            patch.setenv(name, value)
        for name in ("AWS_PROFILE", "AWS_SESSION_TOKEN", "AWS_ENDPOINT_URL_S3"):
            patch.delenv(name, raising=False)
        yield Server(endpoint, log)
    process.stdin.close()
    process.wait(timeout=10)
    process.stdout.close()


@pytest.fixture
def bucket(s3: Server) -> RemotePath:
    """An empty bucket."""
    name = f"bucket-{next(_numbers)}"
    s3.client().create_bucket(Bucket=name)
    forget_ranges()
    return RemotePath(f"s3://{name}")


def pulled(folder: RemotePath) -> dict[str, bytes]:
    """Every object below a folder, by name from there on, read by another client than ours."""
    bucket, _, prefix = folder.url.removeprefix("s3://").partition("/")
    client = boto3.client("s3", endpoint_url=os.environ["AWS_ENDPOINT_URL"])
    pages = client.get_paginator("list_objects_v2").paginate(Bucket=bucket, Prefix=prefix)
    return {
        entry["Key"][len(prefix) :].lstrip("/"): client.get_object(Bucket=bucket, Key=entry["Key"])[
            "Body"
        ].read()
        for page in pages
        for entry in page.get("Contents", [])
    }
