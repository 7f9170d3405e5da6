"""Is the start of a recording over-exposed, and until when? What comes later says what is usual."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Final

import numpy as np
from numpy.typing import NDArray

from civil_rgbd.health.looks import Look

_LONGEST_S: Final = 15.0  # what is white for longer is no start
_ALL_UNTIL_S: Final = 1.0
_STEP_S: Final = 0.13
_FADES_S: Final = 4.0
_USUAL_S: Final = (2.5, 5.0)
_USUAL_STEP_S: Final = 0.25
_BRIGHTER: Final = 1.25


def overexposed_until(seconds: NDArray[np.float64], look: Callable[[int], Look | None]) -> float:
    """Find the first image that is exposed as those some seconds later are.

    Images are looked at one after another until it is found: of a fit recording the first, and
    some of those that it is compared with.

    Args:
        seconds: (I,) when the images were taken, ascending, from 0.
        look: looks at one, by its place; None where it is broken.

    Returns:
        Its time; 0 where it is the first, or where the images are white for long.
    """
    drawn = _first(seconds, look, 0.0, _LONGEST_S, lambda seen: not seen.overexposed)
    if drawn is None:
        return 0.0
    from_s, to_s = (drawn + later for later in _USUAL_S)
    later = [look(place) for place in _places(seconds, from_s, to_s, _USUAL_STEP_S)]
    usual = [seen for seen in later if seen is not None and not seen.dark]
    if not usual:
        return drawn
    white = float(np.median([seen.white for seen in usual]))
    brightness = float(np.median([seen.brightness for seen in usual]))
    if Look(white, 1.0, brightness, 0.0).overexposed:
        return 0.0  # white before and after: no matter of the start

    def settled(seen: Look) -> bool:
        brighter = seen.brightness > _BRIGHTER * brightness and seen.white > 2 * (white + 0.01)
        return not brighter and not seen.overexposed

    found = _first(seconds, look, drawn, drawn + _FADES_S, settled)
    return drawn if found is None else found


def _first(
    seconds: NDArray[np.float64],
    look: Callable[[int], Look | None],
    from_s: float,
    to_s: float,
    fits: Callable[[Look], bool],
) -> float | None:
    """Return when the first image was taken that fits; broken ones say nothing."""
    for place in _places(seconds, from_s, to_s, _STEP_S):
        seen = look(place)
        if seen is not None and fits(seen):
            return float(seconds[place])
    return None


def _places(
    seconds: NDArray[np.float64], from_s: float, to_s: float, step_s: float
) -> Iterator[int]:
    """Yield images of a while: all of the first second, later one each step."""
    next_s = from_s
    first, last = np.searchsorted(seconds, (from_s, to_s))
    for place in range(int(first), int(last)):
        here_s = float(seconds[place])
        if here_s >= next_s:
            yield place
            next_s = here_s if here_s < _ALL_UNTIL_S else here_s + step_s
