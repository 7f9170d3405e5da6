"""Training recipes: those that ship have their authors' numbers; mistakes are named."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.errors import RecipeError
from civil_rgbd.training.recipe_files import load_training_recipe, training_recipe_texts


@pytest.mark.parametrize("name", training_recipe_texts())
def test_every_recipe_that_ships_loads_under_its_name(name: str) -> None:
    assert load_training_recipe(name).name == name


def test_bts_has_its_authors_numbers() -> None:
    recipe = load_training_recipe("bts")

    assert (recipe.run.batch, recipe.run.epochs, recipe.run.loss) == (4, 50, "bts")
    assert (recipe.input.crop_height_px, recipe.input.crop_width_px) == (352, 704)
    assert recipe.input.min_depth_m == 1.0
    assert recipe.optimiser.learning_rate == 1e-4
    assert (recipe.optimiser.encoder_decay, recipe.optimiser.decoder_decay) == (1e-2, 0.0)
    assert recipe.optimiser.eps == 1e-3
    assert (recipe.schedule.power, recipe.schedule.end_share) == (0.9, 0.1)
    assert recipe.optimiser.clip_norm == 0
    assert recipe.run.freeze_early_layers


def test_zoe_has_its_authors_numbers() -> None:
    recipe = load_training_recipe("zoe")

    assert (recipe.run.batch, recipe.run.epochs, recipe.run.loss) == (16, 5, "zoedepth")
    assert recipe.optimiser.learning_rate == 1.61e-4
    assert (recipe.optimiser.encoder_share, recipe.optimiser.clip_norm) == (0.1, 0.1)
    assert (recipe.optimiser.encoder_decay, recipe.optimiser.decoder_decay) == (0.01, 0.01)
    assert (recipe.schedule.rise_share, recipe.schedule.start_div) == (0.7, 1.0)


def test_settings_change_numbers_and_the_hash() -> None:
    plain = load_training_recipe("bts-small")
    changed = load_training_recipe("bts-small", ["run.steps=7", "schedule.name=constant"])

    assert (changed.run.steps, changed.schedule.name) == (7, "constant")
    assert changed.sha256() != plain.sha256()
    assert load_training_recipe("bts-small").sha256() == plain.sha256()


def test_a_recipe_of_ones_own_is_a_file(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_text('model = "mine"\n[model_options]\ndeep = true\n[run]\nsteps = 3\n', "utf-8")
    recipe = load_training_recipe(str(path))

    assert (recipe.name, recipe.model, recipe.model_options) == ("mine", "mine", {"deep": True})


@pytest.mark.parametrize(
    ("setting", "words", "fix"),
    [
        ("run.stps=3", "no key 'stps'", "did you mean 'steps'"),
        ("rnu.steps=3", "no stage 'rnu'", "did you mean 'run'"),
        ("run.steps=3.5", "run.steps is 3.5, not a number of at least 0 without fraction", "give"),
        ("run.batch=0", "run.batch is 0, not a number of at least 1", "give"),
        ("run.loss=l1", "run.loss is 'l1', not one of 'bts', 'zoedepth'", "give"),
        ("run.freeze_early_layers=1", "is 1, not true or false", "give"),
        ("run.epochs=3", "contradicts itself", "one of them is not 0"),
        ("input.camera=[1.0, 2.0]", "contradicts itself", "six numbers"),
        ("input.max_depth_m=0", "contradicts itself", "less than input.max_depth_m"),
        ("steps=3", "not of the form stage.key=value", "--set run.steps=500"),
    ],
)
def test_what_does_not_fit_is_named(setting: str, words: str, fix: str) -> None:
    with pytest.raises(RecipeError) as caught:
        load_training_recipe("bts-small", [setting])

    assert words in caught.value.what
    assert fix in caught.value.fix


def test_an_unknown_recipe_is_refused() -> None:
    with pytest.raises(RecipeError, match="no training recipe 'bst'") as caught:
        load_training_recipe("bst")

    assert "did you mean 'bts'" in caught.value.fix
