"""Benchmarks read kept rows again only while the code that measured them is the same."""

from __future__ import annotations

import importlib
import shutil
import subprocess
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).resolve().parents[1]
BENCHMARKS = ROOT / "benchmarks"
SCRIPTS = ("visibility_scenes",)


@pytest.fixture
def measured_code(monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    monkeypatch.syspath_prepend(BENCHMARKS)
    return importlib.import_module("measured_code")


@pytest.fixture
def checkout(tmp_path: Path, measured_code: ModuleType) -> Path:
    """A copy of all that decides figures."""
    for name in (*measured_code.SOURCES, "benchmarks/visibility_scenes.py"):
        source, copy = ROOT / name, tmp_path / name
        copy.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, copy, ignore=shutil.ignore_patterns("__pycache__"))
        else:
            shutil.copy(source, copy)
    return tmp_path


@pytest.mark.parametrize(
    "touched",
    [
        "civil_rgbd/pipeline/visibility.py",
        "civil_rgbd/simulator/sites/plants.py",
        "civil_rgbd/geometry/camera.py",
        "civil_rgbd/domain/recipe.py",
        "civil_rgbd/builder/plan.py",
        "recipes/250k-clean.toml",
        "schema/recipe.schema.json",
        "benchmarks/visibility_scenes.py",
    ],
)
def test_rows_are_kept_under_another_key_when_their_code_changes(
    measured_code: ModuleType, checkout: Path, touched: str
) -> None:
    before = measured_code.measuring_key("walk", SCRIPTS, root=checkout)
    assert measured_code.measuring_key("walk", SCRIPTS, root=checkout) == before
    assert measured_code.measuring_key("another walk", SCRIPTS, root=checkout) != before

    with (checkout / touched).open("a", encoding="utf-8") as stream:
        stream.write("\n")

    assert measured_code.measuring_key("walk", SCRIPTS, root=checkout) != before


def test_what_else_decides_counts_where_it_is_named(
    measured_code: ModuleType, checkout: Path
) -> None:
    planted = checkout / "tests" / "planted.py"
    planted.parent.mkdir()
    planted.write_text("limit = 2\n")
    before = measured_code.measuring_key("check", (), more=("tests/planted.py",), root=checkout)

    planted.write_text("limit = 3\n")

    after = measured_code.measuring_key("check", (), more=("tests/planted.py",), root=checkout)
    assert after != before


def test_compiled_files_change_no_key(measured_code: ModuleType, checkout: Path) -> None:
    before = measured_code.measuring_key("walk", SCRIPTS, root=checkout)
    compiled = checkout / "civil_rgbd" / "pipeline" / "__pycache__"
    compiled.mkdir()
    (compiled / "visibility.pyc").write_bytes(b"compiled")

    assert measured_code.measuring_key("walk", SCRIPTS, root=checkout) == before


def test_another_version_of_a_library_changes_the_key(
    measured_code: ModuleType, monkeypatch: pytest.MonkeyPatch
) -> None:
    before = measured_code.measuring_key("walk", SCRIPTS)
    for library in ("numba", "opencv-python-headless"):
        assert library in measured_code.LIBRARIES
        with monkeypatch.context() as patched:
            patched.setattr(
                measured_code,
                "version",
                lambda name, library=library: f"0.{name == library}",
            )
            assert measured_code.measuring_key("walk", SCRIPTS) != before


def test_every_module_that_measures_counts(measured_code: ModuleType) -> None:
    said = "import sys, accumulation_scenes, visibility_scenes; print(*sys.modules)"
    run = subprocess.run(  # our own interpreter: what is imported there, and only there
        [sys.executable, "-c", said], cwd=BENCHMARKS, capture_output=True, text=True, check=True
    )
    imported = {name for name in run.stdout.split() if name.startswith("civil_rgbd.")}
    # Where things are found and written, and what errors say: no figure hangs on them.
    aside = ("errors", "resources", "ros1", "storage", "builder", "format")
    counted = tuple(
        name.removesuffix(".py").replace("/", ".")
        for name in measured_code.SOURCES
        if name.startswith("civil_rgbd/")
    )

    assert "civil_rgbd.pipeline.visibility" in imported
    for name in imported - {f"civil_rgbd.{room}" for room in aside}:
        assert name.startswith((*counted, "civil_rgbd.ros1.", "civil_rgbd.storage.")), name
