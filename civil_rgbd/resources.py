"""Data that ships inside the package: schemas and recipes; and what is like what."""

from __future__ import annotations

import difflib
import json
from collections.abc import Iterable
from functools import cache
from importlib import resources
from typing import Any


@cache
def load_schema(name: str) -> dict[str, Any]:
    """Return the JSON Schema ``schema/<name>.schema.json``.

    >>> load_schema("recipe")["$schema"]
    'https://json-schema.org/draft/2020-12/schema'
    """
    text = resources.files("civil_rgbd.schema").joinpath(f"{name}.schema.json").read_text("utf-8")
    document: dict[str, Any] = json.loads(text)
    return document


def recipe_texts() -> dict[str, str]:
    """Return the TOML text of every recipe that ships, by name.

    >>> sorted(recipe_texts())
    ['1m', '250k', '250k-all', '50k', 'demo']
    """
    return {
        entry.name.removesuffix(".toml"): entry.read_text("utf-8")
        for entry in resources.files("civil_rgbd.recipes").iterdir()
        if entry.name.endswith(".toml")
    }


def nearest(name: str, known: Iterable[str]) -> str:
    """Name the known word most like ``name``, and list them all.

    >>> nearest("25k", ["250k", "50k", "demo"])
    "did you mean '250k'? Known: 250k, 50k, demo"
    """
    words = sorted(known)
    close = difflib.get_close_matches(name, words, n=1, cutoff=0.4)
    listing = f"Known: {', '.join(words)}"
    return f"did you mean {close[0]!r}? {listing}" if close else listing
