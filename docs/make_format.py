"""Write docs/format.md from the schemas, so that prose and law cannot differ.

Run ``python docs/make_format.py`` after a change to schema/; a test compares.
"""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

from civil_rgbd.constants import FORMAT_VERSION
from civil_rgbd.resources import load_schema
from civil_rgbd.validation.report import CODES

PAGE: Final = Path(__file__).parent / "format.md"

FILES: Final = (
    "manifest",
    "intrinsics",
    "poses",
    "frames",
    "defects",
    "dataset",
    "bridge_info",
    "recipe",
    "rig",
    "survey",
    "registry",
)
"""The schemas, in the order of the page."""

MAJOR: Final = FORMAT_VERSION.split(".")[0]

INTRODUCTION: Final = f"""\
# The on-disk format, version {FORMAT_VERSION}

This page is made by `docs/make_format.py` from the JSON Schemas in `schema/`: change them, not
this page.

A **bridge folder** is whole by itself: what a build writes, a contributor submits and a user
downloads. A **dataset** is a folder of bridge folders.

```text
<dataset>/
  dataset.json               name, list of bridges, splits
  bridges/<bridge_id>/
    manifest.json            what it is, where it came from, what was counted; written last
    intrinsics.json          the pinhole camera of all images
    poses.json               where the camera was for each frame
    frames.parquet           one row a frame: stamps, paths, pose, depth range, hashes
    rgb/000042.jpg           colour, JPEG or PNG as the recipe says
    depth/000042.exr         depth
    quality/000042.exr       optional: how good each depth is
    defects.json             optional: marked defects
  .partial/                  unfinished builds; no reader looks there
```

A bridge folder holds nothing else. A folder without `manifest.json` is not a bridge: it is
unfinished. A folder appears by one rename, and each file is whole or absent.

## Conventions

- **Units** are in the names: `_m`, `_mm`, `_px`, `_ns`, `_s`, `_deg`. A name without one is a
  count, a share or an id.
- **Frames of reference**: `map` (metric, one recording), `lidar`, `body`, `camera` (optical: x
  right, y down, z forward). `T_a_b` takes points of frame b to frame a: `T_map_camera` is the
  camera's pose in the map.
- **Rotations** are unit quaternions in the order x, y, z, w: norm within 1e-9 of 1, w not
  negative.
- **Pixels**: (0, 0) is the *centre* of the first pixel; u counts columns, v rows. A point (x, y,
  z) of the camera falls on u = fx x / z + cx, v = fy y / z + cy. Resizing by s gives cx' = (cx +
  0.5) s - 0.5. COLMAP and nerfstudio count from the pixel's corner: add 0.5 to cx and cy for
  them.
- **Depth** is in metres along the optical axis (z, not the length of the ray), float32. **0 means
  that nothing was measured.** There is no NaN, no infinity, no negative number and no -0.0. EXR:
  one part, flat, one channel `Z` of 32-bit floats, lossless (ZIP when written here), data window
  equal to the display window, from (0, 0). Read it with the `OpenEXR` package; OpenCV 4 reads
  this channel as zeros without a word.
- **Colour** is 8 bit, undistorted, of the same pinhole as the depth. Where the lens has no pixel
  to give, rgb and depth are 0. EXIF orientation is ignored.
- **Stamps** are integer nanoseconds since the Unix epoch on the LiDAR's clock. They do not fit a
  JSON reader that makes every number a float: read them as 64-bit integers.
- **Frame ids** are the image's index in the recording, in six digits (more when they do not
  suffice). The same image has the same id under every recipe, so ids ascend with gaps.
- **Bridge ids** match `^[A-Za-z0-9][A-Za-z0-9_-]{{0,63}}$` and differ in more than the case of
  letters.
- **Nothing about the making**: no build time, host, user, absolute path or number of workers. The
  same source, recipe and environment give the same bytes.
- **JSON** is UTF-8, holds no key twice and no number that is not finite.

## Hashes

`*_file_sha256` is the SHA-256 of the file's bytes. `*_pixel_sha256` is that of the decoded
pixels, for another program may write the same pixels as other bytes. It is taken over two
things, one after the other:

1. in ASCII: the type of a value as numpy writes it (`|u1` for colour, `<f4` for depth), one
   space, the sizes joined by `x` (height, width, then 3 for colour), and a line feed;
2. the values, row by row (C order), little-endian; colours in the order red, green, blue.

```python
import hashlib

import numpy as np

depth_m = np.zeros((432, 768), dtype="<f4")
digest = hashlib.sha256(b"<f4 432x768\\n" + depth_m.tobytes()).hexdigest()
```

JPEG decoders differ in the last bit: a JPEG whose file hash holds but whose pixel hash does not
is a warning.

## Versions

`format_version` is `major.minor`. A minor only adds optional keys. A reader of {MAJOR}.x reads
every older minor strictly; of a newer minor it ignores the keys that it does not know, with one
warning that names them. A newer major is refused. An older major is migrated while it is read. A
key that its own version does not know is an error.

`data_version` is the publisher's: the data changed, the format did not.
"""


