"""The report that a maintainer reads in minutes: one HTML page that asks for nothing outside."""

from __future__ import annotations

import datetime as dt
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from html import escape

import numpy as np

from civil_rgbd.constants import NS_PER_S
from civil_rgbd.contribution.charts import axis_over, histogram, line_chart, track_chart
from civil_rgbd.contribution.figures import (
    BLOCK_PX,
    DepthFigures,
    Track,
    depth_figures,
    spread,
    track_of,
)
from civil_rgbd.contribution.page_style import STYLE
from civil_rgbd.contribution.pictures import (
    frame_uri,
    overlay_uri,
    scale_colours,
    scale_uri,
    share_map_uri,
)
from civil_rgbd.contribution.statements import making_rows, statement_rows
from civil_rgbd.domain.bridge import OLD_POINTS_S
from civil_rgbd.format.reader import Bridge
from civil_rgbd.validation.report import Report

SHOWN_FRAMES = 6

Rows = Iterable[tuple[str, str]]


@dataclass(frozen=True, slots=True)
class ArchiveWords:
    """What the page says of the archive.

    Attributes:
        name: its file name.
        size_bytes: its length.
        sha256: of its bytes.
        entry: the registry entry, as JSON.
    """

    name: str
    size_bytes: int
    sha256: str
    entry: str


def report_page(bridge: Bridge, report: Report, archive: ArchiveWords) -> str:
    """Return the page; the same bridge gives the same page.

    Args:
        bridge: a bridge that validates, with at least one frame.
        report: what validation found.
        archive: what it was packed into.

    Raises:
        FormatError: an image is missing or damaged.
    """
    info = bridge.manifest.info
    title = f"{info.bridge_id} {bridge.manifest.data_version}"
    track = track_of(bridge.rows, bridge.manifest.map_up)
    depth = depth_figures(bridge)
    body = [
        f"<h1>{escape(title)}<small>{escape(info.name or '')}</small></h1>",
        _at_a_glance(bridge, report, track),
        _section("Findings", _findings(report)),
        _section("What the contributor states", _table(statement_rows(bridge.manifest))),
        _section("Track", _track(bridge, track)),
        _section(f"{SHOWN_FRAMES} frames, evenly spread", *_frames(bridge, depth)),
        _section(
            f"Coverage, density and range of {depth.frames} frames, evenly spread",
            _charts(_depth(depth)),
        ),
        _section("Health", _spacing_table(track), _charts(_health(bridge, track))),
        _section("How it was made", _table(making_rows(bridge.manifest))),
        _section("What was counted", _table(_counts(bridge))),
        _section("Archive", *_archive(archive)),
    ]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        # Whatever a contributor wrote: nothing runs, nothing is asked for outside.
        '<meta http-equiv="Content-Security-Policy" '
        "content=\"default-src 'none'; img-src data:; style-src 'unsafe-inline'\">\n"
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def _section(title: str, *parts: str) -> str:
    return f"<section>\n<h2>{escape(title)}</h2>\n" + "\n".join(parts) + "\n</section>"


def _table(rows: Rows) -> str:
    cells = (f"<tr><th>{escape(key)}</th><td>{escape(value)}</td></tr>" for key, value in rows)
    return "<table>" + "".join(cells) + "</table>"


def _charts(figures: Iterable[str]) -> str:
    return '<div class="charts">' + "\n".join(figures) + "</div>"


def _figure(drawing: str, words: str) -> str:
    return f"<figure>{drawing}<figcaption>{escape(words)}</figcaption></figure>"


def _image(uri: str, words: str, kind: str = "") -> str:
    return f'<img src="{uri}" alt="{escape(words)}" class="{kind}">'


