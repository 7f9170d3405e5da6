"""Write down which commit a wheel or an sdist is made of; all else is in pyproject.toml.

A package that pip built and installed knows nothing of the checkout that it came from, but the
manifests of its bridges shall name it. The same commit gives the same bytes.
"""

from __future__ import annotations

import subprocess
from pathlib import Path

from setuptools import setup
from setuptools.command.build_py import build_py
from setuptools.command.sdist import sdist

ROOT = Path(__file__).resolve().parent
STAMP = Path("civil_rgbd/source_commit.txt")
FOLDERS = ("civil_rgbd", "conversion", "recipes", "registry", "schema")
SHIPPED = (*FOLDERS, "pyproject.toml", "setup.py")


def commit_of(root: Path) -> str | None:
    """Return the commit of a checkout, with "-dirty" when what ships differs from it.

    In an unpacked sdist it is what the sdist says; None where nobody knows.
    """
    top = _git(root, "rev-parse", "--show-toplevel")
    # An sdist may be unpacked inside somebody else's repository.
    if top is None or Path(top).resolve() != root:
        return (root / STAMP).read_text("ascii").strip() if (root / STAMP).exists() else None
    commit = _git(root, "rev-parse", "HEAD")
    changes = _git(root, "status", "--porcelain", "--", *SHIPPED)
    if commit is None or changes is None:
        return None
    return f"{commit}-dirty" if changes else commit


def _git(root: Path, *arguments: str) -> str | None:
    command = ["git", "-C", str(root), *arguments]
    try:
        done = subprocess.run(command, capture_output=True, text=True, check=True)  # noqa: S603  # git, on our own folder
    except (OSError, subprocess.CalledProcessError):
        return None  # no git, no checkout, or one that git does not trust
    return done.stdout.strip()


def stamp(folder: str) -> None:
    """Write the commit into a folder that will be packed; it may hold links to the source."""
    path, commit = Path(folder, STAMP), commit_of(ROOT)
    path.unlink(missing_ok=True)
    if commit is not None:
        path.write_text(f"{commit}\n", "ascii")


class BuildPy(build_py):
    """Stamps a wheel; an editable install runs whatever the files say, and gets no stamp."""

    def run(self) -> None:
        """Copy the modules, then stamp them."""
        super().run()
        if not self.editable_mode:
            stamp(self.build_lib)


class Sdist(sdist):
    """Stamps an sdist."""

    def make_release_tree(self, base_dir: str, files: list[str]) -> None:
        """Copy the files, then stamp them."""
        super().make_release_tree(base_dir, files)
        stamp(base_dir)


setup(cmdclass={"build_py": BuildPy, "sdist": Sdist})
