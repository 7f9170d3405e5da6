"""docs/format.md is what the schemas say."""

from __future__ import annotations

import importlib.util
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]


def test_the_page_is_made_from_the_schemas() -> None:
    spec = importlib.util.spec_from_file_location("make_format", ROOT / "docs" / "make_format.py")
    assert spec is not None
    assert spec.loader is not None
    make_format = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(make_format)

    page = (ROOT / "docs" / "format.md").read_text(encoding="utf-8")

    assert page == make_format.page(), "run `python docs/make_format.py`"
