"""The floors: a room imports rooms on lower floors and itself, never a neighbour, never up."""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FLOORS = [
    {"errors", "constants", "resources", "schema", "recipes", "registry"},
    {"geometry", "ros1", "storage"},
    {"domain"},
    {
        "conversion",
        "trajectories",
        "odometry",
        "simulator",
        "pipeline",
        "format",
        "baselines",
        "defects",
    },
    {
        "converters",
        "builder",
        "dataset",
        "validation",
        "importers",
        "exporters",
        "health",
        "prediction",
        "lineage",
    },
    {"training", "evaluation"},
    {"benchmark", "contribution", "viewer", "measuring"},
    {"civil_rgbd"},  # the front door, civil_rgbd/__init__.py: hands on what lies below it
    {"cli"},
    {"__main__"},
]
FLOOR_OF = {room: floor for floor, rooms in enumerate(FLOORS) for room in rooms}
MAPPED = {name: name for name in ("schema", "recipes", "registry", "conversion")}
"""Folders at the top of the repository that are rooms of the package."""


def modules() -> Iterator[tuple[Path, str]]:
    """Every module of the package: its file and its dotted name."""
    folders = {"": ROOT / "civil_rgbd"} | {f".{room}": ROOT / at for room, at in MAPPED.items()}
    for prefix, folder in folders.items():
        for path in sorted(folder.rglob("*.py")):
            parts = path.relative_to(folder).with_suffix("").parts
            inner = parts[:-1] if parts[-1] == "__init__" else parts
            yield path, ".".join(["civil_rgbd" + prefix, *inner])


def room_of(module: str) -> str:
    """The room of a dotted name; the package itself is the room ``civil_rgbd``."""
    parts = module.split(".")
    return parts[1] if len(parts) > 1 else parts[0]


