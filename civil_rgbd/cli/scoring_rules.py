"""Options that say which pixels are scored."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from civil_rgbd.evaluation.metrics import MetricRules


def rules_from(
    min_depth_m: float | None, max_depth_m: float | None, *, median_scaling: bool = False
) -> MetricRules:
    """Turn the options into rules; what is not given has its default.

    Raises:
        UsageError: they make no range.
    """
    from civil_rgbd.errors import UsageError
    from civil_rgbd.evaluation.metrics import MetricRules

    limits = {"min_depth_m": min_depth_m, "max_depth_m": max_depth_m}
    given = {name: value for name, value in limits.items() if value is not None}
    try:
        return MetricRules(**given, median_scaling=median_scaling)  # type: ignore[arg-type]  # only the limits are in it
    except ValueError as error:
        raise UsageError(
            str(error), where="--min-depth, --max-depth", fix="give 0 < min < max"
        ) from error
