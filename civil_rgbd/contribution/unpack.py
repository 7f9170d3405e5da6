"""An archive of a bridge, unpacked without trust in it."""

from __future__ import annotations

import hashlib
import re
from pathlib import Path
from typing import BinaryIO, Final

from civil_rgbd.contribution.archive import SUMS
from civil_rgbd.contribution.tar_members import Member, members
from civil_rgbd.errors import FormatError
from civil_rgbd.format.atomic import writing
from civil_rgbd.format.layout import DEFECTS, FRAMES, INTRINSICS, MANIFEST, POSES

MAX_FILES: Final = 500_000
"""More than any walk has frames; a bomb of empty files stops here."""

MAX_FILE_BYTES: Final = 1 << 30
"""Of one file: an image has megabytes, the index of half a million frames some 200 MB."""

_FILE: Final = re.compile(
    "|".join(re.escape(name) for name in (MANIFEST, INTRINSICS, POSES, FRAMES, DEFECTS))
    + r"|rgb/[0-9]{6,18}\.(?:jpg|png)|(?:depth|quality)/[0-9]{6,18}\.exr"
)
_FOLDERS: Final = {"", "/rgb", "/depth", "/quality"}
_SUM_LINE: Final = re.compile(r"([0-9a-f]{64}) [ *](.+)")
_PIECE: Final = 1 << 20
_FIX: Final = (
    "do not use this archive; one that `civil-rgbd pack` wrote holds files of a bridge only"
)


def unpack_bridge(archive: Path, bridge_id: str, destination: Path) -> int:
    """Unpack an archive into an empty folder, and check it against its own checksums.

    Only files that a bridge has, by exactly their names, are written: no name can lead out of the
    folder, no link is followed. A plain tar file holds no more bytes than it has, so nothing
    grows while it is unpacked.

    Args:
        archive: the file.
        bridge_id: the one folder in it.
        destination: the folder to fill; it becomes the bridge folder.

    Returns:
        how many files were written.

    Raises:
        FormatError: the archive holds something else, is damaged, or does not fit its checksums.
        OutputError: a file cannot be written.
    """
    found: dict[str, str] = {}
    sums: dict[str, str] | None = None
    with writing(destination):
        destination.mkdir(parents=True)
    with archive.open("rb") as stream:
        for member in members(stream, where=archive):
            if member.is_folder:
                _refuse_odd_folder(member, bridge_id, archive)
            elif member.name == SUMS and sums is None:
                sums = _sums(stream, member, archive)
            else:
                inner = _inner(member, bridge_id, archive)
                if inner in found or len(found) >= MAX_FILES:
                    what = f"{inner!r} twice" if inner in found else f"over {MAX_FILES:,} files"
                    raise FormatError(f"the archive holds {what}", where=archive, fix=_FIX)
                found[inner] = _write(stream, member, destination / inner)
    _compare(found, sums, bridge_id, archive)
    return len(found)


def _inner(member: Member, bridge_id: str, archive: Path) -> str:
    """Return a member's path in the bridge folder; it is one that a bridge has."""
    name = member.name
    if (
        name.startswith(("/", "\\"))
        or re.match("[A-Za-z]:", name)
        or ".." in re.split(r"[/\\]", name)
    ):
        raise FormatError(
            f"the archive holds a name that leads out of its folder: {name!r}",
            where=archive,
            fix=_FIX,
        )
    folder, _, inner = name.partition("/")
    if folder != bridge_id or not _FILE.fullmatch(inner):
        raise FormatError(
            f"the archive holds {name!r}, which is no file of the bridge {bridge_id!r}",
            where=archive,
            fix=_FIX,
        )
    if member.size_bytes > MAX_FILE_BYTES:
        raise FormatError(
            f"{name!r} has {member.size_bytes:,} bytes, more than {MAX_FILE_BYTES:,}",
            where=archive,
            fix=_FIX,
        )
    return inner


def _refuse_odd_folder(member: Member, bridge_id: str, archive: Path) -> None:
    if member.size_bytes or member.name not in {bridge_id + inner for inner in _FOLDERS} | {
        ".",
        "",
    }:
        raise FormatError(
            f"the archive holds the folder {member.name!r}, which no bridge has",
            where=archive,
            fix=_FIX,
        )


def _write(stream: BinaryIO, member: Member, path: Path) -> str:
    digest, left = hashlib.sha256(), member.size_bytes
    with writing(path):
        path.parent.mkdir(exist_ok=True)
        with path.open("xb") as out:
            while left:
                data = stream.read(min(_PIECE, left))
                if not data:
                    raise OSError("the archive shrank while it was read")
                digest.update(data)
                out.write(data)
                left -= len(data)
    return digest.hexdigest()


def _sums(stream: BinaryIO, member: Member, archive: Path) -> dict[str, str]:
    if member.size_bytes > 200 * MAX_FILES:
        raise FormatError(f"{SUMS} has {member.size_bytes:,} bytes", where=archive, fix=_FIX)
    lines = stream.read(member.size_bytes).decode("utf-8", "replace").splitlines()
    matches = [_SUM_LINE.fullmatch(line) for line in lines]
    return {match[2]: match[1] for match in matches if match}


def _compare(
    found: dict[str, str], sums: dict[str, str] | None, bridge_id: str, archive: Path
) -> None:
    if sums is None:
        raise FormatError(f"the archive holds no {SUMS}", where=archive, fix=_FIX)
    ours = {f"{bridge_id}/{inner}": digest for inner, digest in found.items()}
    odd = sorted(name for name in ours.keys() | sums.keys() if ours.get(name) != sums.get(name))
    if odd:
        more = f" and {len(odd) - 1} others" if len(odd) > 1 else ""
        raise FormatError(
            f"{odd[0]!r}{more} and {SUMS} do not agree",
            where=archive,
            fix="download it again; if it stays so, tell those who offer it",
        )
