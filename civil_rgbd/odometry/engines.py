"""The engines that are known: how each is installed, called, and what its answer means."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from civil_rgbd.errors import UsageError
from civil_rgbd.resources import nearest

IMU_TOPIC: Final = "/imu"
LIDAR_TOPIC: Final = "/lidar"
"""Topics of the bag that engines are given."""

START, END = "start", "end"
"""Instants of a scan: its first and its last point."""


@dataclass(frozen=True, slots=True)
class EngineFiles:
    """Where one run finds and leaves things.

    Attributes:
        bag: the input, alone in its folder.
        settings: a YAML file in the engine's own words.
        out: folder for whatever it writes.
    """

    bag: Path
    settings: Path
    out: Path


@dataclass(frozen=True, slots=True)
class Engine:
    """One engine. It is never imported: licences differ, and so do the packages it needs.

    Attributes:
        name: as in ``--engine``, and of its distribution on PyPI.
        version: the one that was tried.
        requirements: what pip is asked for.
        program: what the distribution installs.
        licence: SPDX.
        suits: the sensors it is for, in words.
        all_round: they are sensors that look all round.
        livox_messages: it is given Livox CustomMsg, otherwise PointCloud2.
        arguments: what the program is called with.
        stamps_name: the instant of a scan that the stamps of its poses name.
        poses_hold_at: the instant of a scan at which its poses hold.
    """

    name: str
    version: str
    requirements: tuple[str, ...]
    program: str
    licence: str
    suits: str
    all_round: bool
    livox_messages: bool
    arguments: Callable[[EngineFiles], list[str]]
    stamps_name: str
    poses_hold_at: str


def _genz_lio(files: EngineFiles) -> list[str]:
    return ["run", str(files.bag), "--config", str(files.settings), "--output", str(files.out)]


def _se3_lio(files: EngineFiles) -> list[str]:
    return [
        str(files.bag),
        *("--config", str(files.settings), "--output", str(files.out)),
        *("--input-type", "ros1-ouster", "--no-progress"),
    ]


def _rko_lio(files: EngineFiles) -> list[str]:
    return [
        str(files.bag.parent),
        *("--config", str(files.settings), "--log_dir", str(files.out), "--run_name", "poses"),
        *("--dataloader", "rosbag", "--imu", IMU_TOPIC, "--lidar", LIDAR_TOPIC),
    ]


ENGINES: Final = {
    engine.name: engine
    for engine in (
        Engine(
            name="genz-lio",
            version="0.1.1",
            requirements=("genz-lio[rosbag]==0.1.1",),
            program="genz_lio_pipeline",
            licence="GPL-2.0-only",
            suits="a hand-held Livox Avia and others that look one way",
            all_round=False,
            livox_messages=True,
            arguments=_genz_lio,
            stamps_name=END,
            poses_hold_at=END,
        ),
        Engine(
            name="se3-lio",
            version="0.2.0",
            requirements=("se3-lio==0.2.0",),
            program="se3_lio_pipeline",
            licence="GPL-2.0-only",
            suits="a hand-held Livox Avia and others that look one way",
            all_round=False,
            livox_messages=False,
            arguments=_se3_lio,
            stamps_name=END,
            poses_hold_at=END,
        ),
        Engine(
            name="rko-lio",
            version="0.4.0",
            # typer < 0.28: later ones refuse how its command line is declared.
            requirements=("rko-lio==0.4.0", "rosbags>=0.10,<0.12", "typer<0.28"),
            program="rko_lio",
            licence="MIT",
            suits="sensors that look all round",
            all_round=True,
            livox_messages=False,
            arguments=_rko_lio,
            stamps_name=END,
            poses_hold_at=END,
        ),
    )
}


def engine_named(name: str) -> Engine:
    """Return an engine.

    Raises:
        UsageError: none goes by that name.
    """
    if name not in ENGINES:
        raise UsageError(
            f"no odometry engine is called {name!r}", where="--engine", fix=nearest(name, ENGINES)
        )
    return ENGINES[name]
