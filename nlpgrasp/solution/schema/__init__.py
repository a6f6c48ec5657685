"""JSON Schema of solution files, shipped as data."""

from __future__ import annotations

import json
from functools import lru_cache
from importlib.resources import files

from nlpgrasp.common.types import Json

SCHEMA_NAME = "nlpgrasp/1"


@lru_cache
def solution_schema() -> Json:
    """Return the JSON Schema of solution files (schema 1)."""
    text = files(__name__).joinpath("nlpgrasp-1.schema.json").read_text(encoding="utf-8")
    return dict(json.loads(text))
