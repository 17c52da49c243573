"""The list of the files in tests/renders: what they are, which of their channels are a colour, and its reference."""

import json
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[2] / "tests" / "renders"
LIST = FOLDER / "files.json"


def colour(part, prefix, reference):
    """One colour of a file: the number of its part, its three channels, its reference below tests/renders."""
    return {"part": part, "channels": [prefix + c for c in "RGB"], "reference": f"reference/{reference}.exr"}


def load():
    return json.loads(LIST.read_text())


def add(entries):
    """Put entries (by file name) into the list; others stay."""
    files = (load() if LIST.exists() else {}) | entries
    LIST.write_text(json.dumps(dict(sorted(files.items())), indent=1) + "\n")
