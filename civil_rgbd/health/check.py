"""Is this recording fit? Everything that can be told before leaving the site, in seconds."""

from __future__ import annotations

import pickle
from collections import deque
from collections.abc import Callable, Collection, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial

from civil_rgbd.domain.inspection import RecordingSummary, TopicSummary
from civil_rgbd.domain.recipe import Recipe
from civil_rgbd.domain.recording import Recording, RecordingOptions
from civil_rgbd.errors import RecordingError
from civil_rgbd.health.checks import CHECKS, Figure
from civil_rgbd.health.coverage import coverage_figures
from civil_rgbd.health.direction import compare_directions
from civil_rgbd.health.extrinsics import extrinsics_figure
from civil_rgbd.health.inspection import choose
from civil_rgbd.health.offset_figures import change_figures, largest_of_each, offset_figure
from civil_rgbd.health.pictures import OF_PICTURES, look_at_pictures, picture_figures
from civil_rgbd.health.rates import common_span, rate_figures, timing_figures, unknown_figures
from civil_rgbd.health.rates import drift_figure as clock_figure
from civil_rgbd.health.sampling import Stretch, image_stamps, stretch_starts, stretches_of
from civil_rgbd.health.steadiness import drift_figure, jump_figures
from civil_rgbd.health.tracks import Pair, pairs_of
from civil_rgbd.health.turning import time_offset
from civil_rgbd.health.views import Views, viewer_of

_OF_POSES = ("pose-rate", "pose-gap", "pose-jump", "pose-jerk")

_OF_MOUNTING = frozenset({"clock-drift", "time-offset", "extrinsics", "rig-inverted"})
_OF_STRETCHES = _OF_MOUNTING | {"pose-drift"}

Seen = list[tuple[Stretch, tuple[Pair, ...]]]
Task = Callable[["CheckInput"], Iterator[Figure]]


@dataclass(frozen=True, slots=True, eq=False)
class CheckInput:
    """A recording, and what else is known of it.

    Attributes:
        recording: opened; without poses, as if the LiDAR stood still.
        posed: whether it has poses.
        summary: what it holds; None of sources that are not inspected.
        options: with which it was opened.
        why_not_posed: in words.
    """

    recording: Recording
    posed: bool
    summary: RecordingSummary | None
    options: RecordingOptions
    why_not_posed: str = "the recording has no poses yet"


def check_recording(
    given: CheckInput, recipe: Recipe, codes: Collection[str] = CHECKS.keys()
) -> tuple[Figure, ...]:
    """Take every figure of :data:`civil_rgbd.health.checks.CHECKS`, in their order.

    Args:
        given: the recording.
        recipe: what coverage is expected with.
        codes: figures that are wanted; what no other needs is not computed.
    """
    # A recording that can be sent to a worker opens its files there anew: so does a copy of it,
    # which may then be read beside the first. Decoding and numpy let go of the interpreter.
    other = replace(given, recording=pickle.loads(pickle.dumps(given.recording)))  # noqa: S301  # our own
    views = Views(given.recording)
    wanted = set(codes)
    with ThreadPoolExecutor(1) as thread:
        seen = _seen(given, other, views, thread) if given.posed and wanted & _OF_STRETCHES else []
        stretches = tuple(stretch for stretch, _ in seen)
        pairs = tuple(pair for _, followed in seen for pair in followed)
        # What needs nothing of the others: done by whoever has time, main thread or second.
        tasks: dict[Task, Collection[str]] = {
            _pictures: OF_PICTURES,
            partial(_drift, stretches): ("pose-drift",),
            partial(_coverage, recipe): ("frames", "coverage"),
        }
        left = deque(task for task, of in tasks.items() if wanted.intersection(of))
        there = thread.submit(_work_off, left, other)
        figures = [*_rates(given), *_poses(given)]
        if wanted & _OF_MOUNTING:
            figures += _mounting(given, stretches, pairs, views)
        figures += [*_work_off(left, given), *there.result()]
    place = {code: number for number, code in enumerate(CHECKS)}
    figures = largest_of_each(figure for figure in figures if figure.code in wanted)
    return tuple(sorted(figures, key=lambda figure: place[figure.code]))


def _work_off(left: deque[Task], given: CheckInput) -> list[Figure]:
    figures: list[Figure] = []
    while True:
        try:
            task = left.popleft()
        except IndexError:
            return figures
        figures += task(given)


