"""Which frames of which bridges are written out."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.errors import UsageError
from civil_rgbd.format.datasets import ALL_FRAMES, read_dataset
from civil_rgbd.format.layout import DATASET, bridge_folders
from civil_rgbd.format.reader import Bridge, read_bridge
from civil_rgbd.resources import nearest
from civil_rgbd.storage.places import Place, place_of

Splits = Mapping[str, Mapping[str, str | tuple[str, ...]]]
"""By name, by bridge: ``all`` or frame ids, as ``dataset.json`` has them."""

NO_SPLITS: Final[Splits] = {}


@dataclass(frozen=True, slots=True, eq=False)
class Chosen:
    """A bridge and those of its frames that are written out.

    Attributes:
        bridge_id: which.
        bridge: the bridge.
        rows: at least one, ids ascend.
    """

    bridge_id: str
    bridge: Bridge
    rows: tuple[FrameRow, ...]


def choose(
    location: str | Place, *, bridges: Sequence[str], split: str | None
) -> tuple[list[Chosen], Splits]:
    """Choose frames of a dataset or of one bridge.

    Args:
        location: a dataset folder or one bridge folder.
        bridges: ids; () for all.
        split: only the frames of this split; None for all.

    Returns:
        the bridges with a frame among the chosen, by id; and the dataset's splits, the chosen one
        alone where one is.

    Raises:
        FormatError: the location is neither, or a document is damaged.
        UsageError: a bridge, the split or any frame is not there.
    """
    location = place_of(location)
    folders = bridge_folders(location)
    for name in bridges:
        if name not in folders:
            raise UsageError(
                f"there is no bridge {name!r}", where=location, fix=nearest(name, folders)
            )
    path = location / DATASET
    splits = read_dataset(path).splits if path.is_file() else NO_SPLITS
    if split is not None:
        splits = {split: _split(splits, split, location)}
    chosen = []
    for bridge_id in sorted(set(bridges) or folders):
        bridge = read_bridge(folders[bridge_id])
        rows = bridge.rows
        if split is not None:
            rows = rows_in(rows, splits[split].get(bridge_id, ()))
        if rows:
            chosen.append(Chosen(bridge_id, bridge, rows))
    if not chosen:
        raise UsageError(
            "no frame is chosen", where=location, fix="choose other bridges, or another split"
        )
    return chosen, splits


def rows_in(rows: Sequence[FrameRow], frames: str | Sequence[str]) -> tuple[FrameRow, ...]:
    """Return the rows that a split names: ``all`` of them, or those of the given ids."""
    if frames == ALL_FRAMES:
        return tuple(rows)
    wanted = set(frames)
    return tuple(row for row in rows if row.frame_id in wanted)


def _split(splits: Splits, split: str, location: Place) -> Mapping[str, str | tuple[str, ...]]:
    if split not in splits:
        fix = nearest(split, splits) if splits else "leave --split out: no split is named here"
        raise UsageError(f"there is no split {split!r}", where=location, fix=fix)
    return splits[split]
