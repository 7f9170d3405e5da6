"""Cars, vans, cyclists and people: rigid bodies of faces, parked or moving."""

from __future__ import annotations

import numpy as np

from civil_rgbd.simulator.motion import Drive, Mover, Stroll, placed
from civil_rgbd.simulator.scene import Face, Scene
from civil_rgbd.simulator.sites.draft import Draft, octagon

CAR_PAINTS = ("white", "red", "blue", "dark", "silver")
_STRETCH_M = 240.0
CLOTHES = ("dark", "red", "blue", "orange", "cloth")


def car(paint: str) -> list[Face]:
    """Return a saloon, 4.5 m by 1.8 m by 1.45 m, in its own frame: x ahead, wheels on z = 0."""
    draft = Draft()
    # Outlines are z, x: convex, anticlockwise as seen from +y.
    hull = [(0.25, -2.2), (0.75, -2.25), (0.92, -2.1), (0.9, 0.85), (0.72, 2.15), (0.3, 2.25)]
    draft.bar("car", paint, hull, along=1, span_m=(-0.88, 0.88))
    cabin = [(0.9, -1.75), (1.38, -1.1), (1.45, -0.4), (1.4, 0.1), (0.9, 0.95)]
    draft.bar("car", "glass", cabin, along=1, span_m=(-0.74, 0.74))
    roof = [(1.385, -1.08), (1.47, -0.45), (1.42, 0.1), (1.385, 0.1)]
    draft.bar("car", paint, roof, along=1, span_m=(-0.76, 0.76))
    for x in (-1.35, 1.4):
        for y in (-0.9, 0.72):
            wheel = octagon() * 0.32 + np.array([0.32, x])
            draft.bar("car", "rubber", wheel, along=1, span_m=(y, y + 0.18))
    for y in (-0.8, 0.5):
        draft.box("car", "red", ((-2.27, -2.2), (y, y + 0.3), (0.65, 0.8)))
        draft.box("car", "white", ((2.16, 2.27), (y, y + 0.3), (0.55, 0.68)))
    return draft.faces


def van(paint: str) -> list[Face]:
    """Return a van, 5.6 m by 2.0 m by 2.4 m."""
    draft = Draft()
    draft.box("car", paint, ((-2.8, 1.5), (-1.0, 1.0), (0.35, 2.4)))
    nose = [(0.35, 1.5), (2.4, 1.5), (2.3, 1.8), (1.25, 2.4), (0.95, 2.8), (0.35, 2.8)]
    draft.bar("car", paint, nose, along=1, span_m=(-1.0, 1.0))
    screen = [(1.35, 2.36), (2.2, 1.88), (2.23, 1.92), (1.37, 2.42)]
    draft.bar("car", "glass", screen, along=1, span_m=(-0.85, 0.85))
    for side in (-1.0, 1.0):
        window = (side - 0.012, side + 0.012)
        draft.box("car", "glass", ((0.9, 1.7), window, (1.35, 2.05)))
    for x in (-1.9, 1.8):
        for y in (-1.02, 0.82):
            wheel = octagon() * 0.36 + np.array([0.36, x])
            draft.bar("car", "rubber", wheel, along=1, span_m=(y, y + 0.2))
    return draft.faces


def person(shirt: str, trousers: str = "dark") -> list[Face]:
    """Return somebody of 1.75 m in mid-stride."""
    draft = Draft()
    for y, ahead in ((-0.17, 0.24), (0.03, -0.24)):
        leg = [(0.0, ahead - 0.07), (0.88, -0.09), (0.88, 0.09), (0.0, ahead + 0.07)]
        draft.bar("person", trousers, leg, along=1, span_m=(y, y + 0.14))
        draft.box("person", "rubber", ((ahead - 0.08, ahead + 0.2), (y, y + 0.12), (0.0, 0.08)))
    body = [(0.86, -0.11), (1.44, -0.1), (1.48, 0.0), (1.44, 0.1), (0.86, 0.12)]
    draft.bar("person", shirt, body, along=1, span_m=(-0.21, 0.21))
    for y, ahead in ((-0.31, -0.2), (0.22, 0.22)):
        arm = [(0.78, ahead - 0.05), (1.44, -0.06), (1.44, 0.06), (0.78, ahead + 0.05)]
        draft.bar("person", shirt, arm, along=1, span_m=(y, y + 0.09))
    draft.column("person", "skin", (0.01, 0.0), radius_m=0.06, z_m=(1.46, 1.53))
    draft.column("person", "skin", (0.02, 0.0), radius_m=0.105, z_m=(1.52, 1.7))
    draft.column("person", "dark", (0.0, 0.0), radius_m=0.108, z_m=(1.66, 1.76))
    return draft.faces


