"""The same messages in every container give the same bridge folder, byte for byte."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from civil_rgbd.cli import main

from .conversion import containers, scene

SMALL = ["--image-scale", "0.1", "--point-rate-hz", "12000", "--seconds", "3"]
SETTINGS = ["--set", "accumulate.points=8000", "--set", "image.scale=1.0", "--workers", "1"]
KINDS = ["mcap", "bag", "bag-lz4", "bag-bz2", "folder-sqlite3", "folder-mcap", "db3", "splits"]


@pytest.fixture(scope="module")
def messages(tmp_path_factory: pytest.TempPathFactory) -> list[scene.Message]:
    raw = tmp_path_factory.mktemp("raw") / "raw.mcap"
    assert main(["simulate", *SMALL, str(raw)]) == 0
    return containers.messages_of(raw)


def recorded(folder: Path, messages: list[scene.Message], kind: str) -> list[Path]:
    """The messages in one container; its files or its folder."""
    name, _, how = kind.partition("-")
    if name == "mcap":
        return [scene.write(folder / "a.mcap", messages)]
    if name == "bag":
        return [containers.write_bag(folder / "a.bag", messages, compression=how or "none")]
    if name == "splits":
        half = len(messages) // 2
        parts = (messages[:half], messages[half:])
        return [scene.write(folder / f"a_{i}.mcap", part) for i, part in enumerate(parts)]
    written = containers.write_folder(folder / "a", messages, storage=how or "sqlite3")
    return [written / "a.db3"] if name == "db3" else [written]


def built(folder: Path, messages: list[scene.Message], kind: str) -> dict[str, bytes]:
    """The bridge folder, without what the manifest says of its sources."""
    folder.mkdir()
    sources = [str(path) for path in recorded(folder, messages, kind)]
    out = folder / "out"
    command = ["build", *SETTINGS, "--bridge", "B9", "--licence", "CC0-1.0", "--out", str(out)]
    assert main([*command, *sources]) == 0
    files = {
        path.relative_to(out).as_posix(): path.read_bytes()
        for path in out.rglob("*")
        if path.is_file()
    }
    manifest = json.loads(files["bridges/B9/manifest.json"])
    names = {source.pop("converter") for source in manifest["sources"]}
    expected = {"folder": "ros2-folder", "splits": "mcap"}
    assert names == {expected.get(kind.partition("-")[0], kind.partition("-")[0])}
    assert manifest["origin"] == "simulated"  # a message says so: other containers keep it
    manifest["sources"] = None
    files["bridges/B9/manifest.json"] = json.dumps(manifest).encode()
    return files


@pytest.fixture(scope="module")
def reference(
    messages: list[scene.Message], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, bytes]:
    return built(tmp_path_factory.mktemp("reference") / "mcap", messages, "mcap")


@pytest.mark.parametrize("kind", KINDS[1:])
def test_the_bridge_is_the_same(
    messages: list[scene.Message], reference: dict[str, bytes], tmp_path: Path, kind: str
) -> None:
    found = built(tmp_path / kind, messages, kind)

    assert sorted(found) == sorted(reference)
    assert [name for name in found if found[name] != reference[name]] == []
    assert sum(name.endswith(".exr") for name in found) > 3
