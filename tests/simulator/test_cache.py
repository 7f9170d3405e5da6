"""The demo is simulated once, and found again."""

from __future__ import annotations

from pathlib import Path

import pytest

import civil_rgbd.simulator
from civil_rgbd.simulator.cache import _sources, cache_folder, cached_demo_recording
from civil_rgbd.simulator.spec import ScanSpec

TINY = ScanSpec(seconds=0.3, image_scale=0.05, point_rate_hz=600)


def test_it_is_simulated_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CIVIL_RGBD_CACHE", str(tmp_path))
    told: list[int] = []

    first = cached_demo_recording(TINY, progress=lambda done, _: told.append(done))
    written = first.stat().st_mtime_ns
    second = cached_demo_recording(TINY, progress=lambda done, _: told.append(done))

    assert first == second
    assert first.name == "demo.mcap"
    assert tmp_path in first.parents
    assert second.stat().st_mtime_ns == written
    assert told == [1, 1, 1]


def test_another_spec_gets_another_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CIVIL_RGBD_CACHE", str(tmp_path))
    other = ScanSpec(seconds=0.3, image_scale=0.05, point_rate_hz=600, seed=1)

    assert cached_demo_recording(TINY) != cached_demo_recording(other)


def test_every_module_of_the_simulator_counts_for_the_place() -> None:
    room = Path(civil_rgbd.simulator.__file__).parent

    assert {source.name for source in _sources()} == {path.name for path in room.rglob("*.py")}
    assert "box_girder.py" in {source.name for source in _sources()}


@pytest.mark.parametrize(
    ("environment", "platform", "folder"),
    [
        ({"CIVIL_RGBD_CACHE": "/mine", "XDG_CACHE_HOME": "/x"}, "linux", Path("/mine")),
        ({"XDG_CACHE_HOME": "/x"}, "linux", Path("/x/civil_rgbd")),
        ({"XDG_CACHE_HOME": ""}, "linux", Path.home() / ".cache/civil_rgbd"),
        ({}, "darwin", Path.home() / "Library/Caches/civil_rgbd"),
        ({"LOCALAPPDATA": "/local"}, "win32", Path("/local/civil_rgbd")),
        ({}, "win32", Path.home() / "AppData/Local/civil_rgbd"),
    ],
)
def test_every_platform_has_its_own_cache(
    environment: dict[str, str], platform: str, folder: Path
) -> None:
    assert cache_folder(environment, platform) == folder
