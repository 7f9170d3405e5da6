"""What a manifest will say is looked at before the first frame is made."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from civil_rgbd.builder.bridge import manifest_before, require_fit_for_schema
from civil_rgbd.builder.recipes import load_recipe, overrides_of, recipe_parameters
from civil_rgbd.builder.run import BuildOptions, build_bridge
from civil_rgbd.domain.recipe import QualityStage, Recipe, VisibilityStage
from civil_rgbd.errors import BuildError
from civil_rgbd.format.layout import BRIDGES, PARTIAL
from civil_rgbd.format.reader import read_bridge
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.validation import validate

from .conftest import INFO

EVERY_KEY = {
    f"{stage}.{key}": value
    for stage, values in recipe_parameters(
        Recipe("any", visibility=VisibilityStage(), quality=QualityStage())
    ).items()
    for key, value in values.items()
}


@pytest.mark.parametrize("key", EVERY_KEY)
def test_any_key_set_by_hand_fits_into_a_manifest(key: str, recording: SimulatedRecording) -> None:
    settings = [f"{key}={json.dumps(EVERY_KEY[key])}"]  # JSON of such values is TOML

    wanted = manifest_before(recording, load_recipe("250k", settings), INFO, overrides_of(settings))

    require_fit_for_schema(wanted)
    assert wanted.recipe is not None
    assert list(wanted.recipe.overrides) == [key]


def test_a_list_set_by_hand_is_built_read_and_found_again(
    recording: SimulatedRecording, tmp_path: Path
) -> None:
    settings = ["accumulate.points=8000", 'quality.planes=["sigma_m", "empty"]']
    recipe, options = load_recipe("demo", settings), BuildOptions(overrides=overrides_of(settings))

    build_bridge(recording, recipe, tmp_path, INFO, options)
    again = build_bridge(recording, recipe, tmp_path, INFO, options)

    assert validate(tmp_path).findings == ()
    record = read_bridge(tmp_path / BRIDGES / "B9").manifest.recipe
    assert record is not None
    assert record.overrides["quality.planes"] == ["sigma_m", "empty"]
    assert again.already_whole


def test_a_manifest_that_could_not_be_written_is_refused_before_any_frame(
    recording: SimulatedRecording, recipe: Recipe, tmp_path: Path
) -> None:
    options = BuildOptions(overrides={"accumulate.points": {"of": 8000}})

    with pytest.raises(BuildError, match=r"would write breaks its schema") as caught:
        build_bridge(recording, recipe, tmp_path, INFO, options)

    assert "$.recipe.overrides['accumulate.points']: {'of': 8000} is not of type" in str(
        caught.value
    )
    assert caught.value.where == "bridge 'B9'"
    assert "--set" in caught.value.fix
    assert not (tmp_path / PARTIAL).exists()