def _at_a_glance(bridge: Bridge, report: Report, track: Track) -> str:
    manifest, shares = bridge.manifest, [row.valid_share for row in bridge.rows]
    values = [
        ("frames", f"{len(bridge.rows):,}"),
        ("walked", f"{track.along_m[-1]:,.1f} m in {track.seconds[-1]:,.1f} s"),
        ("image", f"{bridge.camera.width_px} x {bridge.camera.height_px}"),
        ("depth in", f"{_percent(float(np.mean(shares)))} of the pixels"),
        ("recipe", manifest.recipe.name if manifest.recipe else "none"),
        ("origin", manifest.origin),
        ("licence", manifest.info.licence),
        ("findings", f"errors: {report.errors}, warnings: {report.warnings}"),
    ]
    cells = (f"<div><dt>{escape(k)}</dt><dd>{escape(v)}</dd></div>" for k, v in values)
    return "<dl>" + "".join(cells) + "</dl>"


def _findings(report: Report) -> str:
    if not report.findings:
        return "<p>Nothing to complain of: the format and the contribution profile are met.</p>"
    return _table(
        (f"{finding.level}: {finding.code}", f"{finding.place}: {finding.message} ({finding.fix})")
        for finding in report.findings
    )


def _track(bridge: Bridge, track: Track) -> str:
    up = "map_up" if bridge.manifest.map_up else "z, since map_up is not known"
    return _figure(
        track_chart(track.plan_m, track.looking, scale_colours(64)),
        f"From above (up is {up}); dark is early, light is late; grey rays: where the camera "
        "looked.",
    )


def _frames(bridge: Bridge, depth: DepthFigures) -> Iterator[str]:
    near_m, far_m = depth.near_far_m
    scale = _image(scale_uri(), "scale of colours", "scale")
    yield (
        f'<p class="legend">{far_m:.1f} m {scale} {near_m:.1f} m'
        " &nbsp; Grey: nothing measured. Measured pixels are drawn larger than they are. "
        "Edges of the structure and of the colours should agree.</p>"
    )
    first_ns = bridge.rows[0].stamp_ns
    for row in spread(bridge.rows, SHOWN_FRAMES):
        rgb, depth_m = bridge.read_rgb(row), bridge.read_depth(row)
        words = (
            f"frame {row.frame_id}, {(row.stamp_ns - first_ns) / NS_PER_S:.1f} s: depth in "
            f"{_percent(row.valid_share)} of the pixels, "
            f"{row.depth_min_m:.2f} to {row.depth_max_m:.2f} m"
        )
        pair = _image(frame_uri(rgb), f"colour of frame {row.frame_id}") + _image(
            overlay_uri(rgb, depth_m, depth.near_far_m), f"depth of frame {row.frame_id}"
        )
        yield _figure(f'<div class="pair">{pair}</div>', words)


def _depth(depth: DepthFigures) -> Iterator[str]:
    highest = float(depth.coverage.max())
    scale = _image(scale_uri(), "scale of colours", "scale")
    yield (
        '<figure class="tall">'
        + _image(share_map_uri(depth.coverage, highest), "coverage by place in the image", "map")
        + f'<figcaption><span class="legend">0 % {scale} {_percent(highest)}</span> &nbsp; '
        "Coverage: share of measured pixels, by their place in the image.</figcaption></figure>"
    )
    yield _figure(
        histogram(
            100 * depth.density_edges,
            depth.density_shares,
            f"measured pixels in a block of {BLOCK_PX} x {BLOCK_PX}, %",
        ),
        f"Density, over the blocks that hold any depth; {_percent(depth.empty_blocks)} hold none.",
    )
    yield _figure(
        histogram(depth.range_edges_m, depth.range_shares, "depth, m"),
        "Range of the measured pixels; the few beyond the right edge are counted in the last bar.",
    )


def _spacing_table(track: Track) -> str:
    if len(track.seconds) < 2:
        return "<p>One frame: there is nothing between frames to look at.</p>"
    speed = track.spacing_m / np.maximum(track.gap_s, 1e-9)
    return _table(
        [
            ("spacing of frames", _spread_words(track.spacing_m, "m")),
            ("time between frames", _spread_words(track.gap_s, "s")),
            ("speed between frames", _spread_words(speed, "m/s")),
        ]
    )


