"""What a sample holds, and that workers give the same samples as the main process."""

from __future__ import annotations

import multiprocessing
import pickle
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from torch.utils.data import DataLoader

from civil_rgbd import BridgeDataset, BridgeSequenceDataset
from civil_rgbd.dataset.transforms import RandomCrop, Sample
from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.errors import FormatError, UsageError

from .conftest import B1_INDICES, B3_INDICES, b1_frames, b3_frames

EXPECTED = {
    "image": ((3, 36, 64), torch.uint8),
    "depth": ((1, 36, 64), torch.float32),
    "valid": ((1, 36, 64), torch.bool),
    "intrinsics": ((3, 3), torch.float32),
    "T_map_camera": ((4, 4), torch.float64),
}


def assert_is(sample: Sample, frame: RgbdFrame, bridge: str) -> None:
    assert np.array_equal(sample["image"].numpy().transpose(1, 2, 0), frame.rgb)
    assert np.array_equal(sample["depth"][0].numpy(), frame.depth_m)
    assert np.array_equal(sample["valid"][0].numpy(), frame.depth_m > 0)
    np.testing.assert_array_equal(sample["intrinsics"], frame.camera.matrix.astype(np.float32))
    np.testing.assert_allclose(sample["T_map_camera"], frame.T_map_camera, atol=1e-9)
    assert (sample["bridge"], sample["frame"]) == (bridge, frame.frame_id)
    assert sample["stamp_ns"] == frame.stamp_ns
    assert type(sample["stamp_ns"]) is int


def test_a_sample_has_the_promised_shapes_and_types(dataset_folder: Path) -> None:
    sample = BridgeDataset(dataset_folder, bridges=["B1"])[0]

    assert {name: (tuple(sample[name].shape), sample[name].dtype) for name in EXPECTED} == EXPECTED
    assert set(sample) == {*EXPECTED, "bridge", "frame", "stamp_ns"}
    assert all(sample[name].is_contiguous() for name in EXPECTED)


def test_samples_are_the_frames_by_bridge_and_stamp(dataset_folder: Path) -> None:
    dataset = BridgeDataset(dataset_folder)
    frames = [*((frame, "B1") for frame in b1_frames()), *((frame, "B3") for frame in b3_frames())]

    assert len(dataset) == len(frames) == 10
    assert dataset.bridges == ("B1", "B3")
    for sample, (frame, bridge) in zip(map(dataset.__getitem__, range(10)), frames, strict=True):
        assert_is(sample, frame, bridge)


def test_one_bridge_folder_is_enough_and_keeps_its_id_when_renamed(
    dataset_folder: Path, tmp_path: Path
) -> None:
    shutil.copytree(dataset_folder / "bridges" / "B3", tmp_path / "renamed")

    for folder in (dataset_folder / "bridges" / "B3", tmp_path / "renamed"):
        dataset = BridgeDataset(folder, bridges="B3")
        assert len(dataset) == 4
        assert dataset[0]["bridge"] == "B3"


def test_a_place_counts_from_either_end_and_ends_there(dataset_folder: Path) -> None:
    dataset = BridgeDataset(str(dataset_folder))

    assert dataset[-1]["frame"] == f"{B3_INDICES[-1]:06d}"
    assert dataset[np.int64(2)]["frame"] == f"{B1_INDICES[2]:06d}"  # type: ignore[call-overload] # an index all the same
    for place in (10, -11):
        with pytest.raises(IndexError, match=f"place {place} of a dataset of 10"):
            dataset[place]
    assert len(list(dataset)) == 10


