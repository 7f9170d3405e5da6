"""Parts that many jobs made become one bridge, or are named when they are missing."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from civil_rgbd.builder import finish
from civil_rgbd.builder.bridge import IDENTITY
from civil_rgbd.builder.bridge_build import Order
from civil_rgbd.builder.facts import FACTS
from civil_rgbd.builder.finish import finish_bridges, unfinished
from civil_rgbd.builder.report import BuildReport
from civil_rgbd.builder.run import BuildOptions, build_bridge, build_bridges
from civil_rgbd.builder.shares import Share
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.errors import BuildError, OutputError, UsageError
from civil_rgbd.format.atomic import folder_lock
from civil_rgbd.format.layout import BRIDGES, PARTIAL
from civil_rgbd.simulator.recording import SimulatedRecording

from .conftest import INFO, contents


@pytest.fixture(scope="module")
def built(
    recording: SimulatedRecording, recipe: Recipe, tmp_path_factory: pytest.TempPathFactory
) -> dict[str, bytes]:
    dataset = tmp_path_factory.mktemp("built")
    build_bridge(recording, recipe, dataset, INFO, BuildOptions())
    return contents(dataset)


def make(recording: SimulatedRecording, recipe: Recipe, out: Path, share: Share) -> None:
    order = Order(INFO, open=lambda: recording)
    (outcome,) = build_bridges([order], recipe, out, BuildOptions(share=share)).outcomes
    if outcome.error:
        raise outcome.error


def test_parts_in_any_order_become_the_same_bytes(
    recording: SimulatedRecording, recipe: Recipe, built: dict[str, bytes], tmp_path: Path
) -> None:
    for number in (3, 1, 2):
        make(recording, recipe, tmp_path, Share(number, 3))
        assert not (tmp_path / BRIDGES).exists()

    (outcome,) = finish_bridges(tmp_path).outcomes

    assert outcome.error is None
    assert contents(tmp_path) == built
    assert unfinished(tmp_path) == ()


def test_missing_parts_are_named_and_nothing_appears(
    recording: SimulatedRecording, recipe: Recipe, built: dict[str, bytes], tmp_path: Path
) -> None:
    for number in (1, 3):
        make(recording, recipe, tmp_path, Share(number, 4))

    (outcome,) = finish_bridges(tmp_path).outcomes

    assert "parts 2/4, 4/4 are missing or damaged: 12 of 23 frames are not whole: 000010 to" in str(
        outcome.error
    )
    assert "--chunk 2/4 --chunk 4/4" in str(outcome.error)
    assert not (tmp_path / BRIDGES).exists()
    build_bridge(recording, recipe, tmp_path, INFO, BuildOptions())  # makes the rest, and joins
    assert contents(tmp_path) == built


def test_a_part_whose_file_was_damaged_since_is_missing(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    for number in (1, 2):
        make(recording, recipe, tmp_path, Share(number, 2))
    depth = max((tmp_path / PARTIAL / "B9").rglob("*.exr"))
    depth.write_bytes(depth.read_bytes()[:-1])

    (outcome,) = finish_bridges(tmp_path, ["B9"]).outcomes

    assert "parts 2/2 are missing or damaged" in str(outcome.error)


def test_a_part_that_runs_twice_finds_its_frames(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    make(recording, recipe, tmp_path, Share(1, 2))
    order = Order(INFO, open=lambda: recording)

    report = build_bridges([order], recipe, tmp_path, BuildOptions(share=Share(1, 2)))

    assert "part 1/2 is made: 11 of 23 frames, 11 of them found" in str(
        report.outcomes[0].report.to_text()  # type: ignore[union-attr]  # it has one
    )


def test_parts_of_another_recipe_do_not_mix(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    from civil_rgbd.builder.recipes import load_recipe

    make(recording, recipe, tmp_path, Share(1, 2))

    with pytest.raises(BuildError, match=r"begun otherwise \(different: recipe\)") as caught:
        make(recording, load_recipe("250k", ["accumulate.points=7000"]), tmp_path, Share(2, 2))

    assert "--overwrite" in caught.value.fix


def test_nothing_to_join_is_said(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="no unfinished bridge lies here") as caught:
        finish_bridges(tmp_path)

    assert "--chunk 1/8" in caught.value.fix


def test_a_bridge_that_was_never_begun_is_said(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    make(recording, recipe, tmp_path, Share(1, 2))

    with pytest.raises(UsageError, match="no unfinished bridge 'B8'") as caught:
        finish_bridges(tmp_path, ["B8"])

    assert "B9" in caught.value.fix


@pytest.mark.parametrize(
    "lost", [["bridge"], ["bridge", "done", FACTS], ["bridge", IDENTITY], [".", "../dataset.json"]]
)
def test_a_kill_after_the_bridge_had_appeared_is_no_dead_end(
    recording: SimulatedRecording,
    recipe: Recipe,
    built: dict[str, bytes],
    tmp_path: Path,
    lost: list[str],
) -> None:
    make(recording, recipe, tmp_path, Share(1, 1))
    partial, kept = tmp_path / PARTIAL / "B9", tmp_path / "kept"
    shutil.copytree(partial, kept)
    assert not finish_bridges(tmp_path).failed
    shutil.copytree(kept, partial)  # what the kill left: some of this is gone already
    shutil.rmtree(kept)
    for name in lost:
        path = tmp_path / PARTIAL / name if name.startswith("..") else partial / name
        shutil.rmtree(path) if path.is_dir() else path.unlink()

    if FACTS in lost:
        assert "run one of its build commands again" in str(
            finish_bridges(tmp_path).failed[0].error
        )
        make(recording, recipe, tmp_path, Share(1, 1))
    (outcome,) = finish_bridges(tmp_path).outcomes

    assert isinstance(outcome.report, BuildReport)
    assert outcome.report.already_whole
    assert contents(tmp_path) == built
    assert not (tmp_path / PARTIAL).exists()


def test_what_other_parts_are_at_is_no_left_over(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    make(recording, recipe, tmp_path, Share(1, 2))
    kept = tmp_path / "kept"
    shutil.copytree(tmp_path / PARTIAL / "B9", kept)
    build_bridge(recording, recipe, tmp_path, INFO, BuildOptions())
    shutil.copytree(kept, tmp_path / PARTIAL / "B9")

    with folder_lock(tmp_path / PARTIAL / "B9"):
        make(recording, recipe, tmp_path, Share(2, 2))
        assert unfinished(tmp_path) == ("B9",)
    make(recording, recipe, tmp_path, Share(2, 2))
    assert unfinished(tmp_path) == ()


def test_a_damaged_plan_is_said(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    make(recording, recipe, tmp_path, Share(1, 1))
    (tmp_path / PARTIAL / "B9" / FACTS).write_text("{")

    (outcome,) = finish_bridges(tmp_path).outcomes

    assert "plan of this unfinished build cannot be read" in str(outcome.error)
    assert "each writes the plan" in str(outcome.error)


def test_parts_that_are_still_made_are_waited_for_by_hand(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    make(recording, recipe, tmp_path, Share(1, 1))
    hold = (
        "import sys, time; from pathlib import Path;"
        "from civil_rgbd.format.atomic import folder_lock\n"
        "with folder_lock(Path(sys.argv[1]), shared=True):\n"
        "    print('held', flush=True)\n    time.sleep(60)"
    )
    with subprocess.Popen(
        [sys.executable, "-c", hold, str(tmp_path / PARTIAL / "B9")],
        stdout=subprocess.PIPE,
        text=True,
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        (outcome,) = finish_bridges(tmp_path).outcomes
        holder.kill()

    assert isinstance(outcome.error, OutputError)
    assert "one of several parts" in str(outcome.error)
    assert finish_bridges(tmp_path).failed == ()


def test_a_part_that_begins_is_waited_for(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    order = Order(INFO, lambda: recording)
    build_bridges([order], recipe, tmp_path, BuildOptions(share=Share(1, 1)))
    monkeypatch.setattr(finish, "BEGIN_WAIT_S", 0.1)

    with folder_lock(tmp_path / PARTIAL / f"{INFO.bridge_id}.begin"):
        report = finish_bridges(tmp_path)
    assert report.failed
    assert "is writing here" in str(report.outcomes[0].error)
    assert not (tmp_path / BRIDGES).exists()

    assert not finish_bridges(tmp_path).failed


def test_a_whole_build_keeps_parts_away(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    with (
        folder_lock(tmp_path / PARTIAL / "B9"),
        pytest.raises(OutputError, match="is writing here"),
    ):
        make(recording, recipe, tmp_path, Share(1, 2))


@pytest.mark.slow
def test_four_parts_at_once_become_the_same_bytes(built: dict[str, bytes], tmp_path: Path) -> None:
    script = (
        f"import sys; sys.path.insert(0, {str(Path(__file__).parent)!r})\n"
        "from pathlib import Path\nfrom one_build import build\n"
        "from civil_rgbd.builder.shares import share_from\n"
        "build(Path(sys.argv[1]), 'serial', 1, share_from(sys.argv[2]))\n"
    )
    parts = [
        subprocess.Popen([sys.executable, "-c", script, str(tmp_path), f"{number}/4"])
        for number in (1, 2, 3, 4)
    ]
    assert [part.wait(timeout=120) for part in parts] == [0, 0, 0, 0]

    assert finish_bridges(tmp_path).failed == ()
    assert contents(tmp_path) == built
    assert os.listdir(tmp_path / BRIDGES) == ["B9"]  # noqa: PTH208  # names only
