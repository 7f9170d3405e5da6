"""Members of a tar file from a stranger: plain files and folders, nothing that could do harm.

Not by the standard library's ``tarfile``: that one follows every extension of forty years, and what
an archive of a bridge needs is a header of 512 bytes.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from typing import BinaryIO, Final

from civil_rgbd.errors import FormatError

BLOCK: Final = 512
_PAX_LIMIT: Final = 65_536
_KINDS: Final = {
    b"1": "a hard link",
    b"2": "a symbolic link",
    b"3": "a device",
    b"4": "a device",
    b"6": "a pipe",
    b"S": "a sparse file",
    b"L": "a name that is too long",
    b"K": "a link with a name that is too long",
}
_MAGIC: Final = {
    b"\x1f\x8b": "gzip",
    b"BZh": "bzip2",
    b"\xfd7zXZ\x00": "xz",
    b"\x28\xb5\x2f\xfd": "zstd",
    b"PK\x03\x04": "zip",
}
_FIX: Final = "do not use this archive; one that `civil-rgbd pack` wrote holds nothing of the kind"


@dataclass(frozen=True, slots=True)
class Member:
    """One entry of an archive.

    Attributes:
        name: as it stands there, without a leading ``./`` or a trailing slash.
        size_bytes: of its data, which lies in the file.
        is_folder: it is a folder, without data.
    """

    name: str
    size_bytes: int
    is_folder: bool


def members(stream: BinaryIO, *, where: object) -> Iterator[Member]:
    """Walk over the members of a plain tar file.

    When a member is yielded the stream stands at its data; the caller may read some of it or none.

    Args:
        stream: the file, open for reading at its beginning.
        where: its name, for messages.

    Returns:
        members in the order of the file. Nothing is allocated on the word of a header.

    Raises:
        FormatError: it is no plain tar file, is cut off, or holds anything but files and folders.
    """
    end = stream.seek(0, 2)
    place = 0
    while True:
        stream.seek(place)
        header = stream.read(BLOCK)
        if place == 0:
            _refuse_other_containers(header, where)
        if len(header) < BLOCK:
            raise _damaged("it ends without an end mark: it is cut off", where)
        if not any(header):
            return
        _check_sum(header, where, place)
        name, kind, size_bytes = _name(header, where), header[156:157], _size(header, where)
        place += BLOCK
        if place + size_bytes > end:
            raise _damaged(f"{name!r} claims {size_bytes:,} bytes, {end - place:,} are left", where)
        if kind in (b"x", b"g"):
            _check_pax(stream, size_bytes, where)
        elif kind in (b"0", b"\0", b"5"):
            yield Member(name.removeprefix("./").rstrip("/"), size_bytes, kind == b"5")
        else:
            what = _KINDS.get(kind, f"an entry of kind {kind!r}")
            raise FormatError(f"the archive holds {what}: {name!r}", where=where, fix=_FIX)
        place += -(-size_bytes // BLOCK) * BLOCK


def _refuse_other_containers(header: bytes, where: object) -> None:
    for magic, what in _MAGIC.items():
        if header.startswith(magic):
            raise FormatError(
                f"the archive is compressed by {what}: it is not unpacked, since what comes out "
                "of it has no limit that its size would show",
                where=where,
                fix="pack the bridge as plain tar: `civil-rgbd pack` does so",
            )
    if header[257:262] != b"ustar" and any(header):
        raise _damaged("it does not begin as a tar file does", where)


def _check_sum(header: bytes, where: object, place: int) -> None:
    # As POSIX has it: the sum of all bytes, those of the sum itself counted as spaces.
    total = sum(header) - sum(header[148:156]) + 8 * ord(" ")
    if _octal(header[148:156]) != total:
        raise _damaged(f"the header at byte {place} does not fit its own sum", where)


def _octal(field: bytes) -> int | None:
    digits = field.strip(b" \0")
    return int(digits, 8) if re.fullmatch(rb"[0-7]+", digits) else None


def _name(header: bytes, where: object) -> str:
    name, prefix = header[:100].split(b"\0")[0], header[345:500].split(b"\0")[0]
    # GNU tar keeps times where POSIX keeps the prefix.
    whole = prefix + b"/" + name if prefix and header[257:263] == b"ustar\0" else name
    try:
        return whole.decode("utf-8")
    except UnicodeDecodeError as error:
        raise _damaged(f"the name {whole!r} is not UTF-8", where) from error


def _size(header: bytes, where: object) -> int:
    size_bytes = _octal(header[124:136])
    if size_bytes is None:
        raise _damaged(f"the size {header[124:136]!r} is no octal number", where)
    return size_bytes


def _check_pax(stream: BinaryIO, size_bytes: int, where: object) -> None:
    """Let pass what says nothing on names and sizes: times, owners, comments."""
    if size_bytes > _PAX_LIMIT:
        raise _damaged(f"an extended header has {size_bytes:,} bytes", where)
    rest = stream.read(size_bytes)
    while rest.strip(b"\0"):
        length = re.match(rb"([0-9]{1,6}) ([^=]{1,200})=", rest)
        if not length or not length.end() < int(length[1]) <= len(rest):
            raise _damaged("an extended header is no list of keys and values", where)
        key = length[2].decode("utf-8", "replace")
        if key in {"path", "linkpath", "size", "hdrcharset"} or key.startswith("GNU."):
            raise FormatError(
                f"the archive holds an extended header for {key!r}", where=where, fix=_FIX
            )
        rest = rest[int(length[1]) :]


def _damaged(what: str, where: object) -> FormatError:
    return FormatError(
        f"this is no whole tar file: {what}",
        where=where,
        fix="download it again; if it stays so, tell those who offer it",
    )
