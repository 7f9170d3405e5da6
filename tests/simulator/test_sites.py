"""The five bridges have the dimensions, hollows and company that they say they have: by rays."""

from __future__ import annotations

import numpy as np
import pytest

from civil_rgbd.simulator.catalogue import SITES, site_caster_of, site_of
from civil_rgbd.simulator.motion import placed
from civil_rgbd.simulator.scene import SKY, Scene
from civil_rgbd.simulator.spec import BRIDGES
from civil_rgbd.simulator.texture import MATERIALS

FIVE = ("B1", "B2", "B3", "B4", "B5")
Vector = tuple[float, float, float]


def _meets(bridge: str, origin: Vector, direction: Vector) -> tuple[float, str]:
    caster = site_caster_of(bridge, moving=False)
    hits = caster.cast(np.array([origin]), np.array([direction], dtype=float), np.zeros(1))
    triangle = int(hits.triangles[0])
    return float(hits.distances[0]), "sky" if triangle == SKY else str(caster.site.parts[triangle])


def test_every_bridge_that_can_be_asked_for_is_drawn() -> None:
    assert (*SITES, "mesh") == BRIDGES == ("demo", *FIVE, "mesh")


@pytest.mark.parametrize(
    ("bridge", "origin", "direction", "dimension", "part"),
    [
        ("B1", (2.0, -4.0, 0.5), (0, 0, 1), "deck_soffit_z_m", "soffit"),
        ("B1", (1.0, -4.0, 0.5), (0, 0, 1), "girder_soffit_z_m", "girder"),
        ("B1", (4.0, -1.5, 2.0), (0, -1, 0), "abutment_y_m", "abutment"),
        ("B2", (2.0, 0.0, 0.5), (0, 0, 1), "soffit_z_m", "soffit"),
        ("B3", (2.0, -5.0, 0.5), (0, 0, 1), "soffit_z_m", "soffit"),
        ("B4", (8.0, 0.0, 0.5), (0, 0, 1), "soffit_z_m", "soffit"),
        ("B4", (8.0, 5.0, 0.5), (0, 0, 1), "overhang_z_m", "overhang"),
        ("B5", (4.0, 0.0, 0.5), (0, 0, 1), "soffit_crown_z_m", "soffit"),
    ],
)
def test_a_ray_measures_what_the_drawing_says(
    bridge: str, origin: Vector, direction: Vector, dimension: str, part: str
) -> None:
    distance, found = _meets(bridge, origin, direction)

    assert found == part
    already = 0.5 if direction[2] else 1.5  # from the ground, or from the middle of the bridge
    stated = site_of(bridge).scene.dimensions_m[dimension]
    assert distance + already == pytest.approx(stated, abs=1e-9)


@pytest.mark.parametrize(
    ("bridge", "middle", "axis", "dimension"),
    [
        ("B2", (4.0, 0.0, 2.2), 1, "clear_width_m"),
        ("B5", (-6.0, 0.0, 2.5), 1, "clear_span_m"),
        ("B4", (0.0, 0.5, 2.0), 0, "span_m"),
    ],
)
def test_clear_widths_are_found_between_two_rays(
    bridge: str, middle: Vector, axis: int, dimension: str
) -> None:
    away = [0.0, 0.0, 0.0]
    away[axis] = 1.0
    there, _ = _meets(bridge, middle, (away[0], away[1], away[2]))
    back, _ = _meets(bridge, middle, (-away[0], -away[1], -away[2]))
    pier = site_of(bridge).scene.dimensions_m.get("pier_length_m", 0.0) if bridge == "B4" else 0.0

    assert there + back + pier == pytest.approx(
        site_of(bridge).scene.dimensions_m[dimension], abs=1e-9
    )


def test_the_slab_of_b3_rests_on_a_pier_as_thick_as_stated() -> None:
    south, part = _meets("B3", (4.9, -5.0, 3.5), (0, 1, 0))
    north, _ = _meets("B3", (4.9, 3.0, 3.5), (0, -1, 0))

    assert part == "pier"
    assert 8.0 - south - north == pytest.approx(0.9, abs=1e-9)