def _health(bridge: Bridge, track: Track) -> Iterator[str]:
    seconds = axis_over(track.seconds, "time since the first frame, s")
    if len(track.seconds) > 1:
        spacing = axis_over(track.spacing_m, "spacing, m", from_zero=True)
        yield _figure(
            line_chart(track.seconds[1:], track.spacing_m, seconds, spacing),
            "Distance to the frame before: steps show where poses or images are missing.",
        )
        gap = axis_over(track.gap_s, "gap, s", from_zero=True)
        yield _figure(
            line_chart(track.seconds[1:], track.gap_s, seconds, gap),
            "Time since the frame before: peaks are gaps in the poses, the images or the walk.",
        )
        height = axis_over(track.height_m, "height, m")
        yield _figure(
            line_chart(track.seconds, track.height_m, seconds, height),
            "Height above the first frame: a walk is level but for steps and slopes.",
        )
    shares = 100 * np.array([row.valid_share for row in bridge.rows])
    share = axis_over(shares, "pixels with depth, %", from_zero=True)
    yield _figure(
        line_chart(track.seconds, shares, seconds, share),
        "Share of pixels with depth, frame by frame.",
    )


def _percent(share: float) -> str:
    return f"{100 * share:.1f} %"


def _spread_words(values: np.ndarray[tuple[int, ...], np.dtype[np.float64]], unit: str) -> str:
    low, middle, high = np.quantile(values, [0.0, 0.5, 1.0])
    return f"{low:.2f} to {high:.2f} {unit}, half below {middle:.2f} {unit}"


def _counts(bridge: Bridge) -> Iterator[tuple[str, str]]:
    counts = bridge.manifest.counts
    yield "images seen", f"{counts.images_seen:,}"
    yield "frames kept", f"{counts.frames_kept:,}"
    for reason, count in counts.dropped.items():
        yield f"images dropped: {reason}", f"{count:,}"
    if counts.points_read is not None:
        yield "points read", f"{counts.points_read:,} in {counts.scans_read or 0:,} scans"
    for reason, count in counts.points_dropped.items():
        yield f"points dropped: {reason}", f"{count:,}"
    for what, count in counts.skipped.items():
        yield f"skipped: {what}", f"{count:,}"
    if counts.mean_points_in_view is not None:
        yield "points in view, mean", f"{counts.mean_points_in_view:,.0f}"
    if counts.mean_age_span_s is not None:
        yield "oldest to newest point, mean", f"{counts.mean_age_span_s:.2f} s"
    if counts.mean_newest_age_s is not None and counts.max_newest_age_s is not None:
        mean, most = counts.mean_newest_age_s, counts.max_newest_age_s
        yield "image to newest point", f"{mean:.3f} s on average, {most:.3f} s at most"
    if counts.frames_with_old_points:
        old = f"{counts.frames_with_old_points} of {counts.frames_kept} frames"
        yield "old points", f"{old} have no point within {OLD_POINTS_S} s of their image"
    first, last = bridge.rows[0].stamp_ns, bridge.rows[-1].stamp_ns
    yield "stamps", f"{_time_words(first)} to {_time_words(last)}"


def _time_words(stamp_ns: int) -> str:
    try:
        moment = dt.datetime(1970, 1, 1) + dt.timedelta(microseconds=stamp_ns // 1000)  # noqa: DTZ001  # UTC by the format
    except OverflowError:
        return f"{stamp_ns} ns"
    return f"{moment:%Y-%m-%d %H:%M:%S} UTC"


def _archive(archive: ArchiveWords) -> Iterator[str]:
    yield _table(
        [
            ("file", archive.name),
            ("size", f"{archive.size_bytes:,} bytes"),
            ("SHA-256", archive.sha256),
        ]
    )
    yield "<p>For the registry, once the archive has an address:</p>"
    yield f"<pre>{escape(archive.entry)}</pre>"
