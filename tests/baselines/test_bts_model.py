"""BTS as a depth model."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from numpy.typing import NDArray

from civil_rgbd.baselines.bts import KITTI_FOCAL_PX
from civil_rgbd.baselines.bts_model import BtsModel, bts_small
from civil_rgbd.errors import UsageError
from civil_rgbd.geometry.camera import PinholeCamera

Batch = tuple[torch.Tensor, torch.Tensor]


def test_the_small_one_is_small() -> None:
    assert 0.6e6 < sum(p.numel() for p in bts_small().parameters()) < 0.8e6


def test_bytes_and_floats_mean_the_same(batch: Batch) -> None:
    model = bts_small().eval()
    bytes_ = (batch[0] * 255).round().to(torch.uint8)

    torch.testing.assert_close(model(bytes_, batch[1]), model(bytes_.float() / 255, batch[1]))


def test_images_are_normalised_as_for_imagenet(batch: Batch) -> None:
    model = bts_small().eval()
    mean, deviation = np.array([0.485, 0.456, 0.406]), np.array([0.229, 0.224, 0.225])
    by_hand = (batch[0].numpy().transpose(0, 2, 3, 1) - mean) / deviation
    normalised = torch.from_numpy(by_hand.transpose(0, 3, 1, 2).astype(np.float32))

    expected = model.network(normalised, batch[1][:, 0, 0]).depth_m

    torch.testing.assert_close(model(*batch), expected, rtol=1e-4, atol=1e-4)


def test_depth_scales_with_the_focal_length_where_a_reference_is_given(batch: Batch) -> None:
    torch.manual_seed(3)
    plain = bts_small().eval()
    scaled = bts_small(focal_reference_px=KITTI_FOCAL_PX).eval()
    scaled.network.load_state_dict(plain.network.state_dict())

    torch.testing.assert_close(scaled(*batch), plain(*batch) * 50.0 / 715.0873)


def test_one_image_is_predicted_as_in_a_padded_batch(
    rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    model = bts_small(focal_reference_px=40.0).eval()
    padded = np.pad(rgb, ((0, 14), (0, 21), (0, 0)), mode="edge")
    tensor = torch.from_numpy(padded.transpose(2, 0, 1).copy())[None]

    with torch.no_grad():
        expected = model(tensor, torch.from_numpy(camera.matrix).float()[None])[0, 0, :50, :75]

    np.testing.assert_allclose(model.predict(rgb, camera), expected.numpy(), rtol=1e-5)


def test_prediction_leaves_the_mode_of_training_alone(
    rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    model = bts_small().train()
    before = {key: value.clone() for key, value in model.state_dict().items()}

    first, second = model.predict(rgb, camera), model.predict(rgb, camera)

    assert model.training
    np.testing.assert_array_equal(first, second)
    assert all(torch.equal(value, before[key]) for key, value in model.state_dict().items())


def test_a_model_of_a_size_resizes_and_its_focal_length_follows(
    rgb: NDArray[np.uint8], camera: PinholeCamera
) -> None:
    torch.manual_seed(4)
    sized = bts_small(width_px=64, height_px=32, focal_reference_px=40.0).eval()
    resized = torch.nn.functional.interpolate(
        torch.from_numpy(rgb.transpose(2, 0, 1).copy())[None] / 255,
        size=(32, 64),
        mode="bilinear",
        antialias=True,
    )
    K = torch.diag(torch.tensor([40.0 * 64 / 75, 1.0, 1.0]))[None]

    with torch.no_grad():
        small = sized(resized, K)
    expected = torch.nn.functional.interpolate(small, size=(50, 75), mode="bilinear")[0, 0]

    np.testing.assert_allclose(sized.predict(rgb, camera), expected.numpy(), rtol=1e-5)


def test_an_image_of_another_camera_is_refused(rgb: NDArray[np.uint8]) -> None:
    with pytest.raises(UsageError, match=r"uint8 \(50, 75, 3\); its camera asks .* \(51, 75, 3\)"):
        bts_small().predict(rgb, PinholeCamera(75, 51, 40.0, 40.0, 37.0, 25.0))


def test_parameters_are_in_one_group_each_and_frozen_ones_in_none() -> None:
    model = bts_small()
    everything = {id(p) for p in model.parameters()}

    groups = model.parameter_groups()
    frozen = model.freeze_early_layers()
    after = model.parameter_groups()

    ids = [id(p) for group in groups.values() for p in group]
    assert set(groups) == {"encoder", "decoder"}
    assert len(ids) == len(set(ids))
    assert set(ids) == everything
    assert sum(p.numel() for p in groups["encoder"]) - frozen == sum(
        p.numel() for p in after["encoder"]
    )
    assert len(after["decoder"]) == len(groups["decoder"])


def test_an_underflowing_answer_keeps_a_finite_logarithm(batch: Batch) -> None:
    model = bts_small().eval()
    torch.nn.init.constant_(model.network.decoder.get_depth[0].weight, -1e6)

    depth_m = model(*batch)

    assert bool(torch.isfinite(depth_m.log()).all())


def test_resnets_classifier_waits_for_no_gradient(batch: Batch) -> None:
    model = BtsModel("resnet50", features=16)

    model(batch[0][..., :32, :32], batch[1]).log().mean().backward()

    assert all(p.grad is not None for p in model.parameters() if p.requires_grad)
    assert [n for n, p in model.named_parameters() if not p.requires_grad] == [
        "network.encoder.base_model.fc.weight",
        "network.encoder.base_model.fc.bias",
    ]
