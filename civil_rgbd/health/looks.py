"""What a short look at one image tells: how white, how dark, how smeared it is."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.domain.recording import Recording
from civil_rgbd.health.views import small_grey

_WHITE: Final = 250
_MOST_WHITE: Final = 0.35  # skies of a bridge site are white, and a third of the image at most
_BLACK: Final = 25
"""Grey levels below are black: of 16, where a video's black lies, and the noise upon it."""
_FEWEST_SEEN: Final = 0.01  # by night and in tunnels, lamps and what they light are more than that
_AVERAGE_PX: Final = 9
_STRONGEST: Final = 0.05
_FLAT: Final = 6.0  # grey levels: an image without any stronger edge shows nothing to judge
_SMEARED: Final = 0.4
"""Of sharp images 0.1 to 0.25; 0.4 is a Gaussian blur of 2 pixels in 1280, or motion over 18."""


@dataclass(frozen=True, slots=True)
class Look:
    """What is seen of one image.

    Attributes:
        white: share of pixels without any drawing left.
        seen: share of pixels that are not black.
        brightness: mean grey level.
        smear: how much of the strongest edges an average over 9 pixels leaves; NaN without.
    """

    white: float
    seen: float
    brightness: float
    smear: float

    @property
    def overexposed(self) -> bool:
        """Whether more of it is white than a sky may be."""
        return self.white > _MOST_WHITE

    @property
    def dark(self) -> bool:
        """Whether hardly a pixel shows anything: a cap on the lens, or no light at all."""
        return self.seen < _FEWEST_SEEN

    @property
    def blurred(self) -> bool:
        """Whether its strongest edges are smeared."""
        return self.smear > _SMEARED


class Looks:
    """The images of a recording in order of their stamps; each is looked at once, when asked for.

    Attributes:
        seconds: (I,) float64, since the first image.
        taken: what was looked at so far, by place in that order; None where it is broken.
    """

    def __init__(self, recording: Recording, reduction: int) -> None:
        stamps_ns = recording.image_stamps_ns
        self._order = np.argsort(stamps_ns, kind="stable")
        self._recording, self._reduction = recording, reduction
        ordered_ns = stamps_ns[self._order]
        self.seconds: NDArray[np.float64] = (ordered_ns - ordered_ns[:1]) / NS_PER_S
        self.taken: dict[int, Look | None] = {}

    def at(self, place: int) -> Look | None:
        """Look at one image; None where it cannot be decoded."""
        if place not in self.taken:
            small = small_grey(self._recording, int(self._order[place]), self._reduction)
            self.taken[place] = None if small is None else look_at(small)
        return self.taken[place]


def look_at(grey: NDArray[np.uint8]) -> Look:
    """Look at one image.

    Args:
        grey: (H, W) uint8, some 640 pixels wide.
    """
    white, seen = float((grey >= _WHITE).mean()), float((grey >= _BLACK).mean())
    # What is left of edges in the dark is noise, which says nothing of the lens.
    smear = smear_of(grey) if seen >= _FEWEST_SEEN else float("nan")
    return Look(white, seen, float(grey.mean()), smear)


def smear_of(grey: NDArray[np.uint8]) -> float:
    """Say how smeared the strongest edges are: 0 = one pixel wide, 1 = wider than can be told.

    An average over a few pixels takes most of a sharp edge's slope, and hardly any of a blurred
    one's (Crete 2007). Motion blurs along one axis: the more smeared one counts.

    Args:
        grey: (H, W) uint8.

    Returns:
        NaN where there is no edge to speak of.
    """
    if int(grey.max()) - int(grey.min()) < _FLAT:
        return float("nan")
    worst = np.nan
    for across in (grey, cv2.transpose(grey)):
        # Slopes along every third row: the strongest of so many are the strongest of all.
        values = np.ascontiguousarray(across[1::3], dtype=np.float32)
        slopes = cv2.absdiff(values[:, 1:], values[:, :-1])
        average = cv2.blur(values, (_AVERAGE_PX, 1))
        after = cv2.absdiff(average[:, 1:], average[:, :-1])
        least = float(np.quantile(slopes[:, ::3], 1 - _STRONGEST))
        strong = slopes >= max(least, 1.0)
        if strong.any():
            worst = np.fmax(worst, float(after[strong].sum() / slopes[strong].sum()))
    return float(worst)
