"""The headers of an EXR file as they are written: every attribute's type and bytes.

PyPI's OpenEXR turns attributes into Python's values, and some get lost on the way: it does not tell float from double,
nor an empty name from none, and skips types that it does not know. What is compared here is the bytes.
"""

import struct

MAGIC = b"\x76\x2f\x31\x01"
# Flags of the version field.
TILED, LONG_NAMES, DEEP, MULTIPART = 0x200, 0x400, 0x800, 0x1000
# What fits a name without the flag for long ones.
SHORT = 31


def name(data, at):
    end = data.index(b"\0", at)
    return data[at:end].decode("utf-8", "replace"), end + 1


def header(data, at):
    """One part's attributes: name -> (type, bytes), and where the next thing begins."""
    found = {}
    while data[at]:
        attribute, at = name(data, at)
        kind, at = name(data, at)
        size = struct.unpack_from("<i", data, at)[0]
        if attribute in found:
            raise ValueError(f"attribute {attribute} is there twice")
        found[attribute] = (kind, data[at + 4 : at + 4 + size])
        at += 4 + size
    return found, at + 1


def read(path):
    """The version's flags, and the attributes of every part."""
    with open(path, "rb") as file:
        data = file.read()
    if data[:4] != MAGIC:
        raise ValueError("not an EXR file")
    flags, at = struct.unpack_from("<I", data, 4)[0] & ~0xFF, 8
    found, at = header(data, at)
    parts = [found]
    while flags & MULTIPART and data[at]:
        found, at = header(data, at)
        parts.append(found)
    return flags, parts


def channels(value):
    """The names in a `chlist`."""
    at, found = 0, []
    while value[at]:
        channel, at = name(value, at)
        found.append(channel)
        # Type, linearity, and the two sampling rates.
        at += 16
    return found


def names(parts):
    """Every name that the flag for long ones is about."""
    for part in parts:
        for attribute, (kind, value) in part.items():
            yield from (attribute, kind)
            if kind == "chlist":
                yield from channels(value)
