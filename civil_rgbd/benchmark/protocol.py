"""Leave one bridge out, give back k of its frames: who trains and who is scored.

The k frames (shots) of a seed are nested: those of 10 are among those of 20. They are **mixed
into** the training bridges, as the paper does. Three sets of the test bridge's frames are scored:

- ``same``: those outside the largest draw. The same frames for every k of a seed: the headline,
  because only there do scores of different k differ by the training alone.
- ``remainder``: all but the k shots, as the paper scores. Easier for larger k: neighbours of shots
  are nearly shots.
- ``apart``: the remainder without frames within 1 m and 20 deg of a shot: what is left when that
  leakage is taken out.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.domain.frame import FrameRow
from civil_rgbd.domain.split import Split
from civil_rgbd.errors import UsageError
from civil_rgbd.evaluation.frames import all_frames, open_bridges, require_bridge
from civil_rgbd.format.reader import Bridge
from civil_rgbd.format.split_files import read_split
from civil_rgbd.geometry.transforms import matrix_from_quaternion

SAME, REMAINDER, APART = TESTS = ("same", "remainder", "apart")
"""Names of the sets of frames that are scored; the first is the headline."""

NEAR_M: Final = 1.0
NEAR_DEG: Final = 20.0
"""A frame within both of a shot sees nearly what the shot sees."""

DRAW: Final = 30
"""The paper's largest number of shots: so many frames stay out of ``same``, whatever k is."""


@dataclass(frozen=True, slots=True)
class ShotRequest:
    """Which split to draw.

    Attributes:
        test_bridge: id of the bridge that is left out of training.
        shots: how many of its frames train.
        seed: of the draw.
        draw: how many frames may be shots under this seed, ``shots`` at least; the others are the
            frames that every number of shots is scored on.
    """

    test_bridge: str
    shots: int = 0
    seed: int = 0
    draw: int = DRAW


def split_for(data: Path, request: ShotRequest | None, *, split_file: Path | None) -> Split:
    """Return the split of a file, or draw one.

    Args:
        data: a dataset folder.
        request: what to draw; None with a file.
        split_file: of a split; None to draw.

    Raises:
        UsageError: both are given, or neither, or the data does not have what it takes.
        FormatError: the file is no split.
    """
    if (request is None) == (split_file is None):
        raise UsageError(
            "which frames train is said twice" if request else "nothing says which frames train",
            where="--test-bridge, --split",
            fix="give one of --test-bridge ID and --split FILE",
        )
    if split_file is not None:
        return read_split(split_file)
    assert request is not None  # noqa: S101  # seen to above; tells mypy
    return draw_split(open_bridges(data), request, where=data)


def draw_split(bridges: Mapping[str, Bridge], request: ShotRequest, *, where: object) -> Split:
    """Draw the frames that train and the frames that are scored.

    Args:
        bridges: all bridges of the data, by id.
        request: what to draw.
        where: the data, for errors.

    Raises:
        UsageError: the test bridge is not there, has no frames or too few; or no other is there.
    """
    test = request.test_bridge
    require_bridge(test, bridges, where=where)
    others = {name: ids for name, ids in all_frames(bridges).items() if name != test}
    if not others:
        raise UsageError(
            f"no bridge is left to train with: {test!r} is the only one with frames",
            where=where,
            fix="add other bridges to the dataset",
        )
    rows = bridges[test].rows
    _refuse_too_many(len(rows), request, where=where)
    order = np.random.default_rng([request.seed, len(rows)]).permutation(len(rows))
    shots, drawn = order[: request.shots], order[: request.draw]
    rest = np.setdiff1d(np.arange(len(rows)), shots)
    sets = {
        SAME: np.setdiff1d(np.arange(len(rows)), drawn),
        REMAINDER: rest,
        APART: rest[~_near_any(rows, rest, shots)],
    }
    shot_ids = _ids(rows, shots)
    return Split(
        train=others | ({test: shot_ids} if shot_ids else {}),
        tests={name: {test: _ids(rows, some)} for name, some in sets.items()},
        origin={
            "test_bridge": test,
            "shots": request.shots,
            "seed": request.seed,
            "draw": request.draw,
        },
    )


def _refuse_too_many(count: int, request: ShotRequest, *, where: object) -> None:
    if not 0 <= request.shots <= request.draw:
        raise UsageError(
            f"{request.shots} shots are not 0 to {request.draw}, the frames that are drawn",
            where=where,
            fix="give fewer shots, or a larger --draw",
        )
    if request.draw >= count:
        raise UsageError(
            f"bridge {request.test_bridge!r} has {count} frames; drawing {request.draw} of them "
            "leaves none to score",
            where=where,
            fix=f"draw at most {count - 1}: fewer --shots, and a smaller --draw; "
            "or test on a bridge with more frames",
        )


def _ids(rows: Sequence[FrameRow], places: NDArray[np.int64]) -> tuple[str, ...]:
    return tuple(sorted(rows[place].frame_id for place in places.tolist()))


def _near_any(
    rows: Sequence[FrameRow], frames: NDArray[np.int64], shots: NDArray[np.int64]
) -> NDArray[np.bool_]:
    """Tell which frames lie within both limits of any one shot."""
    near = np.zeros(len(frames), dtype=bool)
    if not len(shots):
        return near
    places_m = np.array([(row.tx, row.ty, row.tz) for row in rows])
    turns = matrix_from_quaternion([(row.qx, row.qy, row.qz, row.qw) for row in rows])
    least_cosine = math.cos(math.radians(NEAR_DEG))
    for shot in shots.tolist():
        apart_m = np.sqrt(((places_m[frames] - places_m[shot]) ** 2).sum(axis=1))
        # The trace of R_a^T R_b is 1 + 2 cos(angle between a and b).
        trace = (turns[frames] * turns[shot]).sum(axis=(1, 2))
        near |= (apart_m <= NEAR_M) & ((trace - 1) / 2 >= least_cosine)
    return near