@pytest.mark.parametrize(
    ("choice", "expected"),
    [
        ({"split": "train"}, [("B1", i) for i in B1_INDICES] + [("B3", 12), ("B3", 47)]),
        ({"split": "test"}, [("B3", 48), ("B3", 50)]),
        ({"split": "train", "bridges": "B3"}, [("B3", 12), ("B3", 47)]),
        ({"frames": ["000048", "000012"]}, [("B1", 12), ("B3", 12), ("B3", 48)]),
        ({"frames": {"B1": ["000012"]}}, [("B1", 12)]),
        ({"split": "train", "frames": ["000012"]}, [("B1", 12), ("B3", 12)]),
    ],
)
def test_bridges_split_and_frames_narrow_the_choice(
    dataset_folder: Path, choice: dict[str, Any], expected: list[tuple[str, int]]
) -> None:
    dataset = BridgeDataset(dataset_folder, **choice)

    assert [(s["bridge"], int(s["frame"])) for s in dataset] == expected  # type: ignore[attr-defined] # by __getitem__


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"bridges": ["B2"]}, "there is no bridge 'B2'"),
        ({"split": "tests"}, "did you mean 'test'"),
        ({"split": "empty"}, "no frame is left"),
        ({"split": "test", "bridges": "B1"}, "no frame is left"),
        ({"frames": []}, "no frame is left"),
        ({"frames": ["000049"]}, "did you mean '000048'"),
    ],
)
def test_a_choice_that_is_not_there_is_an_error_that_helps(
    dataset_folder: Path, choice: dict[str, Any], message: str
) -> None:
    with pytest.raises(UsageError, match=message):
        BridgeDataset(dataset_folder, **choice)


def test_a_split_of_a_lone_bridge_folder_is_refused(dataset_folder: Path) -> None:
    with pytest.raises(UsageError, match="needs a dataset; this is one bridge folder"):
        BridgeDataset(dataset_folder / "bridges" / "B3", split="train")


def test_a_missing_folder_and_an_empty_dataset_are_told_apart(tmp_path: Path) -> None:
    (tmp_path / "set" / "bridges").mkdir(parents=True)

    with pytest.raises(FormatError, match="there is no such folder"):
        BridgeDataset(tmp_path / "sett")
    with pytest.raises(UsageError, match="no whole bridge"):
        BridgeDataset(tmp_path / "set")


