"""From the registry to a bridge in a dataset: fetched, checked, unpacked, whole or absent."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from civil_rgbd.builder.bridge import remove_if_empty, require_free_id
from civil_rgbd.contribution.fetch import Progress, fetch_archive, fetch_text
from civil_rgbd.contribution.registry import (
    RegistryEntry,
    find_entry,
    read_registry,
    registry_from_text,
    shipped_registry,
)
from civil_rgbd.contribution.unpack import unpack_bridge
from civil_rgbd.errors import DownloadError, FormatError, OutputError
from civil_rgbd.format.atomic import (
    folder_lock,
    publish_folder,
    recover_folder,
    sync_tree,
    writing,
)
from civil_rgbd.format.datasets import refresh_dataset
from civil_rgbd.format.layout import BRIDGES, DEFECTS, MANIFEST, PARTIAL
from civil_rgbd.format.manifest import read_manifest
from civil_rgbd.validation.report import Report
from civil_rgbd.validation.walk import validate


@dataclass(frozen=True, slots=True)
class Downloaded:
    """A bridge that arrived.

    Attributes:
        entry: what the registry says of it.
        folder: where it lies.
        report: what validation found; no error.
    """

    entry: RegistryEntry
    folder: Path
    report: Report


def open_registry(where: str | None) -> tuple[RegistryEntry, ...]:
    """Read a registry.

    Args:
        where: a file, an http(s) address, or None for the one that ships.

    Raises:
        FormatError: it is missing, damaged, or breaks its schema.
        DownloadError: the address cannot be read.
        MissingExtraError: an address is given and pooch is not installed.
    """
    if where is None:
        return shipped_registry()
    if where.startswith(("http://", "https://")):
        return registry_from_text(fetch_text(where), where=where)
    return read_registry(Path(where))


def download_bridge(
    bridge_id: str,
    dataset: Path,
    *,
    registry: str | None = None,
    overwrite: bool = False,
    progress: Progress = lambda _here, _total: None,
) -> Downloaded:
    """Fetch a bridge, and let it appear in a dataset only when all of it is right.

    The archive goes to ``<dataset>/.partial`` and is deleted once the bridge is there. A download
    that broke off is gone on with by the same call.

    Args:
        bridge_id: which, by the registry.
        dataset: the dataset folder; it is made if need be.
        registry: as for :func:`open_registry`.
        overwrite: replace a bridge of that id.
        progress: called as bytes come in.

    Raises:
        UsageError: the registry does not list the bridge, or the id differs from another's in the
            case of letters only.
        DownloadError: it cannot be fetched, or is not what the registry says.
        FormatError: the archive holds what it should not, or the registry is damaged.
        OutputError: a bridge of that id is there, or the folder cannot be written.
        MissingExtraError: pooch is not installed.
    """
    where = registry or "the registry of this release (registry/bridges.json)"
    entry = find_entry(open_registry(registry), bridge_id, where=where)
    require_free_id(dataset, bridge_id)
    folder, partial = dataset / BRIDGES / bridge_id, dataset / PARTIAL
    with writing(dataset):
        partial.mkdir(parents=True, exist_ok=True)
    with folder_lock(partial / bridge_id):
        recover_folder(folder)
        _refuse_to_replace(folder, overwrite=overwrite)
        archive = fetch_archive(
            entry.where,
            partial,
            name=f"{bridge_id}-{entry.sha256[:12]}.tar",
            sha256=entry.sha256,
            size_bytes=entry.size_bytes,
            progress=progress,
        )
        with _unpacked(archive, entry, partial) as unpacked:
            report = _checked(unpacked, entry)
            sync_tree(unpacked)
            publish_folder(unpacked, folder, replace=overwrite)
        refresh_dataset(dataset)
    remove_if_empty(partial)
    return Downloaded(entry, folder, report)


def _refuse_to_replace(folder: Path, *, overwrite: bool) -> None:
    if not folder.exists():
        return
    if not overwrite:
        raise OutputError(
            "a bridge of that id is here already",
            where=folder,
            fix="give --overwrite to replace it, or another --out",
        )
    if (folder / DEFECTS).exists():
        raise OutputError(
            "the bridge to be replaced holds measured defects",
            where=folder / DEFECTS,
            fix="move the file away first, or give another --out",
        )


@contextmanager
def _unpacked(archive: Path, entry: RegistryEntry, partial: Path) -> Iterator[Path]:
    """Give the unpacked bridge; afterwards neither it nor the archive is left aside."""
    # Deeper by one, so that the folder's name is the bridge's id, as it will be.
    aside = partial / f"{entry.id}.unpacked"
    with writing(aside):
        if aside.exists():
            shutil.rmtree(aside)  # of a download that was killed
        aside.mkdir()
    try:
        try:
            unpack_bridge(archive, entry.id, aside / entry.id)
        except FormatError as error:
            # The archive goes: what is left to look at is where it came from.
            raise FormatError(error.what, where=entry.where, fix=error.fix) from error
        yield aside / entry.id
    finally:
        shutil.rmtree(aside, ignore_errors=True)
        archive.unlink(missing_ok=True)


def _checked(folder: Path, entry: RegistryEntry) -> Report:
    report = validate(folder)
    if report.errors:
        first = next(finding for finding in report.findings if finding.level == "error")
        faults = "1 fault" if report.errors == 1 else f"{report.errors} faults, the first"
        raise DownloadError(
            f"the archive is what the registry says, but the bridge in it has {faults}: "
            f"{first.code} in {first.place}: {first.message}",
            where=entry.where,
            fix="nothing of it is kept; tell the registry's maintainers",
        )
    manifest = read_manifest(folder / MANIFEST)
    said = (entry.id, entry.version, entry.licence)
    found = (manifest.info.bridge_id, manifest.data_version, manifest.info.licence)
    if said != found:
        raise DownloadError(
            f"the registry says bridge, version and licence {said}, the manifest says {found}",
            where=entry.where,
            fix="nothing of it is kept; tell the registry's maintainers",
        )
    return report
