"""Words for those who have no torch."""

from __future__ import annotations


def require_torch(command: str) -> None:
    """Refuse a command that needs torch where it is not installed.

    Raises:
        MissingExtraError: it is not.
    """
    from civil_rgbd.errors import MissingExtraError

    try:
        import torch  # noqa: F401  # asked for here so that the answer is in words
    except ImportError as error:
        raise MissingExtraError(
            f"`{command}` needs torch, and it cannot be imported: {error}",
            where=f"civil-rgbd {command}",
            fix='pip install "civil-rgbd[train]"',
        ) from error
