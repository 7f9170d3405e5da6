"""What stands under the table: how it was scored, on what, and what is missing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence

from civil_rgbd.benchmark.protocol import NEAR_DEG, NEAR_M, SAME
from civil_rgbd.benchmark.table import TableRow
from civil_rgbd.evaluation.results import in_words


def caption(rows: Sequence[TableRow], test_bridge: str) -> str:
    """Say what the table shows."""
    seeds = sorted({seed for row in rows for seed in row.seeds})
    frames = span({seed: count for row in rows for seed, count in row.frames[SAME].items()})
    marked = any(row.seen.in_words() for row in rows)
    alone = len(seeds) == 1
    return (
        f"{_what_a_number_is(seeds)} on bridge {test_bridge}, which no model without shots has "
        f"seen{', but where its row says so' * marked}; each metric is taken per image, then "
        "averaged over images. Every number of shots of a seed is scored on the same "
        f"{frames} frames, which are no shots. Beside it AbsRel on the remainder (all "
        "frames but the shots, as the paper scores) and on the remainder apart (without frames "
        f"within {NEAR_M:g} m and {NEAR_DEG:g} deg of a shot), each with the number of frames that "
        f"it rests on{', least to most over seeds' * (not alone)}: remainder below apart is "
        "leakage by overlap. Gain is AbsRel taken off by the shots, "
        f"{'against the run' if alone else 'each seed against its own run'} without."
    )


def _what_a_number_is(seeds: Sequence[int]) -> str:
    if len(seeds) == 1:
        return f"One run of each model (seed {seeds[0]}: no mean, and no deviation to judge by)"
    return f"Mean ± standard deviation over {len(seeds)} seeds ({', '.join(map(str, seeds))})"


def span(frames: Mapping[int, int]) -> str:
    """Return numbers of frames, from least to most over seeds.

    >>> span({0: 40, 1: 40}), span({0: 8, 1: 12}), span({})
    ('40', '8-12', '-')
    """
    if not frames:
        return "-"
    least, most = min(frames.values()), max(frames.values())
    return str(least) if least == most else f"{least}-{most}"


def notes(rows: Sequence[TableRow]) -> list[str]:
    """Say what failed, what each row rests on, which splits and which software: a line each."""
    lines = [*_failures(rows), *_seen(rows), *map(_counts, rows), *_splits(rows)]
    return [*lines, f"Software: {in_words(rows[0].software)}."]


def _failures(rows: Sequence[TableRow]) -> Iterator[str]:
    for row in rows:
        for seed, cause in row.failed.items():
            yield (
                f"FAILED: {row.model}, {row.shots} shots, seed {seed} is not in the table: "
                f"{' '.join(cause.split())}. The same command takes up what failed."
            )


def _seen(rows: Sequence[TableRow]) -> Iterator[str]:
    for row in rows:
        if row.seen.in_words():
            yield (
                f"SEEN: {row.model}, or one that its first weights are of, was "
                f"{row.seen.in_words()}."
            )


def _counts(row: TableRow) -> str:
    """Add up what was scored over seeds, on the frames of the headline."""
    counts = row.counts[SAME].values()
    total = {name: sum(one[name] for one in counts) for name in next(iter(counts), {})}
    name = f"{row.model}, {row.shots} shots"
    if not total:
        return f"{name}: nothing was scored."
    images = total["images"] - total["images_skipped"]
    return (
        f"{name}, same frames, seed{'s' * (len(row.seeds) > 1)} "
        f"{', '.join(map(str, row.seeds))}: {images} images and "
        f"{total['pixels']} pixels scored, {total['images_skipped']} images skipped with "
        f"{total['pixels_skipped']} pixels; of the predictions {total['clamped_low']} raised to "
        f"the minimum, {total['clamped_high']} lowered to the maximum, {total['prediction_nan']} "
        f"NaN, {total['prediction_infinite']} infinite."
    )


def _splits(rows: Sequence[TableRow]) -> Iterator[str]:
    found = {(seed, row.shots): sha for row in rows for seed, sha in row.splits.items()}
    for (seed, shots), sha in sorted(found.items()):
        yield f"Split of seed {seed}, {shots} shots: {sha}"
