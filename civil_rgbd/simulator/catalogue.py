"""Every bridge by name: its site, and the rays that meet it."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from typing import Final

from civil_rgbd.simulator.bridge import GirderBridge, girder_bridge
from civil_rgbd.simulator.shading import Painter
from civil_rgbd.simulator.site import Site
from civil_rgbd.simulator.site_rays import SiteCaster
from civil_rgbd.simulator.sites.box_girder import box_girder_site
from civil_rgbd.simulator.sites.frame import frame_site
from civil_rgbd.simulator.sites.girder import girder_site
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
"""What makes each site from the seed of its clutter, cars and people."""


@lru_cache(maxsize=12)
def site_of(bridge: str, *, moving: bool = True, seed: int = 0) -> Site:
    """Return a bridge and everything about it.

    Args:
        bridge: key of :data:`SITES`.
        moving: False leaves out whatever moves.
        seed: of clutter, cars and people.
    """
    if moving:
        return SITES[bridge](seed)
    site = site_of(bridge, seed=seed)  # they share what stands
    return Site(site.scene, (), site.spalls, site.path)


@lru_cache(maxsize=12)
def site_caster_of(bridge: str, *, moving: bool = True, seed: int = 0) -> SiteCaster:
    """Return the rays of a site, as :func:`site_of` takes it."""
    if moving:
        return SiteCaster(site_of(bridge, seed=seed))
    standing = site_caster_of(bridge, seed=seed).standing
    return SiteCaster(site_of(bridge, moving=False, seed=seed), standing=standing)


@lru_cache(maxsize=2)
def painter_of(bridge: str, *, moving: bool = True, seed: int = 0) -> Painter:
    """Return the painter of a site, as :func:`site_of` takes it."""
    return Painter(site_caster_of(bridge, moving=moving, seed=seed))


def caster_for(spec: ScanSpec) -> SiteCaster:
    """Return the rays of the site that a spec asks for."""
    return site_caster_of(spec.bridge, moving=bool(spec.moving), seed=spec.scene_seed)


def painter_for(spec: ScanSpec) -> Painter:
    """Return the painter of the site that a spec asks for."""
    return painter_of(spec.bridge, moving=bool(spec.moving), seed=spec.scene_seed)


def site_for(spec: ScanSpec) -> Site:
    """Return the site that a spec asks for."""
    return site_of(spec.bridge, moving=bool(spec.moving), seed=spec.scene_seed)
