"""Procedural textures: what a surface looks like, for every material, at every distance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.waves import sine

TILE_PX: Final = 512
LEVELS: Final = 9  # 512, 256 ... 2: each level halves the one before
STAIN_TEXEL_M: Final = 0.12
"""One texel of the large-scale stain, which hides that tiles repeat."""

_MARGIN_PX = 1  # the tile goes on over its edge, so that bilinear lookups wrap


@dataclass(frozen=True, slots=True)
class Material:
    """A surface.

    Attributes:
        colour: mean albedo, red green blue, 0 to 1.
        tile_m: length of one texture tile.
        reflectivity: what a LiDAR reports, 0 to 255.
        stain: how strongly the large-scale stain shows, 0 to 1.
    """

    colour: tuple[float, float, float]
    tile_m: float
    reflectivity: int
    stain: float = 0.35


MATERIALS: Final = {
    "wall": Material((0.50, 0.48, 0.44), 3.0, 60, 0.55),
    "slab": Material((0.52, 0.50, 0.47), 3.0, 65, 0.5),
    "girder": Material((0.56, 0.54, 0.50), 2.4, 70, 0.4),
    "paving": Material((0.47, 0.46, 0.44), 2.4, 50),
    "road": Material((0.15, 0.15, 0.16), 4.0, 15, 0.3),
    "grass": Material((0.13, 0.21, 0.06), 3.0, 35, 0.5),
    "foliage": Material((0.09, 0.16, 0.05), 2.0, 30, 0.4),
    "bark": Material((0.16, 0.11, 0.07), 1.0, 25),
    "rubber": Material((0.05, 0.05, 0.05), 1.0, 8, 0.1),
    "sign": Material((0.85, 0.62, 0.04), 1.0, 180, 0.0),
    "aged": Material((0.44, 0.41, 0.36), 3.5, 55, 0.8),
    "soffit": Material((0.50, 0.48, 0.44), 3.2, 60, 0.6),
    "spall": Material((0.46, 0.38, 0.30), 0.8, 45, 0.2),
    "steel": Material((0.16, 0.27, 0.21), 2.0, 40, 0.5),
    "galvanised": Material((0.42, 0.43, 0.44), 1.0, 90, 0.2),
    "gravel": Material((0.30, 0.27, 0.23), 2.0, 45, 0.4),
    "brick": Material((0.40, 0.20, 0.14), 1.6, 50, 0.4),
    "bush": Material((0.05, 0.09, 0.03), 1.5, 25, 0.4),
    "leaf": Material((0.17, 0.29, 0.07), 1.5, 40, 0.6),
    "glass": Material((0.06, 0.07, 0.08), 2.0, 5, 0.1),
    "white": Material((0.80, 0.80, 0.78), 2.0, 160, 0.05),
    "silver": Material((0.45, 0.46, 0.48), 2.0, 110, 0.05),
    "dark": Material((0.07, 0.07, 0.08), 2.0, 9, 0.05),
    "red": Material((0.50, 0.06, 0.05), 2.0, 70, 0.05),
    "blue": Material((0.07, 0.13, 0.35), 2.0, 40, 0.05),
    "orange": Material((0.80, 0.30, 0.04), 2.0, 120, 0.05),
    "cloth": Material((0.48, 0.44, 0.36), 1.0, 60, 0.1),
    "footway": Material((0.31, 0.30, 0.29), 2.4, 45, 0.45),
    "skin": Material((0.50, 0.33, 0.25), 1.0, 80, 0.0),
}
"""Every material that a face can be made of. New ones go last: a tile's seed is its place."""


def noise(rng: np.random.Generator, *, size_px: int, cells: tuple[int, int]) -> NDArray[np.float32]:
    """Return smooth noise that wraps: (size, size) float32, -1 to 1, ``cells`` bumps each way."""
    # In numpy alone: OpenCV's float resize may differ in the last bit from processor to processor.
    values = rng.random(cells, dtype=np.float32) * 2 - 1
    for axis, count in enumerate(cells):
        place = (np.arange(size_px, dtype=np.float32) + 0.5) * np.float32(count / size_px)
        before = np.floor(place).astype(int)
        share = place - before
        weight = share * share * (3 - 2 * share)
        weight = weight.reshape((-1, 1) if axis == 0 else (1, -1))
        low, high = values.take(before % count, axis), values.take((before + 1) % count, axis)
        values = low + (high - low) * weight
    return values


def octaves(
    rng: np.random.Generator, *, start: int, count: int, size_px: int = TILE_PX, gain: float = 0.6
) -> NDArray[np.float32]:
    """Add up noises of doubling fineness: (size, size) float32, about -1 to 1."""
    total = np.zeros((size_px, size_px), dtype=np.float32)
    for k in range(count):
        cells = start * 2**k
        total += np.float32(gain**k) * noise(rng, size_px=size_px, cells=(cells, cells))
    return total


