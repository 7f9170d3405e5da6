"""What object storage refuses, said as every error here: what, where, what to do."""

from __future__ import annotations

import re
from typing import Final

from civil_rgbd.errors import CivilRgbdError, StorageError
from civil_rgbd.storage.credentials import no_credentials

_CODE: Final = re.compile(r"<Code>(\w+)</Code>")
_STATUS: Final = re.compile(r"status code: (\d{3})")
_UNREACHABLE: Final = re.compile(
    r"error sending request|connect|timed? ?out|dns|refused|resolve|unreachable", re.IGNORECASE
)
_OTHER_REGION: Final = {
    "PermanentRedirect",
    "AuthorizationHeaderMalformed",
    "IllegalLocationConstraint",
}
_NOBODY: Final = re.compile(r"169\.254\.169\.254|NoCredential|credential|metadata", re.IGNORECASE)


def refusal(error: Exception, *, where: str, writing: bool) -> Exception:
    """Turn what a client raised into one of our errors.

    Args:
        error: of obstore, s3fs, or another of fsspec's clients.
        where: the URL.
        writing: something was to be written.

    Returns:
        the error to raise: the same one when it says enough by itself, as FileNotFoundError does.
    """
    text, name = str(error), type(error).__name__
    code = _CODE.search(text)
    said = code[1] if code else ""
    lacks_bucket = "NoSuchBucket" in text or "bucket does not exist" in text
    if lacks_bucket or (writing and isinstance(error, FileNotFoundError)):
        return no_bucket(where)
    if isinstance(error, CivilRgbdError | FileNotFoundError):
        return error
    if name in {"PermissionDeniedError", "UnauthenticatedError", "PermissionError"}:
        return _denied(said, where, writing=writing)
    if _NOBODY.search(text) or _NOBODY.search(name):
        return no_credentials(where)
    return _failed(text, said or name, where)


def _failed(text: str, name: str, where: str) -> StorageError:
    if name in _OTHER_REGION:
        return StorageError(
            f"the bucket lies in another region than asked ({name})",
            where=where,
            fix="set AWS_REGION to the bucket's: `aws s3api get-bucket-location --bucket NAME`",
        )
    if _UNREACHABLE.search(text) or name in {"TimeoutError", "ConnectionError"}:
        return StorageError(
            f"the object storage cannot be reached: {_first_line(text)}",
            where=where,
            fix="check the network and AWS_ENDPOINT_URL; then run the same command again: what is "
            "finished is kept",
        )
    status = _STATUS.search(text)
    return StorageError(
        f"the object storage refuses ({name}): {status[0] if status else _first_line(text)}",
        where=where,
        fix="look it up in the storage's own documentation, or try again",
    )


def no_bucket(where: object) -> StorageError:
    """Compose the error for a bucket that is not there."""
    return StorageError(
        "there is no such bucket",
        where=where,
        fix="check its name and AWS_ENDPOINT_URL; a bucket is made by its owner: `aws s3 mb`",
    )


def _denied(said: str, where: str, *, writing: bool) -> StorageError:
    rights = "s3:PutObject, s3:DeleteObject, " if writing else ""
    return StorageError(
        f"the object storage denies it{f' ({said})' if said else ''}",
        where=where,
        fix=f"ask the bucket's owner for {rights}s3:GetObject and s3:ListBucket, and see who you "
        "are: `aws sts get-caller-identity`",
    )


def _first_line(text: str) -> str:
    line = text.strip().partition("\n")[0]
    return line.rpartition(" - ")[2].strip()[:200]
