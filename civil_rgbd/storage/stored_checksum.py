"""The SHA-256 that S3 keeps of an object, where whoever uploaded it asked for one.

Only that of the whole object is the file's: an upload in parts leaves a hash of hashes. fsspec
knows nothing of it, so this is one signed request of our own (AWS Signature Version 4). Whatever
goes wrong here, the answer is None, and the object is read instead.
"""

from __future__ import annotations

import base64
import binascii
import hashlib
import hmac
import logging
import os
import urllib.request
from collections.abc import Mapping
from datetime import UTC, datetime
from typing import Final
from urllib.parse import quote, urlsplit

from civil_rgbd.errors import CivilRgbdError
from civil_rgbd.storage.credentials import s3_settings
from civil_rgbd.storage.remote_path import RemotePath

_TIMEOUT_S: Final = 10.0
_NO_BODY: Final = hashlib.sha256(b"").hexdigest()
_log = logging.getLogger(__name__)


def stored_sha256(path: RemotePath) -> str | None:
    """Return the SHA-256 that the storage has of a whole object, lower-case hex.

    Args:
        path: the object, pinned: the checksum of another version is none.

    Returns:
        None where there is none, or it cannot be asked for.
    """
    if path.protocol != "s3":
        return None
    try:
        return _from_headers(_head(path))
    except (OSError, CivilRgbdError, ValueError, KeyError) as error:
        _log.debug("no stored checksum of %s: %s", path, error)
        return None


def _from_headers(headers: Mapping[str, str]) -> str | None:
    encoded = headers.get("x-amz-checksum-sha256", "")
    kind = headers.get("x-amz-checksum-type") or ("COMPOSITE" if "-" in encoded else "FULL_OBJECT")
    if not encoded or kind != "FULL_OBJECT" or "-" in encoded:
        return None
    try:
        digest = base64.b64decode(encoded, validate=True)
    except binascii.Error:
        return None
    return digest.hex() if len(digest) == hashlib.sha256().digest_size else None


def _head(path: RemotePath) -> Mapping[str, str]:
    settings = s3_settings(os.environ)
    region = settings.config.get("region", "us-east-1")
    bucket, _, key = path.url.partition("://")[2].partition("/")
    endpoint = settings.endpoint or f"https://s3.{region}.amazonaws.com"
    address = f"{endpoint.rstrip('/')}/{quote(bucket)}/{quote(key, safe='/~')}"
    headers: dict[str, str] = {"host": urlsplit(address).netloc, "x-amz-checksum-mode": "ENABLED"}
    if path.pinned and path.pinned[1]:
        headers["if-match"] = path.pinned[1]
    config = settings.config
    identity = {
        "key": config.get("access_key_id") or os.environ.get("AWS_ACCESS_KEY_ID", ""),
        "secret": config.get("secret_access_key") or os.environ.get("AWS_SECRET_ACCESS_KEY", ""),
        "token": config.get("session_token") or os.environ.get("AWS_SESSION_TOKEN", ""),
    }
    if identity["key"]:
        headers.update(_signed(address, headers, identity, region))
    request = urllib.request.Request(address, method="HEAD", headers=headers)  # noqa: S310  # the endpoint is the user's own
    with urllib.request.urlopen(request, timeout=_TIMEOUT_S) as answer:  # noqa: S310  # same
        return {name.lower(): value for name, value in answer.headers.items()}


def _signed(
    address: str, headers: Mapping[str, str], identity: Mapping[str, str], region: str
) -> dict[str, str]:
    """Return the headers that sign a HEAD request, by the recipe of Signature Version 4."""
    now = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    added = {"x-amz-content-sha256": _NO_BODY, "x-amz-date": now}
    if identity["token"]:
        added["x-amz-security-token"] = identity["token"]
    signed = dict(sorted({**headers, **added}.items()))
    names = ";".join(signed)
    lines = "".join(f"{name}:{value.strip()}\n" for name, value in signed.items())
    canonical = f"HEAD\n{urlsplit(address).path}\n\n{lines}\n{names}\n{_NO_BODY}"
    scope = f"{now[:8]}/{region}/s3/aws4_request"
    digest = hashlib.sha256(canonical.encode()).hexdigest()
    secret = f"AWS4{identity['secret']}".encode()
    for part in scope.split("/"):
        secret = hmac.digest(secret, part.encode(), "sha256")
    text = f"AWS4-HMAC-SHA256\n{now}\n{scope}\n{digest}"
    signature = hmac.digest(secret, text.encode(), "sha256").hex()
    added["authorization"] = (
        f"AWS4-HMAC-SHA256 Credential={identity['key']}/{scope}, SignedHeaders={names}, "
        f"Signature={signature}"
    )
    return added
