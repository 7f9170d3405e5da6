"""The whole check, and parts of it: of a walk that is fit."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.builder.recipes import load_recipe
from civil_rgbd.cli.check import gather
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.health.check import CheckInput, check_recording
from civil_rgbd.health.checks import CHECKS, Figure

RECIPE = load_recipe("250k")


@pytest.fixture(scope="module")
def walk(turning_walk: Path) -> tuple[CheckInput, tuple[Figure, ...]]:
    """The walk, and all its figures."""
    given, _ = gather((str(turning_walk),), RecordingOptions(source_hash=False))
    return given, check_recording(given, RECIPE)


def test_every_check_has_a_figure(walk: tuple[CheckInput, tuple[Figure, ...]]) -> None:
    _, figures = walk

    assert [figure.code for figure in figures] == [*CHECKS]


@pytest.mark.parametrize(
    "codes",
    [("imu-gap",), ("blurred", "overexposed"), ("frames",), ("pose-drift",), ("extrinsics",)],
)
def test_a_figure_does_not_depend_on_what_else_is_asked(
    walk: tuple[CheckInput, tuple[Figure, ...]], codes: tuple[str, ...]
) -> None:
    given, every = walk

    some = check_recording(given, RECIPE, codes)

    assert {figure.code for figure in some} == {*codes}
    assert set(some) < set(every)
