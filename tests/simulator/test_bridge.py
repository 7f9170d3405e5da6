"""The bridge has the dimensions that it says it has: measured by rays."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.simulator.bridge import GirderBridge, caster_of, scene_of
from civil_rgbd.simulator.scene import SKY, Scene
from civil_rgbd.simulator.texture import MATERIALS


def _distance(origin: tuple[float, ...], direction: tuple[float, ...]) -> tuple[float, str]:
    distances, triangles = caster_of("demo").distances(
        np.array([origin], dtype=np.float64), np.array([direction], dtype=np.float64)
    )
    scene = scene_of("demo")
    part = "sky" if triangles[0] == SKY else scene.faces[scene.face_of_triangle[triangles[0]]].part
    return float(distances[0]), part


@pytest.mark.parametrize(
    ("origin", "direction", "distance_m", "part"),
    [
        ((0.0, -6.0, 0.9), (0, 0, 1), 5.0, "deck"),  # soffit at 4.9 + 0.1 + 0.9 = 5.9
        ((1.15, -6.0, 0.9), (0, 0, 1), 4.1, "girder"),  # underside at 5.0
        ((0.0, -4.0, 1.5), (0, -1, 0), 5.0, "abutment"),  # front at y = -9
        ((0.0, -4.0, 1.5), (0, 0, -1), 1.5, "road"),
        ((0.0, -7.0, 1.5), (0, 0, -1), 1.35, "sidewalk"),  # kerb 0.15
        ((-20.0, -4.0, 1.5), (0, 0, 1), 0.0, "sky"),
        ((-20.0, -4.0, 6.5), (1, 0, 0), 15.5, "parapet"),  # edge at x = -4.5
        ((-10.0, -4.0, 1.0), (0, -1, 0), 5.6, "wing"),  # 0.6 behind the abutment's front
    ],
)
def test_a_ray_measures_what_the_drawing_says(
    origin: tuple[float, ...], direction: tuple[float, ...], distance_m: float, part: str
) -> None:
    distance, found = _distance(origin, direction)

    assert found == part
    assert distance == pytest.approx(distance_m, abs=1e-12)


def test_an_octagonal_column_presents_a_flat_face_to_each_axis() -> None:
    distance, part = _distance((-3.0, -4.0, 1.5), (0, 1, 0))

    assert part == "pier"
    assert distance == pytest.approx(4.0 - 0.45 * np.cos(np.pi / 8), abs=1e-12)


def test_every_closed_part_points_outside() -> None:
    scene = scene_of("demo")
    for part in {face.part for face in scene.faces} - {"road", "grass"}:
        faces = tuple(face for face in scene.faces if face.part == part)
        assert Scene(part, faces).mesh().volume > 0, part


def test_the_dimensions_are_told_in_metres_by_name() -> None:
    dimensions = scene_of("demo").dimensions_m

    assert dimensions["deck_soffit_z_m"] == pytest.approx(5.9)
    assert dimensions["girder_soffit_z_m"] == pytest.approx(5.0)
    assert dimensions["abutment_y_m"] == GirderBridge().abutment_y_m


def test_every_face_is_plane_and_of_a_known_material() -> None:
    for face in scene_of("demo").faces:
        off_plane = (face.corners_m - face.corners_m[0]) @ face.normal
        assert np.abs(off_plane).max() < 1e-12
        assert face.material in MATERIALS
