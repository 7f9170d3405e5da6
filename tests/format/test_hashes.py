"""The same pixels, the same hash; other pixels, another."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest

from civil_rgbd.format.hashes import document_sha256, file_sha256, pixel_sha256


def test_the_pixel_hash_can_be_made_by_hand() -> None:
    rgb = np.arange(24, dtype=np.uint8).reshape(2, 4, 3)
    depth_m = np.array([[0.0, 1.5], [2.25, 0.0]], dtype=np.float32)

    assert pixel_sha256(rgb) == hashlib.sha256(b"|u1 2x4x3\n" + bytes(range(24))).hexdigest()
    values = bytes.fromhex("000000000000c03f0000104000000000")
    assert pixel_sha256(depth_m) == hashlib.sha256(b"<f4 2x2\n" + values).hexdigest()


def test_memory_order_and_byte_order_do_not_matter() -> None:
    depth_m = np.arange(12, dtype=np.float32).reshape(3, 4)

    assert pixel_sha256(np.asfortranarray(depth_m)) == pixel_sha256(depth_m)
    assert pixel_sha256(depth_m.astype(">f4")) == pixel_sha256(depth_m)
    assert pixel_sha256(np.repeat(depth_m, 2, axis=1)[:, ::2]) == pixel_sha256(depth_m)


def test_shape_and_type_matter() -> None:
    zeros = np.zeros((4, 6), dtype=np.float32)

    others = [zeros.T, zeros.reshape(-1), zeros.astype(np.float64), zeros.astype(np.uint32)]
    assert len({pixel_sha256(pixels) for pixels in [zeros, *others]}) == 5


@pytest.mark.parametrize(
    ("value", "words"),
    [(np.nan, "NaN or Inf"), (np.inf, "NaN or Inf"), (-np.inf, "NaN or Inf"), (-0.0, r"-0\.0")],
)
def test_values_without_one_meaning_are_refused(value: float, words: str) -> None:
    depth_m = np.zeros((2, 3), dtype=np.float32)
    depth_m[1, 2] = value

    with pytest.raises(ValueError, match=rf"1 values are {words}, the first at \(1, 2\)"):
        pixel_sha256(depth_m)


def test_a_file_is_hashed_by_its_bytes(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_bytes(b"abc")

    assert file_sha256(path) == hashlib.sha256(b"abc").hexdigest()


def test_a_documents_hash_is_of_its_canonical_json() -> None:
    expected = hashlib.sha256(b'{"a":1.0,"b":"\\u00e9"}').hexdigest()

    assert document_sha256({"b": "\u00e9", "a": 1.0}) == expected
