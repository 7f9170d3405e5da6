"""Random changes for training: rolls, zooms and colours, beside the crops and flips of transforms.

Randomness comes from torch's generator of this process, as in
:class:`~civil_rgbd.dataset.transforms.RandomCrop`: whoever seeds it gets the same sample again.
"""

from __future__ import annotations

from dataclasses import dataclass

import torch

from civil_rgbd.dataset.transforms import Sample
from civil_rgbd.dataset.warps import roll, zoom


@dataclass(frozen=True, slots=True)
class RandomRoll:
    """Turn the camera about its optical axis by up to an angle, either way.

    Attributes:
        limit_deg: the largest angle.
    """

    limit_deg: float = 1.0

    def __call__(self, sample: Sample) -> Sample:
        """Return the turned sample."""
        return roll(sample, angle_deg=_between(-self.limit_deg, self.limit_deg))


@dataclass(frozen=True, slots=True)
class RandomZoom:
    """Enlarge a random part to the whole image.

    Attributes:
        limit: the largest factor; the smallest is 1.
        keep_camera: read the result as an image of the given focal length, and divide depth: the
            images of all zooms then belong to one common camera. Else the focal length grows.
    """

    limit: float = 1.2
    keep_camera: bool = True

    def __call__(self, sample: Sample) -> Sample:
        """Return the enlarged sample."""
        return zoom(
            sample,
            factor=_between(1.0, self.limit),
            left_share=_between(0.0, 1.0),
            top_share=_between(0.0, 1.0),
            keep_camera=self.keep_camera,
        )


@dataclass(frozen=True, slots=True)
class RandomColour:
    """Change gamma, brightness and each channel by factors 1 - limit to 1 + limit, as BTS does.

    Attributes:
        limit: of each of the three changes.
        probability: of any change.
    """

    limit: float = 0.1
    probability: float = 0.5

    def __call__(self, sample: Sample) -> Sample:
        """Return the sample with another image; all frames of a window change alike."""
        if float(torch.rand(())) >= self.probability:
            return sample
        image = sample["image"]
        unit = image if image.is_floating_point() else image.float() / 255
        low, high = 1 - self.limit, 1 + self.limit
        brighter = unit ** _between(low, high) * _between(low, high)
        channels = low + (high - low) * torch.rand(3)
        changed = (brighter * channels[:, None, None]).clamp(0, 1)
        if not image.is_floating_point():
            changed = (changed * 255).round().to(image.dtype)
        return {**sample, "image": changed}


def _between(low: float, high: float) -> float:
    return low + (high - low) * float(torch.rand(()))
