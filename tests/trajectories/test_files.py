"""Trajectory files: every format, told by content; and everything that may be wrong with one."""

from __future__ import annotations

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from civil_rgbd.errors import CivilRgbdError, RecordingError, UsageError
from civil_rgbd.geometry.trajectory import Trajectory
from civil_rgbd.trajectories.files import FORMATS, read_trajectory, read_trajectory_file

START_NS = 1_700_000_000_000_000_000
COUNT = 20
STAMPS = [START_NS + at * 100_000_000 for at in range(COUNT)]
PLACES = np.stack([np.linspace(0, 1, COUNT), np.linspace(0, 0.5, COUNT), np.full(COUNT, 1.4)], 1)
TURNS = Rotation.from_rotvec(np.stack([np.linspace(0, 0.6, COUNT)] * 3, 1) * [0.2, 0.5, 1.0])


def seconds(ns: int) -> str:
    return f"{ns // 10**9}.{ns % 10**9:09d}"


def tum(stamps: list[int] = STAMPS) -> str:
    rows = np.concatenate([PLACES, TURNS.as_quat()], axis=1)
    return "# timestamp tx ty tz qx qy qz qw\n" + "".join(
        f"{seconds(ns)} {' '.join(map(repr, row))}\n"
        for ns, row in zip(stamps, rows.tolist(), strict=False)
    )


def kitti() -> str:
    rows = np.concatenate([TURNS.as_matrix(), PLACES[:, :, None]], axis=2).reshape(-1, 12)
    return "".join(" ".join(f"{v:.12e}" for v in row) + "\n" for row in rows)


def lab(first: int = 1) -> str:
    rows = np.concatenate([PLACES, TURNS.as_quat()], axis=1).tolist()
    return "".join(f"{at + first},{','.join(map(repr, row))}\n" for at, row in enumerate(rows))


def r3live() -> str:
    """CRLF, a space before it, six decimals, time since the first IMU message."""
    lines = []
    for at in range(COUNT):
        numbers = [at / 10, *TURNS[at].as_rotvec(), *PLACES[at], *np.zeros(60)]
        lines.append(" ".join(f"{value:.6f}" for value in numbers) + " \r\n")
    return "".join(lines)


def euroc(extra: int = 0) -> str:
    head = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], "
    head += "q_RS_y [], q_RS_z []\n"
    q = TURNS.as_quat()[:, [3, 0, 1, 2]]
    rows = np.concatenate([PLACES, q, np.zeros((COUNT, extra))], axis=1).tolist()
    return head + "".join(
        f"{ns},{','.join(map(repr, row))}\n" for ns, row in zip(STAMPS, rows, strict=True)
    )


def colmap(scale: float = 1.0) -> str:
    """Camera from world, in an order of its own; one image has no points, names have folders."""
    lines = ["# Image list with two lines of data per image:", "#   IMAGE_ID, QW, QX, QY, QZ, ..."]
    for at in reversed(range(COUNT)):
        R = TURNS[at].inv()
        qx, qy, qz, qw = (-R.as_quat()).tolist()  # either sign is the same rotation
        t = -R.apply(PLACES[at] / scale)
        pose = " ".join(map(repr, [qw, qx, qy, qz, *t.tolist()]))
        lines += [f"{at + 7} {pose} 1 cam 0/{at + 1}.png", "" if at == 3 else "1.5 2.5 -1 3 4 5"]
    return "\n".join(lines) + "\n"


def times(*, names: bool = False) -> str:
    return "".join(
        (f"{at + 1}.png," if names else "") + seconds(ns) + "\n" for at, ns in enumerate(STAMPS)
    )


def written(folder: Path, text: str, name: str = "poses.txt") -> Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


def assert_is_the_walk(found: Trajectory, digits: float = 1e-9) -> None:
    assert found.stamps_ns.tolist() == STAMPS
    np.testing.assert_allclose(found.translations_m, PLACES, atol=digits)
    expected = TURNS.as_quat(canonical=True)
    np.testing.assert_allclose(found.quaternions_xyzw, expected, atol=digits)


