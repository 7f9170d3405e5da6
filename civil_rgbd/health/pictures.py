"""Are the images whole, well exposed and sharp? Some are looked at; more where one is not."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np

from civil_rgbd.domain.recording import Recording
from civil_rgbd.health.checks import Figure
from civil_rgbd.health.looks import Look, Looks
from civil_rgbd.health.opening import overexposed_until
from civil_rgbd.health.views import Viewer

_OF_WHOLE_PICTURES: Final = ("overexposed-start", "overexposed", "too-dark", "blurred")
OF_PICTURES: Final = ("images-broken", *_OF_WHOLE_PICTURES)
"""Codes of the figures that looking at images gives; of the first, at those that decode."""

_FEW: Final = 60
"""A fault of a tenth of the images is among them but for 2 recordings in 1000."""
_MANY: Final = 300
"""Of them 5 % are faulty where 10 % of all are, but for 1 recording in 1000."""
_GOLDEN: Final = 0.6180339887498949


@dataclass(frozen=True, slots=True, eq=False)
class PictureSamples:
    """What was seen of images spread evenly over a recording.

    Attributes:
        seconds: when each was taken, since the first image; ascending.
        looks: at each; None where it cannot be decoded.
        start_s: until when the recording's start is over-exposed; 0 = it is not.
    """

    seconds: tuple[float, ...]
    looks: tuple[Look | None, ...]
    start_s: float


def look_at_pictures(recording: Recording, viewer: Viewer) -> PictureSamples:
    """Look at some images; at many more where any of them is not as it should be."""
    looks = Looks(recording, viewer.reduction)
    images = len(looks.seconds)
    start_s = overexposed_until(looks.seconds, looks.at)
    places = spread(images, _FEW)
    for place in places:
        looks.at(place)
    if any(_at_fault(look, looks.seconds[place] >= start_s) for place, look in looks.taken.items()):
        places = spread(images, _MANY)
    seconds = tuple(float(looks.seconds[place]) for place in places)
    return PictureSamples(seconds, tuple(looks.at(place) for place in places), start_s)


def spread(images: int, most: int) -> tuple[int, ...]:
    """Choose images spread evenly, and yet out of step with all that recurs.

    Args:
        images: how many there are.
        most: how many to choose.

    >>> spread(4, 60)
    (0, 1, 2, 3)
    >>> spread(100, 5)
    (0, 32, 44, 76, 89)
    """
    if images <= most:
        return tuple(range(images))
    parts, step = np.arange(most), images / most
    places = (parts * step + parts * _GOLDEN % 1.0 * (step - 1) + 0.5).astype(np.int64)
    return tuple(places.tolist())


def _at_fault(look: Look | None, after_start: bool) -> bool:  # noqa: FBT001  # private, by place
    if look is None or look.dark:
        return True
    return after_start and (look.overexposed or look.blurred)


def picture_figures(samples: PictureSamples) -> Iterator[Figure]:
    """Judge whether images can be decoded, their exposure and their sharpness.

    Args:
        samples: from :func:`look_at_pictures`.
    """
    every = len(samples.looks)
    whole = [look for look in samples.looks if look is not None]
    if not every:
        yield from (Figure(code, None, "there is no image") for code in OF_PICTURES)
        return
    yield _share("images-broken", every - len(whole), every)
    if not whole:
        why = f"none of {every} images could be decoded"
        yield from (Figure(code, None, why) for code in _OF_WHOLE_PICTURES)
        return
    start_s = samples.start_s
    yield Figure(
        "overexposed-start",
        start_s,
        f"until {start_s:.2f} s after the first image" if start_s else "",
        fix=f"leave the first {start_s:.1f} s out: start the poses there, or cut the recording; "
        "next time let the camera run for two seconds before recording",
    )
    rest = [
        look
        for second, look in zip(samples.seconds, samples.looks, strict=True)
        if look is not None and second >= start_s
    ] or whole
    yield _share("overexposed", sum(look.overexposed for look in rest), len(rest))
    yield _share("too-dark", sum(look.dark for look in whole), len(whole))
    judged = [look for look in rest if np.isfinite(look.smear)]
    if not judged:
        yield Figure("blurred", None, "no image has an edge to judge by")
        return
    median = float(np.median([look.smear for look in judged]))
    smeared = sum(look.blurred for look in judged)
    yield _share("blurred", smeared, len(judged), f"; median smear {median:.2f}")


def _share(code: str, faulty: int, judged: int, said: str = "") -> Figure:
    return Figure(code, 100 * faulty / judged, f"{faulty} of {judged} looked at{said}")
