"""Recipes are read alike, whatever they are for."""

from __future__ import annotations

from pathlib import Path

import pytest

from civil_rgbd.errors import RecipeError
from civil_rgbd.format.recipe_toml import RecipeKind, parse_setting, read_recipe

KIND = RecipeKind("soup recipe", "--soup", "pot.litres=3")
TEXTS = {"leek": "[pot]\nlitres = 2\n"}


def test_a_recipe_that_ships_is_found_by_its_name_and_changed_in_a_copy() -> None:
    document = read_recipe("leek", TEXTS, KIND)

    changed = document.changed("pot", "litres", 3).changed("stove", "gas", value=True)

    assert (document.name, document.where) == ("leek", "soup recipe leek")
    assert document.values == {"pot": {"litres": 2}}
    assert changed.values == {"pot": {"litres": 3}, "stove": {"gas": True}}


def test_a_stage_that_is_no_table_is_left_as_it_is(tmp_path: Path) -> None:
    (tmp_path / "own.toml").write_text("pot = 3\n")
    document = read_recipe(str(tmp_path / "own.toml"), TEXTS, KIND)

    assert document.changed("pot", "litres", 2).values == {"pot": 3}
    assert (document.name, document.where) == ("own", str(tmp_path / "own.toml"))


def test_a_name_that_is_unknown_is_said_with_the_nearest_one() -> None:
    with pytest.raises(RecipeError, match="there is no soup recipe 'lek'") as caught:
        read_recipe("lek", TEXTS, KIND)

    assert caught.value.where == "--soup"
    assert caught.value.fix == "did you mean 'leek'? Known: leek; or a path that ends in .toml"


@pytest.mark.parametrize(
    ("data", "words"), [(b"pot =", "is not TOML"), (b"\xff", "cannot be read"), (None, "cannot be")]
)
def test_a_file_that_is_none_is_said(data: bytes | None, words: str, tmp_path: Path) -> None:
    if data is not None:
        (tmp_path / "own.toml").write_bytes(data)

    with pytest.raises(RecipeError, match=words) as caught:
        read_recipe(str(tmp_path / "own.toml"), TEXTS, KIND)

    assert caught.value.where == str(tmp_path / "own.toml")


@pytest.mark.parametrize("setting", ["pot", "pot=3", "pot.litres"])
def test_a_setting_of_another_form_is_said_with_an_example(setting: str) -> None:
    with pytest.raises(RecipeError, match=r"not of the form stage\.key=value") as caught:
        parse_setting(setting, KIND)

    assert caught.value.fix == "for example --set pot.litres=3"