def _boards(rng: np.random.Generator, count: int) -> NDArray[np.float32]:
    """Formwork: boards side by side, each of its own shade, with a dark joint."""
    shades = rng.uniform(-0.07, 0.07, count).astype(np.float32)
    board = np.arange(TILE_PX) * count // TILE_PX
    line: NDArray[np.float32] = shades[board]
    line[np.flatnonzero(np.diff(board, prepend=-1))] -= 0.16
    return line


def _joints(lines: NDArray[np.float32], spacing_px: int, depth: float) -> NDArray[np.float32]:
    lines[::spacing_px] -= depth
    lines[1::spacing_px] -= depth / 2
    return lines


def _concrete(rng: np.random.Generator, *, boards: int, across: bool) -> NDArray[np.float32]:
    shade = 0.10 * octaves(rng, start=4, count=6)
    pattern = np.broadcast_to(_boards(rng, boards)[:, np.newaxis], shade.shape)
    shade += pattern if across else pattern.T
    seeds = (rng.random((TILE_PX, TILE_PX), dtype=np.float32) > 0.9985).astype(np.float32)
    pores: NDArray[np.float32] = cv2.dilate(seeds, np.ones((2, 2), np.uint8))
    return shade - np.float32(0.28) * pores


def _wall(rng: np.random.Generator) -> NDArray[np.float32]:
    shade = _joints(_concrete(rng, boards=20, across=True), 256, 0.15)
    runs = noise(rng, size_px=TILE_PX, cells=(4, 64))
    runs += np.float32(0.6) * noise(rng, size_px=TILE_PX, cells=(8, 128))
    shade -= np.float32(0.16) * np.maximum(runs, 0)  # water has run down it
    return shade


def _slab(rng: np.random.Generator) -> NDArray[np.float32]:
    return _concrete(rng, boards=16, across=False)


def _girder(rng: np.random.Generator) -> NDArray[np.float32]:
    return 0.09 * octaves(rng, start=4, count=6) + 0.03 * noise(
        rng, size_px=TILE_PX, cells=(128, 4)
    )


def _paving(rng: np.random.Generator) -> NDArray[np.float32]:
    shade = 0.12 * octaves(rng, start=8, count=6)
    return _joints(_joints(shade, 256, 0.2).T.copy(), 256, 0.2).T


def _road(rng: np.random.Generator) -> NDArray[np.float32]:
    grit = rng.random((TILE_PX, TILE_PX), dtype=np.float32) - 0.5
    return 0.10 * octaves(rng, start=4, count=5) + 0.6 * grit


def _leafy(rng: np.random.Generator) -> NDArray[np.float32]:
    return 0.42 * octaves(rng, start=16, count=5, gain=0.8)


def _bark(rng: np.random.Generator) -> NDArray[np.float32]:
    return 0.4 * noise(rng, size_px=TILE_PX, cells=(4, 64))


def _plain(rng: np.random.Generator) -> NDArray[np.float32]:
    return 0.02 * octaves(rng, start=8, count=3)


def _aged(rng: np.random.Generator) -> NDArray[np.float32]:
    shade = _wall(rng)
    blotches = octaves(rng, start=3, count=5)
    crust = np.clip(blotches * 2 - np.float32(0.6), 0, 1)  # lime that came out of cracks
    shade -= np.float32(0.16) * np.maximum(blotches, 0)
    shade += np.float32(0.35) * crust
    return shade


def _soffit(rng: np.random.Generator) -> NDArray[np.float32]:
    shade = _joints(_concrete(rng, boards=24, across=True), 512, 0.18)
    damp = octaves(rng, start=2, count=5)
    shade -= np.float32(0.22) * np.clip(damp * 2 - np.float32(0.4), 0, 1)
    return shade


def _broken(rng: np.random.Generator) -> NDArray[np.float32]:
    return 0.35 * octaves(rng, start=12, count=5, gain=0.75)


def _painted_steel(rng: np.random.Generator) -> NDArray[np.float32]:
    shade = 0.06 * octaves(rng, start=4, count=5)
    rust = np.clip(octaves(rng, start=6, count=5) * 3 - np.float32(1.5), 0, 1)
    shade += np.float32(0.5) * rust
    return shade


