"""Errors: each says what is wrong, where it is, and what to do about it."""

from __future__ import annotations

from typing import Any


class CivilRgbdError(Exception):
    """Says what is wrong, where it is, and what to do about it.

    Attributes:
        what: the finding, in the present tense, with the values that show it.
        where: the file, topic, frame or option it was found in.
        fix: what the reader can do next.
    """

    def __init__(self, what: str, *, where: object, fix: str) -> None:
        super().__init__(f"{what}\n  where: {where}\n  fix:   {fix}")
        self.what, self.where, self.fix = what, str(where), fix

    def __reduce__(self) -> tuple[Any, ...]:
        # Workers send errors by pickle, which forgets keyword arguments.
        return (_rebuild, (type(self), self.what, self.where, self.fix))


def _rebuild(kind: type[CivilRgbdError], what: str, where: str, fix: str) -> CivilRgbdError:
    return kind(what, where=where, fix=fix)


class UsageError(CivilRgbdError):
    """An option, a name or a key does not fit."""


class RecordingError(CivilRgbdError):
    """A raw recording cannot be read, or lacks what a build needs."""


class RecipeError(CivilRgbdError):
    """A recipe is unknown or does not fit its schema."""


class FormatError(CivilRgbdError):
    """A file on disk breaks the format."""


class BuildError(CivilRgbdError):
    """A build cannot start, go on or finish."""


class BridgeFailedError(BuildError):
    """A build ran, and its bridge did not come out."""


class OutputError(CivilRgbdError):
    """A file or folder cannot be written."""


class StorageError(CivilRgbdError):
    """Object storage cannot be reached, or refuses."""


class DownloadError(CivilRgbdError):
    """A file cannot be fetched, or is not what was promised."""


class MissingExtraError(CivilRgbdError):
    """An optional dependency is not installed."""


class ImageDecodeError(RecordingError):
    """One image of a recording cannot be decoded; the build counts it and goes on."""


class OdometryError(CivilRgbdError):
    """An odometry engine cannot start or finish, or what it answers cannot be right."""


class TrainingError(CivilRgbdError):
    """A training run cannot start, go on or finish."""