@pytest.mark.parametrize("bridge", FIVE)
def test_every_spall_is_as_deep_as_stated_and_no_deeper(bridge: str) -> None:
    caster = site_caster_of(bridge, moving=False)
    for spall in caster.site.spalls:
        rng = np.random.default_rng(5)
        a = rng.uniform(-0.55, 0.55, (400, 1)) * spall.length_m * spall.along
        b = rng.uniform(-0.55, 0.55, (400, 1)) * spall.width_m * spall.up
        spots = np.concatenate([spall.deepest_m[np.newaxis], spall.centre_m + a + b])
        flat = (spots - spall.centre_m) - ((spots - spall.centre_m) @ spall.normal)[
            :, np.newaxis
        ] * spall.normal
        starts = spall.centre_m + flat + 0.3 * spall.normal
        hits = caster.cast(starts, np.broadcast_to(-spall.normal, starts.shape), np.zeros(401))
        depths = hits.distances - 0.3

        assert depths[0] == pytest.approx(spall.depth_m, abs=1e-9), spall.name
        assert depths.max() <= spall.depth_m + 1e-9
        assert depths.min() >= -1e-9  # nothing hangs before it
        hollow = caster.site.materials[hits.triangles] == "spall"
        assert (depths[~hollow] < 1e-9).all()
        assert set(caster.site.parts[hits.triangles]) == {spall.part}


@pytest.mark.parametrize("bridge", FIVE)
def test_every_spall_is_as_long_and_wide_as_stated(bridge: str) -> None:
    for spall in site_of(bridge).spalls:
        away = spall.outline_m - spall.centre_m

        assert np.ptp(away @ spall.along) == pytest.approx(spall.length_m, abs=1e-9)
        assert np.ptp(away @ spall.up) == pytest.approx(spall.width_m, abs=1e-9)
        assert np.abs(away @ spall.normal).max() < 1e-9


def test_abutment_pier_and_soffit_are_spalled_in_b3() -> None:
    spalls = {spall.name: spall for spall in site_of("B3").spalls}

    assert {"S1", "S2", "S3", "S4"} <= set(spalls)
    assert {spall.part for spall in spalls.values()} == {"abutment", "pier", "soffit"}
    assert spalls["S1"].severity == "very severe"
    assert spalls["S3"].severity == "severe"


@pytest.mark.parametrize("bridge", FIVE)
def test_every_bridge_has_railings_plants_cars_or_people(bridge: str) -> None:
    site = site_of(bridge)
    names = {mover.name.split("-")[0] for mover in site.movers}

    assert {"railing", "plant", "tree", "soffit", "abutment"} <= set(site.parts.tolist())
    assert "person" in names
    assert ("car" in set(site.parts.tolist()) and "car" in names) or bridge == "B2"
    assert set(site.materials.tolist()) <= set(MATERIALS)


def test_railing_bars_are_thin_and_stand_apart() -> None:
    # Across the railing of B4's fence: bars of 16 mm every 12 cm or so.
    x = np.arange(-29.0, -20.0, 0.002)
    origins = np.stack([x, np.full(len(x), 8.0), np.full(len(x), 0.6)], axis=1)
    caster = site_caster_of("B4", moving=False)
    hits = caster.cast(origins, np.tile([0.0, 1.0, 0.0], (len(x), 1)), np.zeros(len(x)))
    railing = (hits.triangles != SKY) & (caster.site.parts[hits.triangles] == "railing")
    edges = np.flatnonzero(np.diff(railing.astype(int)) == 1)

    assert 0.10 < railing.mean() < 0.20
    assert np.median(np.diff(edges)) * 0.002 == pytest.approx(0.12, abs=0.006)


def test_the_soffit_of_b4_runs_on_for_more_than_thirty_metres() -> None:
    distance, part = _meets("B4", (-8.0, -2.2, 1.4), (1.0, 0.0, 0.115))

    assert part == "soffit"
    assert distance > 30