def test_a_missing_or_swapped_image_names_the_file(dataset_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "B3"
    shutil.copytree(dataset_folder / "bridges" / "B3", folder)
    (folder / "depth" / "000012.exr").unlink()
    other = dataset_folder / "bridges" / "B1"
    shutil.copy(other / "rgb" / "000003.png", folder / "rgb" / "000047.png")
    shutil.copy(other / "depth" / "000003.exr", folder / "depth" / "000048.exr")
    dataset = BridgeDataset(folder)

    with pytest.raises(FormatError, match=r"the file is missing\n.*000012\.exr"):
        dataset[0]
    with pytest.raises(FormatError, match=r"64 x 36 px; the camera has 48 x 28\n.*000047\.png"):
        dataset[1]
    with pytest.raises(FormatError, match=r"64 x 36 pixels; the camera has 48 x 28\n.*000048\.exr"):
        dataset[2]


def test_the_transform_is_applied_last(dataset_folder: Path) -> None:
    dataset = BridgeDataset(
        dataset_folder, transform=lambda sample: {"shape": sample["image"].shape}
    )

    assert dataset[0] == {"shape": (3, 36, 64)}


def test_writing_to_a_sample_changes_no_other(dataset_folder: Path) -> None:
    dataset = BridgeDataset(dataset_folder)
    first, again = dataset[0], dataset[0]
    for name in EXPECTED:
        first[name].zero_()

    for name in EXPECTED:
        assert torch.equal(dataset[0][name], again[name]), name
        assert bool(again[name].any()), name


def test_samples_of_one_size_collate_by_default(dataset_folder: Path) -> None:
    (batch,) = DataLoader(BridgeDataset(dataset_folder, bridges="B1"), batch_size=6)

    assert {name: (tuple(batch[name].shape), batch[name].dtype) for name in EXPECTED} == {
        name: ((6, *shape), dtype) for name, (shape, dtype) in EXPECTED.items()
    }
    assert batch["stamp_ns"].tolist() == [frame.stamp_ns for frame in b1_frames()]
    assert batch["frame"] == [f"{i:06d}" for i in B1_INDICES]
    assert batch["bridge"] == ["B1"] * 6


@pytest.mark.parametrize(
    "start",
    [
        pytest.param(
            "fork",
            marks=pytest.mark.skipif(
                "fork" not in multiprocessing.get_all_start_methods(),
                reason="this system cannot fork",
            ),
        ),
        pytest.param("spawn", marks=pytest.mark.slow),
    ],
)
def test_two_workers_give_what_the_main_process_gives(dataset_folder: Path, start: str) -> None:
    dataset = BridgeDataset(dataset_folder)
    here = [dataset[place] for place in range(len(dataset))]  # decoders ran before any fork

    loader = DataLoader(
        dataset, batch_size=None, num_workers=2, multiprocessing_context=start, timeout=60
    )

    for epoch in range(2):
        there = list(loader)
        assert [s["stamp_ns"] for s in there] == [s["stamp_ns"] for s in here], epoch
        for ours, theirs in zip(here, there, strict=True):
            for name in EXPECTED:
                assert torch.equal(ours[name], theirs[name]), name


@pytest.fixture
def busy_decoders() -> Iterator[None]:
    """OpenCV and OpenEXR with threads of their own in this process, as a user may have them."""
    import cv2
    import OpenEXR

    before = cv2.getNumThreads()
    cv2.setNumThreads(4)
    OpenEXR.set_global_thread_count(2)
    cv2.GaussianBlur(np.zeros((2000, 2000, 3), np.uint8), (9, 9), 2)
    yield
    cv2.setNumThreads(before)
    OpenEXR.set_global_thread_count(0)


@pytest.mark.skipif(
    "fork" not in multiprocessing.get_all_start_methods(), reason="this system cannot fork"
)
@pytest.mark.usefixtures("busy_decoders")
def test_forked_workers_do_not_wait_for_threads_of_the_parent(dataset_folder: Path) -> None:
    import cv2

    loader = DataLoader(
        BridgeDataset(dataset_folder, bridges="B1", transform=_threads_seen),
        batch_size=None,
        num_workers=1,
        multiprocessing_context="fork",
        timeout=30,
    )

    assert [sample["threads"] for sample in loader] == [1] * len(B1_INDICES)
    assert cv2.getNumThreads() == 4  # the user's own process is left alone


def _threads_seen(sample: Sample) -> Sample:
    import cv2

    cv2.GaussianBlur(np.zeros((2000, 2000, 3), np.uint8), (9, 9), 2)  # would start threads
    return {**sample, "threads": cv2.getNumThreads()}


def test_workers_crop_differently_from_each_other(dataset_folder: Path) -> None:
    dataset = BridgeDataset(
        dataset_folder, frames={"B1": ["000003"]}, transform=RandomCrop(width_px=16, height_px=9)
    )
    torch.manual_seed(0)
    loader = DataLoader(dataset, batch_size=None, sampler=[0] * 8, num_workers=2)

    cx = [float(sample["intrinsics"][0, 2]) for sample in loader]

    assert cx[0::2] != cx[1::2]


def test_a_broken_file_stops_the_loader_in_words(dataset_folder: Path, tmp_path: Path) -> None:
    folder = tmp_path / "B3"
    shutil.copytree(dataset_folder / "bridges" / "B3", folder)
    exr = folder / "depth" / "000047.exr"
    exr.write_bytes(exr.read_bytes()[:-100])
    loader = DataLoader(BridgeDataset(folder), batch_size=None, num_workers=1)

    # torch raises errors of workers anew and forgets their type; the words stay.
    with pytest.raises(RuntimeError, match=r"FormatError: .*whole depth image[\s\S]*000047\.exr"):
        list(loader)


def test_a_dataset_is_small_to_pickle_and_holds_no_file(dataset_folder: Path) -> None:
    dataset = BridgeDataset(dataset_folder)

    data = pickle.dumps(dataset)

    assert len(data) < 10_000
    assert_is(pickle.loads(data)[0], b1_frames()[0], "B1")  # noqa: S301 - our own bytes


@pytest.mark.parametrize("blocked", ["torch", "torch.utils"])
def test_without_torch_the_answer_is_what_to_install(blocked: str) -> None:
    program = f"""
import sys
sys.modules[{blocked!r}] = None
import civil_rgbd
try:
    from civil_rgbd import BridgeDataset
except civil_rgbd.CivilRgbdError as error:
    print(type(error).__name__, error.fix, sep="|")
try:
    civil_rgbd.BridgeSequenceDataset
except civil_rgbd.CivilRgbdError as error:
    print(type(error).__name__, error.fix, sep="|")
"""
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60
    )

    expected = 'MissingExtraError|pip install "civil-rgbd[torch]"'
    assert done.stdout.splitlines() == [expected, expected], done.stderr


