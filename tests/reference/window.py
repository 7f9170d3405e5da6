"""Which points a frame sees, counted one by one: the slow twin of ``SlidingWindow``."""

from __future__ import annotations

from collections.abc import Sequence


def seen(
    scans: Sequence[Sequence[int]], stamp_ns: int, *, points: int, window: str, max_age_ns: int = 0
) -> list[tuple[int, int]]:
    """Return (message, place in the message) of every point that an image at ``stamp_ns`` sees.

    Args:
        scans: the point stamps of each message, message order.
        stamp_ns: corrected stamp of the image.
        points: N.
        window: past, centred or future.
        max_age_ns: points further from the image's stamp do not count; 0 = no limit.
    """
    past, future = [], []
    for message, stamps in enumerate(scans):
        # sorted() is stable: equal stamps stay in the order of the message.
        for stamp, place in sorted((s, p) for p, s in enumerate(stamps)):
            if max_age_ns and abs(stamp - stamp_ns) > max_age_ns:
                continue
            if stamp < stamp_ns:
                past.append((message, place))
            else:
                future.append((message, place))
    if window == "past":
        return past[max(0, len(past) - points) :]
    if window == "future":
        return future[:points]
    half = points // 2
    return past[max(0, len(past) - half) :] + future[: points - half]
