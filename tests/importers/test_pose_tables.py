"""Poses are read from the layouts that people keep them in; an order is never guessed."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from civil_rgbd.errors import RecordingError
from civil_rgbd.importers.pose_tables import read_pose_table

T = np.eye(4)
T[:3, :3] = Rotation.from_euler("xyz", [0.3, -0.5, 1.1]).as_matrix()
T[:3, 3] = [1.5, -2.25, 3.125]
X, Y, Z, W = (float(value) for value in Rotation.from_matrix(T[:3, :3]).as_quat())
P = "1.5 -2.25 3.125"
ROW12 = " ".join(repr(float(value)) for value in T[:3].ravel())
COMMAS = P.replace(" ", ",")
EUROC = (
    "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], "
    f"q_RS_z []\n7,{COMMAS},{W},{X},{Y},{Z}"
)
ROW16 = " ".join(repr(float(value)) for value in T.ravel())


@pytest.mark.parametrize(
    ("name", "text", "keys"),
    [
        ("a.txt", f"{P} {X} {Y} {Z} {W}", None),
        ("a.csv", f"7,{COMMAS},{X},{Y},{Z},{W}\r\n", ("7",)),
        (
            "a.csv",
            f"\ufeffid,tx,ty,tz,qw,qx,qy,qz\n7,{COMMAS},{W},{X},{Y},{Z}",
            ("7",),
        ),
        ("a.csv", f"x,y,z,qx,qy,qz,qw\n{COMMAS},{X},{Y},{Z},{W}", None),
        ("a.csv", EUROC, ("7",)),
        ("a.txt", f"# a remark\n0.25 {P} {X} {Y} {Z} {W}", ("0.25",)),
        ("a.txt", ROW12, None),
        ("a.txt", f"rgb/7.png {ROW16}", ("rgb/7.png",)),
        ("a.txt", ROW16, None),
        ("a.log", "0 0 1\n" + "\n".join(" ".join(map(repr, row)) for row in T.tolist()), ("0",)),
        ("a.json", json.dumps({"7": T.tolist()}), ("7",)),
        ("a.json", json.dumps([T.tolist()]), None),
        (
            "a.json",
            json.dumps(
                {
                    "frames": [
                        {
                            "frame_id": "000007",
                            "T_map_camera": {
                                "translation_m": [1.5, -2.25, 3.125],
                                "quaternion_xyzw": [X, Y, Z, W],
                            },
                        }
                    ]
                }
            ),
            ("000007",),
        ),
    ],
)
def test_every_layout_gives_the_same_pose(
    name: str, text: str, keys: tuple[str, ...] | None, tmp_path: Path
) -> None:
    (tmp_path / name).write_text(text, encoding="utf-8")

    table = read_pose_table(tmp_path / name)

    assert table.keys == keys
    assert table.transforms == pytest.approx(T[None], abs=1e-12)


def test_a_folder_of_matrices_is_read_by_name(tmp_path: Path) -> None:
    np.savetxt(tmp_path / "frame-000010.pose.txt", T, fmt="%.6f")
    np.savetxt(tmp_path / "frame-000002.pose.txt", np.full((4, 4), -np.inf))

    table = read_pose_table(tmp_path)

    assert np.isnan(table.transforms[0]).all()
    assert table.transforms[1] == pytest.approx(T, abs=1e-6)
    R = table.transforms[1, :3, :3]
    assert np.abs(R @ R.T - np.eye(3)).max() < 1e-15


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "holds no row"),
        ("1 2 3", "row 1 has 3 columns"),
        (f"{P} {X} {Y} {Z} {2 * W + 1}", "norm"),
        (f"{P} a b c d", "row 1 is"),
        (f"{P} {X} {Y} {Z} {W}\n{ROW12}", "row 2 is"),
        (" ".join(["2"] * 12), "no rigid transform"),
        (ROW12.replace(ROW12.split()[0], "9", 1), "no rigid transform"),
    ],
)
def test_what_is_no_pose_is_refused_with_the_file(text: str, said: str, tmp_path: Path) -> None:
    (tmp_path / "poses.txt").write_text(text)

    with pytest.raises(RecordingError, match=said) as caught:
        read_pose_table(tmp_path / "poses.txt")

    assert caught.value.where == str(tmp_path / "poses.txt")
    assert "--poses" in caught.value.fix
