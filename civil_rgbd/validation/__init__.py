"""Is a dataset or a bridge folder what the format says? Everything that is not, as findings."""

from civil_rgbd.validation.report import Finding, Report
from civil_rgbd.validation.walk import validate

__all__ = ["Finding", "Report", "validate"]
