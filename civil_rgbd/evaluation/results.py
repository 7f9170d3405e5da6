"""Results as files: JSON for machines, CSV for spreadsheets, Markdown for people."""

from __future__ import annotations

import contextlib
import csv
import io
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any, Final

from civil_rgbd.evaluation.metrics import Scores, image_scores, label_of, metric_names
from civil_rgbd.evaluation.run import Evaluation
from civil_rgbd.format.atomic import writing
from civil_rgbd.format.documents import document_text, write_text
from civil_rgbd.lineage import lineage_of, run_identity_of, seen_from, seen_of

RESULTS: Final = "results.json"
"""Every score; its stem with .md and .csv are the same for people and spreadsheets."""

FRAMES: Final = "frames.csv"
"""The metrics of each frame."""


@dataclass(frozen=True, slots=True)
class Scored:
    """What was scored, and on what.

    Attributes:
        model: what was scored, in the words of the caller.
        data: what it was scored on, in the words of the caller.
        model_sha256: of the model; None where it cannot be known.
        data_sha256: of the frames; None where nobody took it.
        location: where the model is, to say what it has seen; None where that is nowhere.
    """

    model: str
    data: str
    model_sha256: str | None = None
    data_sha256: str | None = None
    location: str | Path | None = None


def results_document(evaluation: Evaluation, scored: Scored) -> dict[str, Any]:
    """Return every score as JSON values; NaN, the score of nothing, becomes null.

    Args:
        evaluation: what came out.
        scored: which model, on which frames.

    Raises:
        FormatError: a document of the model's run is damaged.
    """
    split, location = evaluation.split, scored.location
    lineage = None if location is None else lineage_of(location)
    tests = {name: _test_document(evaluation, name) for name in split.tests}
    return {
        "civil_rgbd_results": 1,
        "model": scored.model,
        "model_sha256": scored.model_sha256,
        "data": scored.data,
        "data_sha256": scored.data_sha256,
        "run": None if location is None else run_identity_of(location),
        "seen": seen_of(lineage, split.scored()).to_document(),
        "software": software(),
        "rules": asdict(evaluation.rules) | {"flip_averaged": evaluation.flip},
        "split": {"sha256": split.sha256(), "origin": dict(split.origin)},
        "tests": tests,
    }


def software() -> dict[str, str]:
    """Return the versions of what scores and of what predicts, where it is installed."""
    names = {"civil_rgbd": "civil-rgbd", "numpy": "numpy", "torch": "torch"}
    found = {}
    for name, package in names.items():
        with contextlib.suppress(PackageNotFoundError):
            found[name] = version(package)
    return found


def in_words(versions: Mapping[str, str]) -> str:
    """Say versions.

    >>> in_words({"civil_rgbd": "0.1.0", "numpy": "2.0"})
    'civil_rgbd 0.1.0, numpy 2.0'
    """
    return ", ".join(f"{name} {number}" for name, number in versions.items())


def _origin(origin: Mapping[str, Any]) -> str:
    told = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in origin.items())
    return f" ({told})" if told else ""


def _test_document(evaluation: Evaluation, test: str) -> dict[str, Any]:
    bridges = sorted(evaluation.split.tests[test])
    return _scores_document(evaluation.scores(test)) | {
        "bridges": {name: _scores_document(evaluation.scores(test, name)) for name in bridges}
    }


def _scores_document(scores: Scores) -> dict[str, Any]:
    ranges = {
        name: {
            "per_image": _finite(one.per_image),
            "pooled": _finite(one.pooled),
            "images": one.images,
            "pixels": one.pixels,
        }
        for name, one in scores.ranges.items()
    }
    return {
        "per_image": _finite(scores.per_image),
        "pooled": _finite(scores.pooled),
        "ranges": ranges,
        "counts": asdict(scores.counts),
    }


def _finite(values: Mapping[str, float]) -> dict[str, float | None]:
    return {name: value if math.isfinite(value) else None for name, value in values.items()}


