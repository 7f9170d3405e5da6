"""Taking a set over, as the command does."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from civil_rgbd.domain.bridge import BridgeInfo, Software
from civil_rgbd.format.reader import Bridge, read_bridge
from civil_rgbd.importers.convert import ConvertOptions, convert_set
from civil_rgbd.importers.registry import open_rendered_set
from civil_rgbd.importers.rendered_set import ImportOptions

SOFTWARE = Software(civil_rgbd="0", python="3", packages={})

Take = Callable[..., Bridge]


@pytest.fixture
def take(tmp_path: Path) -> Take:
    """Convert a folder into a bridge of a dataset, and read it."""

    def convert(source: Path, importer: str, *, overwrite: bool = False, **options: Any) -> Bridge:
        importing = ImportOptions(**options)
        opened = open_rendered_set(source, importer, importing)
        writing = ConvertOptions(software=SOFTWARE, overwrite=overwrite)
        info = BridgeInfo("B3", licence="CC0-1.0")
        report = convert_set(opened, tmp_path / "dataset", info, importing, writing)
        return read_bridge(report.folder)

    return convert
