"""Training recipes as TOML; four ship.

``bts`` and ``zoe`` have their authors' numbers, ``bts-small`` and ``zoe-small`` are for a CPU.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from importlib import resources
from typing import Any, Final

from civil_rgbd.errors import RecipeError
from civil_rgbd.format.recipe_toml import RecipeKind, parse_setting, read_recipe
from civil_rgbd.resources import nearest
from civil_rgbd.training.recipe import (
    AugmentStage,
    InputStage,
    OptimiserStage,
    RunStage,
    ScheduleStage,
    TrainingRecipe,
)

_STAGES: Final[Mapping[str, type[Any]]] = {
    "input": InputStage,
    "augment": AugmentStage,
    "optimiser": OptimiserStage,
    "schedule": ScheduleStage,
    "run": RunStage,
}
_KIND: Final = RecipeKind("training recipe", "train", "run.steps=500")
_OPTIONS: Final = "model_options"
_WORDS: Final = {
    ("schedule", "name"): ("polynomial", "one-cycle", "constant"),
    ("run", "loss"): ("bts", "zoedepth"),
    ("run", "amp"): ("off", "bfloat16", "float16"),
    ("run", "pretrained"): ("", "imagenet"),
}
_LEAST: Final = {
    ("run", "batch"): 1,
    ("optimiser", "learning_rate"): 1e-12,
    ("augment", "zoom"): 1.0,
    ("input", "min_depth_m"): 1e-6,
}
"""Everything else is at least 0."""


def training_recipe_texts() -> dict[str, str]:
    """Return the TOML text of every training recipe that ships, by name.

    >>> sorted(training_recipe_texts())
    ['bts', 'bts-small', 'zoe', 'zoe-small']
    """
    folder = resources.files("civil_rgbd.training.recipes")
    return {
        entry.name.removesuffix(".toml"): entry.read_text("utf-8")
        for entry in folder.iterdir()
        if entry.name.endswith(".toml")
    }


def load_training_recipe(name_or_path: str, settings: Iterable[str] = ()) -> TrainingRecipe:
    """Load a training recipe that ships, or one from a file, and apply settings to it.

    Args:
        name_or_path: ``bts-small``, or a path that ends in ``.toml``.
        settings: ``stage.key=value`` each, the value in TOML.

    Raises:
        RecipeError: unknown name or key (the nearest right one is named), or a value that does
            not fit.
    """
    document = read_recipe(name_or_path, training_recipe_texts(), _KIND)
    for setting in settings:
        document = document.changed(*parse_setting(setting, _KIND))
    return recipe_from_document({"name": document.name, **document.values}, where=document.where)


def recipe_from_document(document: Mapping[str, Any], *, where: object) -> TrainingRecipe:
    """Turn a parsed training recipe into what it says; keys left out have their defaults.

    Raises:
        RecipeError: a stage or key is unknown, or a value does not fit.
    """
    known = ["name", "model", _OPTIONS, *_STAGES]
    for key, value in document.items():
        if key not in known:
            raise RecipeError(
                f"a training recipe has no stage {key!r}", where=where, fix=nearest(key, known)
            )
        is_table = isinstance(value, Mapping)
        if is_table != (key not in {"name", "model"}):
            raise RecipeError(
                f"{key!r} is {value!r}",
                where=where,
                fix="give a table" * (not is_table) or "a word",
            )
    if not isinstance(document.get("model"), str):
        raise RecipeError(
            "the recipe names no model", where=where, fix='for example model = "bts-small"'
        )
    stages = {
        name: _stage(kind, name, document.get(name, {}), where=where)
        for name, kind in _STAGES.items()
    }
    recipe = TrainingRecipe(
        document["name"], document["model"], dict(document.get(_OPTIONS, {})), **stages
    )
    _refuse_contradictions(recipe, where=where)
    return recipe


def _stage(kind: type[Any], stage: str, table: Mapping[str, Any], *, where: object) -> Any:  # noqa: ANN401  # one of the stages
    kinds = {one.name: type(one.default) for one in dataclasses.fields(kind)}
    values = {}
    for key, value in table.items():
        if key not in kinds:
            raise RecipeError(
                f"stage {stage!r} has no key {key!r}", where=where, fix=nearest(key, kinds)
            )
        values[key] = _value(stage, key, value, kinds[key], where=where)
    return kind(**values)


def _value(stage: str, key: str, value: object, kind: type, *, where: object) -> object:
    if kind is tuple and isinstance(value, list) and all(type(v) in {int, float} for v in value):
        return tuple(map(float, value))
    if kind is float and type(value) is int:
        value = float(value)
    least = _LEAST.get((stage, key), 0)
    fits = type(value) is kind and (not isinstance(value, (int, float)) or value >= least)
    words = _WORDS.get((stage, key))
    if not fits or (words and value not in words):
        kinds: dict[object, str] = {
            tuple: "a list of numbers",
            bool: "true or false",
            str: "a word",
        }
        number = f"a number of at least {least:g}" + " without fraction" * (kind is int)
        name = kinds.get(kind, number)
        expected = f"one of {', '.join(map(repr, words))}" if words else name
        raise RecipeError(
            f"{stage}.{key} is {value!r}, not {expected}", where=where, fix=f"give {expected}"
        )
    return value


def _refuse_contradictions(recipe: TrainingRecipe, *, where: object) -> None:
    faults = {
        "run.epochs and run.steps: one of them is not 0": bool(recipe.run.epochs)
        != bool(recipe.run.steps),
        "input.camera is empty or has six numbers, of which four are positive": not (
            recipe.input.camera
        )
        or (len(recipe.input.camera) == 6 and min(recipe.input.camera[:4]) > 0),
        "input.min_depth_m is less than input.max_depth_m": recipe.input.min_depth_m
        < recipe.input.max_depth_m,
        "run.ema_decay is less than 1": recipe.run.ema_decay < 1,
    }
    for rule, kept in faults.items():
        if not kept:
            raise RecipeError("the recipe contradicts itself", where=where, fix=f"see that {rule}")