def write_results(folder: Path, evaluation: Evaluation, scored: Scored) -> dict[str, Any]:
    """Write ``results.json``, ``results.md``, ``results.csv`` and ``frames.csv``; JSON comes last.

    Args:
        folder: is made if need be.
        evaluation: what came out.
        scored: which model, on which frames.

    Returns:
        the JSON document.

    Raises:
        FormatError: a document of the model's run is damaged.
        OutputError: a file cannot be written.
    """
    document = results_document(evaluation, scored)
    with writing(folder):
        folder.mkdir(parents=True, exist_ok=True)
    path = folder / RESULTS
    write_text(path.with_suffix(".md"), results_markdown(document))
    write_text(path.with_suffix(".csv"), _csv(_result_rows(document)))
    write_text(folder / FRAMES, _csv(_frame_rows(evaluation)))
    write_text(path, document_text(document))
    return document


def results_markdown(document: Mapping[str, Any]) -> str:
    """Return the results as a page of Markdown."""
    rules, split = document["rules"], document["split"]
    lines = [
        f"# {document['model']} on {document['data']}",
        "",
        f"Truth strictly between {rules['min_depth_m']:g} and {rules['max_depth_m']:g} m, "
        "predictions clamped to it, no crop"
        + (", scaled by the truth's median" if rules["median_scaling"] else ", no median scaling")
        + (", averaged over flips" if rules["flip_averaged"] else "")
        + f". Images with fewer than {rules['min_valid_px']} such pixels are skipped. "
        f"Split `{split['sha256']}`{_origin(split['origin'])}; {in_words(document['software'])}.",
    ]
    if seen := seen_from(document["seen"]).in_words("the scored bridges"):
        lines += ["", f"The model, or one that its first weights are of, was {seen}."]
    for name, test in document["tests"].items():
        lines += ["", f"## Frames: {name}", "", *_test_lines(test)]
    return "\n".join(lines) + "\n"


def _test_lines(test: Mapping[str, Any]) -> Iterator[str]:
    names = list(test["per_image"])
    yield _table_row(["", *map(label_of, names), "images", "pixels"])
    yield "|" + " --- |" + " ---: |" * (len(names) + 2)
    counts = test["counts"]
    scored = [counts["images"] - counts["images_skipped"], counts["pixels"]]
    yield _table_row(["mean of images", *_numbers(test["per_image"]), *map(str, scored)])
    yield _table_row(["all pixels pooled", *_numbers(test["pooled"]), *map(str, scored)])
    for bridge, one in test["bridges"].items():
        count = one["counts"]["images"] - one["counts"]["images_skipped"]
        cells = [*_numbers(one["per_image"]), str(count), str(one["counts"]["pixels"])]
        yield _table_row([f"{bridge}, mean of images", *cells])
    for span, one in test["ranges"].items():
        cells = [*_numbers(one["pooled"]), str(one["images"]), str(one["pixels"])]
        yield _table_row([f"{span}, pooled", *cells])
    yield ""
    yield "Not scored, or not as they came: " + ", ".join(
        f"{name.replace('_', ' ')} {count}"
        for name, count in counts.items()
        if name not in {"images", "pixels"}
    )


def _table_row(cells: Sequence[str]) -> str:
    return "| " + " | ".join(cells) + " |"


def _numbers(values: Mapping[str, float | None]) -> list[str]:
    return ["-" if value is None else f"{value:.4f}" for value in values.values()]


def _result_rows(document: Mapping[str, Any]) -> Iterator[Sequence[object]]:
    """One value a row: what any program can pivot."""
    yield ("test", "bridge", "range", "averaging", "metric", "value")
    for name, test in document["tests"].items():
        for bridge, one in {"all": test, **test["bridges"]}.items():
            for span, part in {"all": one, **one["ranges"]}.items():
                for averaging in ("per_image", "pooled"):
                    for metric, value in part[averaging].items():
                        yield (name, bridge, span, averaging, metric, value)


def _frame_rows(evaluation: Evaluation) -> Iterator[Sequence[object]]:
    yield ("bridge", "frame", "pixels", *metric_names(evaluation.rules))
    for (bridge, frame), image in evaluation.images.items():
        values = image_scores(image, rules=evaluation.rules).values()
        cells = [value if math.isfinite(value) else None for value in values]
        yield (bridge, frame, image.valid_px, *cells)


def _csv(rows: Iterator[Sequence[object]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()
