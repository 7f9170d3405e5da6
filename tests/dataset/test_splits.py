"""Names of splits, bridges and frames become row numbers, or an error that helps."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.dataset.splits import (
    choose_bridges,
    choose_split,
    refuse_strange_bridges,
    rows_of_frames,
    rows_of_split,
)
from civil_rgbd.errors import FormatError, UsageError

IDS = {"B1": ["000003", "000005", "000009"], "B3": ["000005", "000047"]}
ROWS = {bridge: np.arange(len(ids)) for bridge, ids in IDS.items()}


def as_lists(rows: dict[str, np.ndarray]) -> dict[str, list[int]]:
    return {bridge: some.tolist() for bridge, some in rows.items()}


def test_bridges_come_sorted_and_once_however_they_were_asked_for() -> None:
    assert choose_bridges(["B3", "B1", "B2"], ["B3", "B1", "B3"], where="d") == ("B1", "B3")
    assert choose_bridges(["B3", "B1"], None, where="d") == ("B1", "B3")
    assert choose_bridges(["B3", "B1"], "B3", where="d") == ("B3",)


def test_an_unknown_bridge_is_answered_with_the_nearest() -> None:
    with pytest.raises(UsageError, match=r"no bridge 'b3'.*\n.*\n.*did you mean 'B3'"):
        choose_bridges(["B1", "B3"], ["b3"], where="d")


def test_no_bridge_at_all_is_refused() -> None:
    with pytest.raises(UsageError, match="names no bridge"):
        choose_bridges(["B1", "B3"], [], where="d")


def test_an_unknown_split_is_answered_with_the_nearest() -> None:
    with pytest.raises(UsageError, match=r"no split 'trains'.*\n.*\n.*did you mean 'train'"):
        choose_split({"train": {}, "test": {}}, "trains", where="d")
    with pytest.raises(UsageError, match=r"dataset\.json names no split"):
        choose_split({}, "train", where="d")


def test_a_split_gives_all_frames_or_those_it_names_in_the_order_of_rows() -> None:
    rows = rows_of_split({"B1": ["000009", "000003"], "B3": "all"}, IDS, where="d")

    assert as_lists(rows) == {"B1": [0, 2], "B3": [0, 1]}


def test_a_bridge_that_a_split_does_not_name_has_no_rows() -> None:
    assert as_lists(rows_of_split({"B3": "all"}, IDS, where="d")) == {"B3": [0, 1]}


def test_a_split_with_a_frame_that_is_not_there_breaks_the_format() -> None:
    with pytest.raises(FormatError, match="'000006' of bridge 'B1'") as caught:
        rows_of_split({"B1": ["000006"]}, IDS, where="d")

    assert "did you mean '000005'" in caught.value.fix


def test_a_split_with_a_bridge_that_is_not_there_breaks_the_format() -> None:
    with pytest.raises(FormatError, match="bridge 'B9', which is not in the dataset"):
        refuse_strange_bridges({"B9": "all", "B1": "all"}, IDS, where="d")
    refuse_strange_bridges({"B9": "all"}, None, where="d")


def test_frames_without_a_bridge_are_taken_from_every_bridge_that_has_them() -> None:
    rows = rows_of_frames(["000047", "000005"], ROWS, IDS, where="d")

    assert as_lists(rows) == {"B1": [1], "B3": [0, 1]}


def test_frames_by_bridge_are_taken_from_that_bridge_only() -> None:
    assert as_lists(rows_of_frames({"B3": ["000005"]}, ROWS, IDS, where="d")) == {"B3": [0]}
    assert as_lists(rows_of_frames({"B1": "all"}, ROWS, IDS, where="d")) == {"B1": [0, 1, 2]}


def test_one_frame_may_be_given_as_a_word_and_frames_as_a_generator() -> None:
    assert as_lists(rows_of_frames("000003", ROWS, IDS, where="d")) == {"B1": [0]}
    assert as_lists(rows_of_frames(iter(["000003"]), ROWS, IDS, where="d")) == {"B1": [0]}


@pytest.mark.parametrize(
    ("frames", "fix"),
    [
        (["000004"], "did you mean '000003'"),
        (["48"], "did you mean '000047'"),
        (["frame47"], "frame ids are like '000003'"),
        ({"B3": ["000003"]}, "did you mean '000005'"),
    ],
)
def test_an_unknown_frame_is_answered_with_the_nearest(frames: object, fix: str) -> None:
    with pytest.raises(UsageError, match="there is no frame") as caught:
        rows_of_frames(frames, ROWS, IDS, where="d")  # type: ignore[arg-type] # parametrised

    assert fix in caught.value.fix
    assert "to '0000" not in caught.value.fix


def test_a_frame_outside_the_rows_chosen_so_far_is_unknown() -> None:
    with pytest.raises(UsageError, match="no frame '000003' among those chosen"):
        rows_of_frames(["000003"], {"B1": np.array([1, 2])}, IDS, where="d")


def test_an_unknown_bridge_of_frames_is_answered_with_the_nearest() -> None:
    with pytest.raises(UsageError, match="no bridge 'B4'"):
        rows_of_frames({"B4": ["000003"]}, ROWS, IDS, where="d")
