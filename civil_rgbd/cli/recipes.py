"""``civil-rgbd recipes``: the recipes that ship."""

from __future__ import annotations

import click


@click.command("recipes")
@click.argument("name", required=False)
def command(name: str | None) -> None:
    """List the recipes that ship, or print the one called NAME.

    A printed recipe is a good beginning for one of your own:

        civil-rgbd recipes 250k > mine.toml
    """
    from civil_rgbd.builder.recipes import load_recipe
    from civil_rgbd.resources import recipe_texts

    texts = recipe_texts()
    if name is not None:
        load_recipe(name)
        print(texts[name], end="")
        return
    for known in sorted(texts):
        print(f"{known:10} {load_recipe(known).description}")
