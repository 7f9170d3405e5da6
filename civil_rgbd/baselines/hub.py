"""Weights for ``transformers``: from a local folder, or from the hub when it can be reached."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, Final

from civil_rgbd.errors import DownloadError, FormatError, MissingExtraError

_PREPROCESSOR: Final = "preprocessor_config.json"


def require_transformers(what: str) -> None:
    """Refuse to go on without transformers.

    Args:
        what: needs it, for the message.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import transformers  # noqa: F401  # only whether it is there
    except ImportError as error:
        raise MissingExtraError(
            f"{what} needs transformers", where=what, fix='pip install "civil-rgbd[zoe]"'
        ) from error


@contextmanager
def reaching(source: str) -> Iterator[None]:
    """Turn what ``from_pretrained`` says of a source it cannot read into our words.

    Args:
        source: name on the hub or a folder.

    Raises:
        DownloadError: the source cannot be reached or read.
    """
    try:
        yield
    except (
        OSError,
        ValueError,
        RuntimeError,
    ) as error:  # all that from_pretrained is seen to raise
        first = next((line for line in str(error).splitlines() if line.strip()), "")
        raise DownloadError(
            f"cannot load {source!r}: {first[:300] or type(error).__name__}",
            where=source,
            fix="check the name and the network; without one, give a folder that holds config.json "
            "and model.safetensors, made elsewhere with `hf download NAME --local-dir FOLDER`",
        ) from error


def read_preprocessor(source: str) -> dict[str, Any]:
    """Read how the authors prepare an image: ``preprocessor_config.json``, where there is one.

    Args:
        source: name on the hub or a folder.

    Raises:
        DownloadError: the hub cannot be reached.
        FormatError: the file is no JSON object.
    """
    file = Path(source) / _PREPROCESSOR
    if not Path(source).is_dir():
        from transformers.utils.hub import cached_file

        with reaching(source):
            found = cached_file(source, _PREPROCESSOR, _raise_exceptions_for_missing_entries=False)
        if found is None:
            return {}
        file = Path(found)
    if not file.is_file():
        return {}
    try:
        document = json.loads(file.read_text("utf-8"))
    except ValueError as error:
        raise FormatError(
            f"the file is no JSON: {error}", where=file, fix="copy or download it again"
        ) from error
    if not isinstance(document, dict):
        raise FormatError("the file is no JSON object", where=file, fix="copy or download it again")
    return document
