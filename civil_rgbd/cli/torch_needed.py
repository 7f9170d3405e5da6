"""Words for those who have no torch."""

from __future__ import annotations


def require_torch(command: str, *, extra: str = "train") -> None:
    """Refuse a command that needs torch where it is not installed.

    Args:
        command: its name, for the message.
        extra: what to install, which has all that the command needs.

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
            fix=f'pip install "civil-rgbd[{extra}]"',
        ) from error
