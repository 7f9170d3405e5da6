"""Hashes of remote objects that were read once: kept in the user's cache, by URL, size and ETag."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import re
import secrets
from pathlib import Path

from civil_rgbd.resources import cache_folder
from civil_rgbd.storage.remote_path import RemotePath


def cached_sha256(path: RemotePath) -> str | None:
    """Return the hash of an object that was read before; None when it was not, or has changed.

    Args:
        path: the object, pinned.
    """
    try:
        document = json.loads(_file(path).read_text("utf-8"))
        sha256 = document["sha256"] if document["of"] == _identity(path) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return sha256 if re.fullmatch("[0-9a-f]{64}", str(sha256)) else None


def keep_sha256(path: RemotePath, sha256: str) -> None:
    """Keep the hash of an object, unless nothing tells its versions apart, or nothing is writable.

    Args:
        path: the object, pinned.
        sha256: of its bytes.
    """
    if not (path.pinned and path.pinned[1]):
        return
    file = _file(path)
    scratch = file.with_name(f".{secrets.token_hex(8)}")
    with contextlib.suppress(OSError):  # it saves time only
        file.parent.mkdir(parents=True, exist_ok=True)
        scratch.write_text(json.dumps({"of": _identity(path), "sha256": sha256}), "utf-8")
        scratch.replace(file)


def _identity(path: RemotePath) -> list[object]:
    size_bytes, etag = path.pinned or (0, None)
    # The same URL may be another object at another endpoint.
    endpoint = os.environ.get("AWS_ENDPOINT_URL_S3") or os.environ.get("AWS_ENDPOINT_URL")
    return [str(path), size_bytes, etag, endpoint]


def _file(path: RemotePath) -> Path:
    name = hashlib.sha256(json.dumps(_identity(path)).encode()).hexdigest()
    return cache_folder() / "sha256" / f"{name[:40]}.json"
