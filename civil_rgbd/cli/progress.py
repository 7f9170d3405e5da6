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


@contextmanager
def step_bar(title: str) -> Iterator[Callable[[int, int, float], object]]:
    """Show one bar of training; the callback takes the step, the steps in all, and the loss."""
    from tqdm import tqdm

    with tqdm(desc=title, unit="step", disable=None) as bar:

        def advance(step: int, steps: int, loss: float) -> None:
            if bar.total is None:
                bar.initial = step - 1  # a run that is gone on with: speed counts from here
                bar.n = step - 1
            bar.total = steps
            bar.set_postfix(loss=f"{loss:.3f}", refresh=False)
            bar.update(step - bar.n)

        yield advance


@contextmanager
def cell_bar(title: str) -> Iterator[Callable[[str, int], object]]:
    """Show one bar; the callback takes the name of what is done, and how many there are."""
    from tqdm import tqdm

    with tqdm(desc=title, unit="run", disable=None) as bar:

        def advance(name: str, total: int) -> None:
            bar.total = total
            bar.set_postfix_str(name, refresh=False)
            bar.update(1)

        yield advance