def imported(tree: ast.AST, module: str, *, is_package: bool) -> Iterator[tuple[int, str]]:
    """Line and dotted name of everything of ours that a module imports, wherever in it."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom):
            base = node.module or ""
            if node.level:
                around = module.split(".")
                around = around[: len(around) - node.level + is_package]
                base = ".".join([*around, *([node.module] if node.module else [])])
            # `from civil_rgbd import format` names a room; `from civil_rgbd.format import x` has.
            names = [f"{base}.{a.name}" if base == "civil_rgbd" else base for a in node.names]
        elif isinstance(node, ast.Call) and _imports_by_name(node.func):
            names = [_literal_start(node.args[0])] if node.args else []
        else:
            continue
        for name in names:
            if name == "civil_rgbd" or name.startswith("civil_rgbd."):
                yield node.lineno, name


def _imports_by_name(function: ast.expr) -> bool:
    name = function.attr if isinstance(function, ast.Attribute) else getattr(function, "id", "")
    return name in {"import_module", "__import__"}


def _literal_start(argument: ast.expr) -> str:
    if isinstance(argument, ast.JoinedStr) and argument.values:
        argument = argument.values[0]
    value = argument.value if isinstance(argument, ast.Constant) else ""
    return value if isinstance(value, str) else ""


def faults(source: str, path: str, module: str) -> list[str]:
    """Say what a module imports that it may not: place, what, remedy."""
    room, found = room_of(module), []
    if room not in FLOOR_OF:
        return [f"{path}:1: room {room!r} has no floor; give it one in FLOORS of this test"]
    for line, name in imported(ast.parse(source), module, is_package=path.endswith("__init__.py")):
        fault = _fault(room, name)
        if fault:
            found.append(f"{path}:{line}: {module} imports {name}: {fault}")
    return found


def _fault(room: str, name: str) -> str | None:
    other = room_of(name)
    if other == room or name == "civil_rgbd.__version__":
        return None
    if other not in FLOOR_OF:
        # An attribute of the front door, such as BridgeDataset.
        other = "civil_rgbd"
    if other == "conversion":
        return "converters are found by entry point only; ask civil_rgbd.converters"
    if FLOOR_OF[other] < FLOOR_OF[room]:
        return None
    if FLOOR_OF[other] == FLOOR_OF[room]:
        return (
            f"{other!r} is a neighbour of {room!r}; move what both need down (a noun to domain, a "
            "function to geometry), or let a room above bring the two together"
        )
    return (
        f"{other!r} stands above {room!r} (floor {FLOOR_OF[other]} > {FLOOR_OF[room]}); hand the "
        "value in from above, or move what is needed down"
    )


@pytest.mark.parametrize(
    ("path", "module"), [pytest.param(path, module, id=module) for path, module in modules()]
)
def test_every_module_imports_lower_floors_only(path: Path, module: str) -> None:
    name = path.relative_to(ROOT).as_posix()

    found = faults(path.read_text("utf-8"), name, module)

    assert not found, "\n".join(found)


@pytest.mark.parametrize("room", ["schema", "recipes", "registry"])
def test_rooms_of_data_hold_no_code(room: str) -> None:
    (only,) = (ROOT / room).glob("*.py")
    (docstring,) = ast.parse(only.read_text("utf-8")).body

    assert only.name == "__init__.py"
    assert isinstance(docstring, ast.Expr)


def test_nothing_hides_under_a_name_that_says_nothing() -> None:
    empty_words = {"utils", "util", "helpers", "common", "misc", "base", "core"}

    assert [module for _, module in modules() if module.split(".")[-1] in empty_words] == []


def test_no_module_is_longer_than_400_lines() -> None:
    lengths = {module: len(path.read_text("utf-8").splitlines()) for path, module in modules()}

    assert {module: lines for module, lines in lengths.items() if lines > 400} == {}


# --- the checker itself -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("module", "source", "word"),
    [
        ("civil_rgbd.pipeline.render", "import civil_rgbd.format.writer", "neighbour"),
        ("civil_rgbd.pipeline.render", "from civil_rgbd.builder.plan import Plan", "above"),
        ("civil_rgbd.pipeline.render", "from civil_rgbd import builder", "above"),
        ("civil_rgbd.pipeline.render", "from civil_rgbd import BridgeDataset", "above"),
        ("civil_rgbd.pipeline.render", "from ..builder import plan", "above"),
        ("civil_rgbd.pipeline.render", "from .. import builder", "above"),
        ("civil_rgbd.pipeline.render", "def f():\n    from civil_rgbd import cli", "above"),
        (
            "civil_rgbd.geometry.camera",
            "from typing import TYPE_CHECKING\nif TYPE_CHECKING:\n    import civil_rgbd.domain.rig",
            "above",
        ),
        (
            "civil_rgbd.domain.rig",
            "import importlib\nimportlib.import_module('civil_rgbd.dataset')",
            "above",
        ),
        ("civil_rgbd.domain.rig", "f = __import__(f'civil_rgbd.{x}')", "above"),
        ("civil_rgbd.builder.run", "from civil_rgbd.conversion import mcap", "entry point only"),
        ("civil_rgbd.cli.build", "from civil_rgbd.conversion.mcap import x", "entry point only"),
        ("civil_rgbd.cli.build", "import civil_rgbd.__main__", "above"),
        ("civil_rgbd.errors", "from civil_rgbd.constants import X", "neighbour"),
        ("civil_rgbd.helpers.x", "", "has no floor"),
    ],
)
def test_it_sees_every_way_of_importing_upwards(module: str, source: str, word: str) -> None:
    (fault,) = faults(source, "somewhere.py", module)

    assert fault.startswith(f"somewhere.py:{max(1, len(source.splitlines()))}:")
    assert word in fault


@pytest.mark.parametrize(
    ("module", "source"),
    [
        ("civil_rgbd.pipeline.render", "from civil_rgbd.pipeline import select"),
        ("civil_rgbd.pipeline.render", "from . import select"),
        ("civil_rgbd.pipeline.render", "from civil_rgbd.geometry.camera import PinholeCamera"),
        ("civil_rgbd.builder.provenance", "from civil_rgbd import __version__"),
        ("civil_rgbd.cli.build", "from civil_rgbd import BridgeDataset"),
        ("civil_rgbd.cli.build", "from civil_rgbd.builder.run import build_bridge"),
        ("civil_rgbd.__main__", "from civil_rgbd.cli import main"),
        ("civil_rgbd.geometry.camera", "import numpy\nfrom numpy.typing import NDArray"),
    ],
)
def test_it_lets_pass_what_goes_down(module: str, source: str) -> None:
    assert faults(source, "somewhere.py", module) == []
