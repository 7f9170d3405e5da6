"""Rays against distances by hand."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.simulator.scene import SKY, RayCaster, Scene, box, polygon, prism


def _caster() -> RayCaster:
    return RayCaster(Scene("test", tuple(box("b", "wall", (1.1, -1, -1), (2.3, 1, 1)))))


def test_a_ray_meets_the_near_side_of_a_box_at_the_exact_distance() -> None:
    distances, triangles = _caster().distances(
        np.zeros((1, 3)), np.array([[1.0, 0.0, 0.0], [0.5, 0.2, 0.1], [2.0, 0.0, 0.3]])
    )

    assert distances.tolist() == pytest.approx([1.1, 2.2, 0.55], abs=1e-15)
    assert (triangles != SKY).all()


def test_a_ray_past_the_box_finds_the_sky() -> None:
    distances, triangles = _caster().distances(
        np.zeros((1, 3)), np.array([[-1.0, 0.0, 0.0], [1.0, 2.0, 0.0]])
    )

    assert distances.tolist() == [0.0, 0.0]
    assert triangles.tolist() == [SKY, SKY]


def test_every_ray_may_start_elsewhere() -> None:
    origins = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 5.0], [1.5, 0.0, 7.25]])
    directions = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]])

    distances, _ = _caster().distances(origins, directions)

    assert distances.tolist() == pytest.approx([1.1, 0.0, 6.25], abs=1e-15)


def test_a_point_is_blocked_only_towards_the_box() -> None:
    points = np.array([[0.0, 0.0, 0.0], [3.0, 0.0, 0.0]], dtype=np.float32)

    blocked = _caster().blocked(points, np.array([1.0, 0.0, 0.0], dtype=np.float32))

    assert blocked.tolist() == [True, False]


@pytest.mark.parametrize("along", [0, 1, 2])
def test_a_prism_is_closed_and_its_faces_point_outside(along: int) -> None:
    triangle = [(0.0, 0.0), (2.0, 0.0), (0.0, 3.0)]
    scene = Scene("test", tuple(prism("p", "wall", triangle, along=along, start_m=1, end_m=5)))

    mesh = scene.mesh()
    mesh.merge_vertices()

    assert mesh.is_watertight
    assert mesh.volume == pytest.approx(3.0 * 4.0)  # positive: the normals point outside


def test_a_face_is_seen_from_the_side_that_its_corners_go_round_anticlockwise() -> None:
    face = polygon("f", "wall", [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)])

    assert face.normal.tolist() == [0.0, 0.0, 1.0]