@pytest.mark.parametrize("bridge", FIVE)
def test_the_inspector_walks_clear_of_everything_that_stands(bridge: str) -> None:
    path = site_of(bridge).path
    assert path is not None
    feet, _ = path.ground(np.arange(0.0, path.length_m, 0.5))
    turns = np.arange(16) / 16 * 2 * np.pi
    level = np.stack([np.cos(turns), np.sin(turns), np.zeros(16)], axis=1)
    for height in (0.25, 0.9, 1.5):
        starts = np.repeat(feet + np.array([0, 0, height]), 16, axis=0)
        ways = np.tile(level, (len(feet), 1))
        hits = site_caster_of(bridge, moving=False).cast(starts, ways, np.zeros(len(starts)))
        met = hits.triangles != SKY
        assert hits.distances[met].min() > 0.3
    down = np.tile([0.0, 0.0, -1.0], (len(feet), 1))
    ground = site_caster_of(bridge, moving=False).cast(
        feet + np.array([0, 0, 1.0]), down, np.zeros(len(feet))
    )
    assert np.abs(ground.distances - 1.0).max() < 0.2  # a kerb, at most


@pytest.mark.parametrize("bridge", FIVE)
def test_nothing_moves_through_the_inspector_or_through_what_stands(bridge: str) -> None:
    site = site_of(bridge)
    assert site.path is not None
    feet, _ = site.path.ground(np.arange(0.0, site.path.length_m, 0.5))
    times = np.arange(0.0, 60.0, 0.25)
    for mover in site.movers:
        places, _ = mover.motion.places(times)
        for foot in feet:
            assert np.hypot(*(places - foot)[:, :2].T).min() > 0.9, mover.name
        spread = np.abs(mover.body.triangles_m[..., 1]).max()
        ahead, beside = np.array([[1.0, 0.0]]), np.array([[0.0, spread + 0.02, 0.7]])
        if mover.name.startswith("car"):
            for side in (-1, 1):
                starts = places + placed(beside * [1, side, 1], ahead)
                near = np.abs(starts[:, 0]) < 40
                ways = np.tile([0.5, 0.0, 0.0], (int(near.sum()), 1))
                hits = site_caster_of(bridge, moving=False).cast(
                    starts[near], ways, np.zeros(len(ways))
                )
                met = (hits.triangles != SKY) & (hits.distances < 1)
                assert not met.any(), mover.name


@pytest.mark.parametrize("bridge", FIVE)
def test_whatever_is_built_is_closed_and_looks_outwards(bridge: str) -> None:
    site = site_of(bridge)
    open_ground = {"road", "grass", "ground", "verge", "trail", "plant"}
    bodies = [(mover.name, mover.body) for mover in site.movers]
    for part in {face.part for face in site.scene.faces} - open_ground:
        faces = tuple(face for face in site.scene.faces if face.part == part)
        bodies.append((part, Scene(part, faces)))
    for name, body in bodies:
        a, b, c = body.triangles_m.transpose(1, 0, 2)
        middle = body.triangles_m.mean(axis=(0, 1))
        volume = np.einsum("ij,ij->i", a - middle, np.cross(b - middle, c - middle)).sum() / 6
        square = (np.cross(b - a, c - a) / 2).sum(axis=0)
        assert volume > 0, name
        assert np.abs(square).max() < 1e-6, name  # the sides of a closed body balance


def test_a_site_is_the_same_for_a_seed_and_another_for_another() -> None:
    first, again, other = SITES["B3"](3), SITES["B3"](3), SITES["B3"](4)

    np.testing.assert_array_equal(first.scene.triangles_m, again.scene.triangles_m)
    assert [m.motion for m in first.movers] == [m.motion for m in again.movers]
    assert [m.motion for m in first.movers] != [m.motion for m in other.movers]
    assert [s.name for s in first.spalls] == [s.name for s in other.spalls]


def test_whatever_moves_can_be_left_out() -> None:
    site = site_of("B1", moving=False)

    assert site.movers == ()
    assert len(site.parts) == len(site.scene.face_of_triangle)
    assert len(site_of("B1").parts) > len(site.parts)
