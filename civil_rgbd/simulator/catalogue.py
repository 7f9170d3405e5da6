"""Every bridge by name: its site, the rays that meet it, and the painter of its pictures."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path
from typing import Final

from civil_rgbd.simulator.bridge import GirderBridge, girder_bridge
from civil_rgbd.simulator.shading import Painter
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.site_rays import SiteCaster
from civil_rgbd.simulator.sites.box_girder import box_girder_site
from civil_rgbd.simulator.sites.frame import frame_site
from civil_rgbd.simulator.sites.girder import girder_site
from civil_rgbd.simulator.sites.mesh import mesh_site
from civil_rgbd.simulator.sites.slab import slab_site
from civil_rgbd.simulator.sites.underpass import underpass_site
from civil_rgbd.simulator.spec import ScanSpec


def _demo(_seed: int) -> Site:
    return Site(girder_bridge(GirderBridge(), name="demo"))


SITES: Final[dict[str, Callable[[int], Site]]] = {
    "demo": _demo,
    "B1": girder_site,
    "B2": underpass_site,
    "B3": slab_site,
    "B4": box_girder_site,
    "B5": frame_site,
}
"""What draws each site from the seed of its clutter, cars and people."""


def site_of(bridge: str, *, moving: bool = True, seed: int = 0, mesh: str = "") -> Site:
    """Return a bridge and everything about it.

    Args:
        bridge: key of :data:`SITES`, or ``mesh``.
        moving: False leaves out whatever moves.
        seed: of clutter, cars and people.
        mesh: of the bridge ``mesh``, the OBJ file or folder.

    Raises:
        UsageError: it has no OBJ mesh.
    """
    return _rays(bridge, moving, seed, mesh).site


def site_caster_of(
    bridge: str, *, moving: bool = True, seed: int = 0, mesh: str = ""
) -> SiteCaster:
    """Return the rays of a site, as :func:`site_of` takes it."""
    return _rays(bridge, moving, seed, mesh)


def painter_of(bridge: str, *, moving: bool = True, seed: int = 0, mesh: str = "") -> Painter:
    """Return the painter of a site, as :func:`site_of` takes it."""
    return _painter(bridge, moving, seed, mesh)


def site_for(spec: ScanSpec) -> Site:
    """Return the site that a spec asks for."""
    return caster_for(spec).site


def caster_for(spec: ScanSpec) -> SiteCaster:
    """Return the rays of the site that a spec asks for."""
    return _rays(spec.bridge, bool(spec.moving), spec.scene_seed, spec.mesh)


def painter_for(spec: ScanSpec) -> Painter:
    """Return the painter of the site that a spec asks for."""
    return _painter(spec.bridge, bool(spec.moving), spec.scene_seed, spec.mesh)


# Positional and without defaults: a cache takes other spellings of one question for another.
@lru_cache(maxsize=12)
def _rays(bridge: str, moving: bool, seed: int, mesh: str) -> SiteCaster:  # noqa: FBT001  # a key
    if moving:
        return SiteCaster(SITES[bridge](seed) if bridge in SITES else mesh_site(Path(mesh), seed))
    whole = _rays(bridge, True, seed, mesh)  # noqa: FBT003  # they share what stands
    still = Site(whole.site.scene, (), whole.site.spalls, whole.site.path)
    return SiteCaster(still, standing=whole.standing)


@lru_cache(maxsize=2)
def _painter(bridge: str, moving: bool, seed: int, mesh: str) -> Painter:  # noqa: FBT001  # a key
    return Painter(_rays(bridge, moving, seed, mesh))
