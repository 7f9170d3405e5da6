"""What a model has seen: the frames of its own run, and of the runs that its weights come from."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Final

from civil_rgbd.baselines.identity import run_folder_of
from civil_rgbd.domain.split import FramesOf, Split
from civil_rgbd.errors import FormatError
from civil_rgbd.format.documents import read_document
from civil_rgbd.format.split_files import read_split

SPLIT_FILE: Final = "split.json"
"""The frames that train and that are scored, in a run's folder."""

RUN_FILE: Final = "run.json"
"""What a run is, in its folder: recipe, seed, split, and what its first weights had seen."""

FIRST_WEIGHTS: Final = "first_weights"
"""The key of that document which holds a :class:`Lineage`; null for weights of the recipe."""


@dataclass(frozen=True, slots=True)
class Lineage:
    """What some weights were trained with, by their own run and by those before it.

    Attributes:
        name: what the weights are called.
        trained_with: frame ids by bridge.
        unknown: names of weights whose frames nobody wrote down.
    """

    name: str
    trained_with: FramesOf
    unknown: tuple[str, ...] = ()

    def to_document(self) -> dict[str, Any]:
        """Turn it into JSON values."""
        frames = {bridge: sorted(ids) for bridge, ids in sorted(self.trained_with.items())}
        return {"name": self.name, "trained_with": frames, "unknown": list(self.unknown)}


@dataclass(frozen=True, slots=True)
class Seen:
    """What a model has seen of the bridges that it is scored on.

    Attributes:
        trained: how many of their frames it, or weights before it, was trained with.
        scored: how many of those are scored.
        unknown: names of weights whose frames nobody wrote down.
    """

    trained: int = 0
    scored: int = 0
    unknown: tuple[str, ...] = ()

    def to_document(self) -> dict[str, Any]:
        """Turn it into JSON values."""
        return asdict(self) | {"unknown": list(self.unknown)}

    def in_words(self, bridges: str = "this bridge") -> str:
        """Say it; empty when there is nothing to say.

        Args:
            bridges: what the scored bridges are called.

        >>> Seen(trained=10, scored=2).in_words()
        'trained with 10 frames of this bridge, 2 of them scored'
        """
        parts = []
        if self.trained:
            parts.append(
                f"trained with {self.trained} frames of {bridges}, {self.scored} of them scored"
            )
        if self.unknown:
            names = ", ".join(self.unknown)
            parts.append(f"started from {names}, and nobody knows what that was trained with")
        return "; ".join(parts)


def seen_from(document: Mapping[str, Any]) -> Seen:
    """Turn what :meth:`Seen.to_document` made back."""
    return Seen(document["trained"], document["scored"], tuple(document["unknown"]))


def lineage_of(location: str | Path) -> Lineage | None:
    """Return what a run has seen; None for what is no run.

    Args:
        location: a run folder or its ``model.pt``, or any other model.

    Raises:
        FormatError: a document of the run is damaged.
    """
    folder = run_folder_of(location)
    if folder is None or not (folder / SPLIT_FILE).is_file():
        return None
    own = Lineage(folder.resolve().name, read_split(folder / SPLIT_FILE).train)
    path = folder / RUN_FILE
    before = read_document(path).get(FIRST_WEIGHTS) if path.is_file() else None
    return own if before is None else _joined(own, _lineage_from(before, where=path))


def lineage_of_weights(weights: Path) -> Lineage:
    """Return what weights have seen that a run starts from.

    Args:
        weights: a run folder, its ``model.pt``, or any file of weights.

    Raises:
        FormatError: a document of their run is damaged.
    """
    known = lineage_of(weights)
    return known or Lineage(weights.name, {}, unknown=(weights.name,))


def seen_of(lineage: Lineage | None, scored: FramesOf) -> Seen:
    """Compare what a model has seen with what is scored.

    Args:
        lineage: of the model; None for what is no run.
        scored: frame ids by bridge.
    """
    if lineage is None:
        return Seen()
    trained = {bridge: set(lineage.trained_with.get(bridge, ())) for bridge in scored}
    both = sum(len(trained[bridge].intersection(ids)) for bridge, ids in scored.items())
    return Seen(sum(map(len, trained.values())), both, lineage.unknown)


def run_identity_of(location: str | Path) -> Mapping[str, Any] | None:
    """Return recipe, seed, split and data of a run, as hashes; None for what is no run.

    Raises:
        FormatError: ``run.json`` is damaged.
    """
    folder = run_folder_of(location)
    if folder is None or not (folder / RUN_FILE).is_file():
        return None
    identity: Mapping[str, Any] | None = read_document(folder / RUN_FILE).get("identity")
    return identity


def split_of_run(location: str | Path) -> Split | None:
    """Return the split that a run was trained with; None for what is no run.

    Args:
        location: a run folder or its ``model.pt``, or any other model.

    Raises:
        FormatError: the split file is damaged.
    """
    folder = run_folder_of(location)
    if folder is None or not (folder / SPLIT_FILE).is_file():
        return None
    return read_split(folder / SPLIT_FILE)


def _lineage_from(document: object, *, where: object) -> Lineage:
    try:
        assert isinstance(document, Mapping)  # noqa: S101  # answered below, as the rest is
        frames = {str(name): tuple(ids) for name, ids in document["trained_with"].items()}
        return Lineage(str(document["name"]), frames, tuple(document["unknown"]))
    except (AssertionError, AttributeError, KeyError, TypeError) as error:
        raise FormatError(
            f"{FIRST_WEIGHTS} does not say what the weights were trained with",
            where=where,
            fix="copy the run's folder again, or train it again",
        ) from error


def _joined(own: Lineage, before: Lineage) -> Lineage:
    frames = {
        bridge: tuple(
            sorted({*own.trained_with.get(bridge, ()), *before.trained_with.get(bridge, ())})
        )
        for bridge in sorted({*own.trained_with, *before.trained_with})
    }
    return Lineage(own.name, frames, before.unknown)
