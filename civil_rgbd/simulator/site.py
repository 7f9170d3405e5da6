"""A bridge with all that stands and moves about it, and the path that its inspector takes."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.simulator.motion import Mover
from civil_rgbd.simulator.path import WalkPath
from civil_rgbd.simulator.scene import Scene
from civil_rgbd.simulator.spall import Spall


@dataclass(frozen=True, slots=True, eq=False)
class Site:
    """One bridge with everything about it.

    Triangles are numbered through: those of ``scene`` first, then those of each mover in turn.

    Attributes:
        scene: all that stands.
        movers: all that moves.
        spalls: hollows of known size.
        path: where the inspector walks; None is the demo's oval.
        materials: (T,) str names, of every triangle.
        parts: (T,) str names of what every triangle belongs to; a mover's is its name.
    """

    scene: Scene
    movers: tuple[Mover, ...] = ()
    spalls: tuple[Spall, ...] = ()
    path: WalkPath | None = None
    materials: NDArray[np.str_] = field(init=False)
    parts: NDArray[np.str_] = field(init=False)

    def __post_init__(self) -> None:
        bodies = [self.scene, *(mover.body for mover in self.movers)]
        materials = [
            np.array([face.material for face in body.faces])[body.face_of_triangle]
            for body in bodies
        ]
        standing = np.array([face.part for face in self.scene.faces])[self.scene.face_of_triangle]
        moving = [np.full(len(mover.body.face_of_triangle), mover.name) for mover in self.movers]
        set_once = object.__setattr__  # frozen: derived fields are set here and never again
        set_once(self, "materials", np.concatenate(materials))
        set_once(self, "parts", np.concatenate([standing, *moving]))

    @property
    def first_triangles(self) -> list[int]:
        """Number of each mover's first triangle."""
        counts = [len(self.scene.face_of_triangle)]
        counts += [len(mover.body.face_of_triangle) for mover in self.movers]
        return np.cumsum(counts)[:-1].tolist()  # type: ignore[no-any-return]  # numpy's stubs say Any
