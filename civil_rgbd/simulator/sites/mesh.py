"""A bridge that somebody else drew, read from OBJ files, on plain ground with plants and people."""

from __future__ import annotations

from pathlib import Path
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.errors import UsageError
from civil_rgbd.simulator.path import WalkPath
from civil_rgbd.simulator.scene import SKY, Face, RayCaster, Scene, unit_normals
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.sites.draft import FAR_M, Draft
from civil_rgbd.simulator.sites.surroundings import put_green
from civil_rgbd.simulator.sites.traffic import strollers

_SUN = (-0.42, -0.48, 0.77)
_LANE_M = 1.6  # half the distance between the ways there and back
_BESIDE_M = 9.0  # how far the walk goes on beyond the bridge
_SHOWN = 6  # bridges that a message names
_FLAT_M2 = 1e-9  # a triangle smaller than this has no side to it
_MATERIALS: Final = {
    "rail": "galvanised",
    "pier": "wall",
    "deck": "soffit",
    "girder": "girder",
    "bearing": "rubber",
}
"""Material by a word in a file's name; the rest is of concrete."""


def mesh_site(path: Path, seed: int) -> Site:
    """Draw a bridge from OBJ.

    Args:
        path: an OBJ file, or a folder of them, one a part; metres, z up. A folder without any is
            searched for one that has. The longer of x and y becomes the scene's x, the middle its
            origin, the lowest point its ground.
        seed: places plants and people.

    Raises:
        UsageError: there is no OBJ file, no surface in it, or more than one bridge.
    """
    files = _files_of(path) if path.is_dir() else [path]
    parts = {file.stem: _triangles(file) for file in files if file.is_file()}
    if not sum(map(len, parts.values())):
        raise UsageError(
            "there is no OBJ mesh of a bridge",
            where=path,
            fix="name an OBJ file with faces, or a folder of such files, as mesh=PATH",
        )
    corners = np.concatenate(list(parts.values())).reshape(-1, 3)
    low, high = corners.min(axis=0), corners.max(axis=0)
    turned = high[1] - low[1] > high[0] - low[0]
    parts = {name: _settled(triangles, low, high, turned) for name, triangles in parts.items()}
    draft = Draft()
    for name, triangles in _faced(parts).items():
        material = next((m for word, m in _MATERIALS.items() if word in name.lower()), "slab")
        draft.add(Face(name, material, triangle) for triangle in triangles)
    length, width = sorted((high - low)[:2].tolist(), reverse=True)
    path_walked = _clear_way(draft, length, width)
    draft.level("ground", "gravel", (-FAR_M, FAR_M), (-FAR_M, FAR_M))
    rng = np.random.default_rng([seed, 9])
    put_green(draft, rng, sun=_SUN, foot_x_m=length / 2 + 2, beside_y_m=width / 2 + 4)
    people = strollers(rng, [((16.0, width / 2 + 3.5), 9.0, 0.4)], z_m=0.0)
    size = {"length_m": length, "width_m": width, "height_m": float(high[2] - low[2])}
    scene = draft.scene("mesh", size, _SUN)
    return Site(scene, tuple(people), (), path_walked)


def _files_of(folder: Path) -> list[Path]:
    """Return the OBJ files of the one folder that holds any: this one, or else below it."""
    found: dict[Path, list[Path]] = {}
    for file in sorted(folder.rglob("*")):
        if file.suffix.lower() == ".obj":
            found.setdefault(file.parent, []).append(file)
    if folder in found:
        return found[folder]
    if len(found) <= 1:
        return [file for files in found.values() for file in files]
    bridges = [files[0] if len(files) == 1 else parent for parent, files in found.items()]
    more = f" or another of {len(bridges)}" if len(bridges) > _SHOWN else ""
    raise UsageError(
        f"there are {len(bridges)} bridges of OBJ files here",
        where=folder,
        fix="name one: " + ", ".join(f"mesh={bridge}" for bridge in bridges[:_SHOWN]) + more,
    )


def _triangles(file: Path) -> NDArray[np.float64]:
    import trimesh

    mesh = trimesh.load(file, file_type="obj", force="mesh", process=False)
    triangles = np.asarray(mesh.triangles, dtype=np.float64).reshape(-1, 3, 3)
    n = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    kept: NDArray[np.float64] = triangles[np.sqrt((n * n).sum(axis=1)) > _FLAT_M2]
    return kept


def _settled(
    triangles: NDArray[np.float64],
    low_m: NDArray[np.float64],
    high_m: NDArray[np.float64],
    turned: np.bool_,
) -> NDArray[np.float64]:
    middle = (low_m + high_m) / 2
    moved: NDArray[np.float64] = triangles - np.array([middle[0], middle[1], low_m[2]])
    if turned:
        moved = np.stack([moved[..., 1], -moved[..., 0], moved[..., 2]], axis=-1)
    return moved


def _faced(parts: dict[str, NDArray[np.float64]]) -> dict[str, NDArray[np.float64]]:
    """Turn every triangle's front to where more rays get away: meshes often mix them up."""
    faces = [Face(name, "slab", triangle) for name, rows in parts.items() for triangle in rows]
    caster = RayCaster(Scene("mesh", tuple(faces)))
    turned = {}
    for name, rows in parts.items():
        normals = unit_normals(rows[:, 0], rows[:, 1], rows[:, 2])
        front, back = (_escaped(caster, rows.mean(axis=1), side * normals) for side in (1, -1))
        wrong = back > front
        rows[wrong] = rows[wrong, ::-1]
        turned[name] = rows
    return turned


def _escaped(
    caster: RayCaster, middles_m: NDArray[np.float64], normals: NDArray[np.float64]
) -> NDArray[np.int64]:
    rng = np.random.default_rng(17)
    total = np.zeros(len(middles_m), dtype=np.int64)
    starts = (middles_m + 1e-3 * normals).astype(np.float32)
    for direction in rng.uniform(-1, 1, (24, 3)) * 0.55:
        ways = (normals + direction).astype(np.float32)
        total += caster.nearest(starts, np.ascontiguousarray(ways)) == SKY
    return total


def _clear_way(draft: Draft, length_m: float, width_m: float) -> WalkPath:
    """Find a way under the bridge, square to it and near its middle; else walk round it."""
    caster = RayCaster(Scene("mesh", tuple(draft.faces)))
    reach = width_m / 2 + _BESIDE_M
    for x in sorted(np.arange(-length_m * 0.4, length_m * 0.4, 1.0).tolist(), key=abs):
        beside = np.arange(x - _LANE_M - 0.8, x + _LANE_M + 0.85, 0.1)
        feet = np.array([(at, -reach, z) for at in beside for z in (0.1, 0.6, 1.2, 1.9)])
        distances, triangles = caster.distances(feet, np.tile([0.0, 1.0, 0.0], (len(feet), 1)))
        if not ((triangles != SKY) & (distances < 2 * reach)).any():
            ends = ((x + _LANE_M, -reach), (x + _LANE_M, reach), (x, reach + 1.5))
            back = ((x - _LANE_M, reach), (x - _LANE_M, -reach), (x, -reach - 1.5))
            return WalkPath(tuple((a, b, 0.0) for a, b in (*ends, *back)))
    a, b = length_m / 2 + 4, width_m / 2 + 4
    round_it = ((-a, -b), (a, -b), (a, b), (-a, b))
    return WalkPath(tuple((*corner, 0.0) for corner in round_it), look_left_deg=60.0)
