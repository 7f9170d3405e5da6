"""``dataset.json``: a folder of bridges, and the splits of their frames."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import Final

from civil_rgbd.constants import FORMAT_VERSION
from civil_rgbd.errors import FormatError
from civil_rgbd.format.atomic import folder_lock
from civil_rgbd.format.documents import check_document, read_document, write_document
from civil_rgbd.format.layout import DATASET, PARTIAL, dataset_bridges
from civil_rgbd.format.versions import Document, current_document, parse_version
from civil_rgbd.storage.places import Place

KIND: Final = "dataset"
ALL_FRAMES: Final = "all"
"""In a split: every frame of the bridge."""

UNNAMED: Final = "unnamed"
"""Name of a dataset that nobody named."""

_LOCK_WAIT_S: Final = 60.0  # other builds hold it only while they write one small file


@dataclass(frozen=True, slots=True)
class DatasetRecord:
    """What ``dataset.json`` says.

    Attributes:
        name: of the dataset.
        bridges: ids of the whole bridges, sorted; derived from the folders.
        splits: by name, by bridge id: ``"all"`` or the ids of some frames; authoritative.
        data_version: chosen by the publisher.
    """

    name: str
    bridges: tuple[str, ...] = ()
    splits: Mapping[str, Mapping[str, str | tuple[str, ...]]] = field(default_factory=dict)
    data_version: str = "1.0"


def read_dataset(path: Place) -> DatasetRecord:
    """Read ``dataset.json``.

    Raises:
        FormatError: the file is missing, damaged, or breaks its schema.
    """
    return dataset_from_document(read_document(path), where=path)


def dataset_from_document(document: Document, *, where: object) -> DatasetRecord:
    """Turn a parsed ``dataset.json`` into what it says.

    Raises:
        FormatError: it breaks its schema.
    """
    document = current_document(document, kind=KIND, where=where)
    check_document(document, kind=KIND, where=where)
    return DatasetRecord(
        name=document["name"],
        data_version=document["data_version"],
        bridges=tuple(document["bridges"]),
        splits={
            name: {
                bridge: frames if isinstance(frames, str) else tuple(frames)
                for bridge, frames in split.items()
            }
            for name, split in document["splits"].items()
        },
    )


def dataset_to_document(dataset: DatasetRecord) -> Document:
    """Turn it into the document that :func:`dataset_from_document` reads."""
    return {
        "format_version": FORMAT_VERSION,
        "name": dataset.name,
        "data_version": dataset.data_version,
        "bridges": list(dataset.bridges),
        "splits": {
            name: {
                bridge: frames if isinstance(frames, str) else list(frames)
                for bridge, frames in split.items()
            }
            for name, split in dataset.splits.items()
        },
    }


def write_dataset(path: Place, dataset: DatasetRecord) -> None:
    """Write ``dataset.json``, whole or not at all.

    Raises:
        FormatError: it breaks the schema; nothing is written.
        OutputError: the file cannot be written.
    """
    write_document(path, dataset_to_document(dataset), kind=KIND)


def refresh_dataset(dataset_folder: Place, *, name: str | None = None) -> DatasetRecord:
    """Write the list of bridges anew, under the lock of ``<dataset>/.partial``; keep the rest.

    Args:
        dataset_folder: the dataset; ``dataset.json`` is made when it is missing.
        name: the dataset's name; without one the old name stays, else it is ``unnamed``: a folder's
            name says nothing, and the same build elsewhere must give the same bytes.

    Returns:
        what ``dataset.json`` says now.

    Raises:
        FormatError: the old ``dataset.json`` is damaged or newer than this release, or two bridges
            differ in the case of letters only.
        OutputError: it cannot be written.
    """
    path = dataset_folder / DATASET
    with folder_lock(dataset_folder / PARTIAL, wait_s=_LOCK_WAIT_S):
        bridges = tuple(dataset_bridges(dataset_folder))
        refuse_same_ids(bridges, where=dataset_folder)
        old = _rewritable(path) if path.exists() else None
        fresh = old or DatasetRecord(name=UNNAMED)
        fresh = replace(fresh, bridges=bridges, name=name or fresh.name)
        if fresh != old:
            write_dataset(path, fresh)
    return fresh


def _rewritable(path: Place) -> DatasetRecord:
    document = read_document(path)
    version = document.get("format_version")
    if parse_version(version, where=path) > parse_version(FORMAT_VERSION, where=path):
        raise FormatError(
            f"format version {version} is newer than {FORMAT_VERSION}: writing it would lose keys",
            where=path,
            fix="install a newer civil-rgbd, or write to another dataset",
        )
    return dataset_from_document(document, where=path)


def same_ids(ids: Iterable[str]) -> list[tuple[str, str]]:
    """Return pairs of ids that differ in the case of letters only: one folder on some systems.

    >>> same_ids(["B1", "b1", "B2"])
    [('B1', 'b1')]
    """
    seen: dict[str, str] = {}
    return [(seen[i.lower()], i) for i in ids if seen.setdefault(i.lower(), i) != i]


def refuse_same_ids(ids: Iterable[str], *, where: object) -> None:
    """Refuse ids that differ in the case of letters only.

    Raises:
        FormatError: two do.
    """
    for first, second in same_ids(ids):
        raise FormatError(
            f"bridges {first!r} and {second!r} differ in the case of letters only",
            where=where,
            fix="choose another id with --bridge",
        )