def page() -> str:
    """Return the text of docs/format.md."""
    parts = [INTRODUCTION]
    for kind in FILES:
        schema = load_schema(kind)
        rows = "\n".join(_rows(schema, ""))
        parts.append(
            f"## `{schema['title']}`\n\n{schema['description']}\n\n"
            f"| key | type | unit | |\n|---|---|---|---|\n{rows}\n"
        )
    codes = "\n".join(f"| `{code}` | {level} | {fix} |" for code, (level, fix) in CODES.items())
    parts.append(
        "## What `civil-rgbd validate` finds\n\n"
        f"Codes are stable.\n\n| code | level | what to do |\n|---|---|---|\n{codes}\n"
    )
    return "\n".join(parts)


def _rows(schema: dict[str, Any], prefix: str) -> Iterator[str]:
    required = schema.get("required", [])
    for key, value in schema.get("properties", {}).items():
        yield from _row(value, f"{prefix}{key}", optional=key not in required)


def _row(schema: dict[str, Any], path: str, *, optional: bool) -> Iterator[str]:
    unit = schema.get("x-unit", "")
    words = schema["description"]
    if schema.get("default") not in (None, "", []):
        words += f" Default: `{json.dumps(schema['default'])}`."
    elif optional:
        words += " May be left out."
    yield f"| `{path}` | {_type(schema)} | {unit} | {_escaped(words)} |"
    others, items = schema.get("additionalProperties"), schema.get("items")
    yield from _rows(schema, f"{path}.")
    if isinstance(others, dict):
        yield from _row(others, f"{path}.<name>", optional=False)
    if isinstance(items, dict) and (items.get("properties") or "pattern" in items):
        yield from _row(items, f"{path}[]", optional=False)


def _type(schema: dict[str, Any]) -> str:
    if "x-parquet" in schema:
        null = " or null" if isinstance(schema["type"], list) else ""
        return str(schema["x-parquet"]) + null
    if "const" in schema:
        return f"`{schema['const']}`"
    if "enum" in schema:
        return ", ".join("null" if value is None else f"`{value}`" for value in schema["enum"])
    for choices in ("oneOf", "anyOf"):
        if choices in schema:
            return " or ".join(_type(choice) for choice in schema[choices])
    if "$ref" in schema:
        return str(schema["$ref"]).rpartition("/")[2]
    kinds = schema["type"] if isinstance(schema["type"], list) else [schema["type"]]
    words = []
    for kind in kinds:
        if kind == "array" and schema.get("minItems") == schema.get("maxItems") is not None:
            words.append(f"{schema['minItems']} x {_type(schema['items'])}")
        else:
            words.append(str(kind))
    return " or ".join(words)


def _escaped(words: str) -> str:
    return words.replace("|", "\\|")


if __name__ == "__main__":
    PAGE.write_text(page(), encoding="utf-8", newline="\n")
    print(PAGE)
