"""What a recording lacks, told by rules and held against what a build really says."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.writer import CompressionType

from civil_rgbd.cli import main
from civil_rgbd.converters import inspect_recording, open_recording
from civil_rgbd.domain.inspection import RecordingSummary
from civil_rgbd.domain.recording import RecordingOptions
from civil_rgbd.domain.rig import RigFile
from civil_rgbd.errors import CivilRgbdError, RecordingError
from civil_rgbd.geometry.camera import LensCamera, PinholeCamera
from civil_rgbd.health.findings import CODES, Finding
from civil_rgbd.health.inspection import findings_of
from civil_rgbd.health.inspection_report import InspectionReport

from ..conversion import messages, scene

Parts = dict[str, list[scene.Message]]
CAMERA = LensCamera(PinholeCamera(64, 48, 50.0, 50.0, 31.5, 23.5))
POWER_ON_NS = 12 * 10**9


def inspected(
    file: Path, parts: Parts, options: RecordingOptions | None = None
) -> tuple[RecordingSummary, tuple[Finding, ...]]:
    options = options or RecordingOptions()
    summary = inspect_recording(scene.write(file, parts), options)
    return summary, findings_of(summary, options)


def without(*names: str) -> Parts:
    return {name: part for name, part in scene.whole().items() if name not in names}


def whole_with(**parts: list[scene.Message]) -> Parts:
    return scene.whole() | parts


def livox_from_power_on() -> list[scene.Message]:
    points = [(0, 5.0, 0.0, 0.0, 9, 0, 0), (99_000_000, 5.0, 1.0, 0.0, 9, 0, 0)]
    return [
        scene.Message(
            scene.LIDAR,
            "livox_ros_driver2/msg/CustomMsg",
            scene.stamp(i),
            messages.custom_msg(POWER_ON_NS + i * scene.STEP_NS, points, frame="lidar"),
        )
        for i in range(scene.SCANS)
    ]


def clouds_with(*fields: tuple[str, str]) -> list[scene.Message]:
    rows = np.ones(5, dtype=list(fields))
    return [
        message._replace(payload=messages.point_cloud(scene.stamp(i), rows, frame="lidar"))
        for i, message in enumerate(scene.scans())
    ]


def stamped(kind: str) -> list[scene.Message]:
    make: dict[str, Callable[[int], bytes]] = {"PoseStamped": messages.pose_stamped}
    type_name = f"geometry_msgs/msg/{kind}"
    return [
        scene.Message("/pose", type_name, scene.stamp(i), make[kind](scene.stamp(i)))
        for i in range(scene.SCANS + 1)
    ]


def imu() -> list[scene.Message]:
    return [
        scene.Message("/imu", "sensor_msgs/msg/Imu", scene.stamp(i), messages.imu(scene.stamp(i)))
        for i in range(scene.SCANS)
    ]


def depth_images() -> list[scene.Message]:
    payload = messages.raw_image(scene.stamp(0), bytes(48 * 64 * 2), 64, 48, "16UC1", 128)
    return [scene.Message("/depth", "sensor_msgs/msg/Image", scene.stamp(0), payload)]


MISSING: dict[str, tuple[Callable[[], Parts], set[str]]] = {
    "nothing": (scene.whole, set()),
    "clouds": (lambda: without("scans"), {"no-point-clouds"}),
    "images": (lambda: without("images"), {"no-images"}),
    "only depth images": (lambda: without("images") | {"depth": depth_images()}, {"no-images"}),
    "camera model": (lambda: without("infos"), {"no-camera-model"}),
    "poses": (lambda: without("poses"), {"no-poses"}),
    "camera link": (lambda: without("tf"), {"no-camera-link"}),
    "everything": (
        lambda: {"imu": imu()},
        {"no-point-clouds", "no-images", "no-camera-model", "no-poses"},
    ),
    "camera and poses": (lambda: without("infos", "poses"), {"no-camera-model", "no-poses"}),
    "body link": (
        lambda: whole_with(poses=scene.poses(child="base")),
        {"no-camera-link", "no-lidar-link"},
    ),
    "a choice of clouds": (
        lambda: whole_with(more=scene.scans("/rear")),
        {"several-lidar-topics"},
    ),
    "a choice of images": (
        lambda: whole_with(more=scene.images("/rear/image")),
        {"several-image-topics"},
    ),
    "a choice of poses": (
        lambda: whole_with(more=scene.poses("/odom2")),
        {"several-pose-topics"},
    ),
    "a choice of camera models": (
        lambda: whole_with(infos=scene.infos("/a/camera_info"), more=scene.infos("/b/camera_info")),
        {"several-camera-info-topics"},
    ),
    "one frame of clouds": (
        lambda: whole_with(more=scene.scans(frame="other")),
        {"several-lidar-frames"},
    ),
    "one child of poses": (
        lambda: whole_with(
            more=[m._replace(log_time_ns=m.log_time_ns + 1) for m in scene.poses(child="x")]
        ),
        {"several-pose-frames"},
    ),
    "whose poses": (lambda: whole_with(poses=stamped("PoseStamped")), {"pose-of-unknown"}),
    "one clock": (lambda: whole_with(scans=livox_from_power_on()), {"clocks-apart"}),
    "the camera's size": (lambda: whole_with(images=scene.images(size=(32, 24))), {"camera-size"}),
    "a calibrated camera": (
        lambda: whole_with(infos=scene.infos(k=(0.0,) * 9)),
        {"camera-uncalibrated"},
    ),
    "a known time unit": (
        lambda: whole_with(
            scans=clouds_with(("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("stamp", "<u4"))
        ),
        {"point-time-unclear"},
    ),
}


@pytest.mark.parametrize("what", MISSING)
def test_everything_that_is_missing_is_listed_at_once(tmp_path: Path, what: str) -> None:
    parts, codes = MISSING[what]

    summary, findings = inspected(tmp_path / "scan.mcap", parts())

    errors = {finding.code for finding in findings if finding.level == "error"}
    assert errors == codes
    # A build refuses it exactly then, and says one of these things first.
    assert (summary.refusal is not None) == bool(codes)
    if codes:
        with pytest.raises(CivilRgbdError) as caught:
            open_recording(tmp_path / "scan.mcap")
        assert summary.refusal is not None
        assert (caught.value.what, caught.value.fix) == (summary.refusal.what, summary.refusal.fix)


OPTIONS: dict[str, tuple[Callable[[], Parts], RecordingOptions]] = {
    "lidar": (
        lambda: whole_with(more=scene.scans("/rear")),
        RecordingOptions(lidar_topic=scene.LIDAR),
    ),
    "image": (
        lambda: whole_with(more=scene.images("/rear/image")),
        RecordingOptions(image_topic=scene.CAMERA),
    ),
    "poses": (lambda: whole_with(more=scene.poses("/o2")), RecordingOptions(pose_topic=scene.ODOM)),
    "pose of": (
        lambda: whole_with(poses=stamped("PoseStamped")),
        RecordingOptions(pose_of="lidar"),
    ),
    "camera": (lambda: without("infos"), RecordingOptions(rig=RigFile(camera=CAMERA))),
    "extrinsics": (
        lambda: without("tf"),
        RecordingOptions(rig=RigFile(extrinsics={("lidar", "camera"): np.eye(4)})),
    ),
    "body": (
        lambda: whole_with(poses=scene.poses(child="base")),
        RecordingOptions(rig=RigFile(extrinsics={("body", "lidar"): np.eye(4)})),
    ),
    "point time": (
        MISSING["a known time unit"][0],
        RecordingOptions(point_time="none"),
    ),
    "offset": (
        lambda: whole_with(
            images=[
                m._replace(
                    payload=messages.compressed_image(scene.stamp(i) - 3600 * 10**9, scene.jpeg())
                )
                for i, m in enumerate(scene.images())
            ]
        ),
        RecordingOptions(rig=RigFile(camera_time_offset_s=3600.0)),
    ),
}


@pytest.mark.parametrize("what", OPTIONS)
def test_the_option_that_supplies_it_is_enough(tmp_path: Path, what: str) -> None:
    parts, options = OPTIONS[what]
    _, before = inspected(tmp_path / "scan.mcap", parts())
    (tmp_path / "scan.mcap").unlink()

    summary, after = inspected(tmp_path / "scan.mcap", parts(), options)

    assert any(finding.level == "error" for finding in before)
    assert not [finding for finding in after if finding.level == "error"]
    assert summary.refusal is None
    assert summary.T_lidar_camera is not None


def test_topics_say_what_they_hold(tmp_path: Path) -> None:
    summary, _ = inspected(tmp_path / "scan.mcap", whole_with(imu=imu()))
    topics = {topic.name: topic for topic in summary.topics}

    lidar = topics[scene.LIDAR]
    assert (lidar.role, lidar.messages, lidar.frames) == ("lidar", scene.SCANS, ("lidar",))
    assert lidar.cloud is not None
    assert (lidar.cloud.points, lidar.cloud.point_time) == (30, None)
    assert [name for name, _ in lidar.cloud.fields] == ["x", "y", "z"]
    assert lidar.stamped is not None
    assert lidar.stamped.rate_hz == 10.0
    image = topics[scene.CAMERA]
    assert image.image is not None
    assert (image.image.width_px, image.image.height_px) == (64, 48)
    assert image.log_minus_stamp_ns == (2, 2, 2)  # stamped 5 ns, logged 7 ns after the scan
    assert topics[scene.INFO].camera is not None
    assert topics[scene.ODOM].children == ("lidar",)
    assert topics["/imu"].stamped is not None
    assert topics["/imu"].stamped.rate_hz == 10.0
    assert summary.fixed_links == (("lidar", "camera"),)
    assert summary.messages == sum(topic.messages for topic in summary.topics)


def test_topics_that_no_build_reads_are_counted(tmp_path: Path) -> None:
    chatter = [
        scene.Message("/log", "rcl_interfaces/msg/Log", scene.stamp(i), b"") for i in range(9)
    ]

    summary, findings = inspected(tmp_path / "scan.mcap", whole_with(chatter=chatter))

    (log,) = (topic for topic in summary.topics if topic.name == "/log")
    assert (log.role, log.messages, log.type_name) == ("", 9, "rcl_interfaces/Log")
    assert [finding.code for finding in findings] == ["no-point-time"]


def test_a_gap_is_said_with_its_length_and_place(tmp_path: Path) -> None:
    scans = [message for i, message in enumerate(scene.scans()) if not 4 < i < 12]

    _, findings = inspected(tmp_path / "scan.mcap", whole_with(scans=scans))

    (gap,) = (finding for finding in findings if finding.code == "cloud-gap")
    assert gap.level == "warning"
    assert (
        "1 gap of more than three periods, the longest 0.80 s, 0.4 s after its start" in gap.message
    )


def ends(tmp_path: Path, **some: list[scene.Message]) -> list[tuple[str, str]]:
    _, findings = inspected(tmp_path / "scan.mcap", whole_with(**some))
    return [(f.code, f.message) for f in findings if f.code in {"cloud-gap", "image-gap"}]


def test_a_lidar_that_ends_or_begins_apart_from_the_images_is_said(tmp_path: Path) -> None:
    images = f"the images of {scene.CAMERA}"
    early, late = scene.scans()[:10], scene.scans()[10:]
    assert ends(tmp_path, scans=early) == [
        ("cloud-gap", f"{scene.LIDAR} ends 0.90 s before {images} do")
    ]
    assert ends(tmp_path, scans=late) == [
        ("cloud-gap", f"{scene.LIDAR} begins 1.00 s after {images} do")
    ]


def test_images_that_end_or_begin_apart_from_the_lidar_are_said(tmp_path: Path) -> None:
    images = f"the images of {scene.CAMERA}"
    early, late = scene.images()[:10], scene.images()[10:]
    assert ends(tmp_path, images=early) == [
        ("image-gap", f"{images} end 1.10 s before {scene.LIDAR} does")
    ]
    assert ends(tmp_path, images=late) == [
        ("image-gap", f"{images} begin 1.00 s after {scene.LIDAR}")
    ]


def test_sensors_that_end_within_a_period_of_each_other_are_not_remarked(tmp_path: Path) -> None:
    assert ends(tmp_path, scans=scene.scans()[1:-2]) == []


def test_stamps_that_step_back_are_counted(tmp_path: Path) -> None:
    images = scene.images()
    images[3] = images[3]._replace(payload=images[1].payload)

    _, findings = inspected(tmp_path / "scan.mcap", whole_with(images=images))

    (finding,) = (finding for finding in findings if finding.code == "stamps-backward")
    assert "1 messages are stamped earlier" in finding.message


def test_a_clock_that_counts_from_power_on_is_named(tmp_path: Path) -> None:
    summary, findings = inspected(tmp_path / "scan.mcap", whole_with(scans=livox_from_power_on()))

    (clock,) = (finding for finding in findings if finding.code == "power-on-clock")
    assert "/lidar: 12.000 to 13.900 s since power-on" in clock.message
    text = InspectionReport(summary, findings).to_text()
    assert (
        "clocks  12.000 to 13.900 s since power-on, the recorder's clock is another: /lidar" in text
    )
    assert "2023-11-14 22:13:20.000 UTC + 1.900 s: /cam/image/compressed" in text


def test_a_cut_file_says_what_is_readable(tmp_path: Path) -> None:
    path = scene.write(tmp_path / "scan.mcap", scene.whole())
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])

    summary = inspect_recording(path)
    (damage, *_) = findings_of(summary, RecordingOptions())
    salvaging = RecordingOptions(salvage=True)
    after = findings_of(inspect_recording(path, salvaging), salvaging)

    assert damage.code == "damaged"
    assert f"{summary.messages} messages over" in damage.message
    assert "--salvage" in damage.fix
    assert summary.topics
    assert "damaged" not in {finding.code for finding in after}
    assert "damage-salvaged" in {finding.code for finding in after}


def test_a_truth_that_no_rule_knows_is_still_told(tmp_path: Path) -> None:
    poses = scene.poses()
    poses[5] = poses[5]._replace(payload=poses[4].payload)  # two poses with one stamp

    summary, findings = inspected(tmp_path / "scan.mcap", whole_with(poses=poses))

    errors = [finding for finding in findings if finding.level == "error"]
    assert [finding.code for finding in errors] == ["build-refuses"]
    assert summary.refusal is not None
    assert (errors[0].message, errors[0].fix) == (summary.refusal.what, summary.refusal.fix)


def test_every_code_is_told_with_a_remedy() -> None:
    bare = {code for code, (_, fix) in CODES.items() if not fix}
    assert all(code == "build-refuses" or code.startswith("several-") for code in bare)


# --- the command -------------------------------------------------------------------------------


def test_a_whole_recording_gives_0(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scene.write(tmp_path / "scan.mcap", scene.whole())

    assert main(["inspect-recording", str(path)]) == 0
    out = capsys.readouterr().out
    assert out.startswith("scan.mcap: mcap, ")
    assert out.endswith("a build can start\n")
    assert "30 points: x y z; no point times" in out
    assert "the camera sits at x 1.000, y 2.000, z 3.000 m of the LiDAR" in out


def test_something_missing_gives_1(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scene.write(tmp_path / "scan.mcap", without("infos", "poses"))

    assert main(["inspect-recording", str(path)]) == 1
    out = capsys.readouterr().out
    assert "error: no-camera-model: no topic carries a camera model" in out
    assert "fix: give the camera in a rig file (--rig)" in out
    assert out.endswith("no build can start yet: 2 things are in its way\n")


@pytest.mark.parametrize("content", [None, b"not a recording"])
def test_what_cannot_be_read_gives_2(
    tmp_path: Path, content: bytes | None, capsys: pytest.CaptureFixture[str]
) -> None:
    if content is not None:
        (tmp_path / "scan.mcap").write_bytes(content)

    assert main(["inspect-recording", str(tmp_path / "scan.mcap")]) == 2
    captured = capsys.readouterr()
    assert captured.out == ""
    assert "fix:" in captured.err


def test_json_gives_everything(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = scene.write(tmp_path / "scan.mcap", without("poses"))

    assert main(["inspect-recording", "--json", str(path)]) == 1
    document = json.loads(capsys.readouterr().out)
    assert not document["build_can_start"]
    assert [finding["code"] for finding in document["findings"]] == ["no-poses", "no-point-time"]
    assert {topic["name"] for topic in document["topics"]} == {
        scene.LIDAR,
        scene.CAMERA,
        scene.INFO,
        "/tf_static",
    }


def test_ninety_topics_stay_on_one_screen(
    shared_data: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bag = shared_data / "rosbags_rs/tests/test_bags/test_bag_mcap/test_bag_mcap.mcap"

    assert main(["inspect-recording", str(bag)]) == 1
    out = capsys.readouterr().out
    assert "188 messages in 94 topics" in out
    assert "... and 81 more" in out
    assert len(out.splitlines()) <= 40


def test_the_real_drive_can_be_built(shared_data: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drive = shared_data / "kitti_bridge_drive" / "kitti_20frames.mcap"

    assert main(["inspect-recording", str(drive)]) == 0
    out = capsys.readouterr().out
    assert "114278 points: x y z intensity; no point times" in out
    assert "png 1242x375" in out
    assert "looks along its +x (0.6 deg off)" in out


def test_old_schema_names_are_understood(shared_data: Path) -> None:
    summary = inspect_recording(shared_data / "amber_mcap" / "soccer_goal_12.mcap")

    (topic,) = summary.topics
    assert (topic.type_name, topic.role, topic.messages) == ("sensor_msgs/Image", "image", 2)
    assert topic.image is not None
    assert (topic.image.encoding, topic.image.width_px) == ("rgb8", 640)


def test_a_recording_that_cannot_be_inspected_says_so() -> None:
    from civil_rgbd.errors import UsageError

    with pytest.raises(UsageError, match="cannot inspect") as caught:
        inspect_recording("simulated:demo")
    assert "start the build" in caught.value.fix
    with pytest.raises(RecordingError, match="no such recording"):
        inspect_recording("nowhere.mcap")


def test_a_document_holds_no_numpy(tmp_path: Path) -> None:
    summary, findings = inspected(tmp_path / "scan.mcap", scene.whole())
    again = replace(summary, warnings=("x",))
    assert json.loads(json.dumps(InspectionReport(again, findings).to_document()))


def test_a_trajectory_file_stands_in_for_poses(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = scene.write(tmp_path / "scan.mcap", without("poses"))
    rows = [
        f"{scene.stamp(i) // 10**9}.{scene.stamp(i) % 10**9:09d} {0.1 * i} 0 0 0 0 0 1"
        for i in range(21)
    ]
    (tmp_path / "poses.tum").write_text("\n".join(rows) + "\n")
    command = ["inspect-recording", str(path), "--trajectory", str(tmp_path / "poses.tum")]

    assert main(command) == 1
    assert "error: pose-of-unknown: the trajectory file does not say" in capsys.readouterr().out
    assert main([*command, "--pose-of", "lidar"]) == 0
    assert capsys.readouterr().out.endswith("a build can start\n")


def test_a_simulated_recording_is_opened_to_be_inspected(
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["inspect-recording", "simulated:demo?seconds=1&image_scale=0.1"]) == 0
    out = capsys.readouterr().out
    assert "24000 points: x y z; times: each point has its own" in out
    assert "image 128x72" in out


@settings(max_examples=60)
@given(data=st.data())
def test_damage_of_any_kind_is_inspected_or_refused_clearly(
    tmp_path_factory: pytest.TempPathFactory, data: st.DataObject
) -> None:
    path = tmp_path_factory.mktemp("fuzz") / "scan.mcap"
    whole = scene.write(path, scene.whole(), crcs=False, compression=CompressionType.NONE)
    content = bytearray(whole.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(8, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(len(content) // 2, len(content)))])

    with suppress(CivilRgbdError):
        options = RecordingOptions(salvage=data.draw(st.booleans()))
        summary = inspect_recording(path, options)
        findings = findings_of(summary, options)
        assert InspectionReport(summary, findings).to_text()
        errors = any(finding.level == "error" for finding in findings)
        assert errors == (summary.refusal is not None)
