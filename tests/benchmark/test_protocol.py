"""The draw: nested, by seed, scored on the same frames, and honest about neighbours."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import pytest

from civil_rgbd.benchmark.protocol import APART, REMAINDER, SAME, ShotRequest, draw_split
from civil_rgbd.domain.bridge import Counts
from civil_rgbd.domain.split import Split
from civil_rgbd.errors import UsageError
from civil_rgbd.evaluation.frames import all_frames, open_bridges
from civil_rgbd.format.reader import Bridge, read_bridge
from civil_rgbd.format.writer import finish_bridge

from ..dataset.conftest import b1_frames, write_bridge


@dataclass
class Pose:
    x_m: float
    yaw_deg: float = 0.0


@pytest.fixture(scope="module")
def template(tmp_path_factory: pytest.TempPathFactory) -> Bridge:
    folder = tmp_path_factory.mktemp("draw") / "B1"
    write_bridge(folder, b1_frames()[:1])
    return read_bridge(folder)


def bridge_of(template: Bridge, poses: list[Pose]) -> Bridge:
    """A bridge with these poses; its images are never opened."""
    rows = []
    for number, pose in enumerate(poses):
        half = math.radians(pose.yaw_deg) / 2
        changes: dict[str, Any] = {"tx": pose.x_m, "ty": 0.0, "tz": 0.0, "qx": 0.0, "qy": 0.0}
        changes |= {"qz": math.sin(half), "qw": math.cos(half), "frame_id": f"{number:06d}"}
        rows.append(replace(template.rows[0], **changes))
    return replace(template, rows=tuple(rows))


@pytest.fixture
def bridges(template: Bridge) -> dict[str, Bridge]:
    return {
        "B1": bridge_of(template, [Pose(0)] * 5),
        "B2": bridge_of(template, [Pose(0)] * 4),
        "B3": bridge_of(template, [Pose(0.4 * i) for i in range(60)]),
    }


def draw(bridges: dict[str, Bridge], shots: int, seed: int = 0, draw: int = 30) -> Split:
    return draw_split(bridges, ShotRequest("B3", shots, seed, draw), where="data")


def test_a_bridge_without_frames_hinders_nobody_else(tmp_path: Path) -> None:
    write_bridge(tmp_path / "data" / "bridges" / "B1", b1_frames())
    write_bridge(tmp_path / "data" / "bridges" / "B2", b1_frames())
    _empty(tmp_path / "data" / "bridges" / "B2")
    found = open_bridges(tmp_path / "data")

    assert list(all_frames(found)) == ["B1"]
    with pytest.raises(UsageError, match="bridge 'B2' has no frames"):
        open_bridges(tmp_path / "data", ["B2"])
    with pytest.raises(UsageError, match="bridge 'B2' has no frames"):
        draw_split(found, ShotRequest("B2", 0, 0, 1), where="data")
    _empty(tmp_path / "data" / "bridges" / "B1")
    with pytest.raises(UsageError, match="bridge 'B1' has no frames"):
        open_bridges(tmp_path / "data")


def _empty(folder: Path) -> None:
    """Take every frame out of a bridge's documents."""
    import shutil

    bridge = read_bridge(folder)
    shutil.rmtree(folder)
    partial = folder.with_name("partial")
    partial.mkdir()
    manifest = replace(bridge.manifest, counts=Counts(images_seen=6, frames_kept=0))
    finish_bridge(partial, folder, manifest=manifest, camera=bridge.camera, rows=[], replace=False)


def test_without_shots_only_other_bridges_train(bridges: dict[str, Bridge]) -> None:
    split = draw(bridges, 0)

    assert {name: len(ids) for name, ids in split.train.items()} == {"B1": 5, "B2": 4}
    assert len(split.tests[REMAINDER]["B3"]) == len(split.tests[APART]["B3"]) == 60
    assert len(split.tests[SAME]["B3"]) == 30


def test_shots_are_nested_and_join_the_other_bridges(bridges: dict[str, Bridge]) -> None:
    shots = [set(draw(bridges, k).train["B3"]) for k in (10, 20, 30)]

    assert [len(some) for some in shots] == [10, 20, 30]
    assert shots[0] < shots[1] < shots[2]
    assert set(draw(bridges, 10).train) == {"B1", "B2", "B3"}


def test_every_number_of_shots_is_scored_on_the_same_frames(bridges: dict[str, Bridge]) -> None:
    splits = [draw(bridges, k) for k in (0, 10, 20, 30)]

    assert len({split.tests[SAME]["B3"] for split in splits}) == 1
    assert set(splits[3].tests[SAME]["B3"]).isdisjoint(splits[3].train["B3"])
    assert next(iter(splits[0].tests)) == SAME


def test_the_papers_remainder_is_all_but_the_shots(bridges: dict[str, Bridge]) -> None:
    split = draw(bridges, 20)

    assert set(split.train["B3"]) | set(split.tests[REMAINDER]["B3"]) == {
        row.frame_id for row in bridges["B3"].rows
    }
    assert set(split.train["B3"]).isdisjoint(split.tests[REMAINDER]["B3"])


def test_frames_near_a_shot_are_taken_out_of_apart(bridges: dict[str, Bridge]) -> None:
    split = draw(bridges, 5)
    shots = [int(frame) for frame in split.train["B3"]]

    wanted = [i for i in range(60) if min(abs(i - shot) for shot in shots) * 0.4 > 1.0]
    assert [int(frame) for frame in split.tests[APART]["B3"]] == wanted


def test_who_stands_near_but_looks_elsewhere_is_apart(template: Bridge) -> None:
    poses = [Pose(0), Pose(0.9, 19.9), Pose(0.9, -19.9), Pose(0.9, 20.1), Pose(1.01), Pose(0, 180)]
    both = {"B1": bridge_of(template, [Pose(0)]), "B3": bridge_of(template, poses)}
    for seed in range(40):
        split = draw(both, 1, seed, draw=1)
        if split.train["B3"] == ("000000",):
            break

    assert split.train["B3"] == ("000000",)
    assert split.tests[APART]["B3"] == ("000003", "000004", "000005")


def test_the_seed_decides_and_another_draws_others(bridges: dict[str, Bridge]) -> None:
    assert draw(bridges, 10, seed=1) == draw(bridges, 10, seed=1)
    assert draw(bridges, 10, seed=1).train != draw(bridges, 10, seed=2).train
    assert draw(bridges, 10, seed=1).sha256() != draw(bridges, 10, seed=2).sha256()


def test_requests_that_cannot_be_met_are_refused(bridges: dict[str, Bridge]) -> None:
    with pytest.raises(UsageError, match="there is no bridge 'B4'"):
        draw_split(bridges, ShotRequest("B4"), where="data")
    with pytest.raises(UsageError, match="has 60 frames; drawing 60 of them leaves none") as caught:
        draw(bridges, 10, draw=60)
    assert "at most 59" in caught.value.fix
    with pytest.raises(UsageError, match="40 shots are not 0 to 30"):
        draw(bridges, 40)
    with pytest.raises(UsageError, match="no bridge is left to train with"):
        draw({"B3": bridges["B3"]}, 0)
    with pytest.raises(UsageError, match="bridge 'B3' has no frames"):
        draw(bridges | {"B3": replace(bridges["B3"], rows=())}, 0)


def test_a_drawn_split_can_be_written_and_read(bridges: dict[str, Bridge], tmp_path: Path) -> None:
    from civil_rgbd.format.split_files import read_split, write_split

    split = draw(bridges, 10)
    write_split(tmp_path / "split.json", split)

    assert read_split(tmp_path / "split.json") == split
