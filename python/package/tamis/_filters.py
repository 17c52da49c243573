"""Filters by what people call them."""

from __future__ import annotations

import os
from typing import Union

from ._errors import InvalidTypeError
from ._tamis import Filter, names

AnyFilter = Union[Filter, str, "os.PathLike[str]"]


def filters() -> list[str]:
    """The names of the filters that have one, the best first.

    Wherever a filter is asked for, one of these names will do; so will the path of a filter file,
    a weight such as ``"exp(-distance2(normal, normal) / 0.1)"``, or a :class:`Filter`.
    """
    return names()


def found(filter: AnyFilter) -> Filter:
    """The filter that somebody means."""
    if isinstance(filter, Filter):
        return filter
    if isinstance(filter, str):
        return Filter(filter)
    if isinstance(filter, os.PathLike):
        return Filter.read(filter)
    raise InvalidTypeError(
        f"filter: a {type(filter).__name__} is none; give a name, a filter file, a weight or a tamis.Filter"
    )


def from_toml(text: str) -> Filter:
    """What pickled filters are read back by."""
    return Filter.from_toml(text)
