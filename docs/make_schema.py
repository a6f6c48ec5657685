"""Write the records' parts of the JSON Schema of solution files from their classes: ``python docs/make_schema.py``."""

import json
import re
from importlib import import_module
from pathlib import Path
from typing import Any

from nlpgrasp.common.types import Json
from nlpgrasp.solution.record_fields import nullable

FILE = Path(__file__).resolve().parents[1] / "nlpgrasp" / "solution" / "schema" / "nlpgrasp-1.schema.json"
GENERATED = re.compile(r"generated from (\S+)\.(\w+) by docs/make_schema.py")  # comment of a part
WIDTH = 160  # characters of a line with objects inside it


def with_records(schema: Json) -> Json:
    """Return a schema whose generated parts are those of their classes, and may be null where they may be so far."""
    comment = GENERATED.match(str(schema.get("$comment")))
    if comment is None:
        return {key: with_records(value) if isinstance(value, dict) else value for key, value in schema.items()}
    part = getattr(import_module(comment[1]), comment[2]).json_schema()
    return {"$comment": comment[0], **(nullable(part) if "null" in schema["type"] else part)}


def text(value: Any, indent: int = 0) -> str:
    """Return JSON text; an object or list is on one line where that is short, or there is no object inside it."""
    line, margin = json.dumps(value, ensure_ascii=False), "  " * (indent + 1)
    if "{" not in line[1:] or len(line) + len(margin) <= WIDTH:
        return line
    if isinstance(value, dict):
        entries = [f"{json.dumps(key)}: {text(item, indent + 1)}" for key, item in value.items()]
    else:
        entries = [text(item, indent + 1) for item in value]
    begin, end = line[0], line[-1]
    return begin + ",".join(f"\n{margin}{entry}" for entry in entries) + f"\n{margin[2:]}{end}"


def schema_text() -> str:
    """Return the text of the schema file with the present parts of the records."""
    return text(with_records(json.loads(FILE.read_text(encoding="utf-8")))) + "\n"


if __name__ == "__main__":
    FILE.write_text(schema_text(), encoding="utf-8")
