"""Does ``dataset.json`` agree with the folders, and do the splits name what is there?"""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping

from civil_rgbd.constants import BRIDGE_ID_PATTERN
from civil_rgbd.format.datasets import ALL_FRAMES, DatasetRecord, dataset_from_document, same_ids
from civil_rgbd.format.layout import BRIDGES, DATASET
from civil_rgbd.storage.places import Place, entries_of
from civil_rgbd.validation.documents import load
from civil_rgbd.validation.report import Finding


def bridge_entries(dataset: Place) -> tuple[dict[str, Place], list[Finding]]:
    """List the folders that ought to be bridges, whole or not.

    Args:
        dataset: the dataset folder.

    Returns:
        folders by name, sorted; and findings on what else lies there. Names that begin with a dot
        are a build's own.
    """
    folders, found = {}, []
    for entry in entries_of(dataset / BRIDGES):
        if entry.is_dir() and re.fullmatch(BRIDGE_ID_PATTERN, entry.name):
            folders[entry.name] = entry
        elif not entry.name.startswith("."):
            message = "neither a folder nor a name for a bridge"
            found.append(Finding("file-unknown", message, f"{BRIDGES}/{entry.name}"))
    return folders, found


def check_dataset(dataset: Place, whole: Mapping[str, frozenset[str] | None]) -> Iterator[Finding]:
    """Check ``dataset.json`` against the bridges that are there.

    Args:
        dataset: the dataset folder.
        whole: the ids of the frames of each whole bridge; None where its index cannot be read.
    """
    found: list[Finding] = []
    record = load(dataset / DATASET, "dataset", dataset_from_document, None, found)
    yield from found
    for first, second in same_ids(whole):
        message = f"{first!r} and {second!r} differ in the case of letters only"
        yield Finding("bridge-ids-alike", message, BRIDGES)
    if record is None:
        return
    for bridge in sorted(set(record.bridges) - set(whole)):
        message = f"lists {bridge!r}, which is no whole bridge here"
        yield Finding("dataset-bridge-missing", message, DATASET)
    for bridge in sorted(set(whole) - set(record.bridges)):
        yield Finding("dataset-bridge-unlisted", f"does not list {bridge!r}", DATASET)
    yield from _split_findings(record, whole)


def _split_findings(
    record: DatasetRecord, whole: Mapping[str, frozenset[str] | None]
) -> Iterator[Finding]:
    for split, bridges in record.splits.items():
        for bridge, frames in bridges.items():
            if bridge not in whole:
                message = f"split {split!r} names bridge {bridge!r}"
                yield Finding("split-bridge-unknown", message, DATASET)
                continue
            known = whole[bridge]
            if known is None or frames == ALL_FRAMES:
                continue
            for frame in frames:
                if frame not in known:
                    message = f"split {split!r} names frame {frame!r} of bridge {bridge!r}"
                    yield Finding("split-frame-unknown", message, DATASET)
