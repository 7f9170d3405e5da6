"""The schemas themselves: the law of the format."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import jsonschema
import pyarrow as pa
import pytest

from civil_rgbd.format.index import SCHEMA
from civil_rgbd.resources import load_schema

KINDS = [
    "manifest",
    "intrinsics",
    "poses",
    "dataset",
    "defects",
    "frames",
    "bridge_info",
    "registry",
    "survey",
]


def parts(schema: dict[str, Any], path: str = "$") -> Iterator[tuple[str, dict[str, Any]]]:
    """Every schema inside a schema, with its path."""
    yield path, schema
    for key, value in schema.get("properties", {}).items():
        yield from parts(value, f"{path}.{key}")
    for key in ("items", "additionalProperties"):
        if isinstance(schema.get(key), dict):
            yield from parts(schema[key], f"{path}.{key}")
    for number, value in enumerate(schema.get("oneOf", [])):
        yield from parts(value, f"{path}.oneOf[{number}]")


def types(schema: dict[str, Any]) -> set[str]:
    kinds = schema.get("type", [])
    return {kinds} if isinstance(kinds, str) else set(kinds)


@pytest.mark.parametrize("kind", KINDS)
def test_a_schema_is_valid_draft_2020_12(kind: str) -> None:
    schema = load_schema(kind)

    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$schema"].endswith("2020-12/schema")


@pytest.mark.parametrize("kind", KINDS)
def test_every_field_has_a_description_and_every_number_a_unit(kind: str) -> None:
    for path, part in parts(load_schema(kind)):
        assert part.get("description"), path
        if types(part) & {"number", "integer"}:
            assert part.get("x-unit"), path


@pytest.mark.parametrize("kind", KINDS)
def test_objects_refuse_keys_that_they_do_not_know(kind: str) -> None:
    for path, part in parts(load_schema(kind)):
        if "object" in types(part):
            # Either no other key, or a dictionary whose values have a schema of their own.
            assert part.get("additionalProperties") is False or isinstance(
                part["additionalProperties"], dict
            ), path


def test_the_parquet_columns_are_those_of_the_schema() -> None:
    schema = load_schema("frames")
    names = {"string": pa.string(), "int64": pa.int64()}
    names |= {"float64": pa.float64(), "float32": pa.float32()}

    columns = [
        pa.field(name, names[value["x-parquet"]], "null" in types(value))
        for name, value in schema["properties"].items()
    ]

    assert pa.schema(columns).equals(SCHEMA)
    assert schema["required"] == SCHEMA.names


def test_the_format_knows_its_future_from_the_start() -> None:
    manifest = load_schema("manifest")["properties"]

    assert manifest["origin"]["enum"] == ["rendered", "imported", "simulated"]
    assert "null" in types(manifest["recipe"])
    assert {"quality", "contribution"} <= manifest.keys()
    assert "splits" in load_schema("dataset")["properties"]