def _brick(rng: np.random.Generator) -> NDArray[np.float32]:
    course, brick = TILE_PX // 16, TILE_PX // 8
    row, column = np.divmod(np.arange(TILE_PX * TILE_PX), TILE_PX)
    layer = row // course
    shifted = column + (layer % 2) * (brick // 2)
    shades = rng.uniform(-0.2, 0.2, (16, 8)).astype(np.float32)
    shade: NDArray[np.float32] = shades[layer, shifted // brick % 8]
    shade[(row % course < 3) | (shifted % brick < 3)] = 0.5  # texels of mortar
    return shade.reshape(TILE_PX, TILE_PX) + 0.1 * octaves(rng, start=16, count=4)


_SHADES: Final[dict[str, Callable[[np.random.Generator], NDArray[np.float32]]]] = {
    "wall": _wall,
    "slab": _slab,
    "girder": _girder,
    "paving": _paving,
    "road": _road,
    "grass": _leafy,
    "foliage": _leafy,
    "bark": _bark,
    "rubber": _plain,
    "sign": _plain,
    "aged": _aged,
    "soffit": _soffit,
    "spall": _broken,
    "steel": _painted_steel,
    "gravel": _road,
    "footway": _paving,
    "brick": _brick,
    "bush": _leafy,
    "leaf": _leafy,
}


def _tile(material: str, rng: np.random.Generator) -> NDArray[np.float32]:
    """Return (TILE_PX, TILE_PX, 3) albedo; row 0 is the lower end."""
    shade = 1 + _SHADES.get(material, _plain)(rng)
    tint = 1 + 0.05 * octaves(rng, start=2, count=3)[..., np.newaxis] * [1.0, 0.2, -1.0]
    colour = np.asarray(MATERIALS[material].colour)
    albedo = np.clip(shade[..., np.newaxis] * tint * colour, 0.01, 1.0)
    tile: NDArray[np.float32] = albedo.astype(np.float32)
    return tile


@dataclass(frozen=True, slots=True, eq=False)
class Atlas:
    """All tiles of some materials in one picture, each with its ever coarser copies.

    Attributes:
        albedo: (H, W, 3) uint8, 255 = 1.0 after a square root, red green blue.
        lefts_px: (M, LEVELS) float32, column of the tile's first texel.
        tops_px: (M, LEVELS) float32, its row.
        stain: (TILE_PX + 2, TILE_PX + 2) uint8, 128 = none; wraps.
    """

    albedo: NDArray[np.uint8]
    lefts_px: NDArray[np.float32]
    tops_px: NDArray[np.float32]
    stain: NDArray[np.uint8]


def _halved(tile: NDArray[np.float32]) -> NDArray[np.float32]:
    total: NDArray[np.float32] = (
        tile[::2, ::2] + tile[1::2, ::2] + tile[::2, 1::2] + tile[1::2, 1::2]
    )
    return total / np.float32(4)


@lru_cache(maxsize=2)
def atlas(materials: tuple[str, ...]) -> Atlas:
    """Draw the textures of some materials."""
    width = (TILE_PX + 2 * _MARGIN_PX) * len(materials)
    height = 2 * TILE_PX + 2 * _MARGIN_PX * LEVELS
    picture = np.zeros((height, width, 3), dtype=np.uint8)
    lefts = np.empty((len(materials), LEVELS), dtype=np.float32)
    tops = np.empty_like(lefts)
    places = list(MATERIALS)
    for m, material in enumerate(materials):
        # Seeded by its place among all: no other material changes how it looks.
        tile = _tile(material, np.random.default_rng([places.index(material), 2025]))
        left, top = m * (TILE_PX + 2 * _MARGIN_PX), 0
        for level in range(LEVELS):
            edged = np.pad(tile, ((1, 1), (1, 1), (0, 0)), mode="wrap")
            size = len(edged)
            picture[top : top + size, left : left + size] = np.sqrt(edged) * 255 + 0.5
            lefts[m, level], tops[m, level] = left + _MARGIN_PX, top + _MARGIN_PX
            top += size
            tile = _halved(tile)
    large = octaves(np.random.default_rng(2026), start=8, count=6, gain=0.65)
    stain = np.pad(np.clip(large * 85 + 128, 0, 255), 1, mode="wrap")
    return Atlas(picture, lefts, tops, stain.astype(np.uint8))


@cache
def sky_picture() -> NDArray[np.float32]:
    """Clouds seen from below: (TILE_PX, TILE_PX) float32, 0 = blue to 1 = white; does not wrap."""
    cloud = octaves(np.random.default_rng(2027), start=4, count=6)
    # The edge fades out, so that whatever lies beyond joins on.
    fade = sine((np.arange(TILE_PX) + 0.5) / (2 * TILE_PX)).astype(np.float32)
    veil: NDArray[np.float32] = np.clip(cloud * 1.1 + 0.35, 0, 1) * np.outer(fade, fade)
    return veil
