"""Which way round: told on simulated walks and on two real rigs, for the right and the inverse."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.writer import Writer
from numpy.typing import NDArray

from civil_rgbd.cli import main
from civil_rgbd.conversion.pcd import read_pcd
from civil_rgbd.conversion.point_table import scan_from_table
from civil_rgbd.converters import open_recording
from civil_rgbd.domain.recording import CameraImage, Recording
from civil_rgbd.domain.rig import Rig
from civil_rgbd.domain.scan import LidarScan
from civil_rgbd.errors import RecordingError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.geometry.transforms import compose, inverse, transform_from, transform_points
from civil_rgbd.health.direction import Evidence, compare_directions
from civil_rgbd.health.edges import edge_picture, sample_edges
from civil_rgbd.simulator.recording import SimulatedRecording
from civil_rgbd.simulator.spec import ScanSpec
from civil_rgbd.trajectories.rig_importers.formats import import_rig
from civil_rgbd.trajectories.rig_text import rig_to_text

from ..recordings import MemoryRecording, standing_still

SEEDS = range(4)
R_OPTICAL = np.array([[0.0, -1, 0], [0, 0, -1], [1, 0, 0]])
"""Takes x forward, y left, z up to x right, y down, z forward."""


@dataclass(frozen=True, eq=False)
class Remounted:
    """A recording whose LiDAR frame is turned, and whose rig says something of its own.

    Attributes:
        inner: the recording.
        T_lidar_camera: what the rig says.
        T_new_lidar: turns the points of every scan.
    """

    inner: Recording
    T_lidar_camera: NDArray[np.float64]
    T_new_lidar: NDArray[np.float64]

    def __getattr__(self, name: str) -> object:
        return getattr(self.inner, name)

    @property
    def rig(self) -> Rig:
        return replace(self.inner.rig, T_body_camera=self.T_lidar_camera, T_body_lidar=np.eye(4))

    def read_scan(self, index: int) -> LidarScan:
        scan = self.inner.read_scan(index)
        returned = (scan.points != 0).any(axis=1)
        points = transform_points(self.T_new_lidar, scan.points) * returned[:, np.newaxis]
        return replace(scan, points=points)

    def read_image(self, index: int) -> CameraImage:
        return self.inner.read_image(index)


def walk(seed: int, *, image_scale: float = 0.25, images_a_s: float = 1.0) -> SimulatedRecording:
    """A short noisy walk; seeds differ in way, speed and noise."""
    return SimulatedRecording(
        ScanSpec(
            seconds=3.0 + seed,
            seed=seed,
            image_rate_hz=images_a_s,
            image_scale=image_scale,
            point_rate_hz=240_000,
            range_noise_m=0.02,
            false_return_share=0.01,
            speed_m_s=1.0 + 0.3 * seed,
        )
    )


def stated(
    recording: Recording, T: NDArray[np.float64], Q: NDArray[np.float64] | None = None
) -> Remounted:
    return Remounted(recording, T, np.eye(4) if Q is None else Q)


@pytest.mark.parametrize("seed", SEEDS)
def test_simulated_walks_tell_right_from_inverse(seed: int) -> None:
    recording = walk(seed)
    T_lidar_camera = recording.rig.T_lidar_camera

    right = compare_directions(recording, 3)
    wrong = compare_directions(stated(recording, inverse(T_lidar_camera)), 3)  # type: ignore[arg-type]  # it fits by delegation

    assert (right.verdict, wrong.verdict) == ("given", "inverse")
    assert right.given.contrast > 1.3  # measured: 1.44 to 1.55
    assert right.given.share_in_view > 0.8
    assert (right.misses, wrong.misses) == (False, True)  # 70 degrees of view, turned by 90
    assert wrong.inverse == right.given


@pytest.mark.parametrize(
    "seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in SEEDS[1:])]
)
def test_edges_tell_them_apart_where_both_are_in_view(seed: int) -> None:
    # A LiDAR whose frame is named like the camera's: only 3 degrees and 10 cm change sign.
    recording, Q = walk(seed, image_scale=0.5, images_a_s=2.0), transform_from(R_OPTICAL, [0, 0, 0])
    T_new_camera = compose(Q, recording.rig.T_lidar_camera)

    right = compare_directions(stated(recording, T_new_camera, Q), 6)  # type: ignore[arg-type]  # as above
    wrong = compare_directions(stated(recording, inverse(T_new_camera), Q), 6)  # type: ignore[arg-type]  # as above

    assert min(right.given.share_in_view, right.inverse.share_in_view) > 0.8
    assert (right.verdict, wrong.verdict) == ("given", "inverse")
    assert right.given.contrast - right.inverse.contrast > 0.2  # measured: 0.31 to 0.41


def test_the_real_drive_tells_right_from_inverse(shared_data: Path) -> None:
    recording = open_recording(shared_data / "kitti_bridge_drive" / "kitti_20frames.mcap")

    right = compare_directions(recording)
    wrong = compare_directions(stated(recording, inverse(recording.rig.T_lidar_camera)))  # type: ignore[arg-type]  # as above

    assert (right.verdict, wrong.verdict) == ("given", "inverse")
    # The share in view alone would hardly tell: 14 % against 9 %.
    assert right.given.share_in_view < 2 * right.inverse.share_in_view
    assert right.given.contrast > 1.6  # measured: 1.82
    assert right.inverse.contrast < 1.15  # measured: 0.99
    assert not wrong.misses


def test_a_real_rig_whose_frames_agree_is_told_by_edges_alone(shared_data: Path) -> None:
    recording = open_recording(shared_data / "kitti_bridge_drive" / "kitti_20frames.mcap")
    Q = transform_from(R_OPTICAL, [0.0, 0.0, 0.0])
    T_new_camera = compose(Q, recording.rig.T_lidar_camera)  # 27 cm and no rotation to speak of

    right = compare_directions(stated(recording, T_new_camera, Q))  # type: ignore[arg-type]  # as above
    wrong = compare_directions(stated(recording, inverse(T_new_camera), Q))  # type: ignore[arg-type]  # as above

    assert (right.verdict, wrong.verdict) == ("given", "inverse")
    assert right.inverse.share_in_view > right.given.share_in_view  # the share would be wrong


@pytest.fixture(scope="module")
def opencalib(shared_data: Path) -> MemoryRecording:
    folder = shared_data / "pjlab_opencalib/lidar2camera/auto_calib/data"
    _, imported = import_rig(sorted(folder.glob("*.json")))
    T_lidar_camera = imported.rig.extrinsics["lidar", "camera"]
    assert imported.rig.camera is not None
    table = read_pcd(folder / "calib.pcd")
    scan = scan_from_table(table, 10**9, None, in_map=False)
    rgb = cv2.cvtColor(cv2.imread(str(folder / "calib.png")), cv2.COLOR_BGR2RGB)
    return MemoryRecording(
        rig=Rig(imported.rig.camera, T_lidar_camera, np.eye(4)),
        trajectory=standing_still(),
        scans=[scan],
        image_stamps_ns=np.array([10**9]),
        images=[rgb],
    )


def test_opencalibs_extrinsics_are_imported_the_right_way_round(opencalib: MemoryRecording) -> None:
    turned = replace(opencalib.rig, T_body_camera=inverse(opencalib.rig.T_body_camera))

    right = compare_directions(opencalib)
    wrong = compare_directions(replace(opencalib, rig=turned))

    assert (right.verdict, wrong.verdict) == ("given", "inverse")
    assert right.given.contrast > 1.15  # measured: 1.26, one image
    assert right.inverse.contrast < 1.0  # measured: 0.88


# --- its parts -----------------------------------------------------------------------------------


CAMERA = LensCamera(PinholeCamera(640, 480, 400.0, 400.0, 319.5, 239.5))


def box_before_wall() -> tuple[NDArray[np.uint8], NDArray[np.float64]]:
    """A dark square of 2 m at 5 m before a bright wall at 10 m, and points on both."""
    rgb = np.full((480, 640, 3), 220, dtype=np.uint8)
    rgb[160:320, 240:400] = 30  # 2 m at 5 m = 160 pixels
    u, v = np.meshgrid(np.arange(0, 640, 3.0), np.arange(0, 480, 3.0))
    on_box = (u >= 240) & (u < 400) & (v >= 160) & (v < 320)
    z = np.where(on_box, 5.0, 10.0)
    points = np.stack([(u - 319.5) * z / 400, (v - 239.5) * z / 400, z], axis=-1)
    return rgb, points.reshape(-1, 3)


def test_rims_of_a_box_lie_on_its_edges_in_the_picture() -> None:
    rgb, points = box_before_wall()

    samples = sample_edges(edge_picture(rgb, CAMERA), points, np.eye(4))

    assert samples.points == samples.in_view == len(points)
    # Four sides of 40 cells; corners count for both directions.
    assert 150 < len(samples.at_rims) < 340
    assert samples.at_rims.mean() > 5


@pytest.mark.parametrize("shift_m", [(1.0, 0.0), (0.0, 1.0)])
def test_rims_beside_the_edges_find_none(shift_m: tuple[float, float]) -> None:
    rgb, points = box_before_wall()
    T = transform_from(np.eye(3), [*shift_m, 0.0])

    aligned = sample_edges(edge_picture(rgb, CAMERA), points, np.eye(4)).at_rims.mean()
    shifted = sample_edges(edge_picture(rgb, CAMERA), points, T).at_rims.mean()

    assert shifted < 0.7 * aligned


def test_what_lies_behind_the_camera_is_not_in_view() -> None:
    rgb, points = box_before_wall()
    samples = sample_edges(edge_picture(rgb, CAMERA), -points, np.eye(4))
    assert (samples.in_view, len(samples.at_rims)) == (0, 0)


def test_an_even_picture_tells_nothing() -> None:
    _, points = box_before_wall()
    grey = np.full((480, 640, 3), 128, dtype=np.uint8)
    recording = memory(grey, points)
    report = compare_directions(recording)
    assert report.verdict == "undecided"
    assert "do not tell" in report.to_text()


def memory(
    rgb: NDArray[np.uint8], points: NDArray[np.float64], *, at_ns: int = 10**9
) -> MemoryRecording:
    return MemoryRecording(
        rig=Rig(CAMERA, np.eye(4), np.eye(4)),
        trajectory=standing_still(),
        scans=[LidarScan(at_ns, points)],
        image_stamps_ns=np.array([10**9]),
        images=[rgb],
    )


def test_an_identity_is_its_own_inverse() -> None:
    assert compare_directions(memory(*box_before_wall())).verdict == "undecided"


def test_clouds_in_the_map_are_brought_back() -> None:
    rgb, points = box_before_wall()
    T_map_body = transform_from(np.eye(3), [100.0, 50.0, 2.0])
    recording = memory(rgb, points)
    trajectory = replace(
        recording.trajectory, translations_m=recording.trajectory.translations_m + T_map_body[:3, 3]
    )
    in_map = LidarScan(10**9, transform_points(T_map_body, points), in_map=True)

    moved = compare_directions(replace(recording, trajectory=trajectory, scans=[in_map]))

    assert moved.given.share_in_view == 1.0
    assert moved.given.contrast == pytest.approx(compare_directions(recording).given.contrast)


@pytest.mark.parametrize("what", ["no image", "no scan near"])
def test_nothing_to_look_at_is_an_error(what: str) -> None:
    recording = memory(*box_before_wall(), at_ns=10**9 if what == "no image" else 2 * 10**9)
    if what == "no image":
        recording = replace(recording, images=[None])
    with pytest.raises(
        RecordingError, match="no image of 1 can be decoded and has points"
    ) as caught:
        compare_directions(recording)
    assert "inspect-recording" in caught.value.fix


def test_few_rims_say_so() -> None:
    assert "too few depth jumps among them (7)" in Evidence(0.5, 7, 1.0, 0.0).in_words


# --- the command ---------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def scan(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("scan") / "scan.mcap"
    assert (
        main(
            [
                "simulate",
                str(path),
                "--seconds",
                "2",
                "--image-rate-hz",
                "2",
                "--image-scale",
                "0.25",
            ]
        )
        == 0
    )
    return path


def test_the_command_gives_0_for_the_right_rig(
    scan: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["rig", "check", str(scan)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("as given: the camera sits at x 0.021, y 0.034, z 0.093 m of the LiDAR")
    assert out.endswith("the given direction explains 4 images better\n")


def test_the_command_gives_1_for_an_inverted_rig(
    scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    rig = open_recording(scan).rig
    from civil_rgbd.domain.rig import RigFile

    inverted = RigFile(extrinsics={("lidar", "camera"): inverse(rig.T_lidar_camera)})
    (tmp_path / "rig.toml").write_text(rig_to_text(inverted), encoding="utf-8")

    command = ["rig", "check", str(scan), "--rig", str(tmp_path / "rig.toml")]
    assert main(command) == 1
    assert "warning: rig-inverted: the inverse explains 4 images better" in capsys.readouterr().out
    assert main([*command, "--json"]) == 1
    document = json.loads(capsys.readouterr().out)
    assert (document["verdict"], document["misses"]) == ("inverse", True)


def test_a_recording_without_poses_can_be_checked(
    scan: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    without = tmp_path / "no_poses.mcap"
    with scan.open("rb") as file, without.open("wb") as out:
        writer, channels = Writer(out), {}
        writer.start("ros2", "tests")
        for schema, channel, message in make_reader(file).iter_messages():
            if channel.topic == "/odometry" or schema is None:
                continue
            if channel.id not in channels:
                known = writer.register_schema(schema.name, schema.encoding, schema.data)
                channels[channel.id] = writer.register_channel(
                    channel.topic, channel.message_encoding, known
                )
            writer.add_message(
                channels[channel.id], message.log_time, message.data, message.publish_time
            )
        writer.finish()

    assert main(["inspect-recording", str(without)]) == 1
    assert main(["rig", "check", str(without)]) == 0
    assert capsys.readouterr().out.endswith("the given direction explains 4 images better\n")