def cyclist(shirt: str) -> list[Face]:
    """Return a cyclist on a bicycle, 1.7 m long."""
    draft = Draft()
    for x in (-0.52, 0.53):
        rim = octagon() * 0.34 + np.array([0.34, x])
        draft.bar("cyclist", "rubber", rim, along=1, span_m=(-0.02, 0.02))
    frame = [(0.35, -0.5), (0.8, -0.15), (0.95, 0.45), (0.4, 0.1)]
    draft.bar("cyclist", "blue", frame, along=1, span_m=(-0.025, 0.025))
    draft.box("cyclist", "dark", ((0.4, 0.46), (-0.25, 0.25), (0.98, 1.02)))
    for y in (-0.14, 0.05):
        leg = [(0.25, 0.0), (0.6, 0.15), (0.92, -0.05), (0.85, -0.25), (0.3, -0.12)]
        draft.bar("cyclist", "dark", leg, along=1, span_m=(y, y + 0.1))
    body = [(0.88, -0.25), (1.3, 0.1), (1.42, 0.15), (1.35, 0.28), (0.95, 0.0)]
    draft.bar("cyclist", shirt, body, along=1, span_m=(-0.2, 0.2))
    arm = [(1.0, 0.4), (1.28, 0.15), (1.35, 0.22), (1.03, 0.46)]
    for y in (-0.24, 0.16):
        draft.bar("cyclist", shirt, arm, along=1, span_m=(y, y + 0.08))
    draft.column("cyclist", "skin", (0.3, 0.0), radius_m=0.1, z_m=(1.4, 1.58))
    draft.column("cyclist", "white", (0.29, 0.0), radius_m=0.13, z_m=(1.56, 1.68))
    return draft.faces


def put(draft: Draft, body: list[Face], place_m: tuple[float, float, float], ahead: int) -> None:
    """Put a body down for good, facing along x (``ahead`` 1) or against it (-1)."""
    heading = np.array([[float(ahead), 0.0]])
    draft.add(
        Face(face.part, face.material, placed(face.corners_m, heading) + np.array(place_m))
        for face in body
    )


def mover(name: str, body: list[Face], motion: Drive | Stroll) -> Mover:
    """Return a body that moves."""
    return Mover(name, Scene(name, tuple(body), seamless=True), motion)


def drivers(
    rng: np.random.Generator,
    lanes: list[tuple[float, int]],
    *,
    z_m: float,
) -> list[Mover]:
    """Return two cars or vans on each lane: its middle along y, and 1 or -1 for its direction."""
    movers = []
    for lane, (y, ahead) in enumerate(lanes):
        speed, start = rng.uniform(5.0, 11.0), rng.uniform(0, _STRETCH_M)
        for k in range(2):
            paint = CAR_PAINTS[int(rng.integers(len(CAR_PAINTS)))]
            body = van(paint) if rng.random() < 0.25 else car(paint)
            run = start + (k + rng.uniform(-0.2, 0.2)) * _STRETCH_M / 2
            drive = Drive((0.0, y, z_m), (float(ahead), 0.0), speed, _STRETCH_M, run)
            movers.append(mover(f"car-{2 * lane + k + 1}", body, drive))
    return movers


def strollers(
    rng: np.random.Generator,
    beats: list[tuple[tuple[float, float], float, float]],
    *,
    z_m: float,
) -> list[Mover]:
    """Return somebody on each beat: the middle of an ellipse, half its length, half its width."""
    movers = []
    for k, (middle, half_x, half_y) in enumerate(beats):
        shirt = CLOTHES[int(rng.integers(len(CLOTHES)))]
        # Ellipses this slim are some four half-lengths round.
        turns_per_s = rng.uniform(1.0, 1.5) / (4.2 * half_x)
        way = -1.0 if rng.random() < 0.5 else 1.0
        beat = Stroll((*middle, z_m), half_x, way * half_y, turns_per_s, rng.random())
        movers.append(mover(f"person-{k + 1}", person(shirt), beat))
    return movers
