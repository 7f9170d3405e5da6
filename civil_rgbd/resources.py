"""Data that ships inside the package, the user's cache, and what is like what."""

from __future__ import annotations

import difflib
import json
import os
import sys
from collections.abc import Iterable, Mapping
from functools import cache
from importlib import resources
from pathlib import Path
from typing import Any, Final

CACHE_VARIABLE: Final = "CIVIL_RGBD_CACHE"
"""Environment variable that names the cache folder, whatever the platform's own."""


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
    ['1m', '250k', '250k-all', '250k-clean', '50k', 'demo']
    """
    return {
        entry.name.removesuffix(".toml"): entry.read_text("utf-8")
        for entry in resources.files("civil_rgbd.recipes").iterdir()
        if entry.name.endswith(".toml")
    }


def source_commit() -> str | None:
    """Return the commit that this package was built from, with "-dirty" if its files differed.

    None where nobody knows: an editable install runs whatever its files say now.
    """
    stamp = resources.files("civil_rgbd").joinpath("source_commit.txt")
    return stamp.read_text("ascii").strip() if stamp.is_file() else None


def nearest(name: str, known: Iterable[str]) -> str:
    """Name the known word most like ``name``, and list them all.

    >>> nearest("25k", ["250k", "50k", "demo"])
    "did you mean '250k'? Known: 250k, 50k, demo"
    """
    words = sorted(known)
    close = difflib.get_close_matches(name, words, n=1, cutoff=0.4)
    listing = f"Known: {', '.join(words)}"
    return f"did you mean {close[0]!r}? {listing}" if close else listing


def cache_folder(environment: Mapping[str, str] = os.environ, platform: str = sys.platform) -> Path:
    """Return where things that can be made again are kept.

    >>> cache_folder({"XDG_CACHE_HOME": "/var/cache/me"}, "linux").as_posix()
    '/var/cache/me/civil_rgbd'
    """
    own = environment.get(CACHE_VARIABLE)
    if own:
        return Path(own)
    if platform == "win32":
        local = environment.get("LOCALAPPDATA")
        return (Path(local) if local else Path.home() / "AppData" / "Local") / "civil_rgbd"
    if platform == "darwin":
        return Path.home() / "Library" / "Caches" / "civil_rgbd"
    xdg = environment.get("XDG_CACHE_HOME")
    return (Path(xdg) if xdg else Path.home() / ".cache") / "civil_rgbd"
