"""The frames to score: bridges of a dataset, and checks that what is asked for is there."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.domain.split import FramesOf
from civil_rgbd.errors import UsageError
from civil_rgbd.format.layout import bridge_folders
from civil_rgbd.format.reader import Bridge, read_bridge
from civil_rgbd.resources import nearest


def open_bridges(location: Path, bridges: Iterable[str] = ()) -> dict[str, Bridge]:
    """Read the documents of a dataset's bridges, or of one bridge folder.

    Args:
        location: a dataset folder or one bridge folder.
        bridges: ids; none for all, also those without frames.

    Returns:
        bridges by id, at least one with frames.

    Raises:
        UsageError: there is no whole bridge, or none of such an id; or one that is asked for has no
            frames, or none of all has.
        FormatError: a document breaks the format.
    """
    bridges, found = tuple(bridges), {}
    for folder in bridge_folders(location).values():
        bridge = read_bridge(folder)
        found[bridge.manifest.info.bridge_id] = bridge
    if not found:
        raise UsageError(
            "the dataset has no whole bridge",
            where=location,
            fix=f"build one: `civil-rgbd build --recipe 250k --out {location} RECORDING`",
        )
    wanted = bridges or tuple(found)
    # One empty bridge of a dataset is no reason not to use the others.
    with_frames = [name for name in wanted if name in found and found[name].rows]
    for name in bridges or (() if with_frames else wanted):
        require_bridge(name, found, where=location)
    return {name: found[name] for name in sorted(wanted)}


def require_bridge(name: str, found: Mapping[str, Bridge], *, where: object) -> None:
    """Refuse a bridge that is not there, or that has no frames.

    Raises:
        UsageError: it is so.
    """
    if name not in found:
        raise UsageError(f"there is no bridge {name!r}", where=where, fix=nearest(name, found))
    if not found[name].rows:
        raise UsageError(
            f"bridge {name!r} has no frames",
            where=where,
            fix="build it again with another recipe, or choose another bridge",
        )


def all_frames(bridges: Mapping[str, Bridge]) -> FramesOf:
    """Return the ids of all frames by bridge; bridges without frames are left out."""
    return {
        name: tuple(row.frame_id for row in one.rows) for name, one in bridges.items() if one.rows
    }


def rows_of(
    frames: FramesOf, bridges: Mapping[str, Bridge], *, where: object
) -> list[tuple[str, FrameRow]]:
    """Find the rows of frames.

    Args:
        frames: frame ids by bridge.
        bridges: where to look.
        where: for errors.

    Returns:
        (bridge id, row) each, by bridge id, then by frame.

    Raises:
        UsageError: a bridge or a frame is not there.
    """
    found = []
    for name in sorted(frames):
        require_bridge(name, bridges, where=where)
        known = {row.frame_id: row for row in bridges[name].rows}
        missing = sorted(set(frames[name]).difference(known))
        if missing:
            raise UsageError(
                f"bridge {name!r} has no frame {missing[0]!r}"
                + (f", nor {len(missing) - 1} others that are asked for" * (len(missing) > 1)),
                where=where,
                fix="the split is of other data: build the bridge with the recipe that it was "
                "drawn from, or draw a new one",
            )
        found += [(name, known[frame]) for frame in sorted(frames[name])]
    return found
