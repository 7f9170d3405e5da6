"""A contribution that lacks nothing, made of the golden folder."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import pytest

from civil_rgbd.contribution.scaffold import known_answers as answers_known
from civil_rgbd.contribution.scaffold import open_submission, write_submission

from ..data.format_v1 import make

ANSWERS = {
    "name": "Golden Bridge",
    "place": "by the river Grand",
    "country": "CA",
    "region": "CA-ON",
    "structure.type": "girder",
    "structure.year_built": 1968,
    "owner": "Town of Nowhere",
    "owner_consent": "letter of its engineer, 2023-11-01",
    "licence": "CC-BY-4.0",
    "citation": "The civil_rgbd authors: the golden folder",
    "contact": "someone@example.org",
    "survey_dates": ["2023-11-14"],
    "sensors": "drawn by a program",
    "privacy": "nobody is in the pictures: they are drawn",
    "contribution.place_precision": "town",
    "contribution.consent": "written",
    "contribution.calibration_method": "simulated",
    "contribution.calibration_date": "2023-11-13",
    "contribution.calibration_report": "exact",
    "contribution.faces": "none visible",
    "contribution.plates": "none visible",
}


@pytest.fixture
def bare(tmp_path: Path) -> Path:
    """A dataset with one bridge, of which nobody has said anything."""
    dataset = tmp_path / "submission"
    bridge = dataset / "bridges" / make.BRIDGE_ID
    partial = tmp_path / "unfinished"
    rows = [make.write_frame(partial, make.frame(i), stage=make.RECIPE.image) for i in (0, 7, 12)]
    share = sum(row.valid_share for row in rows) / len(rows)
    said = make.manifest(share)
    manifest = dataclasses.replace(said, info=make.BridgeInfo(make.BRIDGE_ID))
    make.finish_bridge(
        partial, bridge, manifest=manifest, camera=make.CAMERA, rows=rows, replace=False
    )
    make.refresh_dataset(dataset)
    return dataset


@pytest.fixture
def submission(bare: Path) -> Path:
    """The same, and everything is said."""
    place = open_submission(bare, make.BRIDGE_ID)
    write_submission(place, answers_known(place) | ANSWERS)
    return bare


@pytest.fixture
def bridge(submission: Path) -> Path:
    """The bridge folder of the submission."""
    return submission / "bridges" / make.BRIDGE_ID
