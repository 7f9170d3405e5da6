"""Who belongs to whom: by name, by stamp, by order; never by luck."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.errors import RecordingError
from civil_rgbd.importers.assembly import Parts, match_poses
from civil_rgbd.importers.folders import Pair, indices_of, pair_images
from civil_rgbd.importers.pose_tables import PoseTable
from civil_rgbd.importers.rendered_set import Intrinsics
from civil_rgbd.importers.stamps import stamps_of
from civil_rgbd.importers.tum import MAX_DIFFERENCE_NS, associate


def table(keys: list[str] | None, count: int) -> PoseTable:
    """Poses whose x is their place."""
    transforms = np.tile(np.eye(4), (count, 1, 1))
    transforms[:, 0, 3] = np.arange(count)
    return PoseTable(tuple(keys) if keys is not None else None, transforms, Path("poses"), ())


def parts(
    names: list[str], poses: PoseTable, stamps_ns: list[int] | None = None, **more: bool
) -> Parts:
    pairs, _ = pair_images([Path(name) for name in names], [])
    camera = Intrinsics(1.0, 1.0, 0.0, 0.0)
    return Parts(Path(), "lab", pairs, stamps_ns, poses, camera, 1.0, **more)


def xs(matched: Parts) -> list[float | None]:
    return [None if T is None else float(T[0, 3]) for T in match_poses(matched)[0]]


def test_images_are_counted_as_people_count() -> None:
    pairs, lonely = pair_images([Path(f"rgb/{i}.png") for i in (10, 2, 1)], [Path("depth/11.png")])

    assert [pair.key for pair in pairs] == [1, 2, 10]
    assert lonely == 1
    assert indices_of(pairs) == [1, 2, 10]


def test_names_with_and_without_zeros_are_one_frame_but_not_twice() -> None:
    (pair,), _ = pair_images([Path("rgb/7.jpg")], [Path("depth/000007.png")])
    assert pair.depth == Path("depth/000007.png")

    with pytest.raises(RecordingError, match=r"7\.jpg and 07\.jpg are the same frame"):
        pair_images([Path("7.jpg"), Path("07.jpg")], [])


def test_stamps_in_names_are_no_places() -> None:
    names = ["1700000000123456789.png", "1700000000223456789.png"]
    pairs = [Pair(int(Path(name).stem), Path(name), None) for name in names]

    assert indices_of(pairs) == [0, 1]
    assert stamps_of(pairs, None) == [1700000000123456789, 1700000000223456789]


def test_poses_find_their_images_by_name() -> None:
    assert xs(parts(["1.png", "2.png", "3.png"], table(["3", "1"], 2))) == [1.0, None, 0.0]
    assert xs(parts(["000001.png", "000002.png"], table(["1.0", "2.0"], 2))) == [0.0, 1.0]
    assert xs(parts(["a.png", "b.png"], table(["rgb/b.png", "rgb/a.png"], 2))) == [1.0, 0.0]


def test_a_count_from_zero_is_no_name() -> None:
    import dataclasses

    counted = dataclasses.replace(table(["0", "1", "2"], 3), keys_are_places=True)

    assert xs(parts(["1.png", "2.png", "3.png"], counted)) == [0.0, 1.0, 2.0]


def test_poses_find_their_images_by_stamp_and_only_within_reach() -> None:
    poses = table(["0.0", "0.1", "0.2", "9.0"], 4)
    names = [f"{i}.png" for i in range(5)]
    stamps_ns = [50_000_000, 175_000_000, 200_000_000, 5_000_000_000, 9_100_000_000]

    assert xs(parts(names, poses, stamps_ns)) == pytest.approx([0.5, 1.75, 2.0, None, None])


def test_stamps_that_look_like_names_stay_stamps() -> None:
    poses = table(["0", "1", "2"], 3)
    stamps_ns = [0, 1_000_000_000, 2_000_000_000]
    names = ["1.png", "2.png", "3.png"]

    assert xs(parts(names, poses, stamps_ns, keys_are_stamps=True)) == [0.0, 1.0, 2.0]


def test_as_many_poses_as_images_go_by_order_and_bring_stamps() -> None:
    matched = parts(["a.png", "b.png"], table(["0.5", "0.75"], 2))

    assert xs(matched) == [0.0, 1.0]
    assert match_poses(matched)[1] == [500_000_000, 750_000_000]


def test_other_counts_are_refused() -> None:
    with pytest.raises(RecordingError, match="3 poses for 2 images") as caught:
        match_poses(parts(["a.png", "b.png"], table(None, 3)))

    assert "--stamps" in caught.value.fix


def test_clocks_that_do_not_meet_are_refused() -> None:
    with pytest.raises(RecordingError, match="no image lies within the poses' time"):
        match_poses(parts(["a.png"], table(["10.5", "11.5"], 2), [5]))


def test_two_poses_of_one_name_are_refused() -> None:
    with pytest.raises(RecordingError, match="two poses are named '1'"):
        match_poses(parts(["1.png"], table(["1", "1"], 2)))


def greedy(rgb_ns: list[int], depth_ns: list[int]) -> list[int | None]:
    """The rule spelt out: of all pairs near enough, the nearest goes first."""
    pairs = sorted((abs(a - b), i, j) for i, a in enumerate(rgb_ns) for j, b in enumerate(depth_ns))
    found: list[int | None] = [None] * len(rgb_ns)
    for difference, i, j in pairs:
        if difference < MAX_DIFFERENCE_NS and found[i] is None and j not in found:
            found[i] = j
    return found


@pytest.mark.parametrize("seed", range(8))
def test_association_is_the_greedy_one(seed: int) -> None:
    rng = np.random.default_rng(seed)
    rgb_ns = np.sort(rng.integers(0, 400_000_000, 20)).tolist()
    depth_ns = rng.integers(0, 400_000_000, 15).tolist()

    assert associate(rgb_ns, depth_ns) == greedy(rgb_ns, depth_ns)