def _seen(given: CheckInput, other: CheckInput, views: Views, thread: ThreadPoolExecutor) -> Seen:
    """Read the stretches, and follow their features; every other one in the second thread."""
    starts = stretch_starts(given.recording)
    there = thread.submit(_seen_from, other.recording, starts[1::2], views.through(other.recording))
    here = _seen_from(given.recording, starts[::2], views)
    return sorted((*here, *there.result()), key=lambda seen: seen[0].start_ns)


def _seen_from(recording: Recording, starts: Sequence[int], views: Views) -> Seen:
    # One by one: a stretch's images lie in the chunks that were just read for its points.
    return [
        (stretch, pairs_of(recording, (stretch,), views))
        for stretch in stretches_of(recording, starts)
    ]


def _rates(given: CheckInput) -> Iterator[Figure]:
    scans_ns, images_ns = given.recording.scan_stamps_ns, image_stamps(given.recording)
    yield from rate_figures("lidar", scans_ns, common_span(images_ns))
    yield from rate_figures("image", images_ns, common_span(scans_ns))
    topics: dict[str, TopicSummary] = {}
    imu: tuple[TopicSummary, ...] = ()
    if given.summary is not None:
        chosen = choose(given.summary, given.options)
        imu = tuple(given.summary.of_role("imu"))
        for role, found in (("lidar", chosen.lidars), ("image", chosen.images), ("imu", imu)):
            if len(found) == 1:
                topics[role] = found[0]
    if len(imu) == 1 and imu[0].stamped is not None:
        span = common_span(scans_ns)
        yield from timing_figures("imu", imu[0].messages, imu[0].stamped, span)
    else:
        yield from unknown_figures("imu", _why_no_imu(imu))
    yield clock_figure(given.summary, topics)


def _why_no_imu(imu: tuple[TopicSummary, ...]) -> str:
    if len(imu) > 1:
        return f"{len(imu)} IMUs: {', '.join(topic.name for topic in imu)}"
    return "its messages have no stamps" if imu else "no IMU"


def _pictures(given: CheckInput) -> Iterator[Figure]:
    viewer = viewer_of(given.recording.rig.camera)
    yield from picture_figures(look_at_pictures(given.recording, viewer))


def _poses(given: CheckInput) -> Iterator[Figure]:
    if not given.posed:
        yield from (Figure(code, None, given.why_not_posed) for code in _OF_POSES)
        return
    recording = given.recording
    # Where only one of the two measures, no frame is made, and no pose is missed.
    both = common_span(recording.scan_stamps_ns, image_stamps(recording))
    yield from rate_figures("pose", recording.trajectory.stamps_ns, both)
    yield from jump_figures(recording.trajectory)


def _drift(stretches: Sequence[Stretch], given: CheckInput) -> Iterator[Figure]:
    if given.posed:
        yield drift_figure(stretches)
    else:
        yield Figure("pose-drift", None, given.why_not_posed)


def _mounting(
    given: CheckInput, stretches: tuple[Stretch, ...], pairs: tuple[Pair, ...], views: Views
) -> Iterator[Figure]:
    recording = given.recording
    if not given.posed:
        yield Figure("time-offset", None, given.why_not_posed)
        yield Figure("extrinsics", None, given.why_not_posed)
        yield _inverted(recording)
        return
    offset = time_offset(recording, pairs)
    yield offset_figure(recording, offset)
    yield from change_figures(offset.change)
    if offset.offset_s is None:
        # Unless it turns, an image's instant and the camera's turn cannot be told apart.
        yield Figure("extrinsics", None, offset.why_not)
        yield _inverted(recording)
        return
    turned = extrinsics_figure(recording, stretches, pairs, views, offset.offset_s)
    yield turned
    yield _inverted(recording) if turned.value is None else Figure("rig-inverted", 0.0)


def _inverted(recording: Recording) -> Figure:
    try:
        report = compare_directions(recording)
    except RecordingError as error:
        return Figure("rig-inverted", None, error.what)
    if report.misses:
        return Figure("rig-inverted", 1.0, "hardly any point falls into the images as given")
    if report.verdict == "undecided":
        return Figure("rig-inverted", None, "the images do not tell the two apart")
    said = (
        f"{report.given.contrast:.2f} times chance as given, {report.inverse.contrast:.2f} turned"
    )
    return Figure("rig-inverted", float(report.verdict == "inverse"), said)


def _coverage(recipe: Recipe, given: CheckInput) -> Iterator[Figure]:
    if given.posed:
        yield from coverage_figures(given.recording, recipe)
    else:
        yield from (Figure(code, None, given.why_not_posed) for code in ("frames", "coverage"))
