"""The files that a build reads: have they changed, and does another machine see the same?"""

from __future__ import annotations

import hashlib
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from civil_rgbd.domain.recording import SourceFile
from civil_rgbd.errors import BridgeFailedError, RecordingError
from civil_rgbd.format.hashes import file_sha256

_SAMPLE_BYTES: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Fingerprint:
    """What a file or folder looks like from outside; cheap to take, however large it is.

    Attributes:
        path: absolute.
        size_bytes: of a file, or of all files of a folder.
        mtime_ns: of the last change.
        sample_sha256: of the first and the last mebibyte; of names and sizes for a folder.
    """

    path: Path
    size_bytes: int
    mtime_ns: int
    sample_sha256: str

    def same_content(self, other: Fingerprint) -> bool:
        """Tell whether two machines see the same, as far as a sample can."""
        return (self.size_bytes, self.sample_sha256) == (other.size_bytes, other.sample_sha256)


def fingerprint(path: Path) -> Fingerprint:
    """Take the fingerprint of a file or folder.

    Raises:
        OSError: it is not there or cannot be read.
    """
    path = path.absolute()
    return _of_folder(path) if path.is_dir() else _of_file(path)


def _of_file(path: Path) -> Fingerprint:
    status = path.stat()
    with path.open("rb") as stream:
        digest = hashlib.sha256(stream.read(_SAMPLE_BYTES))
        if status.st_size > 2 * _SAMPLE_BYTES:
            stream.seek(-_SAMPLE_BYTES, 2)
        digest.update(stream.read(_SAMPLE_BYTES))
    return Fingerprint(path, status.st_size, status.st_mtime_ns, digest.hexdigest())


def _of_folder(path: Path) -> Fingerprint:
    status = sorted(
        (inner.relative_to(path).as_posix(), inner.stat())
        for inner in path.rglob("*")
        if inner.is_file()
    )
    listing = "".join(f"{name} {stat.st_size}\n" for name, stat in status)
    return Fingerprint(
        path,
        sum(stat.st_size for _, stat in status),
        max((stat.st_mtime_ns for _, stat in status), default=0),
        hashlib.sha256(listing.encode()).hexdigest(),
    )


def fingerprints(paths: Iterable[Path]) -> tuple[Fingerprint, ...]:
    """Take the fingerprints of what is there; what is missing is the converter's to refuse."""
    return tuple(fingerprint(path) for path in paths if path.exists())


def refuse_changed(before: Sequence[Fingerprint], sources: Sequence[SourceFile]) -> None:
    """Refuse to publish what was made from files that changed while they were read.

    Args:
        before: taken before the recording was opened.
        sources: with the hashes taken when it was opened.

    Raises:
        BridgeFailedError: a file is another one now.
    """
    known = {source.sha256 for source in sources}
    for old in before:
        try:
            new = fingerprint(old.path)
            # A new time alone says nothing yet: somebody may have copied the file onto itself.
            same = old == new or (
                old.same_content(new) and old.path.is_file() and file_sha256(old.path) in known
            )
        except OSError:
            same = False
        if not same:
            raise BridgeFailedError(
                "the source changed while it was read: frames of the old and of the new would mix",
                where=old.path,
                fix="wait until nothing writes to it any more, and run the same command again",
            )


def refuse_other_hashes(
    expected: Sequence[str], sources: Sequence[SourceFile], *, where: object
) -> None:
    """Refuse a recording that is not the one whose hash somebody wrote down.

    Args:
        expected: SHA-256 of its files, lower-case hex, in order; () when nobody wrote any down.
        sources: what it was read from.
        where: who wrote them down.

    Raises:
        RecordingError: a hash differs.
    """
    for number, sha256 in enumerate(expected):
        found = sources[number] if number < len(sources) else None
        # A hash that nobody took, because nobody wanted one, is no other hash.
        if found is None or found.sha256 not in {sha256, None}:
            now = f"{found.name} has {found.sha256}" if found else "there is no such file"
            raise RecordingError(
                f"file {number + 1} of the recording should have sha256 {sha256}; {now}",
                where=where,
                fix="fetch the file again; if it was replaced on purpose, write the new sha256",
            )
