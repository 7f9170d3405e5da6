"""Moving things are met where they say they are, by rays, pictures and depth alike."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.geometry.camera import PinholeCamera
from civil_rgbd.simulator.camera import pinhole_rays, render_depth
from civil_rgbd.simulator.catalogue import site_caster_of
from civil_rgbd.simulator.motion import Drive, Mover, Stroll, placed, unplaced
from civil_rgbd.simulator.scene import SKY, RayCaster, Scene, box, polygon
from civil_rgbd.simulator.shading import Painter
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.site_rays import SiteCaster

AHEAD = np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]])  # optical axis along scene x


def _caster() -> SiteCaster:
    wall = polygon("w", "wall", [(30, 50, -9), (30, -50, -9), (30, -50, 19), (30, 50, 19)])
    block = Scene("block", tuple(box("b", "red", (-1, -0.5, 0), (1, 0.5, 2))), seamless=True)
    drive = Drive((10.0, 0.0, 0.0), (0.0, 1.0), 2.0, 40.0, 20.0)  # at t = 0 before the walker
    return SiteCaster(Site(Scene("t", (wall,)), (Mover("block-1", block, drive),)))


def test_each_ray_meets_the_mover_where_it_is_at_its_own_instant() -> None:
    caster, times = _caster(), np.array([0.0, 0.4, 0.6, 5.0])
    # At t it spans y = 2 t - 1 to 2 t + 1 and x = 9.5 to 10.5.
    hits = caster.cast(np.array([[0.0, 0.0, 1.0]]), np.tile([1.0, 0.0, 0.0], (4, 1)), times)

    assert hits.distances.tolist() == pytest.approx([9.5, 9.5, 30.0, 30.0], abs=1e-12)
    assert [str(caster.site.parts[k]) for k in hits.triangles] == ["block-1"] * 2 + ["w"] * 2
    assert hits.cosines.tolist() == pytest.approx([1.0] * 4)


def test_rays_may_have_any_length_and_start_anywhere() -> None:
    origins = np.array([[0.0, 0.0, 1.0], [5.0, 0.0, 1.0], [20.0, 0.0, 1.0]])
    directions = np.array([[2.0, 0.0, 0.0], [0.5, 0.0, 0.0], [-4.0, 0.0, 0.0]])

    hits = _caster().cast(origins, directions, np.zeros(3))

    assert hits.distances.tolist() == pytest.approx([4.75, 9.0, 9.5 / 4], abs=1e-12)


def test_a_ray_that_passes_a_mover_by_finds_what_is_behind() -> None:
    hits = _caster().cast(np.array([[0.0, 0.0, 2.5]]), np.array([[1.0, 0.0, 0.0]]), np.zeros(1))

    assert hits.distances.tolist() == [30.0]


def test_depth_of_an_instant_sees_the_mover_where_it_is() -> None:
    camera = PinholeCamera(200, 100, 100.0, 100.0, 99.5, 49.5)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = AHEAD, (0.0, 0.0, 1.0)

    depth = render_depth(_caster().at(2.0), camera, T)

    columns = np.flatnonzero((depth[49] > 9.499) & (depth[49] < 9.501))
    x, _ = pinhole_rays(camera)
    left = -x[49, columns] * 9.5  # y is to the left
    assert left.min() == pytest.approx(3.0, abs=0.1)
    assert left.max() == pytest.approx(5.0, abs=0.1)
    assert np.abs(depth[49, columns] - 9.5).max() < 1e-9


def test_pictures_show_the_mover_and_its_shadow_move() -> None:
    ground = polygon("g", "paving", [(-50, -50, 0), (50, -50, 0), (50, 50, 0), (-50, 50, 0)])
    block = Scene("block", tuple(box("b", "red", (-1, -0.5, 0), (1, 0.5, 2))), seamless=True)
    drive = Drive((10.0, 0.0, 0.0), (0.0, 1.0), 2.0, 40.0, 20.0)
    caster = SiteCaster(Site(Scene("t", (ground,)), (Mover("block-1", block, drive),)))
    painter, camera = Painter(caster), PinholeCamera(160, 90, 80.0, 80.0, 79.5, 44.5)
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = AHEAD, (0.0, 0.0, 3.0)

    empty = Painter(RayCaster(caster.site.scene)).paint(pinhole_rays(camera), 80.0, T).astype(int)

    def reds(t_s: float) -> np.ndarray:
        rgb = painter.paint(pinhole_rays(camera), 80.0, T, t_s=t_s).astype(int)
        return rgb[..., 0] - rgb[..., 2] > 60

    def darks(t_s: float) -> np.ndarray:
        rgb = painter.paint(pinhole_rays(camera), 80.0, T, t_s=t_s).astype(int)
        return (empty.sum(axis=2) - rgb.sum(axis=2) > 60) & ~reds(t_s)

    def middle(mask: np.ndarray) -> float:
        return float(np.nonzero(mask)[1].mean())

    assert reds(0.0).sum() > 200
    assert middle(reds(0.0)) == pytest.approx(79.5, abs=2)
    # 4 m to the left of the way ahead, some 9.5 m off: 80 * 4 / 9.5 = 34 pixels.
    assert middle(reds(0.0)) - middle(reds(2.0)) == pytest.approx(34, abs=3)
    assert darks(0.0).sum() > 15
    assert middle(darks(0.0)) - middle(darks(2.0)) == pytest.approx(34, abs=8)


@pytest.mark.parametrize("t_s", [0.0, 3.3, 17.0])
def test_pictures_and_rays_agree_in_a_furnished_site(t_s: float) -> None:
    caster = site_caster_of("B3")
    camera = PinholeCamera(160, 90, 80.0, 80.0, 79.5, 44.5)
    x, y = (plane.ravel() for plane in pinhole_rays(camera))
    directions = np.stack([np.ones_like(x), -x, -y], axis=1)
    here = np.array([[-12.0, -5.0, 1.5]])

    distances, triangles = caster.at(t_s).distances(here, directions)
    hits = caster.cast(here, directions, np.full(len(directions), t_s))

    same = hits.triangles == triangles
    assert same.mean() > 0.999  # two Embree scenes may differ on an edge
    np.testing.assert_allclose(hits.distances[same], distances[same], rtol=1e-9, atol=1e-9)


def test_every_mover_of_a_site_is_met_where_its_motion_says() -> None:
    caster = site_caster_of("B1")
    for mover, first in zip(caster.site.movers, caster.site.first_triangles, strict=True):
        times = np.array([0.0, 7.7, 41.0])
        places, headings = mover.motion.places(times)
        top = float(mover.body.triangles_m[..., 2].max())
        above = places + placed(np.tile([0.02, 0.0, top + 0.02], (3, 1)), headings)
        hits = caster.cast(above, np.tile([0.0, 0.0, -1.0], (3, 1)), times)
        count = len(mover.body.face_of_triangle)

        assert ((hits.triangles >= first) & (hits.triangles < first + count)).all(), mover.name
        assert (hits.distances < 0.6).all()


def test_without_movers_no_ray_meets_one() -> None:
    caster = site_caster_of("B1", moving=False)
    mover = site_caster_of("B1").site.movers[0]
    places, _ = mover.motion.places(np.array([1.0]))

    hits = caster.cast(places + np.array([0, 0, 3.0]), np.array([[0.0, 0.0, -1.0]]), np.ones(1))

    assert hits.triangles[0] == SKY or caster.site.parts[hits.triangles[0]] == "road"


def test_motions_are_steady_and_start_where_they_say() -> None:
    drive = Drive((1.0, 2.0, 0.1), (0.6, 0.8), 5.0, 100.0, 50.0)
    places, headings = drive.places(np.array([0.0, 1.0, 20.0]))

    np.testing.assert_allclose(places[0], [1.0, 2.0, 0.1])
    np.testing.assert_allclose(places[1], [4.0, 6.0, 0.1])
    np.testing.assert_allclose(places[2], places[0])  # once round the stretch
    np.testing.assert_allclose(headings, np.tile([0.6, 0.8], (3, 1)))


@pytest.mark.parametrize("half_y", [0.5, -0.5])
def test_strollers_face_the_way_they_go(half_y: float) -> None:
    stroll = Stroll((3.0, 7.0, 0.15), 10.0, half_y, 0.03, 0.2)
    t = np.linspace(0.0, 60.0, 50)
    places, headings = stroll.places(t)
    onwards = stroll.places(t + 1e-5)[0] - places

    ahead = onwards[:, :2] / np.linalg.norm(onwards[:, :2], axis=1, keepdims=True)
    np.testing.assert_allclose(headings, ahead, atol=1e-3)
    np.testing.assert_allclose(
        ((places[:, 0] - 3) / 10) ** 2 + ((places[:, 1] - 7) / 0.5) ** 2, 1.0, atol=1e-9
    )


def test_unplacing_undoes_placing() -> None:
    rng = np.random.default_rng(1)
    vectors, turns = rng.normal(size=(5, 3)), rng.uniform(0, 6, 5)
    headings = np.stack([np.cos(turns), np.sin(turns)], axis=1)

    np.testing.assert_allclose(unplaced(placed(vectors, headings), headings), vectors, atol=1e-14)
    np.testing.assert_allclose(
        placed(np.array([[1.0, 0.0, 5.0]]), np.array([[0.0, 1.0]])), [[0.0, 1.0, 5.0]]
    )