class TestFormats:
    @pytest.mark.parametrize(
        ("text", "name", "body", "options"),
        [
            (tum(), "tum", None, {}),
            (kitti(), "kitti", None, {"times": times()}),
            (lab(), "lab", "camera", {"times": times()}),
            (lab(first=0), "lab", "camera", {"times": times()}),
            (euroc(), "euroc", None, {}),
            (euroc(extra=9), "euroc", None, {}),
            (colmap(), "colmap", "camera", {"times": times(names=True), "metric_scale": 1.0}),
            (colmap(0.25), "colmap", "camera", {"times": times(names=True), "metric_scale": 0.25}),
        ],
    )
    def test_each_gives_the_same_poses_and_is_told_by_its_content(
        self, tmp_path: Path, text: str, name: str, body: str | None, options: dict[str, object]
    ) -> None:
        path = written(tmp_path, text)
        if "times" in options:
            options = {**options, "times_path": written(tmp_path, str(options["times"]), "t.txt")}
            del options["times"]
        found = read_trajectory_file(path, **options)  # type: ignore[arg-type]  # by name
        assert (found.format, found.body) == (name, body)
        assert_is_the_walk(found.trajectory)
        assert found.sources[0].converter == f"trajectory-{name}"
        assert len(found.sources) == 1 + len(options.keys() & {"times_path"})
        given = read_trajectory_file(path, format=name, **options)  # type: ignore[arg-type]  # same
        assert given.trajectory.stamps_ns.tolist() == STAMPS

    @pytest.mark.parametrize(
        ("comments", "body"),
        [
            ("# engine 1: poses of the imu in its map (T_map_imu)\n", "imu"),
            ("# (T_map_lidar)\n# T_map_lidar, once more\n", "lidar"),
            ("# T_map_imu\n# T_map_lidar\n", None),  # two are none
            ("# T_map_imus and T_map_body\n", None),
        ],
    )
    def test_a_heading_says_whose_poses_they_are(
        self, tmp_path: Path, comments: str, body: str | None
    ) -> None:
        assert read_trajectory_file(written(tmp_path, comments + tum())).body == body

    def test_a_comment_below_the_poses_says_nothing_of_them(self, tmp_path: Path) -> None:
        assert read_trajectory_file(written(tmp_path, tum() + "# T_map_imu\n")).body is None

    def test_r3live_counts_from_its_first_imu_message(self, tmp_path: Path) -> None:
        path = written(tmp_path, r3live(), "lic_lio.log")
        found = read_trajectory_file(path, time_offset_ns=START_NS)
        assert (found.format, found.body) == ("r3live", "imu")
        assert_is_the_walk(found.trajectory, digits=2e-6)
        assert "its stamps moved by +1700000000.000000000 s" in found.note

    def test_an_id_of_the_lab_is_a_line_of_the_list(self, tmp_path: Path) -> None:
        sparse = "".join(line + "\n" for line in lab().splitlines()[4::5])
        path, beside = written(tmp_path, sparse), written(tmp_path, times(), "t.txt")
        assert read_trajectory(path, times_path=beside).stamps_ns.tolist() == STAMPS[4::5]

    def test_images_of_a_folder_name_the_stamps_of_colmap(self, tmp_path: Path) -> None:
        images = tmp_path / "images"
        images.mkdir()
        for at in range(COUNT):
            (images / f"{at + 1}.png").touch()
        beside = written(images, times(), "timestamps.txt")
        found = read_trajectory(
            written(tmp_path, colmap()), image_times=beside, images=images, metric_scale=1.0
        )
        assert_is_the_walk(found)
        (images / "21.png").touch()
        with pytest.raises(RecordingError, match="21 images, but 20 stamps"):
            read_trajectory(
                tmp_path / "poses.txt", times_path=beside, images=images, metric_scale=1.0
            )

    def test_a_scale_makes_metres_of_any_format(self, tmp_path: Path) -> None:
        found = read_trajectory(written(tmp_path, tum()), metric_scale=2.5)
        np.testing.assert_allclose(found.translations_m, PLACES * 2.5)

    def test_import_needs_no_numba(self) -> None:
        code = "import sys, civil_rgbd.trajectories.files; assert 'numba' not in sys.modules"
        subprocess.run([sys.executable, "-c", code], check=True)


