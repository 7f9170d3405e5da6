"""The archive of a bridge: plain tar, the same bytes for the same folder, checksums inside."""

from __future__ import annotations

import hashlib
import io
import tarfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Final, cast

from civil_rgbd.errors import FormatError, OutputError
from civil_rgbd.format.atomic import whole_file
from civil_rgbd.format.hashes import file_sha256
from civil_rgbd.format.index import read_index
from civil_rgbd.format.layout import DEFECTS, FRAMES, INTRINSICS, MANIFEST, POSES

SUMS: Final = "SHA256SUMS"
"""Last file of an archive: what ``sha256sum -c`` reads."""

SUFFIX: Final = ".tar"
"""Plain tar: images are packed already, and a compressor's bytes change from release to release."""

_MTIME_S: Final = 315_532_800  # 1980-01-01: no clock of a machine; GNU tar grumbles about 1970


@dataclass(frozen=True, slots=True)
class Archive:
    """A written archive.

    Attributes:
        path: where it lies.
        sha256: of its bytes.
        size_bytes: its length.
        files: how many files of the bridge are in it.
    """

    path: Path
    sha256: str
    size_bytes: int
    files: int


def bridge_files(folder: Path) -> dict[str, str | None]:
    """Return the files of a bridge, sorted: what its index names, and its documents.

    Args:
        folder: a bridge that validates.

    Returns:
        hashes by path relative to the folder; None where the index holds no hash.

    Raises:
        FormatError: the index cannot be read.
    """
    names: dict[str, str | None] = dict.fromkeys((MANIFEST, INTRINSICS, POSES, FRAMES))
    if (folder / DEFECTS).is_file():
        names[DEFECTS] = None
    for row in read_index(folder / FRAMES):
        names[row.rgb_path] = row.rgb_file_sha256
        names[row.depth_path] = row.depth_file_sha256
        if row.quality_path is not None:
            names[row.quality_path] = row.quality_file_sha256
    return dict(sorted(names.items()))


def write_archive(folder: Path, bridge_id: str, path: Path) -> Archive:
    """Pack a bridge folder, whole or not at all.

    Names are sorted, and modes, owners and times are fixed: the same folder gives the same bytes
    anywhere. A file manager's litter stays outside.

    Args:
        folder: a bridge that validates.
        bridge_id: name of the folder in the archive.
        path: the archive to make.

    Raises:
        FormatError: a file is not what the index says, or the index cannot be read.
        OutputError: the archive cannot be written.
    """
    files = bridge_files(folder)
    with whole_file(path) as scratch:
        with tarfile.open(scratch, "w", format=tarfile.USTAR_FORMAT) as tar:
            sums = "".join(
                f"{digest}  {name}\n" for name, digest in _add(tar, folder, bridge_id, files)
            )
            tar.addfile(_member(SUMS, len(sums)), io.BytesIO(sums.encode("ascii")))
        digest = file_sha256(scratch)
        size_bytes = scratch.stat().st_size
    return Archive(path, digest, size_bytes, len(files))


def _add(
    tar: tarfile.TarFile, folder: Path, bridge_id: str, files: dict[str, str | None]
) -> Iterator[tuple[str, str]]:
    for name, expected in files.items():
        with _opened(folder / name) as stream:
            reader = _HashingReader(stream)
            size_bytes = stream.seek(0, io.SEEK_END)
            stream.seek(0)
            # tarfile asks for nothing but read().
            tar.addfile(_member(f"{bridge_id}/{name}", size_bytes), cast("io.BytesIO", reader))
        digest = reader.digest.hexdigest()
        if expected is not None and digest != expected:
            raise FormatError(
                f"the file has SHA-256 {digest}, {FRAMES} says {expected}",
                where=folder / name,
                fix="`civil-rgbd validate` lists every damage; was the folder touched meanwhile?",
            )
        yield f"{bridge_id}/{name}", digest


def _opened(path: Path) -> io.BufferedReader:
    try:
        return path.open("rb")
    except OSError as error:
        raise OutputError(
            f"the file cannot be packed: {error.strerror}",
            where=path,
            fix="`civil-rgbd validate` lists what is missing",
        ) from error


def _member(name: str, size_bytes: int) -> tarfile.TarInfo:
    member = tarfile.TarInfo(name)
    member.size, member.mode, member.mtime = size_bytes, 0o644, _MTIME_S
    return member


class _HashingReader:
    """Hands bytes through and hashes them: sums are of what was packed, not of what lies there."""

    def __init__(self, stream: io.BufferedReader) -> None:
        self._stream = stream
        self.digest = hashlib.sha256()

    def read(self, size: int) -> bytes:
        """Read at most ``size`` bytes."""
        data = self._stream.read(size)
        self.digest.update(data)
        return data


def write_sums(path: Path, files: list[Path]) -> None:
    """Write what ``sha256sum -c`` reads, for files that lie beside it.

    Raises:
        OutputError: it cannot be written.
    """
    lines = [f"{file_sha256(file)}  {file.name}\n" for file in files]
    with whole_file(path) as scratch:
        scratch.write_bytes("".join(lines).encode("utf-8"))
