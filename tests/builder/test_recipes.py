"""Recipes: found, changed, checked, hashed."""

from __future__ import annotations

import dataclasses
import tomllib
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from civil_rgbd.builder.recipes import (
    load_recipe,
    overrides_of,
    recipe_from_document,
    recipe_parameters,
    recipe_sha256,
)
from civil_rgbd.domain.recipe import QualityStage, Recipe, VisibilityStage
from civil_rgbd.errors import RecipeError
from civil_rgbd.resources import load_schema, recipe_texts

SHIPPED = sorted(recipe_texts())
STAGES: dict[str, Any] = {
    name: properties
    for name, properties in load_schema("recipe")["properties"].items()
    if properties["type"] == "object"
}

ON_REQUEST = {"visibility", "quality"}
"""Stages that a recipe without their table does not have."""
EVERYTHING = Recipe("any", visibility=VisibilityStage(), quality=QualityStage())


def written(tmp_path: Path, text: str, name: str = "mine.toml") -> str:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return str(path)


# --- what ships -------------------------------------------------------------------------------


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_recipe_loads_under_the_name_of_its_file(name: str) -> None:
    recipe = load_recipe(name)

    assert recipe.name == name == tomllib.loads(recipe_texts()[name])["name"]
    assert recipe.description


@pytest.mark.parametrize("name", SHIPPED)
def test_every_shipped_recipe_states_every_key(name: str) -> None:
    document = tomllib.loads(recipe_texts()[name])

    stages = [stage for stage in STAGES if stage in document or stage not in ON_REQUEST]
    stated = {(stage, key) for stage in stages for key in document[stage]}
    assert stated == {(stage, key) for stage in stages for key in STAGES[stage]["properties"]}


def test_250k_is_the_papers() -> None:
    recipe = load_recipe("250k")

    assert recipe_parameters(recipe) == {
        "select": {"min_displacement_m": 0.10},
        "filter": {"min_range_m": 0.5, "max_range_m": 200.0, "drop_noise": True},
        "accumulate": {
            "points": 250_000,
            "window": "past",
            "min_fill": 1.0,
            "max_age_s": 0.0,
            "deskew": True,
        },
        "poses": {"max_gap_s": 0.25, "min_quality": 0.0},
        "image": {
            "scale": 0.6,
            "undistort": True,
            "codec": "jpeg",
            "quality": 95,
            "subsampling": "4:4:4",
        },
        "depth": {"min_m": 0.5, "max_m": 200.0, "step_m": 1 / 1024},
    }


def test_the_other_recipes_differ_from_250k_in_what_their_names_say() -> None:
    def differences(name: str) -> dict[str, Any]:
        of_250k = recipe_parameters(load_recipe("250k"))
        return {
            f"{stage}.{key}": value
            for stage, values in recipe_parameters(load_recipe(name)).items()
            for key, value in values.items()
            if value != of_250k[stage][key]
        }

    assert differences("250k-all") == {"select.min_displacement_m": 0.0}
    assert differences("50k") == {"accumulate.points": 50_000}
    assert differences("1m") == {"accumulate.points": 1_000_000}
    assert set(differences("demo")) == {
        "select.min_displacement_m",
        "accumulate.points",
        "image.scale",
    }


# --- schema and dataclasses say the same --------------------------------------------------------


def test_the_schemas_defaults_are_the_dataclasses() -> None:
    defaults = {
        stage: {
            key: tuple(entry["default"]) if entry["type"] == "array" else entry["default"]
            for key, entry in STAGES[stage]["properties"].items()
        }
        for stage in STAGES
    }

    assert recipe_parameters(EVERYTHING) == defaults
    asked_for_nothing = recipe_parameters(Recipe("any"))
    assert asked_for_nothing == {k: v for k, v in defaults.items() if k not in ON_REQUEST}


def test_every_type_of_the_schema_is_that_of_the_dataclass() -> None:
    kinds = {"number": float, "integer": int, "boolean": bool, "array": tuple}
    for stage, values in recipe_parameters(EVERYTHING).items():
        for key, value in values.items():
            entry = STAGES[stage]["properties"][key]
            assert type(value) is kinds.get(entry.get("type"), str), f"{stage}.{key}"


def test_a_key_that_is_left_out_takes_its_default(tmp_path: Path) -> None:
    recipe = load_recipe(written(tmp_path, "[accumulate]\npoints = 7\n"))

    assert recipe.name == "mine"
    assert recipe.accumulate.points == 7
    assert recipe_parameters(replace(recipe, accumulate=Recipe("x").accumulate)) == (
        recipe_parameters(Recipe("any"))
    )


# --- --set ------------------------------------------------------------------------------------


