"""Which frames of which bridges: names of splits, bridges and frames become row numbers."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.errors import FormatError, UsageError
from civil_rgbd.resources import nearest

ALL_FRAMES: Final = "all"
"""In a split, stands for every frame of a bridge."""

Split = Mapping[str, str | Sequence[str]]
"""Frame ids, or ``all``, by bridge: ``{"B1": "all", "B3": ["000012"]}``."""

FrameChoice = str | Iterable[str] | Mapping[str, str | Iterable[str]]
"""Frame ids in any of the chosen bridges, or frame ids by bridge."""


def choose_bridges(
    known: Iterable[str], bridges: str | Iterable[str] | None, *, where: object
) -> tuple[str, ...]:
    """Return the bridge ids that are asked for, sorted; all of them for None.

    Raises:
        UsageError: a bridge is not there, or none is asked for.

    >>> choose_bridges(["B3", "B1"], "B3", where="data")
    ('B3',)
    """
    names = sorted(known)
    if bridges is None:
        return tuple(names)
    wanted = {bridges} if isinstance(bridges, str) else set(bridges)
    for name in sorted(wanted.difference(names)):
        raise UsageError(f"there is no bridge {name!r}", where=where, fix=nearest(name, names))
    if not wanted:
        raise UsageError(
            "bridges= names no bridge", where=where, fix=f"leave it out, or name some of {names}"
        )
    return tuple(name for name in names if name in wanted)


def choose_split(splits: Mapping[str, Split], split: str, *, where: object) -> Split:
    """Return the split of that name.

    Raises:
        UsageError: there is no such split.
    """
    if split not in splits:
        fix = nearest(split, splits) if splits else "leave split= out: dataset.json names no split"
        raise UsageError(f"there is no split {split!r}", where=where, fix=fix)
    return splits[split]


def refuse_strange_bridges(part: Split, known: Iterable[str] | None, *, where: object) -> None:
    """Refuse a split that names a bridge which is not there.

    Args:
        part: one split.
        known: ids of all bridges; None when the caller chose bridges, and others do not matter.
        where: for errors.

    Raises:
        FormatError: it does.
    """
    if known is None:
        return
    names = set(known)
    for bridge in sorted(set(part).difference(names)):
        raise FormatError(
            f"the split names bridge {bridge!r}, which is not in the dataset",
            where=where,
            fix=f"add it, or choose among those that are there by bridges=: "
            f"{nearest(bridge, names)}",
        )


def rows_of_split(
    part: Split, frame_ids: Mapping[str, Sequence[str]], *, where: object
) -> dict[str, NDArray[np.int64]]:
    """Turn a split into row numbers of each bridge.

    Args:
        part: one split: frame ids, or ``all``, by bridge.
        frame_ids: ids of all frames of the chosen bridges, in the order of their rows.
        where: for errors.

    Returns:
        ascending row numbers by bridge; bridges without a row in the split are left out.

    Raises:
        FormatError: the split names a frame that its bridge does not have.
    """
    rows = {}
    for bridge, ids in frame_ids.items():
        named = part.get(bridge, ())
        if named == ALL_FRAMES:
            rows[bridge] = np.arange(len(ids))
            continue
        wanted = {named} if isinstance(named, str) else set(named)
        for frame in sorted(wanted.difference(ids)):
            raise FormatError(
                f"the split names frame {frame!r} of bridge {bridge!r}, which has no such frame",
                where=where,
                fix=f"correct the split: {_nearest_frame(frame, ids)}",
            )
        rows[bridge] = _rows_in(ids, wanted)
    return {bridge: chosen for bridge, chosen in rows.items() if len(chosen)}


def rows_of_frames(
    frames: FrameChoice,
    rows: Mapping[str, NDArray[np.int64]],
    frame_ids: Mapping[str, Sequence[str]],
    *,
    where: object,
) -> dict[str, NDArray[np.int64]]:
    """Keep only the rows whose frames are asked for.

    Args:
        frames: frame ids that may be in any bridge, or frame ids (or ``all``) by bridge.
        rows: rows chosen so far, by bridge.
        frame_ids: ids of all frames by bridge, in the order of their rows.
        where: for errors.

    Returns:
        ascending row numbers by bridge; bridges without one are left out.

    Raises:
        UsageError: a frame or a bridge is not among those chosen so far.
    """
    ids = {bridge: [frame_ids[bridge][row] for row in some] for bridge, some in rows.items()}
    if isinstance(frames, Mapping):
        choose_bridges(ids, frames.keys(), where=where)
        wanted = {
            bridge: _known_frames(named, ids[bridge], where=f"{where}, bridge {bridge}")
            for bridge, named in frames.items()
        }
    else:
        everywhere = sorted({frame for some in ids.values() for frame in some})
        wanted = dict.fromkeys(ids, _known_frames(frames, everywhere, where=where))
    kept = {
        bridge: np.array([row for row in rows[bridge] if frame_ids[bridge][row] in some], np.int64)
        for bridge, some in wanted.items()
    }
    return {bridge: some for bridge, some in kept.items() if len(some)}


def _known_frames(named: str | Iterable[str], known: Sequence[str], *, where: object) -> set[str]:
    if named == ALL_FRAMES:
        return set(known)
    wanted = {named} if isinstance(named, str) else set(named)
    for frame in sorted(wanted.difference(known)):
        raise UsageError(
            f"there is no frame {frame!r} among those chosen",
            where=where,
            fix=_nearest_frame(frame, known),
        )
    return wanted


def _rows_in(ids: Sequence[str], wanted: set[str]) -> NDArray[np.int64]:
    return np.array([row for row, frame in enumerate(ids) if frame in wanted], dtype=np.int64)


def _nearest_frame(frame: str, ids: Sequence[str]) -> str:
    # A bridge has thousands of frames: name the nearest by number, and the first and the last.
    if not ids:
        return "it has no frames"
    span = f"it has {len(ids)} frames, {ids[0]} to {ids[-1]}"
    if not frame.isdecimal():
        return f"frame ids are like {ids[0]!r}; {span}"
    close = min(ids, key=lambda known: abs(int(known) - int(frame)) if known.isdecimal() else 10**9)
    return f"did you mean {close!r}? {span}"
