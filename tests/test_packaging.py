"""What is listed is what is there, and what ships is what the repository holds."""

from __future__ import annotations

import subprocess
import sys
import tarfile
import tomllib
import zipfile
from importlib import resources
from importlib.metadata import entry_points
from pathlib import Path
from shutil import copytree, ignore_patterns
from typing import Any

import pytest

import civil_rgbd
from civil_rgbd.converters import ENTRY_POINT_GROUP

ROOT = Path(__file__).resolve().parents[1]
PYPROJECT: dict[str, Any] = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
SETUPTOOLS = PYPROJECT["tool"]["setuptools"]
MAPPED = {f"civil_rgbd.{room}": room for room in ("schema", "recipes", "registry", "conversion")}
DATA = {f"civil_rgbd.{room}": room for room in ("schema", "recipes", "registry")} | {
    f"civil_rgbd.{room}": f"civil_rgbd/{room.replace('.', '/')}"
    for room in ("odometry.engine_settings", "training.recipes")
}


def folders_with_modules() -> set[str]:
    """Dotted names of the folders that hold Python modules."""
    inside = {
        ".".join(path.parent.relative_to(ROOT).parts)
        for path in (ROOT / "civil_rgbd").rglob("*.py")
    }
    return inside | set(MAPPED)


def test_the_packages_listed_are_the_folders_on_disk() -> None:
    assert sorted(SETUPTOOLS["packages"]) == sorted(folders_with_modules())


def test_the_list_is_sorted_and_says_nothing_twice() -> None:
    assert SETUPTOOLS["packages"] == sorted(set(SETUPTOOLS["packages"]))


def test_every_package_says_in_its_init_what_it_is() -> None:
    for package in SETUPTOOLS["packages"]:
        folder = ROOT / MAPPED.get(package, package.replace(".", "/"))
        assert (folder / "__init__.py").read_text("utf-8").lstrip().startswith('"""'), package


def test_the_top_level_folders_are_mapped_into_the_package() -> None:
    assert SETUPTOOLS["package-dir"] == {"civil_rgbd": "civil_rgbd"} | MAPPED


@pytest.mark.parametrize(
    ("room", "suffix"), [("schema", ".json"), ("recipes", ".toml"), ("registry", ".json")]
)
def test_the_data_that_the_package_finds_is_the_repositorys(room: str, suffix: str) -> None:
    shipped = {
        entry.name: entry.read_bytes()
        for entry in resources.files(f"civil_rgbd.{room}").iterdir()
        if entry.name.endswith(suffix)
    }

    assert shipped == {path.name: path.read_bytes() for path in (ROOT / room).glob(f"*{suffix}")}
    assert shipped


def test_every_file_of_a_data_room_is_of_a_kind_that_ships() -> None:
    for package, folder in DATA.items():
        kinds = {f"*{path.suffix}" for path in (ROOT / folder).iterdir() if path.is_file()}
        assert kinds - {"*.py"} == set(SETUPTOOLS["package-data"][package])


def test_no_folder_of_data_lies_below_a_package_without_being_listed() -> None:
    # setuptools takes it for a package, and warns that it is absent from the list.
    folders = {
        ".".join(path.relative_to(ROOT).parts)
        for path in (ROOT / "civil_rgbd").rglob("*/")
        if path.name != "__pycache__" and any(map(Path.is_file, path.iterdir()))
    }

    assert folders - set(SETUPTOOLS["packages"]) == set()


def test_the_package_says_that_it_is_typed() -> None:
    assert (ROOT / "civil_rgbd/py.typed").exists()
    assert SETUPTOOLS["package-data"]["civil_rgbd"] == ["py.typed"]


def test_every_converter_loads() -> None:
    installed = {point.name: point for point in entry_points(group=ENTRY_POINT_GROUP)}
    listed = PYPROJECT["project"]["entry-points"][ENTRY_POINT_GROUP]

    for name, value in listed.items():
        assert installed[name].value == value, "install the package anew: pip install -e ."
        assert callable(installed[name].load())


def test_every_converter_of_the_repository_is_listed() -> None:
    listed = PYPROJECT["project"]["entry-points"][ENTRY_POINT_GROUP].values()
    offered = {
        f"civil_rgbd.conversion.{path.stem}:open_recording"
        for path in (ROOT / "conversion").glob("*.py")
        if "\ndef open_recording(" in path.read_text("utf-8")
    }

    assert offered <= set(listed)


def test_the_version_is_the_same_everywhere() -> None:
    citation = (ROOT / "CITATION.cff").read_text("utf-8")

    assert civil_rgbd.__version__ == PYPROJECT["project"]["version"]
    assert f"version: {civil_rgbd.__version__}" in citation.replace('"', "")


def test_the_manifest_of_the_sdist_names_what_is_there() -> None:
    for line in (ROOT / "MANIFEST.in").read_text("utf-8").splitlines():
        verb, *names = line.split()
        if verb in {"include", "graft"}:
            assert [name for name in names if not (ROOT / name).exists()] == []


@pytest.mark.slow
def test_wheel_and_sdist_hold_what_the_repository_holds(tmp_path: Path) -> None:
    pytest.importorskip("setuptools", minversion="77", reason="building needs setuptools >= 77")
    source, out = tmp_path / "source", tmp_path / "out"
    leave_out = ignore_patterns(".*", "build", "dist", "*.egg-info", "__pycache__", "demo")
    copytree(ROOT, source, ignore=leave_out)
    out.mkdir()
    code = (
        "from setuptools import build_meta as b; "
        f"b.build_sdist({str(out)!r}); b.build_wheel({str(out)!r})"
    )

    made = subprocess.run(
        [sys.executable, "-c", code], cwd=source, capture_output=True, text=True, check=False
    )

    assert made.returncode == 0, made.stderr
    assert "Warning" not in made.stderr
    (wheel,), (sdist,) = out.glob("*.whl"), out.glob("*.tar.gz")
    with zipfile.ZipFile(wheel) as archive:
        in_wheel = {name for name in archive.namelist() if ".dist-info/" not in name}
        for package, folder in (MAPPED | DATA).items():
            place = package.replace(".", "/")
            for path in (ROOT / folder).iterdir():
                if path.is_file() and not path.name.startswith("."):
                    assert archive.read(f"{place}/{path.name}") == path.read_bytes()
    assert {name.split("/")[0] for name in in_wheel} == {"civil_rgbd"}
    with tarfile.open(sdist) as archive_of_source:
        names = {name.partition("/")[2] for name in archive_of_source.getnames()}
    wanted = {"DATASHEET.md", "LICENSE", "Makefile", "docs/architecture.md", "recipes/250k.toml"}
    wanted |= {f"{folder}/__init__.py" for folder in DATA.values()}
    wanted |= {"civil_rgbd/training/recipes/bts.toml"}
    wanted |= {"civil_rgbd/odometry/engine_settings/rko-lio.yaml"}
    assert wanted | {"tests/test_packaging.py", "schema/recipe.schema.json"} <= names
