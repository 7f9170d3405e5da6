"""What decides a benchmark's figures: the hash under which measured rows are kept.

Rows stay in a persistent folder and are read again by their key. A key that knows only what was
asked for would serve the figures of code that is gone: so it holds the code as well.
"""

from __future__ import annotations

import hashlib
from importlib.metadata import version
from pathlib import Path
from typing import Final

_ROOT: Final = Path(__file__).resolve().parents[1]

SOURCES: Final = (
    "civil_rgbd/simulator",
    "civil_rgbd/pipeline",
    "civil_rgbd/geometry",
    "civil_rgbd/domain",
    "civil_rgbd/builder/plan.py",
    "civil_rgbd/builder/recipes.py",
    "civil_rgbd/format/recipe_toml.py",
    "civil_rgbd/constants.py",
    "recipes",
    "schema/recipe.schema.json",
)
"""Files, and folders all of whose files count: what simulates, renders and filters."""
LIBRARIES: Final = ("numpy", "numba", "opencv-python-headless", "trimesh", "embreex")
"""Distributions whose other version may give other pixels, or other rays."""


def measuring_key(
    asked: str, scripts: tuple[str, ...], *, more: tuple[str, ...] = (), root: Path = _ROOT
) -> str:
    """Return what rows are kept under: another one as soon as their code, or a recipe, is another.

    Args:
        asked: what is measured.
        scripts: the modules of this folder that measure it.
        more: files and folders beside :data:`SOURCES` that decide the figures.
        root: of the checkout.

    Returns:
        16 hexadecimal digits.
    """
    key = hashlib.sha256(asked.encode())
    key.update("".join(f"\n{name} {version(name)}" for name in LIBRARIES).encode())
    measuring = tuple(f"benchmarks/{name}.py" for name in scripts)
    for name in (*SOURCES, *more, *measuring):
        for source in _files(root / name):
            # Names and lengths keep the end of one file apart from the beginning of the next.
            content = source.read_bytes()
            key.update(f"\n{source.relative_to(root).as_posix()} {len(content)}\n".encode())
            key.update(content)
    return key.hexdigest()[:16]


def _files(path: Path) -> list[Path]:
    if path.is_file():
        return [path]
    inside = (entry for entry in path.rglob("*") if "__pycache__" not in entry.parts)
    return sorted(entry for entry in inside if entry.is_file())