def test_settings_change_a_shipped_recipe() -> None:
    recipe = load_recipe(
        "250k",
        [
            "accumulate.points=100000",
            "accumulate.window=future",
            "accumulate.deskew=false",
            "image.subsampling=4:2:0",
            " depth.step_m = 0.0 ",
            'image.codec="png"',
        ],
    )

    assert (recipe.accumulate.points, recipe.accumulate.window) == (100_000, "future")
    assert recipe.accumulate.deskew is False
    assert (recipe.image.subsampling, recipe.image.codec) == ("4:2:0", "png")
    assert recipe.depth.step_m == 0.0
    assert recipe.name == "250k"


def test_the_last_of_two_settings_counts() -> None:
    assert overrides_of(["select.min_displacement_m=1", "select.min_displacement_m=0.5"]) == {
        "select.min_displacement_m": 0.5
    }


@pytest.mark.parametrize("setting", ["accumulate.points", "points=3", "=3", "accumulate=3"])
def test_a_setting_of_another_form_is_refused(setting: str) -> None:
    with pytest.raises(RecipeError, match=r"not of the form stage\.key=value") as caught:
        load_recipe("250k", [setting])
    assert caught.value.where == "--set"


# --- nearest names ----------------------------------------------------------------------------


def test_a_near_miss_names_the_recipe() -> None:
    with pytest.raises(RecipeError, match="no recipe '25k'") as caught:
        load_recipe("25k")
    assert "did you mean '250k'?" in caught.value.fix
    assert "50k" in caught.value.fix


def test_a_near_miss_names_the_stage() -> None:
    with pytest.raises(RecipeError, match="no stage 'accumulat'") as caught:
        load_recipe("250k", ["accumulat.points=3"])
    assert "did you mean 'accumulate'?" in caught.value.fix


def test_a_near_miss_names_the_key() -> None:
    with pytest.raises(RecipeError, match="stage 'accumulate' has no key 'point'") as caught:
        load_recipe("250k", ["accumulate.point=3"])
    assert "did you mean 'points'?" in caught.value.fix


def test_an_unknown_key_of_a_file_is_named_with_the_file(tmp_path: Path) -> None:
    path = written(tmp_path, "[deepth]\nmin_m = 1.0\n")

    with pytest.raises(RecipeError, match="no key 'deepth'") as caught:
        load_recipe(path)
    assert caught.value.where == path
    assert "did you mean 'depth'?" in caught.value.fix


# --- what is refused --------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("setting", "words"),
    [
        ("accumulate.points=0", r"accumulate\.points: 0 is less than the minimum"),
        ("accumulate.points=2.5", r"accumulate\.points: 2\.5 is not of type 'integer'"),
        ("accumulate.points=true", r"accumulate\.points: True is not of type 'integer'"),
        ("accumulate.window=passed", r"accumulate\.window: 'passed' is not one of"),
        ("accumulate.min_fill=1.5", r"accumulate\.min_fill: 1\.5 is greater than the maximum"),
        ("accumulate.deskew=1", r"accumulate\.deskew: 1 is not of type 'boolean'"),
        ("image.scale=0", r"image\.scale: 0 is less than or equal to the minimum"),
        ("image.quality=101", r"image\.quality: 101 is greater than the maximum"),
        ("depth.min_m=0", r"depth\.min_m: 0 is less than or equal to the minimum"),
        ("depth.step_m=0.001", r"depth\.step_m is 0\.001, which is no power of two"),
        ("select.min_displacement_m=-0.1", r"select\.min_displacement_m: -0\.1 is less than"),
        ("select.min_displacement_m=nan", r"select\.min_displacement_m is nan"),
        ("filter.max_range_m=inf", r"filter\.max_range_m: inf is greater"),
        ("poses.max_gap_s=inf", r"poses\.max_gap_s: inf is greater"),
        ("accumulate.points=inf", r"accumulate\.points: inf is not of type 'integer'"),
        ("accumulate.min_fill=nan", r"accumulate\.min_fill is nan"),
        ("image.scale=nan", r"image\.scale is nan"),
        ("depth.step_m=nan", r"depth\.step_m is nan"),
        ("depth.min_m=200.0", r"depth\.min_m and depth\.max_m leave nothing between them"),
        ("depth.max_m=0.25", r"depth\.min_m and depth\.max_m leave nothing between them"),
        ("filter.min_range_m=300", r"filter\.min_range_m and max_range_m leave nothing"),
    ],
)
def test_a_value_that_does_not_fit_is_refused_by_its_key(setting: str, words: str) -> None:
    with pytest.raises(RecipeError, match=words) as caught:
        load_recipe("250k", [setting])
    assert caught.value.fix


