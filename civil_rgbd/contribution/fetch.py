"""Files over HTTP: a broken download goes on where it stopped, and what comes must match."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from civil_rgbd.errors import DownloadError, MissingExtraError
from civil_rgbd.format.atomic import writing

Progress = Callable[[int, int], object]
"""Called with the bytes that are here and the bytes in all."""

MAX_REGISTRY_BYTES: Final = 16 << 20
_TRIES: Final = 3  # in a row without a single new byte
_PIECE: Final = 1 << 13  # small: what a broken connection cuts in two is lost
_TIMEOUT_S: Final = (10.0, 60.0)  # to connect; between two pieces
_PAUSE_S: Final = 0.2  # doubles from try to try
_WORTH_A_TRY: Final = {408, 429, 500, 502, 503, 504}


class BrokenOffError(DownloadError):
    """The network failed, or the server for a while: another try may do."""


def require_pooch() -> ModuleType:
    """Return the package pooch.

    Raises:
        MissingExtraError: it is not installed.
    """
    try:
        import pooch
    except ImportError as error:
        raise MissingExtraError(
            f"downloading needs the package pooch: {error}",
            where="civil-rgbd download",
            fix='pip install "civil-rgbd[contribute]"',
        ) from error
    module: ModuleType = pooch
    return module


def fetch_archive(
    url: str,
    folder: Path,
    *,
    name: str,
    sha256: str,
    size_bytes: int,
    progress: Progress = lambda _here, _total: None,
) -> Path:
    """Fetch one file by pooch, and check it; a download that broke off is gone on with.

    Unfinished bytes stay in ``<folder>/<name>.part``. When they do not come out right, they are
    thrown away and fetched once more from the beginning: the fault may be theirs.

    Args:
        url: http or https.
        folder: where the file goes; it exists.
        name: the file's name.
        sha256: that it must have.
        size_bytes: that it must have.
        progress: called as bytes come in.

    Returns:
        the file.

    Raises:
        DownloadError: it cannot be fetched, or is not what it should be: then nothing is left.
        MissingExtraError: pooch is not installed.
        OutputError: the folder cannot be written.
    """
    pooch = require_pooch()
    pooch.get_logger().setLevel("WARNING")
    resume = Resume(folder / f"{name}.part", size_bytes, progress)
    had_some = resume.length > 0
    for last in (not had_some, True):
        try:
            with writing(folder):
                pooch.retrieve(url, f"sha256:{sha256}", fname=name, path=folder, downloader=resume)
        except ValueError as error:  # pooch's word for another hash; it has deleted the file
            if last:
                raise DownloadError(
                    f"the file has another SHA-256 than the registry says ({sha256})",
                    where=url,
                    fix="nothing of it is kept; tell the registry's maintainers if it stays so",
                ) from error
        else:
            return folder / name
    raise AssertionError("the second try either returns or raises")


def fetch_text(url: str) -> str:
    """Fetch a small text file.

    Raises:
        DownloadError: it cannot be fetched, is too long, or is no UTF-8.
        MissingExtraError: requests, which pooch brings, is not installed.
    """
    require_pooch()
    data = bytearray()
    with _translated(url), _response(url, {}) as response:
        _refuse_status(response, url)
        for piece in response.iter_content(_PIECE):
            data += piece
            if len(data) > MAX_REGISTRY_BYTES:
                raise DownloadError(
                    f"the file has more than {MAX_REGISTRY_BYTES:,} bytes",
                    where=url,
                    fix="is this a registry? schema/registry.schema.json says what one holds",
                )
    try:
        return data.decode("utf-8")
    except UnicodeDecodeError as error:
        raise DownloadError(
            f"the file is not UTF-8: {error.reason}", where=url, fix="check the address"
        ) from error


class Resume:
    """A downloader for pooch that goes on where an earlier one stopped, by HTTP ranges.

    Call it as pooch does: with the address and the file to make.
    """

    def __init__(self, part: Path, size_bytes: int, progress: Progress) -> None:
        self._part, self._size_bytes, self._progress = part, size_bytes, progress

    @property
    def length(self) -> int:
        """How many bytes are here."""
        return self._part.stat().st_size if self._part.is_file() else 0

    def __call__(self, url: str, output_file: str, _pooch: object, **_: object) -> None:
        """Fetch what is missing, then put the whole file where pooch wants it."""
        if self.length > self._size_bytes:
            self._part.unlink()
        fruitless = 0
        while self.length < self._size_bytes:
            before = self.length
            try:
                with _translated(url):
                    self._fetch_rest(url)
            except BrokenOffError:
                fruitless = 0 if self.length > before else fruitless + 1
                if fruitless >= _TRIES:
                    raise
                time.sleep(_PAUSE_S * 2**fruitless)
        self._part.replace(output_file)

    def _fetch_rest(self, url: str) -> None:
        start = self.length
        with _response(url, {"Range": f"bytes={start}-"} if start else {}) as response:
            if response.status_code == 416:
                self._part.unlink()  # the file there is shorter than what is here
                raise _other_size(url, "shorter than that", self._size_bytes)
            _refuse_status(response, url)
            goes_on = response.status_code == 206 and _starts_at(response, start)
            self._refuse_other_size(response, start if goes_on else 0, url)
            with self._part.open("ab" if goes_on else "wb") as out:
                for piece in response.iter_content(_PIECE):
                    out.write(piece)
                    self._progress(out.tell(), self._size_bytes)
                    if out.tell() > self._size_bytes:
                        break
        if self.length > self._size_bytes:
            self._part.unlink()
            raise _other_size(url, "longer than that", self._size_bytes)
        if self.length < self._size_bytes:
            raise _broken_off(f"the download broke off after {self.length:,} bytes", url)

    def _refuse_other_size(self, response: Any, start: int, url: str) -> None:  # noqa: ANN401  # requests is an extra
        length = response.headers.get("Content-Length", "")
        if length.isdecimal() and start + int(length) != self._size_bytes:
            self._part.unlink(missing_ok=True)
            raise _other_size(url, f"{start + int(length):,} bytes", self._size_bytes)


def _response(url: str, headers: dict[str, str]) -> Any:  # noqa: ANN401  # requests is an extra
    import requests

    # No content coding: ranges are of the file's own bytes.
    headers = {"Accept-Encoding": "identity", **headers}
    return requests.get(url, headers=headers, stream=True, timeout=_TIMEOUT_S)


def _starts_at(response: Any, start: int) -> bool:  # noqa: ANN401  # requests is an extra
    return str(response.headers.get("Content-Range", "")).startswith(f"bytes {start}-")


def _refuse_status(response: Any, url: str) -> None:  # noqa: ANN401  # requests is an extra
    status = response.status_code
    if status in (200, 206):
        return
    what = f"the server answers {status} {response.reason or ''}".rstrip()
    if status in _WORTH_A_TRY:
        raise _broken_off(what, url)
    raise DownloadError(
        what, where=url, fix="check the address in the registry; has the archive moved?"
    )


@contextlib.contextmanager
def _translated(url: str) -> Iterator[None]:
    import requests

    try:
        yield
    except requests.RequestException as error:
        raise _broken_off(f"no answer from the server: {_reason(error)}", url) from error


def _reason(error: BaseException) -> str:
    # requests wraps urllib3, which wraps the socket: the innermost says it shortest.
    while error.__context__ is not None:
        error = error.__context__
    return str(error) or type(error).__name__


def _broken_off(what: str, url: str) -> BrokenOffError:
    return BrokenOffError(
        what,
        where=url,
        fix="check the network, then run the same command: it goes on where it stopped",
    )


def _other_size(url: str, found: str, expected: int) -> DownloadError:
    return DownloadError(
        f"the registry says {expected:,} bytes, the server has {found}",
        where=url,
        fix="nothing of it is kept; tell the registry's maintainers if it stays so",
    )
