"""``poses.json``: plain code that is as strict as the schema."""

from __future__ import annotations

import copy
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from civil_rgbd.errors import FormatError
from civil_rgbd.format.documents import document_from_text, schema_faults
from civil_rgbd.format.index import read_index
from civil_rgbd.format.poses import (
    poses_from_document,
    poses_text,
    poses_to_document,
    read_poses,
    write_poses,
)

Change = Callable[[dict[str, Any]], Any]


@pytest.fixture
def document(golden: Path) -> dict[str, Any]:
    parsed: dict[str, Any] = json.loads((golden / "bridges" / "B1" / "poses.json").read_text())
    return parsed


def test_poses_come_back_bit_by_bit(golden: Path, tmp_path: Path) -> None:
    rows = read_index(golden / "bridges" / "B1" / "frames.parquet")

    write_poses(tmp_path / "poses.json", rows)

    poses = read_poses(tmp_path / "poses.json")
    assert poses.frame_ids == tuple(row.frame_id for row in rows)
    assert poses.stamps_ns.tolist() == [row.stamp_ns for row in rows]
    assert poses.translations_m.tolist() == [[row.tx, row.ty, row.tz] for row in rows]
    quaternions = [[row.qx, row.qy, row.qz, row.qw] for row in rows]
    assert poses.quaternions_xyzw.tolist() == quaternions
    assert (tmp_path / "poses.json").read_text().count("\n") == 3 + 5


def test_a_bridge_without_frames_has_poses(tmp_path: Path) -> None:
    write_poses(tmp_path / "poses.json", [])

    poses = read_poses(tmp_path / "poses.json")
    assert poses.translations_m.shape == (0, 3)
    assert poses.quaternions_xyzw.shape == (0, 4)


def test_the_text_is_the_document(golden: Path) -> None:
    rows = read_index(golden / "bridges" / "B1" / "frames.parquet")
    document = poses_to_document(rows)

    assert document_from_text(poses_text(document), where="") == document
    assert schema_faults(document, kind="poses") == []


def first(document: dict[str, Any]) -> dict[str, Any]:
    frame: dict[str, Any] = document["frames"][0]
    return frame


FAULTS: dict[str, Change] = {
    "'frames' is a required": lambda d: d.pop("frames"),
    "$.frames: is not a list": lambda d: d.update(frames={}),
    "$: 'more' was unexpected": lambda d: d.update(more=1),
    "$.frames[0]: is not an object": lambda d: d.update(frames=[7]),
    "'stamp_ns' is a required": lambda d: first(d).pop("stamp_ns"),
    "$.frames[0]: 'more' was unexpected": lambda d: first(d).update(more=1),
    "'12' is not six digits": lambda d: first(d).update(frame_id="12"),
    "'00000a' is not six": lambda d: first(d).update(frame_id="00000a"),
    "0 is not six digits": lambda d: first(d).update(frame_id=0),
    "1.5 is not a 64-bit": lambda d: first(d).update(stamp_ns=1.5),
    "True is not a 64-bit": lambda d: first(d).update(stamp_ns=True),
    "T_map_camera: is not an object": lambda d: first(d).update(T_map_camera=[1]),
    "'more' was": lambda d: first(d)["T_map_camera"].update(more=1),
    "not three numbers": lambda d: first(d)["T_map_camera"].update(translation_m=[1, 2]),
    "three numbers": lambda d: first(d)["T_map_camera"].update(translation_m=[1, 2, "3"]),
    "is not three": lambda d: first(d)["T_map_camera"].update(translation_m=[1, 2, True]),
    "not four numbers": lambda d: first(d)["T_map_camera"].update(quaternion_xyzw=[0, 0, 1]),
    "four numbers": lambda d: first(d)["T_map_camera"].update(quaternion_xyzw=[0, 0, 0, 1.01]),
    "is not four": lambda d: first(d)["T_map_camera"].update(quaternion_xyzw=None),
}


@pytest.mark.parametrize("words", FAULTS)
def test_plain_code_and_schema_refuse_the_same(document: dict[str, Any], words: str) -> None:
    FAULTS[words](document)

    assert schema_faults(document, kind="poses")
    with pytest.raises(FormatError, match=r"faults? against schema/poses") as caught:
        poses_from_document(document, where="poses.json")
    assert words in caught.value.what
    assert "docs/format.md" in caught.value.fix


def test_plain_code_and_schema_accept_the_same(document: dict[str, Any]) -> None:
    frame = first(document)
    frame["frame_id"] = "1234567"
    frame["T_map_camera"] = {"translation_m": [1, 2, 3], "quaternion_xyzw": [0, 0, 0, 1]}

    assert schema_faults(document, kind="poses") == []
    assert poses_from_document(document, where="").translations_m[0].tolist() == [1.0, 2.0, 3.0]


def test_numbers_beyond_their_type_are_refused(document: dict[str, Any]) -> None:
    far, late = copy.deepcopy(document), copy.deepcopy(document)
    first(far)["T_map_camera"]["translation_m"] = [10**400, 0, 0]
    first(late)["stamp_ns"] = 2**63

    with pytest.raises(FormatError, match="too large for a float"):
        poses_from_document(far, where="poses.json")
    with pytest.raises(FormatError, match="not a 64-bit integer"):
        poses_from_document(late, where="poses.json")


def test_stamps_keep_their_last_nanosecond(document: dict[str, Any]) -> None:
    first(document)["stamp_ns"] = 1_700_000_000_000_000_001

    poses = poses_from_document(document, where="")
    assert poses.stamps_ns.dtype == np.int64
    assert int(poses.stamps_ns[0]) == 1_700_000_000_000_000_001