def test_a_step_so_coarse_that_near_depths_round_to_nothing_is_refused() -> None:
    # 0.5 m rounded to whole metres is 1 m; 0.49 m would be 0, which means nothing measured.
    assert load_recipe("250k", ["depth.step_m=1", "depth.min_m=0.5"]).depth.step_m == 1.0
    with pytest.raises(RecipeError, match=r"depth\.min_m is 0\.49, which rounds to 0") as caught:
        load_recipe("250k", ["depth.step_m=1", "depth.min_m=0.49"])
    assert "0.5" in caught.value.fix


def test_several_faults_are_all_named() -> None:
    with pytest.raises(RecipeError) as caught:
        load_recipe("250k", ["image.scale=9", "accumulate.points=-1"])
    assert "image.scale" in caught.value.what
    assert "accumulate.points" in caught.value.what


def test_a_stage_that_is_no_table_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecipeError, match="depth: 3 is not of type 'object'"):
        load_recipe(written(tmp_path, "depth = 3\n"), ["depth.min_m=1.0"])


def test_a_file_that_is_not_toml_is_refused_with_its_line(tmp_path: Path) -> None:
    with pytest.raises(RecipeError, match=r"not TOML: .*line 2"):
        load_recipe(written(tmp_path, "[depth]\nmin_m = =\n"))


def test_a_file_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(RecipeError, match="cannot be read") as caught:
        load_recipe(str(tmp_path / "none.toml"))
    assert "none.toml" in caught.value.where


def test_a_file_that_is_no_text_is_refused(tmp_path: Path) -> None:
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")

    with pytest.raises(RecipeError, match="cannot be read"):
        load_recipe(str(tmp_path / "binary.toml"))


# --- the hash ---------------------------------------------------------------------------------


def test_the_hash_ignores_name_and_description() -> None:
    recipe = load_recipe("250k")

    assert recipe_sha256(replace(recipe, name="x", description="y")) == recipe_sha256(recipe)


def test_one_and_one_point_zero_hash_the_same(tmp_path: Path) -> None:
    whole = written(tmp_path, "[depth]\nmin_m = 1\n[accumulate]\npoints = 5.0\n", "a.toml")
    real = written(tmp_path, "[depth]\nmin_m = 1.0\n[accumulate]\npoints = 5\n", "b.toml")

    assert recipe_sha256(load_recipe(whole)) == recipe_sha256(load_recipe(real))
    assert type(load_recipe(whole).depth.min_m) is float
    assert type(load_recipe(whole).accumulate.points) is int


def test_every_key_changes_the_hash() -> None:
    other = {"past": "future", "jpeg": "png", "4:4:4": "4:2:0"}
    recipe = EVERYTHING
    hashes = {recipe_sha256(recipe)}
    for stage, values in recipe_parameters(recipe).items():
        for key, value in values.items():
            changed: Any = other[value] if isinstance(value, str) else not value
            changed = value[1:] if isinstance(value, tuple) else changed
            part = replace(getattr(recipe, stage), **{key: changed})
            hashes.add(recipe_sha256(replace(recipe, **{stage: part})))

    keys = sum(len(dataclasses.fields(getattr(recipe, stage))) for stage in STAGES)
    assert len(hashes) == 1 + keys


def test_the_hash_of_250k_stays_what_it_is() -> None:
    # Manifests carry it: a change here makes every build of 250k look like another recipe's.
    assert recipe_sha256(load_recipe("250k")) == (
        "b35610e3a5a71d6b0a4922efef984db26cbb33f4a7e896bf9085f3ad7ceb3efc"
    )


def test_an_empty_table_asks_for_a_stage_with_its_defaults(tmp_path: Path) -> None:
    recipe = load_recipe(written(tmp_path, "[visibility]\n"))

    assert recipe.visibility == VisibilityStage()
    assert load_recipe("250k").visibility is None
    assert load_recipe("250k-clean").visibility == VisibilityStage()


def test_250k_clean_is_250k_that_looks_what_hides_what() -> None:
    clean = load_recipe("250k-clean")

    assert replace(clean, name="", description="", visibility=None) == replace(
        load_recipe("250k"), name="", description=""
    )


@pytest.mark.parametrize("key", ["closing_px", "gone_px"])
def test_a_square_without_a_middle_is_refused(key: str) -> None:
    with pytest.raises(RecipeError, match=f"{key} is 4, which is even") as refused:
        load_recipe("250k-clean", [f"visibility.{key}=4"])
    assert "take 5" in refused.value.fix


def test_a_document_without_name_is_unnamed() -> None:
    assert recipe_from_document({}, where="here") == replace(Recipe("unnamed"), description="")
