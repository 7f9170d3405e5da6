"""A submission: one archive, its checksums, and the report that a maintainer reads."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from civil_rgbd.contribution.archive import SUFFIX, Archive, write_archive, write_sums
from civil_rgbd.contribution.page import ArchiveWords, report_page
from civil_rgbd.contribution.registry import RegistryEntry, entry_text
from civil_rgbd.domain.bridge import Manifest
from civil_rgbd.errors import FormatError, UsageError
from civil_rgbd.format.atomic import writing
from civil_rgbd.format.documents import write_text
from civil_rgbd.format.layout import BRIDGES, MANIFEST, bridge_folders
from civil_rgbd.format.manifest import read_manifest
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.resources import nearest
from civil_rgbd.storage.places import is_remote, place_of
from civil_rgbd.validation.report import Report

PLACEHOLDER = "https://example.org/put-the-address-here"
"""Stands for the archive's address in an entry, until there is one."""


@dataclass(frozen=True, slots=True)
class Packed:
    """What was written.

    Attributes:
        archive: the archive.
        sums: its checksum and the report's, for ``sha256sum -c``.
        page: the report.
        entry: for the registry; its address is still to be filled in.
    """

    archive: Archive
    sums: Path
    page: Path
    entry: RegistryEntry


def bridge_to_pack(location: Path, bridge_id: str | None) -> Path:
    """Return the folder of the bridge to pack.

    Args:
        location: a dataset folder or one bridge folder.
        bridge_id: which, where there are several.

    Raises:
        FormatError: there is none.
        UsageError: there are several and none is named, or the named one is not there.
    """
    if is_remote(place_of(location)):
        raise UsageError(
            "a submission is packed from a folder of this machine",
            where=place_of(location),
            fix=f"copy it here first: `aws s3 sync {place_of(location)} FOLDER`",
        )
    folders = {
        n: folder for n, folder in bridge_folders(location).items() if isinstance(folder, Path)
    }
    if bridge_id is not None:
        if bridge_id not in folders:
            raise UsageError(
                f"there is no whole bridge {bridge_id!r} here",
                where=location,
                fix=nearest(bridge_id, folders) if folders else "build it first",
            )
        return folders[bridge_id]
    if not folders:
        raise FormatError("there is no whole bridge here", where=location, fix="build one first")
    if len(folders) > 1:
        raise UsageError(
            f"there are {len(folders)} bridges here, and a submission is one",
            where=location,
            fix=f"name it: --bridge {min(folders)} (there are {', '.join(sorted(folders))})",
        )
    return next(iter(folders.values()))


def default_archive(folder: Path) -> Path:
    """Return the archive's name in the working folder: id and version of the data.

    Raises:
        FormatError: the manifest is damaged.
    """
    manifest = read_manifest(folder / MANIFEST)
    return Path(f"{manifest.info.bridge_id}-{manifest.data_version}{SUFFIX}")


def pack_bridge(folder: Path, archive: Path, report: Report) -> Packed:
    """Write archive, checksums and report beside each other; the same folder gives the same bytes.

    Args:
        folder: of the bridge.
        archive: the file to make, with the suffix ``.tar``; the others take its name.
        report: of validating the bridge under the contribution profile, without an error.

    Raises:
        UsageError: the archive's place does not fit, or the report has errors.
        FormatError: the folder's name is not the bridge's id, or the bridge changed meanwhile.
        OutputError: a file cannot be written.
    """
    if report.errors:
        raise UsageError(
            f"the bridge is damaged or does not meet the contribution profile (errors: "
            f"{report.errors}): it is not packed",
            where=folder,
            fix="civil-rgbd validate --profile contribution lists them",
        )
    _refuse_odd_place(folder, archive)
    bridge = read_bridge(folder)
    _refuse_other_name(folder, bridge.manifest)
    if not bridge.rows:
        raise FormatError("the bridge has no frame", where=folder, fix="build it again")
    with writing(archive):
        archive.parent.mkdir(parents=True, exist_ok=True)
    written = write_archive(folder, bridge.manifest.info.bridge_id, archive)
    entry = _entry(bridge.manifest, written)
    words = ArchiveWords(archive.name, written.size_bytes, written.sha256, entry_text(entry))
    page = archive.with_suffix(".html")
    write_text(page, report_page(bridge, report, words))
    sums = archive.with_name(f"{archive.name}.sha256")
    write_sums(sums, [archive, page])
    return Packed(written, sums, page, entry)


def _entry(manifest: Manifest, archive: Archive) -> RegistryEntry:
    return RegistryEntry(
        id=manifest.info.bridge_id,
        version=manifest.data_version,
        where=PLACEHOLDER,
        sha256=archive.sha256,
        size_bytes=archive.size_bytes,
        licence=manifest.info.licence,
    )


def _refuse_odd_place(folder: Path, archive: Path) -> None:
    if archive.suffix != SUFFIX:
        raise UsageError(
            f"the archive is a plain tar file, {archive.name!r} says otherwise",
            where="--out",
            fix=f"name it {archive.with_suffix(SUFFIX).name}",
        )
    bridges = folder.resolve().parent
    inside = [folder.resolve()] + ([bridges] if bridges.name == BRIDGES else [])
    if any(
        place == archive.resolve().parent or place in archive.resolve().parents for place in inside
    ):
        raise UsageError(
            "the archive would lie among the bridges, where nothing else may lie",
            where=archive,
            fix="give another place with --out, or run the command from another folder",
        )


def _refuse_other_name(folder: Path, manifest: Manifest) -> None:
    name = folder.resolve().name
    if name != manifest.info.bridge_id:
        raise FormatError(
            f"the folder is called {name!r}, and the bridge in it {manifest.info.bridge_id!r}",
            where=folder,
            fix="rename the folder, or set bridge_id in manifest.json",
        )
