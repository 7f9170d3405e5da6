"""Rolls, zooms and changes of camera of a sample: what no crop or resize can do.

As in :mod:`civil_rgbd.dataset.transforms`, each is a pure function on samples and windows, and the
camera moves along. The image is interpolated; depth and valid take the nearest pixel, since between
a pier and the wall behind it there is no surface. Pixels that saw nothing are black and not valid.
"""

from __future__ import annotations

import math

import torch
from torch import Tensor
from torch.nn import functional

from civil_rgbd.dataset.transforms import Sample, crop, over_planes, resize
from civil_rgbd.errors import UsageError

_DEPTH_ERRORS = ("sigma_m", "bias_m")
"""Quality planes that scale with the depth."""


def roll(sample: Sample, *, angle_deg: float) -> Sample:
    """Turn the camera about its optical axis; intrinsics and depths stay what they are.

    Depth is along the optical axis, which stays where it is. Positive angles turn the camera
    clockwise as seen from behind it, so the picture turns counter-clockwise.

    Args:
        sample: as the datasets give it.
        angle_deg: of the turn.

    Returns:
        A new sample of the same size, whose ``T_map_camera`` is that of the turned camera.
    """
    angle = math.radians(angle_deg)
    cosine, sine = math.cos(angle), math.sin(angle)
    # Takes directions of the turned camera to the given one: x right, y down, so x goes to y.
    turn = torch.tensor([[cosine, -sine, 0.0], [sine, cosine, 0.0], [0.0, 0.0, 1.0]]).double()
    K = _single(sample["intrinsics"]).double()
    height, width = sample["image"].shape[-2:]
    columns, rows = _seen_at(K @ turn @ torch.linalg.inv(K), height=height, width=width)
    T_camera_turned = torch.eye(4, dtype=torch.float64)
    T_camera_turned[:3, :3] = turn
    return {
        **_sampled(sample, sample["image"], columns, rows),
        "T_map_camera": sample["T_map_camera"] @ _unmirrored(T_camera_turned, sample),
    }


def _unmirrored(T_camera_turned: Tensor, sample: Sample) -> Tensor:
    # T_map_camera of a mirrored sample is that of the real camera, which turns the other way.
    if not sample.get("mirrored", False):
        return T_camera_turned
    mirror = torch.diag(torch.tensor([-1.0, 1.0, 1.0, 1.0], dtype=torch.float64))
    return mirror @ T_camera_turned @ mirror


def to_camera(sample: Sample, *, width_px: int, height_px: int, K: Tensor) -> Sample:
    """Show a sample as another camera in the same place sees it: scale, then crop.

    Bridges that were surveyed with different cameras train together when they look through one.

    Args:
        sample: as the datasets give it.
        width_px: columns of the new image.
        height_px: rows of the new image.
        K: (3, 3) intrinsics of the new camera, pixels; without skew.

    Returns:
        A new sample with those intrinsics; parts that the given image does not cover are black and
        not valid.

    Raises:
        UsageError: the new camera has no pixels.
    """
    if min(width_px, height_px) < 1:
        raise UsageError(
            f"the camera has no pixels: {width_px} x {height_px}",
            where="to_camera",
            fix="give a width_px and a height_px of at least 1",
        )
    own, new = _single(sample["intrinsics"]).double(), K.double()
    source = _shrunk_towards(sample, own, new)
    shrunk_K = _single(source["intrinsics"]).double()
    columns, rows = _seen_at(shrunk_K @ torch.linalg.inv(new), height=height_px, width=width_px)
    image_of = _grid(source["image"], columns, rows)
    columns, rows = _seen_at(own @ torch.linalg.inv(new), height=height_px, width=width_px)
    seen = _sampled(sample, None, columns, rows)
    return {
        **seen,
        "image": image_of,
        "intrinsics": new.to(sample["intrinsics"]).expand_as(sample["intrinsics"]).clone(),
    }


def _shrunk_towards(sample: Sample, own: Tensor, new: Tensor) -> Sample:
    """Return the sample no larger than the new camera asks for, filtered against flicker."""
    height, width = sample["image"].shape[-2:]
    share = min(1.0, float(new[0, 0] / own[0, 0])), min(1.0, float(new[1, 1] / own[1, 1]))
    size = max(1, math.ceil(width * share[0])), max(1, math.ceil(height * share[1]))
    if size == (width, height):
        return sample
    return resize(sample, width_px=size[0], height_px=size[1])


