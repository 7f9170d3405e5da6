"""Recipes as TOML, of whatever kind: found by name or path, one key changed by ``--set``."""

from __future__ import annotations

import tomllib
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from civil_rgbd.errors import RecipeError
from civil_rgbd.resources import nearest


@dataclass(frozen=True, slots=True)
class RecipeKind:
    """What recipes are called, and where they are asked for.

    Attributes:
        words: ``recipe``, ``training recipe``.
        asked_in: the option or command that takes a name.
        example: of a setting.
    """

    words: str
    asked_in: str
    example: str


@dataclass(frozen=True, slots=True, eq=False)
class RecipeDocument:
    """A recipe as it was read.

    Attributes:
        name: of one that ships its own, else the file's stem.
        values: the TOML document.
        where: for messages.
    """

    name: str
    values: Mapping[str, Any]
    where: str

    def changed(self, stage: str, key: str, value: object) -> RecipeDocument:
        """Return it with one key set; a stage that is no table is left for its reader to refuse."""
        table = self.values.get(stage, {})
        if not isinstance(table, Mapping):
            return self
        return replace(self, values={**self.values, stage: {**table, key: value}})


def read_recipe(name_or_path: str, texts: Mapping[str, str], kind: RecipeKind) -> RecipeDocument:
    """Read a recipe that ships, or one from a file.

    Args:
        name_or_path: a name, or a path that ends in ``.toml``.
        texts: of those that ship, by name.
        kind: what is read.

    Raises:
        RecipeError: the name is unknown (the nearest right one is named), the file cannot be read
            or is no TOML.
    """
    if name_or_path in texts:
        name, text, where = name_or_path, texts[name_or_path], f"{kind.words} {name_or_path}"
    elif name_or_path.endswith(".toml"):
        path = Path(name_or_path)
        name, text, where = path.stem, _read_text(path), str(path)
    else:
        raise RecipeError(
            f"there is no {kind.words} {name_or_path!r}",
            where=kind.asked_in,
            fix=f"{nearest(name_or_path, texts)}; or a path that ends in .toml",
        )
    try:
        return RecipeDocument(name, tomllib.loads(text), where)
    except tomllib.TOMLDecodeError as error:
        raise RecipeError(
            f"the recipe is not TOML: {error}", where=where, fix="mend the line it names"
        ) from error


def _read_text(path: Path) -> str:
    try:
        return path.read_text("utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise RecipeError(
            f"the recipe file cannot be read: {error}", where=path, fix="check the path"
        ) from error


def parse_setting(setting: str, kind: RecipeKind) -> tuple[str, str, object]:
    """Take ``stage.key=value`` apart; the value is TOML, or a bare word.

    Raises:
        RecipeError: it is not of that form.

    >>> kind = RecipeKind("recipe", "--recipe", "accumulate.points=100000")
    >>> parse_setting("accumulate.window=past", kind), parse_setting("depth.min_m = 0.5", kind)
    (('accumulate', 'window', 'past'), ('depth', 'min_m', 0.5))
    """
    dotted, equals, text = setting.partition("=")
    stage, dot, key = dotted.strip().partition(".")
    if not equals or not dot:
        raise RecipeError(
            f"the setting {setting!r} is not of the form stage.key=value",
            where="--set",
            fix=f"for example --set {kind.example}",
        )
    try:
        value = tomllib.loads(f"value = {text.strip()}")["value"]
    except tomllib.TOMLDecodeError:
        value = text.strip()
    return stage, key, value