def test_importing_the_package_imports_no_torch() -> None:
    program = "import sys, civil_rgbd; print('torch' in sys.modules, 'cv2' in sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=True, timeout=60
    )

    assert done.stdout.split() == ["False", "False"]


def test_windows_are_neighbours_of_one_bridge(dataset_folder: Path) -> None:
    dataset = BridgeSequenceDataset(dataset_folder, length=3)

    ids = [(window["bridge"], [int(f) for f in window["frame"]]) for window in dataset]  # type: ignore[attr-defined] # by __getitem__
    assert len(dataset) == 6
    assert ids == [
        *(("B1", list(B1_INDICES[i : i + 3])) for i in range(4)),
        *(("B3", list(B3_INDICES[i : i + 3])) for i in range(2)),
    ]


def test_a_window_stacks_its_frames(dataset_folder: Path) -> None:
    window = BridgeSequenceDataset(dataset_folder, length=3, bridges="B1")[1]
    frames = BridgeDataset(dataset_folder, bridges="B1")

    for name, (shape, dtype) in EXPECTED.items():
        assert (tuple(window[name].shape), window[name].dtype) == ((3, *shape), dtype)
        assert torch.equal(window[name], torch.stack([frames[i][name] for i in (1, 2, 3)])), name
    assert window["stamp_ns"].dtype == torch.int64
    assert window["stamp_ns"].tolist() == [frames[i]["stamp_ns"] for i in (1, 2, 3)]


def test_stride_counts_frames_between_starts(dataset_folder: Path) -> None:
    dataset = BridgeSequenceDataset(dataset_folder, length=2, stride=2, bridges="B1")

    starts = [window["frame"][0] for window in dataset]  # type: ignore[attr-defined] # by __getitem__
    assert starts == ["000003", "000006", "000012"]


def test_no_window_spans_a_pause_or_a_frame_that_was_left_out(dataset_folder: Path) -> None:
    paused = BridgeSequenceDataset(dataset_folder, length=2, max_gap_s=5.0, bridges="B3")
    left_out = BridgeSequenceDataset(
        dataset_folder, length=2, frames={"B3": ["000012", "000048", "000050"]}
    )

    assert [window["frame"] for window in paused] == [["000012", "000047"], ["000047", "000048"]]  # type: ignore[attr-defined] # by __getitem__
    assert [window["frame"] for window in left_out] == [["000048", "000050"]]  # type: ignore[attr-defined] # by __getitem__


def test_no_window_spans_two_bridges(dataset_folder: Path) -> None:
    rows_0_and_1 = {"B1": ["000003"], "B3": ["000047"]}

    with pytest.raises(UsageError, match="longest unbroken run has 1 of the 2 frames"):
        BridgeSequenceDataset(dataset_folder, length=2, frames=rows_0_and_1)


def test_a_gap_of_exactly_the_limit_is_allowed(dataset_folder: Path) -> None:
    gap_s = 33_333_333 / 1e9
    dataset = BridgeSequenceDataset(dataset_folder, length=2, max_gap_s=gap_s, bridges="B1")

    assert [window["frame"] for window in dataset] == [["000005", "000006"]]  # type: ignore[attr-defined] # by __getitem__


def test_windows_collate_by_default_and_take_transforms(dataset_folder: Path) -> None:
    dataset = BridgeSequenceDataset(
        dataset_folder, length=3, bridges="B1", transform=RandomCrop(width_px=16, height_px=9)
    )

    batch = next(iter(DataLoader(dataset, batch_size=2)))

    assert batch["image"].shape == (2, 3, 3, 9, 16)
    assert batch["stamp_ns"].shape == (2, 3)
    assert batch["bridge"] == ["B1", "B1"]
    assert list(batch["frame"][0]) == ["000003", "000005"]


def test_a_window_longer_than_any_run_is_refused(dataset_folder: Path) -> None:
    with pytest.raises(UsageError, match="longest unbroken run has 6 of the 10 frames"):
        BridgeSequenceDataset(dataset_folder, length=7)


@pytest.mark.parametrize("odd", [{"length": 0}, {"stride": 0}])
def test_a_length_or_stride_below_one_is_refused(dataset_folder: Path, odd: dict[str, int]) -> None:
    with pytest.raises(UsageError, match="at least 1"):
        BridgeSequenceDataset(dataset_folder, **odd)  # type: ignore[arg-type] # one option at a time
