"""Environments of engines: found, refused, made, and gone when they are not whole."""

from __future__ import annotations

import os
import zipfile
from dataclasses import replace
from pathlib import Path

import pytest

from civil_rgbd.errors import MissingExtraError, OdometryError, OutputError
from civil_rgbd.odometry.engines import ENGINES
from civil_rgbd.odometry.environment import create_environment, find_program

from .fakes import fake_environment

pytestmark = pytest.mark.skipif(os.name == "nt", reason="the stand-in engines are scripts")

GENZ = ENGINES["genz-lio"]


def test_a_missing_engine_says_how_to_get_exactly_this_one(tmp_path: Path) -> None:
    with pytest.raises(MissingExtraError, match="genz-lio is not installed") as info:
        find_program(GENZ, tmp_path / "none")

    assert "GPL-2.0-only" in info.value.what
    assert info.value.fix.startswith("add --create-environment")
    assert '-m pip install "genz-lio[rosbag]==0.1.1"`' in info.value.fix


def test_another_version_than_the_tried_one_is_refused(tmp_path: Path) -> None:
    folder = fake_environment(tmp_path / "e", GENZ, "", version="0.2.0")

    with pytest.raises(MissingExtraError, match=r"0\.2\.0 is installed, 0\.1\.1 was tried"):
        find_program(GENZ, folder)


def test_an_installation_that_was_cut_short_is_not_taken_for_one(tmp_path: Path) -> None:
    folder = fake_environment(tmp_path / "e", GENZ, "")
    assert find_program(GENZ, folder) == folder / "bin" / "genz_lio_pipeline"

    (folder / "civil_rgbd_engine.txt").touch()

    with pytest.raises(MissingExtraError, match="was cut short"):
        find_program(GENZ, folder)


def test_a_folder_of_somebody_else_is_left_alone(tmp_path: Path) -> None:
    (tmp_path / "thesis.txt").write_text("years of work")

    with pytest.raises(OutputError, match="no environment of ours"):
        create_environment(GENZ, tmp_path)

    assert (tmp_path / "thesis.txt").exists()


def wheel(folder: Path) -> Path:
    """A wheel of a distribution genz-lio 0.1.1 whose program does nothing."""
    path = folder / "genz_lio-0.1.1-py3-none-any.whl"
    about = "genz_lio-0.1.1.dist-info"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("genz_stand_in.py", "def main():\n    pass\n")
        archive.writestr(
            f"{about}/METADATA", "Metadata-Version: 2.1\nName: genz-lio\nVersion: 0.1.1\n"
        )
        archive.writestr(
            f"{about}/WHEEL", "Wheel-Version: 1.0\nRoot-Is-Purelib: true\nTag: py3-none-any\n"
        )
        entry = "[console_scripts]\ngenz_lio_pipeline = genz_stand_in:main\n"
        archive.writestr(f"{about}/entry_points.txt", entry)
        archive.writestr(f"{about}/RECORD", "")
    return path


@pytest.mark.slow
def test_an_environment_is_made_whole_and_found(tmp_path: Path) -> None:
    engine = replace(GENZ, requirements=(str(wheel(tmp_path)),))
    folder = tmp_path / "engines" / "genz"
    (folder / "rest").mkdir(parents=True)
    (folder / "civil_rgbd_engine.txt").touch()  # an earlier attempt that was killed
    ticks: list[float] = []

    create_environment(engine, folder, on_tick=ticks.append)

    assert find_program(engine, folder).exists()
    assert not (folder / "rest").exists()
    assert ticks


@pytest.mark.slow
def test_a_failed_installation_leaves_nothing_and_quotes_pip(tmp_path: Path) -> None:
    engine = replace(GENZ, requirements=(str(tmp_path / "no_such-1.0-py3-none-any.whl"),))

    with pytest.raises(OdometryError, match=r"(?s)installing genz-lio 0.*no_such") as info:
        create_environment(engine, tmp_path / "e")

    assert "by hand" in info.value.fix
    assert not (tmp_path / "e").exists()
