"""How coordinate frames hang together: transforms as links, paths as products."""

from __future__ import annotations

from collections import deque

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.geometry.transforms import compose, inverse


class FrameTree:
    """Named frames and the rigid transforms between them.

    >>> tree = FrameTree()
    >>> tree.link("base", "lidar", np.eye(4))
    >>> tree.find("lidar", "base").shape
    (4, 4)
    >>> tree.find("lidar", "moon") is None
    True
    """

    def __init__(self) -> None:
        self._links: dict[str, dict[str, NDArray[np.float64]]] = {}

    def link(self, a: str, b: str, T_a_b: NDArray[np.float64]) -> None:
        """Say how frame ``b`` sits in frame ``a``; a later word replaces an earlier one."""
        self._links.setdefault(a, {})[b] = T_a_b
        self._links.setdefault(b, {})[a] = inverse(T_a_b)

    @property
    def frames(self) -> list[str]:
        """All frames, by name."""
        return sorted(self._links)

    def find(self, a: str, b: str) -> NDArray[np.float64] | None:
        """Return ``T_a_b`` along the shortest path, the first linked of equals; None without one.

        A frame is itself, whether it was ever linked or not.
        """
        if a == b:
            return np.eye(4)
        reached = {a: np.eye(4)}
        waiting = deque([a])
        while waiting:
            here = waiting.popleft()
            for there, T_here_there in self._links.get(here, {}).items():
                if there in reached:
                    continue
                reached[there] = compose(reached[here], T_here_there)
                if there == b:
                    return reached[there]
                waiting.append(there)
        return None
