"""Every message that a user can meet on the way from a recording to a bridge, word for word.

``CIVIL_RGBD_REGENERATE=1 pytest tests/test_error_messages.py`` writes the file anew: review its
diff as you would review the messages in the code.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.cli import main

from .conversion import containers, lvx_writer, messages, scene
from .conversion.test_scan_folder import folder_of_scans
from .trajectories import calibrations

GOLDEN = Path(__file__).parent / "data/error_messages.json"
RIG = """
[camera]
width_px = 64
height_px = 48
fx_px = 50.0
fy_px = 50.0
cx_px = 32.0
cy_px = 24.0
"""

Case = Callable[[Path], list[str]]


def _built(folder: Path, parts: dict[str, list[scene.Message]], *extra: str) -> list[str]:
    file = scene.write(folder / "scan.mcap", parts)
    return ["build", "--out", str(folder / "out"), *extra, str(file)]


def _without(part: str) -> Case:
    def case(folder: Path) -> list[str]:
        parts = scene.whole()
        del parts[part]
        return _built(folder, parts)

    return case


def _with(**parts: Callable[[], list[scene.Message]]) -> Case:
    return lambda folder: _built(folder, scene.whole() | {k: make() for k, make in parts.items()})


def _no_such_file(folder: Path) -> list[str]:
    return ["build", "--out", str(folder / "out"), str(folder / "park_street.mcap")]


def _not_an_mcap(folder: Path) -> list[str]:
    (folder / "scan.mcap").write_text("a shopping list")
    return ["build", "--out", str(folder / "out"), str(folder / "scan.mcap")]


def _unknown_container(folder: Path) -> list[str]:
    (folder / "scan.rosbag").write_text("")
    return ["build", "--out", str(folder / "out"), str(folder / "scan.rosbag")]


def _truncated(folder: Path) -> list[str]:
    file = scene.write(folder / "scan.mcap", scene.whole())
    file.write_bytes(file.read_bytes()[: file.stat().st_size // 2])
    return ["build", "--out", str(folder / "out"), str(file)]


def _bag(content: Callable[[bytes], bytes]) -> Case:
    def case(folder: Path) -> list[str]:
        whole = containers.bag_by_hand(scene.flat(scene.whole()), compression="lz4")
        (folder / "scan.bag").write_bytes(content(whole))
        return ["build", "--out", str(folder / "out"), str(folder / "scan.bag")]

    return case


def _folder_of(**files: str) -> Case:
    def case(folder: Path) -> list[str]:
        (folder / "scan").mkdir()
        for name, text in files.items():
            (folder / "scan" / name.replace("__", ".")).write_text(text)
        return ["build", "--out", str(folder / "out"), str(folder / "scan")]

    return case


def _the_same_file_twice(folder: Path) -> list[str]:
    command = _built(folder, scene.whole())
    return [*command, command[-1]]


def _camera_info(**what: object) -> Case:
    return _with(infos=lambda: scene.infos(**what))


def _distortion_left_in(folder: Path) -> list[str]:
    parts = scene.whole() | {"infos": scene.infos(d=(0.1, 0.0, 0.0, 0.0, 0.0))}
    return _built(folder, parts, "--set", "image.undistort=false")


def _two_lidars() -> list[scene.Message]:
    return scene.scans() + scene.scans("/rear/lidar")


def _stamps_near_zero() -> list[scene.Message]:
    return [
        scene.Message(
            scene.LIDAR,
            "livox_ros_driver2/msg/CustomMsg",
            scene.stamp(i),
            messages.custom_msg(i * scene.STEP_NS, [(0, 5.0, 0.0, 0.0, 9, 0, 0)], frame="lidar"),
        )
        for i in range(scene.SCANS)
    ]


def _nothing_finite() -> list[scene.Message]:
    cloud = np.full((30, 3), np.nan, dtype=np.float32)
    return [
        message._replace(payload=messages.xyz_cloud(scene.stamp(i), cloud))
        for i, message in enumerate(scene.scans())
    ]


def _poses_that_end_early() -> list[scene.Message]:
    return [
        message._replace(payload=messages.odometry(scene.stamp(0) - 3 + i, child="lidar"))
        for i, message in enumerate(scene.poses()[:3])
    ]


def _wall_before_the_camera() -> list[scene.Message]:
    # scene.static() puts the camera at (1, 2, 3) m of the LiDAR, looking along its x.
    y, z = np.meshgrid(np.linspace(1, 3, 6), np.linspace(2, 4, 5))
    wall = np.stack([np.full(30, 7.0), y.ravel(), z.ravel()], axis=1).astype(np.float32)
    return [
        message._replace(payload=messages.xyz_cloud(scene.stamp(i), wall))
        for i, message in enumerate(scene.scans())
    ]


def _bridge_there(folder: Path) -> list[str]:
    parts = scene.whole() | {"scans": _wall_before_the_camera()}
    command = _built(folder, parts, "--set", "accumulate.points=30", "--workers", "1")
    assert main(command) == 0
    return [word.replace("points=30", "points=40") for word in command]


def _read_only(folder: Path) -> list[str]:
    (folder / "out").write_text("a file where the folder should be")
    return _built(folder, scene.whole())


def _rig(text: str) -> Case:
    def case(folder: Path) -> list[str]:
        (folder / "rig.toml").write_text(text)
        return _built(folder, scene.whole(), "--rig", str(folder / "rig.toml"))

    return case


def _options(*options: str) -> Case:
    return lambda folder: _built(folder, scene.whole(), *options)


def _recipe_file(text: str) -> Case:
    def case(folder: Path) -> list[str]:
        (folder / "mine.toml").write_text(text)
        return _built(folder, scene.whole(), "--recipe", str(folder / "mine.toml"))

    return case


def _registry(sha256: str = "0" * 64) -> Case:
    def case(folder: Path) -> list[str]:
        entry = {"id": "B1", "version": "1.0", "where": "https://example.org/B1.tar"}
        entry |= {"sha256": sha256, "size_bytes": 10_240, "licence": "CC-BY-4.0"}
        document = {"format_version": "1.0", "bridges": [entry]}
        (folder / "registry.json").write_text(json.dumps(document))
        listed = ["--registry", str(folder / "registry.json")]
        return ["download", "B7", "--out", str(folder / "out"), *listed]

    return case


def _poses(*options: str) -> Case:
    return lambda folder: ["poses", str(folder / "scan.bag"), *options]


def _answers(text: str) -> Case:
    def case(folder: Path) -> list[str]:
        (folder / "answers.toml").write_text(text)
        given = ["--from", str(folder / "answers.toml")]
        return ["new-bridge", "B1", "--out", str(folder / "out"), *given]

    return case


def _calibration(text: str, *options: str) -> Case:
    def case(folder: Path) -> list[str]:
        (folder / "calibration").write_text(text)
        return ["rig", "import", str(folder / "calibration"), *options]

    return case


def _trajectory(text: str, *options: str) -> Case:
    def case(folder: Path) -> list[str]:
        (folder / "poses.txt").write_text(text)
        given = ["--trajectory", str(folder / "poses.txt"), *options]
        return _built(folder, scene.whole(), *given)

    return case


def _lidar_file(name: str, data: bytes, *options: str) -> Case:
    def case(folder: Path) -> list[str]:
        (folder / name).write_bytes(data)
        return ["build", "--out", str(folder / "out"), *options, str(folder / name)]

    return case


def _broken_scan(folder: Path) -> list[str]:
    scans = folder_of_scans(folder)
    (scans / "1.pcd").write_bytes((scans / "1.pcd").read_bytes()[:-9])
    (folder / "rig.toml").unlink()
    return ["build", "--out", str(folder / "out"), "--scans-in", "lidar", str(scans)]


def _lvx(*, hole: range = range(0), back: bool = False) -> bytes:
    points = lvx_writer.cartesian(np.ones((96, 3)))
    stamps = [10**9 + at * 10**8 for at in range(4)]
    if back:
        stamps[2] = stamps[0]
    frames = [[lvx_writer.Packet(stamp, points)] for stamp in stamps]
    data = bytearray(lvx_writer.file_bytes(frames))
    data[hole.start : hole.stop] = bytes(len(hole))
    return bytes(data)


def _cut_poses(length: int | None) -> Case:
    def poses() -> list[scene.Message]:
        found = scene.poses()
        zero = messages.odometry(scene.stamp(3), (0.0,) * 7, child="lidar", frame="odom")
        payload = found[3].payload[:length] if length else zero
        found[3] = found[3]._replace(payload=payload)
        return found

    return _with(poses=poses)


_TUM = "1700000000.0 0 0 0 0 0 0 1\n1700000001.0 1 0 0 0 0 0 1\n"


CASES: dict[str, Case] = {
    "no such file": _no_such_file,
    "not an MCAP": _not_an_mcap,
    "unknown container": _unknown_container,
    "truncated in the middle": _truncated,
    "not a bag": _bag(lambda _: b"a shopping list"),
    "bag of an old version": _bag(lambda whole: whole.replace(b"V2.0", b"V1.2", 1)),
    "truncated bag": _bag(lambda whole: whole[: len(whole) // 2]),
    "bag with a flipped byte": _bag(
        lambda whole: whole[:9000] + bytes([whole[9000] ^ 1]) + whole[9001:]
    ),
    "folder that no converter opens": _folder_of(notes__txt="", photos__zip=""),
    "metadata.yaml of another storage": _folder_of(metadata__yaml="storage_identifier: rocksdb\n"),
    "metadata.yaml without its files": _folder_of(
        metadata__yaml="storage_identifier: mcap\nrelative_file_paths:\n  - scan_0.mcap\n"
    ),
    "the same file twice": _the_same_file_twice,
    "no camera model and no rig": _without("infos"),
    "no point clouds": _without("scans"),
    "no images": _without("images"),
    "no poses": _without("poses"),
    "no extrinsics": _without("tf"),
    "two LiDARs": _with(scans=_two_lidars),
    "clocks that do not overlap": _with(scans=_stamps_near_zero),
    "image size unlike CameraInfo": _camera_info(size=(1280, 720)),
    "uncalibrated camera": _camera_info(k=(0.0,) * 9),
    "unknown lens": _camera_info(model="kannala_brandt8", d=(0.1,) * 8),
    "no finite point": _with(scans=_nothing_finite),
    "ring never full": _options(),
    "nothing selected": _with(poses=_poses_that_end_early),
    "bridge of another recipe": _bridge_there,
    "output is a file": _read_only,
    "unknown recipe": _options("--recipe", "25k"),
    "unknown stage": _options("--set", "accumulat.points=1"),
    "unknown key": _options("--set", "accumulate.point=1"),
    "value out of range": _options("--set", "accumulate.min_fill=2"),
    "unknown key in a recipe file": _recipe_file("[select]\nmin_displacment_m = 0.1\n"),
    "recipe is not TOML": _recipe_file("select = ["),
    "step is no power of two": _options("--set", "depth.step_m=0.001"),
    "distortion left in": _distortion_left_in,
    "no bridge id": _options("--bridge", "Park St."),
    "unknown topic": _options("--lidar-topic", "/lidr"),
    "unusual point time": _options("--point-time", "stamp:us"),
    "unknown key in a rig": _rig(RIG + "focal_px = 3\n"),
    "rig for another camera": _rig(RIG.replace("64", "1280").replace("48", "720")),
    "licence that is none": _options("--licence", "foo bar"),
    "licence that is none, of a set": lambda folder: [
        *("convert", str(folder), "--from", "tum", "--bridge", "B1", "--out", str(folder / "out")),
        *("--licence", "foo bar"),
    ],
    "validate nothing": lambda folder: ["validate", str(folder / "missing")],
    "info of a folder that is no dataset": lambda folder: ["info", str(folder)],
    "unknown importer": lambda folder: ["convert", str(folder), "--from", "bridge_rgbd"],
    "convert a folder without images": lambda folder: [
        *("convert", str(folder), "--from", "lab", "--bridge", "B3"),
        *("--out", str(folder / "out")),
    ],
    "unknown exporter": lambda folder: [
        *("export", str(folder), "--to", "kiti", "--out", str(folder / "out")),
    ],
    "pack nothing": lambda folder: ["pack", str(folder)],
    "bridge that no registry lists": _registry(),
    "registry without a hash": _registry("later"),
    "licence that is an expression": _answers('licence = "MIT OR CC-BY-4.0"'),
    "structure that is no word of the list": _answers('[structure]\ntype = "viaduct"'),
    "date that is none": _answers('survey_dates = ["2023-02-30"]'),
    "unknown key in answers": _answers('ownr = "me"'),
    "calibration of no known format": _calibration('{"a": 1}'),
    "unknown calibration format": _calibration("0,1", "--from", "r4live"),
    "calibration without the image's size": _calibration(calibrations.DIRECT_VISUAL),
    "calibration that mirrors": _calibration("1,0,0,0\n0,1,0,0\n0,0,-1,0\n0,0,0,1\n"),
    "calibration that was not finished": _calibration(
        calibrations.DIRECT_VISUAL.replace('"T_lidar_camera"', '"init_T_lidar_camera_auto"')
    ),
    "unknown odometry engine": _poses("--engine", "genz"),
    "odometry engine that is not installed": lambda folder: _poses(
        "--environment", str(folder / "engine")
    )(folder),
    "poses under a name of something else": _poses("--out", "poses.mcap"),
    "trajectory of no clear format": _trajectory("1 0 0 0 0 0 0 1\n"),
    "trajectory with a broken line": _trajectory(_TUM + "1700000002.0 1 0 0 0 0 0\n"),
    "trajectory in nanoseconds": _trajectory(_TUM.replace(".0", "0" * 9)),
    "trajectory that goes back in time": _trajectory(_TUM + _TUM),
    "trajectory without unit quaternions": _trajectory(_TUM.replace("0 1\n", "0 2\n")),
    "trajectory of nobody": _trajectory(_TUM),
    "trajectory on another clock": _trajectory(_TUM.replace("17000", ""), "--pose-of", "lidar"),
    "KITTI poses without times": _trajectory("1 0 0 0 0 1 0 0 0 0 1 0\n"),
    "COLMAP without stamps and scale": _trajectory("1 1 0 0 0 0 0 0 1 a.png\n\n"),
    "not an LVX file": _lidar_file("scan.lvx", b"a shopping list, and a long one too"),
    "scans in nobody knows which frame": _lidar_file("scan.pcd", b""),
    "scans without a time list": _lidar_file("scan.ply", b"", "--scans-in", "lidar"),
    "one broken scan of a folder": _broken_scan,
    "LVX with a hole": _lidar_file("scan.lvx", _lvx(hole=range(1400, 1600))),
    "LVX whose clock steps back": _lidar_file("scan.lvx", _lvx(back=True)),
    "cut odometry message": _cut_poses(20),
    "pose that is none": _cut_poses(None),
    "poses that nobody judged": _options("--set", "poses.min_quality=0.5"),
    "images without a folder": _options("--image-times", "times.txt"),
    "unknown training recipe": lambda folder: [
        *("train", "bts-smal", "--data", str(folder), "--test-bridge", "B3"),
        *("--out", str(folder / "run")),
    ],
    "no key of a training recipe": lambda folder: [
        *("train", "bts-small", "--data", str(folder), "--test-bridge", "B3"),
        *("--out", str(folder / "run"), "--set", "run.stesp=3"),
    ],
    "training without frames named": lambda folder: [
        *("train", "bts-small", "--data", str(folder), "--out", str(folder / "run")),
    ],
    "score a model that is none": lambda folder: ["evaluate", "bst", "--data", str(folder)],
    "shots that are no numbers": lambda folder: [
        *("benchmark", "--data", str(folder), "--test-bridge", "B3", "--models", "bts"),
        *("--shots", "few", "--out", str(folder / "table")),
    ],
    "photos of an unknown camera": lambda folder: [
        *("predict", str(folder), "--model", "bts-small", "--out", str(folder / "depth")),
    ],
    "photos by an unknown model": lambda folder: [
        *("predict", str(folder), "--model", "bts-smal", "--focal-px", "600"),
        *("--out", str(folder / "depth")),
    ],
    "photos where there are none": lambda folder: [
        *("predict", str(folder), "--model", "bts-small", "--focal-px", "600"),
        *("--out", str(folder / "depth")),
    ],
    "inspect nothing": lambda folder: ["inspect-recording", str(folder / "missing.mcap")],
    "check nothing": lambda folder: ["check", str(folder / "missing.mcap")],
    "check by an unknown recipe": lambda folder: [
        *("check", str(folder / "missing.mcap"), "--recipe", "250"),
    ],
    "check what is not linked": lambda folder: [
        "check",
        str(scene.write(folder / "scan.mcap", scene.whole() | {"tf": []})),
    ],
    "unknown simulated bridge": lambda folder: [
        "simulate",
        "--bridge",
        "dmeo",
        str(folder / "raw.mcap"),
    ],
}


def _said(case: Case, folder: Path, capsys: pytest.CaptureFixture[str]) -> tuple[int, str]:
    arguments = case(folder)
    capsys.readouterr()
    status = main(arguments)
    said = capsys.readouterr().err
    return status, re.sub(r"\.\d+\.partial", ".PID.partial", said.replace(str(folder), "<folder>"))


@pytest.mark.parametrize("name", CASES)
def test_the_message_is_the_one_that_was_agreed(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status, said = _said(CASES[name], tmp_path, capsys)
    golden = json.loads(GOLDEN.read_text("utf-8")) if GOLDEN.exists() else {}
    if os.environ.get("CIVIL_RGBD_REGENERATE"):
        golden = {case: golden.get(case) for case in CASES} | {name: said.splitlines()}
        GOLDEN.write_text(json.dumps(golden, indent=2) + "\n", "utf-8")

    assert status == 2
    assert said.splitlines() == golden[name]
    assert "  where: " in said
    assert "  fix:   " in said
    assert "Traceback" not in said


@pytest.mark.parametrize("name", [name for name in CASES if name != "bridge of another recipe"])
def test_nothing_half_written_is_visible(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    _said(CASES[name], tmp_path, capsys)

    assert not list(tmp_path.rglob("manifest.json"))
    assert not list(tmp_path.rglob("dataset.json"))


def test_the_file_holds_no_message_of_a_case_that_is_gone() -> None:
    assert set(json.loads(GOLDEN.read_text("utf-8"))) == set(CASES)
