"""Make the golden dataset of format 1.0 anew: ``python tests/data/format_v1/make.py``.

Until the first release the folder changes with the schemas, in one commit. From then on it is
frozen: a reader of any later version must go on reading it.
"""

from __future__ import annotations

import dataclasses
import shutil
from pathlib import Path

import numpy as np

from civil_rgbd.domain.bridge import (
    BridgeInfo,
    Contribution,
    Counts,
    Location,
    Manifest,
    RecipeRecord,
    RigRecord,
    Software,
    Structure,
)
from civil_rgbd.domain.defect import DefectMeasure, DefectRecord
from civil_rgbd.domain.frame import RgbdFrame
from civil_rgbd.domain.recipe import ImageStage, Recipe, SelectStage
from civil_rgbd.domain.recording import SourceFile
from civil_rgbd.format.datasets import DatasetRecord, refresh_dataset, write_dataset
from civil_rgbd.format.defects import write_defects
from civil_rgbd.format.hashes import document_sha256
from civil_rgbd.format.layout import BRIDGES, DATASET, DEFECTS
from civil_rgbd.format.writer import finish_bridge, write_frame
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.geometry.transforms import matrix_from_quaternion, transform_from, unit_quaternion

HERE = Path(__file__).parent
BRIDGE_ID = "B1"
SOURCE_INDICES = (0, 7, 12)
CAMERA_TIME_OFFSET_S = 0.015625

RAW = PinholeCamera(64, 48, 40.0, 41.0, 31.25, 23.75)
CAMERA = RAW.scaled(0.5)
RECIPE = Recipe("golden", select=SelectStage(min_displacement_m=0.25), image=ImageStage(scale=0.5))


def frame(source_index: int) -> RgbdFrame:
    """Return a frame of gentle slopes, so that every JPEG decoder gives the same pixels."""
    rows, columns = np.mgrid[0 : CAMERA.height_px, 0 : CAMERA.width_px]
    rgb = np.stack([4 * columns, 6 * rows, np.full_like(rows, 10 * source_index)], axis=-1)
    metres = 3 + columns / 8 + rows / 16 + source_index
    depth_m = np.where((rows + columns + source_index) % 3 == 0, metres, 0.0)
    source_stamp_ns = 1_700_000_000_000_000_000 + source_index * 100_000_000
    rotation = matrix_from_quaternion(unit_quaternion([0.5, -0.5, 0.5, 0.5 + source_index / 64]))
    return RgbdFrame(
        source_index=source_index,
        stamp_ns=source_stamp_ns + round(CAMERA_TIME_OFFSET_S * 1e9),
        source_stamp_ns=source_stamp_ns,
        rgb=rgb.astype(np.uint8),
        depth_m=depth_m.astype(np.float32),
        camera=CAMERA,
        T_map_camera=transform_from(rotation, [540000.5 + source_index, 4810000.25, 331.125]),
    )


def manifest(mean_valid_share: float) -> Manifest:
    """Return a manifest that says something everywhere."""
    parameters = {
        stage.name: dataclasses.asdict(getattr(RECIPE, stage.name))
        for stage in dataclasses.fields(RECIPE)
        if stage.name not in {"name", "description"} and getattr(RECIPE, stage.name) is not None
    }
    return Manifest(
        info=BridgeInfo(
            bridge_id=BRIDGE_ID,
            licence="CC-BY-4.0",
            name="Golden Bridge",
            place="nowhere in particular",
            country="CA",
            region="CA-ON",
            location=Location(latitude_deg=43.5, longitude_deg=-80.5, precision_m=5000.0),
            structure=Structure(type="girder", material="concrete", year_built=1968, length_m=65.0),
            owner="nobody",
            citation="The civil_rgbd authors: the golden folder of format 1.0",
            survey_dates=("2023-11-14",),
            privacy="nobody is in the pictures: they are drawn",
            contribution=Contribution(
                place_precision="town",
                calibration_method="simulated",
                faces="none visible",
                plates="none visible",
            ),
        ),
        origin="rendered",
        sources=(SourceFile("golden.mcap", 12345, "0123456789abcdef" * 4, "mcap"),),
        software=Software("0.1.0", "3.11.2", {"numpy": "2.0.0", "OpenEXR": "3.3.0"}),
        counts=Counts(
            images_seen=14,
            frames_kept=len(SOURCE_INDICES),
            dropped={"image-too-near-previous": 10, "too-few-points": 1},
            scans_seen=15,
            scans_read=14,
            points_read=360_000,
            points_dropped={"no_return": 1200},
            mean_points_in_view=256.5,
            mean_age_span_s=1.25,
            mean_newest_age_s=0.125,
            max_newest_age_s=0.5,
            frames_with_old_points=1,
            mean_valid_share=mean_valid_share,
            pixels_without_source=0,
        ),
        reading={"lidar_topic": "/livox/lidar", "pose_topic": "/odometry"},
        rig=RigRecord(
            camera=LensCamera(RAW, "plumb_bob", (-0.05, 0.01, 0.0, 0.0, 0.0)),
            T_lidar_camera=transform_from(
                [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0], [0.0, -1.0, 0.0]], [0.125, 0.0, -0.0625]
            ),
            T_body_lidar=np.eye(4),
            camera_time_offset_s=CAMERA_TIME_OFFSET_S,
            body="livox_frame",
            lidar_name="Livox Avia",
            camera_name="RealSense D455",
        ),
        recipe=RecipeRecord(
            name=RECIPE.name,
            sha256=document_sha256(parameters),
            parameters=parameters,
            overrides={"image.scale": 0.5},
        ),
        deskew="per_point",
        map_up=(0.0, 0.0, 1.0),
        map_origin_m=(540000.0, 4810000.0, 331.0),
        warnings=("topic /livox/lidar has one message without points",),
    )


def defect() -> DefectRecord:
    """Return one crack."""
    return DefectRecord(
        defect_id="D1",
        frame_id="000007",
        type="crack",
        outline="polyline",
        uv_px=((3.0, 4.5), (9.25, 11.0)),
        measures=(DefectMeasure("length", 431.5, "mm", 2.5), DefectMeasure("width", 0.3, "mm")),
        severity="medium",
    )


def make(dataset: Path) -> None:
    """Write the dataset into an empty folder."""
    partial, bridge = dataset / "unfinished", dataset / BRIDGES / BRIDGE_ID
    rows = [write_frame(partial, frame(i), stage=RECIPE.image) for i in SOURCE_INDICES]
    share = sum(row.valid_share for row in rows) / len(rows)
    finish_bridge(
        partial, bridge, manifest=manifest(share), camera=CAMERA, rows=rows, replace=False
    )
    write_defects(bridge / DEFECTS, [defect()])
    splits = {"train": {BRIDGE_ID: ("000000", "000012")}, "everything": {BRIDGE_ID: "all"}}
    write_dataset(dataset / DATASET, DatasetRecord("golden", splits=splits))
    refresh_dataset(dataset)


if __name__ == "__main__":
    shutil.rmtree(HERE / BRIDGES, ignore_errors=True)
    (HERE / DATASET).unlink(missing_ok=True)
    make(HERE)
