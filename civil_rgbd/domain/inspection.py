"""What a raw recording holds, before anybody asks whether a build can use it."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import NDArray

NOT_OPENED: Final = "not opened"
"""In place of the converter: the source tells nothing before it is opened, and it cannot be."""


@dataclass(frozen=True, slots=True)
class CloudFacts:
    """What the first point cloud of a topic shows.

    Attributes:
        points: how many it holds.
        fields: field name and numpy type without byte order, in their order.
        point_time: how its points' own times are read, in words; None when they have none.
        unclear_time: a field looks like a time in an unknown unit: the error says which.
    """

    points: int
    fields: tuple[tuple[str, str], ...]
    point_time: str | None = None
    unclear_time: str | None = None


@dataclass(frozen=True, slots=True)
class ImageFacts:
    """What the first image of a topic shows.

    Attributes:
        encoding: of an Image its encoding, of a CompressedImage its format.
        photograph: False for depth images.
        width_px: columns; 0 when it cannot be decoded.
        height_px: rows; 0 when it cannot be decoded.
        fault: why it cannot be decoded.
    """

    encoding: str
    photograph: bool = True
    width_px: int = 0
    height_px: int = 0
    fault: str | None = None


@dataclass(frozen=True, slots=True)
class CameraFacts:
    """What the first CameraInfo of a topic says.

    Attributes:
        width_px: columns.
        height_px: rows.
        model: its distortion model.
        calibrated: False when K is zero.
    """

    width_px: int
    height_px: int
    model: str
    calibrated: bool


@dataclass(frozen=True, slots=True)
class Timing:
    """The instants of a topic's messages.

    Attributes:
        first_ns: the earliest.
        last_ns: the latest.
        period_ns: the median step from one to the next; 0 for fewer than two.
        longest_gap_ns: the longest step.
        longest_gap_at_ns: where that begins.
        gaps: steps of more than three periods.
        backward: messages stamped earlier than the one before.
    """

    first_ns: int
    last_ns: int
    period_ns: int = 0
    longest_gap_ns: int = 0
    longest_gap_at_ns: int = 0
    gaps: int = 0
    backward: int = 0

    @property
    def rate_hz(self) -> float:
        """Messages a second; 0 when it cannot be told."""
        return 1e9 / self.period_ns if self.period_ns else 0.0


@dataclass(frozen=True, slots=True)
class TopicSummary:
    """One topic of a recording.

    Attributes:
        name: as recorded.
        type_name: its messages' type, without ``/msg/``.
        role: lidar, image, camera_info, imu, pose or tf; empty for what no build reads.
        messages: how many there are.
        encoding: how messages are serialised; only ``cdr`` and ``ros1`` are read.
        logged: when they were recorded; None without messages.
        stamped: what their headers say; None without headers, or where none was read.
        log_minus_stamp_ns: smallest, median and largest; None without headers.
        lateness_drift_ns: how much log time minus stamp grows over the recording, and its standard
            error: whether the sensor's clock keeps up with the recorder's. None where too few tell.
        frames: frame ids of their headers, most frequent first.
        children: child frame ids of poses.
        fault: the first message that breaks its own layout, and how.
        unstamped: why its messages have no stamps, where these come from a list beside them.
        cloud: for point clouds.
        image: for images.
        camera: for camera models.
    """

    name: str
    type_name: str
    role: str = ""
    messages: int = 0
    encoding: str = "cdr"
    logged: Timing | None = None
    stamped: Timing | None = None
    log_minus_stamp_ns: tuple[int, int, int] | None = None
    lateness_drift_ns: tuple[int, int] | None = None
    frames: tuple[str, ...] = ()
    children: tuple[str, ...] = ()
    fault: str | None = None
    unstamped: str | None = None
    cloud: CloudFacts | None = None
    image: ImageFacts | None = None
    camera: CameraFacts | None = None


@dataclass(frozen=True, slots=True)
class TopicListing:
    """The topics of a recording, without a look into their messages.

    Attributes:
        name: file name without folders.
        converter: the converter that looked.
        size_bytes: of all its files.
        topics: by name; only name, type, role, encoding, count and log times are known.
        by_index: the recording's own index says so, and no message was read.
        damage: what could not be read, in words; an index knows of none.
        remarks: what is odd though nothing is lost.
    """

    name: str
    converter: str
    size_bytes: int
    topics: tuple[TopicSummary, ...]
    by_index: bool
    damage: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True)
class Refusal:
    """Why a build cannot open the recording as it is: the three parts of the error."""

    what: str
    where: str
    fix: str


@dataclass(frozen=True, slots=True, eq=False)
class RecordingSummary:
    """What a recording holds, whether a build can use it or not.

    Attributes:
        name: file name without folders.
        converter: the converter that looked.
        size_bytes: of all its files.
        messages: how many could be read, of all topics.
        logged: when they were recorded; None without messages.
        topics: every topic, also those without messages, by name.
        fixed_links: (parent, child) of tf that do not move.
        moving_links: (parent, child) of tf that move.
        damage: what cannot be read, in words.
        remarks: what is odd though nothing is lost.
        refusal: why ``open_recording`` refuses it with the same options; None when it opens.
        T_lidar_camera: (4, 4) as a build would use it; None when it cannot be opened.
        warnings: what ``open_recording`` remarks.
        lidar_only: the source can hold no more than LiDARs and IMUs: camera, images and poses come
            from files beside it, and its topics are those sensors.
    """

    name: str
    converter: str
    size_bytes: int
    messages: int
    logged: Timing | None
    topics: tuple[TopicSummary, ...]
    fixed_links: tuple[tuple[str, str], ...] = ()
    moving_links: tuple[tuple[str, str], ...] = ()
    damage: tuple[str, ...] = ()
    remarks: tuple[str, ...] = ()
    refusal: Refusal | None = None
    T_lidar_camera: NDArray[np.float64] | None = None
    warnings: tuple[str, ...] = field(default=())
    lidar_only: bool = False

    def of_role(self, role: str) -> list[TopicSummary]:
        """Return the topics of one role that have messages."""
        return [topic for topic in self.topics if topic.role == role and topic.messages]


def timing_of(instants_ns: NDArray[np.int64]) -> Timing | None:
    """Summarise the instants of a topic.

    Args:
        instants_ns: (M,) int64, message order.

    Returns:
        None when there are none.

    >>> timing_of(np.array([0, 10, 20, 90, 100])).longest_gap_ns
    70
    """
    if not len(instants_ns):
        return None
    ordered = np.sort(instants_ns)
    if len(ordered) == 1:
        return Timing(int(ordered[0]), int(ordered[0]))
    steps = np.diff(ordered)
    moving = steps[steps > 0]
    period_ns = int(np.median(moving)) if len(moving) else 0
    longest = int(steps.argmax())
    return Timing(
        first_ns=int(ordered[0]),
        last_ns=int(ordered[-1]),
        period_ns=period_ns,
        longest_gap_ns=int(steps[longest]),
        longest_gap_at_ns=int(ordered[longest]),
        gaps=int((steps > 3 * period_ns).sum()),
        backward=int((np.diff(instants_ns) < 0).sum()),
    )


_BINS: Final = 12
_FEWEST_A_BIN: Final = 4


def lateness_drift(
    logged_ns: NDArray[np.int64], stamped_ns: NDArray[np.int64]
) -> tuple[int, int] | None:
    """Say how much log time minus stamp grows over a recording: a clock that lags makes it grow.

    Messages wait now and then, so that each stretch of time is judged by its prompt ones: the
    quarter that waited least.

    Args:
        logged_ns: (M,) int64.
        stamped_ns: (M,) int64, of the same messages.

    Returns:
        growth and its standard error; None for fewer messages than can tell.

    >>> steps = np.arange(100) * 10**8
    >>> lateness_drift(steps + steps // 1000, steps)
    (9900000, 0)
    """
    if len(logged_ns) < _BINS * _FEWEST_A_BIN:
        return None
    order = np.argsort(logged_ns, kind="stable")
    late = logged_ns[order] - stamped_ns[order]
    since = (logged_ns[order] - logged_ns[order[0]]).astype(np.float64)
    bins = np.array_split(np.arange(len(order)), _BINS)
    at = np.array([since[rows].mean() for rows in bins])
    least = np.array([float(np.quantile(late[rows] - late[0], 0.25)) for rows in bins])
    first, second = np.triu_indices(_BINS, 1)
    if not (at[second] > at[first]).all():
        return None
    slope = float(np.median((least[second] - least[first]) / (at[second] - at[first])))
    left = least - slope * at
    # Of a line through evenly spread values with independent errors: the root of 12 / bins.
    error = 1.4826 * float(np.median(np.abs(left - np.median(left)))) * float(np.sqrt(12 / _BINS))
    return round(slope * since[-1]), round(error)
