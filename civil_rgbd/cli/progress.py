"""Progress bars, on stderr, where somebody is looking."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager


@contextmanager
def frame_bar(title: str) -> Iterator[Callable[[int, int], object]]:
    """Show one bar; the callback takes what is newly done, and the total."""
    from tqdm import tqdm

    with tqdm(desc=title, unit="frame", disable=None) as bar:  # None: only on a terminal

        def advance(done: int, total: int) -> None:
            bar.total = total
            bar.update(done)

        yield advance


@contextmanager
def byte_bar(title: str) -> Iterator[Callable[[int, int], object]]:
    """Show one bar; the callback takes the bytes that are here, and the total."""
    from tqdm import tqdm

    with tqdm(desc=title, unit="B", unit_scale=True, disable=None) as bar:

        def advance(here: int, total: int) -> None:
            bar.total = total
            bar.update(here - bar.n)  # goes back where a download begins anew

        yield advance