class TestWhatIsAskedFor:
    @pytest.mark.parametrize("text", [kitti(), lab()])
    def test_poses_without_stamps_need_a_list(self, tmp_path: Path, text: str) -> None:
        with pytest.raises(UsageError, match="no stamps") as caught:
            read_trajectory(written(tmp_path, text))
        assert "--trajectory-times" in caught.value.fix

    @pytest.mark.parametrize("more", [{}, {"metric_scale": 1.0}, {"times": True}])
    def test_colmap_needs_stamps_and_scale(self, tmp_path: Path, more: dict[str, object]) -> None:
        if more.pop("times", False):
            more["times_path"] = written(tmp_path, times(names=True), "t.txt")
        with pytest.raises(UsageError, match="no stamps and no scale") as caught:
            read_trajectory(written(tmp_path, colmap()), **more)  # type: ignore[arg-type]  # by name
        assert "--image-times" in caught.value.fix
        assert "--metric-scale" in caught.value.fix

    def test_times_of_images_are_not_taken_for_those_of_scans(self, tmp_path: Path) -> None:
        beside = written(tmp_path, times(), "t.txt")
        with pytest.raises(UsageError, match="no stamps"):
            read_trajectory(written(tmp_path, kitti()), image_times=beside)

    @pytest.mark.parametrize(
        "text",
        [
            "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n",  # ids or seconds?
            "1.5,0,0,0,0,0,0,1\n",  # no format has commas and seconds
            "1 2 3\n4 5 6\n",
            "-0.2 0.1 0.3 0.0 0.0 0.0 1.0\n",
        ],
    )
    def test_a_format_that_is_not_clear_is_asked_for(self, tmp_path: Path, text: str) -> None:
        with pytest.raises(UsageError, match="format is not clear: line 1 has") as caught:
            read_trajectory(written(tmp_path, text))
        assert all(name in caught.value.fix for name in FORMATS)

    def test_a_named_format_is_believed(self, tmp_path: Path) -> None:
        path = written(tmp_path, "1 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n")
        assert read_trajectory(path, format="tum").stamps_ns.tolist() == [10**9, 2 * 10**9]
        with pytest.raises(UsageError, match="no trajectory format") as caught:
            read_trajectory(path, format="tumm")
        assert "did you mean 'tum'" in caught.value.fix

    @pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
    def test_a_scale_is_a_positive_number(self, tmp_path: Path, scale: float) -> None:
        with pytest.raises(UsageError, match="--metric-scale is"):
            read_trajectory(written(tmp_path, tum()), metric_scale=scale)


def edited(line: int, edit: Callable[[str], str]) -> str:
    lines = tum().splitlines()
    lines[line - 1] = edit(lines[line - 1])
    return "\n".join(lines) + "\n"


