"""Bridges from OBJ files: measured by rays, whichever way their faces look."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import trimesh

from civil_rgbd.errors import UsageError
from civil_rgbd.simulator.catalogue import caster_for
from civil_rgbd.simulator.scene import SKY
from civil_rgbd.simulator.sites.mesh import mesh_site
from civil_rgbd.simulator.spec import spec_from_location


def _table_bridge(folder: Path) -> Path:
    """A slab of 8 x 20 x 0.5 m, 5 m above the foot of two walls; some faces inside out."""
    slab = trimesh.creation.box((8.0, 20.0, 0.5))
    slab.apply_translation((100.0, 50.0, 7.25))
    slab.faces[::3] = slab.faces[::3, ::-1]
    walls = [trimesh.creation.box((8.0, 1.0, 5.0)) for _ in range(2)]
    for wall, y in zip(walls, (41.0, 59.0), strict=True):
        wall.apply_translation((100.0, y, 4.5))
    (folder / "deck.obj").write_text(trimesh.exchange.obj.export_obj(slab), "utf-8")
    both = trimesh.util.concatenate(walls)
    (folder / "pier.obj").write_text(trimesh.exchange.obj.export_obj(both), "utf-8")
    return folder


def test_a_mesh_is_settled_on_the_ground_with_its_length_along_x(tmp_path: Path) -> None:
    site = mesh_site(_table_bridge(tmp_path), 0)

    assert site.scene.dimensions_m == pytest.approx(
        {"length_m": 20.0, "width_m": 8.0, "height_m": 5.5}
    )
    assert {"deck", "pier"} <= set(site.parts.tolist())


def test_rays_measure_a_mesh_and_its_faces_look_outwards(tmp_path: Path) -> None:
    spec = spec_from_location(f"simulated:mesh?mesh={_table_bridge(tmp_path)}&moving=0")
    caster = caster_for(spec)
    origins = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, 30.0]])
    ways = np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])

    hits = caster.cast(origins, ways, np.zeros(3))

    assert hits.distances.tolist() == pytest.approx([4.0, 8.5, 24.5], abs=1e-5)
    normals = caster.site.scene.normals[hits.triangles]
    assert ((normals * ways).sum(axis=1) < 0).all()  # each is met from its front


def test_the_walk_passes_under_a_mesh_where_nothing_stands(tmp_path: Path) -> None:
    site = mesh_site(_table_bridge(tmp_path), 0)
    spec = spec_from_location(f"simulated:mesh?mesh={tmp_path}&moving=0")
    assert site.path is not None
    feet, _ = site.path.ground(np.arange(0.0, site.path.length_m, 1.0))
    upwards = np.tile([0.0, 0.0, 1.0], (len(feet), 1))

    hits = caster_for(spec).cast(feet + np.array([0, 0, 1.0]), upwards, np.zeros(len(feet)))

    above = hits.triangles != SKY
    assert 0.2 < above.mean() < 0.8  # under it and beside it
    assert hits.distances[above].min() > 3.9


@pytest.mark.parametrize("name", ["missing.obj", ""])
def test_a_place_without_a_mesh_is_refused(tmp_path: Path, name: str) -> None:
    with pytest.raises(UsageError, match="no OBJ mesh") as caught:
        mesh_site(tmp_path / name, 0)

    assert "OBJ file with faces" in caught.value.fix


def test_the_one_bridge_below_a_folder_is_found(tmp_path: Path) -> None:
    (tmp_path / "models/parts").mkdir(parents=True)
    _table_bridge(tmp_path / "models/parts")
    (tmp_path / "models/LICENSE").write_text("free")
    (tmp_path / "models/parts/deck.obj").rename(tmp_path / "models/parts/deck.OBJ")

    site = mesh_site(tmp_path, 0)

    assert site.scene.dimensions_m["height_m"] == pytest.approx(5.5)
    assert {"deck", "pier"} <= set(site.parts.tolist())


def test_of_two_bridges_below_a_folder_one_must_be_named(tmp_path: Path) -> None:
    for name in ("one", "other"):
        (tmp_path / name).mkdir()
        _table_bridge(tmp_path / name)
    (tmp_path / "other/pier.obj").unlink()

    with pytest.raises(UsageError, match="2 bridges of OBJ files") as caught:
        mesh_site(tmp_path, 0)

    assert caught.value.fix == (
        f"name one: mesh={tmp_path / 'one'}, mesh={tmp_path / 'other/deck.obj'}"
    )
    assert mesh_site(tmp_path / "one", 0).scene.dimensions_m["height_m"] == pytest.approx(5.5)


def test_a_folder_that_is_a_bridge_itself_is_not_searched(tmp_path: Path) -> None:
    (tmp_path / "older").mkdir()
    _table_bridge(tmp_path / "older")

    assert mesh_site(_table_bridge(tmp_path), 0).scene.dimensions_m["width_m"] == pytest.approx(8.0)


@pytest.mark.parametrize("location", ["simulated:mesh", "simulated:B1?mesh=bridge.obj"])
def test_a_mesh_belongs_to_the_bridge_mesh_alone(location: str) -> None:
    with pytest.raises(UsageError, match="read from a file"):
        spec_from_location(location)


def test_real_models_in_several_folders_are_named(shared_data: Path) -> None:
    with pytest.raises(UsageError, match="2 bridges of OBJ files") as caught:
        mesh_site(shared_data / "bridge_meshes_salman", 0)

    assert "BridgeModels/bridge_1.obj" in caught.value.fix
    assert caught.value.fix.endswith("sceneparts/bridge1")


def test_a_real_model_of_a_bridge_is_walked_under(shared_data: Path) -> None:
    models = shared_data / "bridge_meshes_salman" / "BridgeModelGeneration" / "Dataset"
    site = mesh_site(models / "BridgeModels" / "bridge_1.obj", 0)

    assert site.scene.dimensions_m == pytest.approx(
        {"length_m": 65.0, "width_m": 17.0, "height_m": 7.635}, abs=1e-3
    )
    assert site.path is not None
    assert len(site.path.corners_m) == 6  # across below it, not round about
