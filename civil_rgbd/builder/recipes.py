"""Recipes: found by name or path, changed by ``--set``, checked by schema, hashed."""

from __future__ import annotations

import dataclasses
import hashlib
import json
import math
from collections.abc import Iterable
from typing import Any

from civil_rgbd.domain.recipe import (
    AccumulateStage,
    DepthStage,
    FilterStage,
    ImageStage,
    PosesStage,
    QualityStage,
    Recipe,
    SelectStage,
    VisibilityStage,
)
from civil_rgbd.errors import RecipeError
from civil_rgbd.format.recipe_toml import RecipeKind, parse_setting, read_recipe
from civil_rgbd.resources import load_schema, nearest, recipe_texts

_STAGES: dict[str, type[Any]] = {
    "select": SelectStage,
    "filter": FilterStage,
    "accumulate": AccumulateStage,
    "poses": PosesStage,
    "image": ImageStage,
    "depth": DepthStage,
    "visibility": VisibilityStage,
    "quality": QualityStage,
}
_KIND = RecipeKind("recipe", "--recipe", "accumulate.points=100000")
_ON_REQUEST = frozenset({"visibility", "quality"})
"""Stages that a recipe without their table does not have."""


def load_recipe(name_or_path: str, settings: Iterable[str] = ()) -> Recipe:
    """Load a recipe that ships, or one from a file, and apply settings to it.

    Args:
        name_or_path: ``250k``, or a path that ends in ``.toml``.
        settings: ``stage.key=value`` each, the value in TOML.

    Returns:
        the whole recipe; keys that the file leaves out have the schema's defaults.

    Raises:
        RecipeError: unknown name or key (the nearest right one is named), or a value that does
            not fit.
    """
    document = read_recipe(name_or_path, recipe_texts(), _KIND)
    for dotted, value in overrides_of(settings).items():
        stage, _, key = dotted.partition(".")
        document = document.changed(stage, key, value)
    values = {**document.values, "name": document.name}
    return recipe_from_document(values, where=document.where)


def overrides_of(settings: Iterable[str]) -> dict[str, Any]:
    """Parse ``stage.key=value`` settings into values by dotted key.

    Raises:
        RecipeError: one is not of that form, or a stage is unknown.

    >>> overrides_of(["accumulate.points=100000", "accumulate.window=future"])
    {'accumulate.points': 100000, 'accumulate.window': 'future'}
    """
    return dict(map(_parse_setting, settings))


def _parse_setting(setting: str) -> tuple[str, Any]:
    stage, key, value = parse_setting(setting, _KIND)
    if stage not in _STAGES:
        raise RecipeError(
            f"a recipe has no stage {stage!r}", where="--set", fix=nearest(stage, _STAGES)
        )
    return f"{stage}.{key}", value


def recipe_from_document(document: dict[str, Any], *, where: object) -> Recipe:
    """Turn a parsed recipe into a :class:`Recipe`.

    Raises:
        RecipeError: a key is unknown or a value does not fit the schema.
    """
    _refuse_unknown_keys(document, where)
    import jsonschema

    validator = jsonschema.Draft202012Validator(load_schema("recipe"))
    faults = sorted(validator.iter_errors(document), key=lambda fault: list(fault.absolute_path))
    if faults:
        lines = "; ".join(
            f"{'.'.join(map(str, fault.absolute_path)) or 'recipe'}: {fault.message}"
            for fault in faults
        )
        raise RecipeError(
            f"the recipe does not fit its schema: {lines}",
            where=where,
            fix="docs/format.md lists every key with its unit and range",
        )
    stages = {
        name: kind(**_in_their_types(kind, document.get(name, {})))
        for name, kind in _STAGES.items()
        if name in document or name not in _ON_REQUEST
    }
    recipe = Recipe(
        name=document.get("name", "unnamed"),
        description=document.get("description", ""),
        **stages,
    )
    _refuse_contradictions(recipe, where)
    return recipe


def _in_their_types(kind: type[Any], values: dict[str, Any]) -> dict[str, Any]:
    # TOML may write 1 for 1.0; the hash of a recipe must not depend on it.
    numbers: dict[str, type[Any]] = {
        field.name: type(field.default)
        for field in dataclasses.fields(kind)
        if type(field.default) in {int, float}
    }
    typed = {
        name: numbers[name](value) if name in numbers else value for name, value in values.items()
    }
    # Planes are a set: their order and repetition mean nothing.
    return {k: tuple(sorted(set(v))) if isinstance(v, list) else v for k, v in typed.items()}


def _refuse_unknown_keys(document: dict[str, Any], where: object) -> None:
    properties = load_schema("recipe")["properties"]
    for key, value in document.items():
        if key not in properties:
            raise RecipeError(
                f"a recipe has no key {key!r}", where=where, fix=nearest(key, properties)
            )
        known = properties[key].get("properties")
        for name in value if known and isinstance(value, dict) else ():
            if name not in known:
                raise RecipeError(
                    f"stage {key!r} has no key {name!r}", where=where, fix=nearest(name, known)
                )


def _refuse_contradictions(recipe: Recipe, where: object) -> None:
    for stage, values in recipe_parameters(recipe).items():
        for key, value in values.items():
            if isinstance(value, float) and not math.isfinite(value):
                raise RecipeError(
                    f"{stage}.{key} is {value!r}", where=where, fix="take a finite number"
                )
    seen = recipe.visibility
    for key in ("closing_px", "gone_px") if seen is not None else ():
        side_px = getattr(seen, key)
        if side_px and not side_px % 2:
            raise RecipeError(
                f"visibility.{key} is {side_px}, which is even",
                where=where,
                fix=f"take {side_px + 1}: a pixel has as many neighbours on either side",
            )
    step_m = recipe.depth.step_m
    if step_m and math.frexp(step_m)[0] != 0.5:
        raise RecipeError(
            f"depth.step_m is {step_m!r}, which is no power of two",
            where=where,
            fix="take 0.0009765625 (1/1024 m), another power of two, or 0 for no rounding",
        )
    if recipe.depth.min_m < step_m / 2:
        raise RecipeError(
            f"depth.min_m is {recipe.depth.min_m!r}, which rounds to 0 in steps of {step_m!r}: "
            "nothing measured",
            where=where,
            fix=f"take a depth.min_m of at least {step_m / 2!r}, or a smaller depth.step_m",
        )
    for low, high, names in (
        (recipe.depth.min_m, recipe.depth.max_m, "depth.min_m and depth.max_m"),
        (
            recipe.filter.min_range_m,
            recipe.filter.max_range_m,
            "filter.min_range_m and max_range_m",
        ),
    ):
        if low >= high:
            raise RecipeError(
                f"{names} leave nothing between them: {low!r} and {high!r}",
                where=where,
                fix="the first must be smaller than the second",
            )


def recipe_parameters(recipe: Recipe) -> dict[str, dict[str, Any]]:
    """Return every key of every stage: what decides the pixels, without name and description.

    Stages that were not asked for are left out, as they were before anybody could ask for them.
    """
    stages = {name: getattr(recipe, name) for name in _STAGES}
    return {name: dataclasses.asdict(stage) for name, stage in stages.items() if stage is not None}


def recipe_sha256(recipe: Recipe) -> str:
    """Return the hash of a recipe's parameters: the same pixels, the same hash."""
    text = json.dumps(recipe_parameters(recipe), sort_keys=True, separators=(",", ":"))
    return hashlib.sha256(text.encode()).hexdigest()