class TestBadInput:
    @pytest.mark.parametrize(
        ("text", "words"),
        [
            ("", "holds no pose"),
            ("# only a comment\n", "holds no pose"),
            (edited(5, lambda s: s.rsplit(" ", 1)[0]), "line 5 has 7 columns, not 8"),
            (edited(5, lambda s: s + " 1"), "line 5 has 9 columns, not 8"),
            (edited(5, lambda s: s.rsplit(" ", 1)[0] + " 0.x"), "line 5 .*no number"),
            (edited(5, lambda s: s.rsplit(" ", 1)[0] + " nan"), "line 5 .*not finite"),
            (edited(5, lambda s: s.rsplit(" ", 1)[0] + " 0.2"), "line 5 has a quaternion of norm"),
            (edited(5, lambda s: s.replace("1700000000.3", "1700000000.2")), "same as line 4"),
            (edited(5, lambda s: s.replace("1700000000.3", "1700000000.1")), "earlier than line 4"),
            (edited(5, lambda s: s.replace("1700000000.", "1700000000")), "line 5 has no stamp"),
            (tum().replace(".", "", 1).replace("1700000000.", "1700000000"), "no stamp in seconds"),
            (tum().replace("tx ty tz qx qy qz qw", "tx ty tz qw qx qy qz"), "order wxyz"),
            ("\0\1\2\xff", "format is not clear|no pose"),
        ],
    )
    def test_it_is_refused_with_the_line(self, tmp_path: Path, text: str, words: str) -> None:
        with pytest.raises(CivilRgbdError, match=words) as caught:
            read_trajectory(written(tmp_path, text))
        assert "poses.txt" in caught.value.where

    def test_a_heading_of_euroc_in_another_order_is_refused(self, tmp_path: Path) -> None:
        text = euroc().replace("q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z []", "qx, qy, qz, qw")
        with pytest.raises(RecordingError, match="order xyzw, the format has wxyz"):
            read_trajectory(written(tmp_path, text))

    def test_columns_that_are_no_motion_are_refused(self, tmp_path: Path) -> None:
        millimetres = "".join(
            f"{seconds(ns)} {at * 50.0} 0 0 0 0 0 1\n" for at, ns in enumerate(STAMPS)
        )
        with pytest.raises(RecordingError, match="faster than 500 m/s") as caught:
            read_trajectory(written(tmp_path, millimetres))
        assert "--metric-scale" in caught.value.fix
        scaled = read_trajectory(tmp_path / "poses.txt", metric_scale=0.001)
        assert scaled.translations_m[1, 0] == pytest.approx(0.05)
        quaternions = Rotation.random(COUNT, random_state=1).as_quat()
        shuffled = "".join(
            f"{seconds(ns)} 0 0 0 {' '.join(map(repr, q))}\n"
            for ns, q in zip(STAMPS, quaternions.tolist(), strict=True)
        )
        with pytest.raises(RecordingError, match="rad from pose to pose"):
            read_trajectory(written(tmp_path, shuffled))

    def test_a_transform_of_kitti_that_is_not_rigid_is_refused(self, tmp_path: Path) -> None:
        lines = kitti().splitlines()
        lines[3] = " ".join(["1.1", *lines[3].split()[1:]])
        beside = written(tmp_path, times(), "t.txt")
        with pytest.raises(RecordingError, match="line 4 is no rigid transform"):
            read_trajectory(written(tmp_path, "\n".join(lines)), times_path=beside)
        with pytest.raises(RecordingError, match="21 poses, but 20 stamps"):
            read_trajectory(written(tmp_path, kitti() + kitti()[:215]), times_path=beside)

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            (lab(first=2), "has the id 21, but the list has 20 stamps"),
            (lab().replace("3,", "x,", 1), "no number|format|id"),
            (lab().replace("\n5,", "\n5.5,", 1), "line 5 does not begin with an id"),
            (lab().replace("\n5,", "\n4,", 1), "the same as line 4"),
        ],
    )
    def test_ids_of_the_lab_are_checked(self, tmp_path: Path, text: str, words: str) -> None:
        beside = written(tmp_path, times(), "t.txt")
        with pytest.raises(RecordingError, match=words):
            read_trajectory(written(tmp_path, text), times_path=beside)

    @pytest.mark.parametrize(
        ("text", "words"),
        [
            (colmap().replace("cam 0/5.png", "cam 0/x.png"), "no stamp for the image 'x.png'"),
            (colmap().replace("cam 0/5.png", "cam 0/6.png"), "the same as line"),
            (colmap().replace(" 1 cam 0/5.png", ""), "has 8 columns"),
        ],
    )
    def test_images_of_colmap_are_checked(self, tmp_path: Path, text: str, words: str) -> None:
        beside = written(tmp_path, times(names=True), "t.txt")
        with pytest.raises(RecordingError, match=words):
            read_trajectory(written(tmp_path, text), times_path=beside, metric_scale=1.0)

    @settings(suppress_health_check=[HealthCheck.function_scoped_fixture])
    @given(
        which=st.sampled_from([tum(), kitti(), lab(), r3live(), euroc(), colmap()]),
        at=st.floats(0, 1),
        junk=st.binary(min_size=1, max_size=12),
        cut=st.booleans(),
    )
    def test_damage_leads_to_our_own_errors_only(
        self, tmp_path: Path, which: str, at: float, junk: bytes, *, cut: bool
    ) -> None:
        data = which.encode()
        place = int(at * len(data))
        path = tmp_path / "damaged"
        path.write_bytes(data[:place] + junk + (b"" if cut else data[place + len(junk) :]))
        beside = written(tmp_path, times(names=True), "t.txt")
        try:
            found = read_trajectory(path, times_path=beside, metric_scale=1.0)
        except CivilRgbdError:
            return
        assert np.isfinite(found.translations_m).all()