def zoom(
    sample: Sample, *, factor: float, left_share: float, top_share: float, keep_camera: bool
) -> Sample:
    """Enlarge a part of the image to the whole: a crop, scaled.

    Args:
        sample: as the datasets give it.
        factor: how much larger things become; 1 or more.
        left_share: where the part lies in the room that it has: 0 left, 1 right.
        top_share: 0 top, 1 bottom.
        keep_camera: read the enlarged image as one of the given focal length, in which everything
            is ``factor`` times nearer: depth is divided. Else the focal length grows.

    Returns:
        A new sample of the same size.

    Raises:
        UsageError: the factor is below 1.
    """
    if factor < 1:
        raise UsageError(
            f"a zoom by {factor} has no pixels for the edge", where="zoom", fix="zoom by 1 or more"
        )
    height, width = sample["image"].shape[-2:]
    part = max(1, round(width / factor)), max(1, round(height / factor))
    window = crop(
        sample,
        left_px=round((width - part[0]) * left_share),
        top_px=round((height - part[1]) * top_share),
        width_px=part[0],
        height_px=part[1],
    )
    enlarged = resize(window, width_px=width, height_px=height)
    if not keep_camera:
        return enlarged
    K = enlarged["intrinsics"].clone()
    nearer = width / part[0]
    K[..., 0, 0] /= nearer
    K[..., 1, 1] /= height / part[1]
    moved = {**enlarged, "intrinsics": K, "depth": enlarged["depth"] / nearer}
    if "quality" in enlarged:  # what is in metres along the axis shrinks with the depth
        moved["quality"] = {
            name: plane / nearer if name in _DEPTH_ERRORS else plane
            for name, plane in enlarged["quality"].items()
        }
    return moved


def _single(intrinsics: Tensor) -> Tensor:
    """Return the (3, 3) intrinsics; the frames of a window share theirs."""
    return intrinsics.reshape(-1, 3, 3)[0]


def _seen_at(H: Tensor, *, height: int, width: int) -> tuple[Tensor, Tensor]:
    """Return where each new pixel looks in the old image: columns and rows, (H, W) float64.

    Args:
        H: (3, 3) takes new pixels to old ones; its last row is 0 0 1.
        height: of the new image.
        width: of the new image.
    """
    v, u = torch.meshgrid(
        torch.arange(height, dtype=torch.float64),
        torch.arange(width, dtype=torch.float64),
        indexing="ij",
    )
    return H[0, 0] * u + H[0, 1] * v + H[0, 2], H[1, 0] * u + H[1, 1] * v + H[1, 2]


def _sampled(sample: Sample, image: Tensor | None, columns: Tensor, rows: Tensor) -> Sample:
    """Return the sample with its planes looked up at places of its own image."""
    height, width = sample["depth"].shape[-2:]
    u, v = torch.floor(columns + 0.5).long(), torch.floor(rows + 0.5).long()
    inside = (u >= 0) & (u < width) & (v >= 0) & (v < height)
    place = v.clamp(0, height - 1) * width + u.clamp(0, width - 1)

    def seen(plane: Tensor) -> Tensor:
        values = plane.flatten(-2)[..., place.flatten()].reshape(*plane.shape[:-2], *place.shape)
        return torch.where(inside, values, torch.zeros((), dtype=values.dtype))

    planes = over_planes(sample, seen, names=("depth", "valid"))
    if image is not None:
        planes["image"] = _grid(image, columns, rows)
    return {**sample, **planes}


def _grid(image: Tensor, columns: Tensor, rows: Tensor) -> Tensor:
    """Interpolate an image (..., 3, H, W) at places; black where it shows nothing."""
    height, width = image.shape[-2:]
    # grid_sample counts from -1 to 1 between the outer edges of the outer pixels.
    grid = torch.stack([(2 * columns + 1) / width - 1, (2 * rows + 1) / height - 1], dim=-1)
    flat = image.reshape(-1, *image.shape[-3:]).float()
    values = functional.grid_sample(
        flat,
        grid.float().expand(len(flat), -1, -1, -1),
        mode="bilinear",
        padding_mode="border",
        align_corners=False,
    )
    inside = (grid.abs() <= 1).all(dim=-1)
    values = torch.where(inside, values, 0.0)
    if not image.is_floating_point():
        values = values.round().clamp(0, 255)
    return values.to(image.dtype).reshape(*image.shape[:-2], *columns.shape)
