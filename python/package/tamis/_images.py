"""Images: what is in files, how far one is from another, and how they look."""

from __future__ import annotations

import json
import os
from typing import Any, Union

import numpy as np

from . import _tamis

Path = Union[str, "os.PathLike[str]"]


def inspect(path: Path) -> dict[str, Any]:
    """What is in an image file, and what becomes of it: ``tamis inspect --json`` as a dict.

    Keys: ``size`` (width, height); ``renderer``, or None if the names do not tell; ``convention``,
    whose names the channels have; ``samples_per_pixel``, or None; ``features``, each with its
    ``status``, the ``channels`` that feed it and its ``variance``; ``absent``, the features that the
    file lacks, and ``switch_on``, what the renderer calls the settings that write them; ``layers``
    with their channels, what each feeds, and its least and greatest sample; ``pictures``, the views
    and layers that are filtered each on its own; ``bad_pixels``.
    """
    found: dict[str, Any] = json.loads(_tamis.inspect(os.fspath(path)))
    found["size"] = (found["layers"][0]["width"], found["layers"][0]["height"])
    features = found["features"]
    found["absent"] = [f["feature"] for f in features if f["status"] == "absent"]
    return found


def read(path: Path) -> dict[str, Any]:
    """The features of an image file, by the names of :func:`tamis.denoise`'s arguments.

    ``tamis.denoise(**tamis.read(path))`` is the colour that ``tamis denoise`` writes. Arrays are
    float32, (H, W, 3) or (H, W), in the file's units, and nothing is repaired. A number ``samples``
    is among them if the file says how many samples a pixel has.
    """
    return _tamis.read(os.fspath(path))


def _image(image: Any) -> Any:
    return os.fspath(image) if isinstance(image, (str, os.PathLike)) else np.asarray(image)


def compare(image: Any, reference: Any) -> dict[str, Any]:
    """How far an image is from its reference, as ``tamis compare`` says.

    Both are arrays, (H, W, 3), (H, W, 4) or (H, W), or files. Files that begin at different places
    are compared where both are.

    Keys: ``rel_mse``, the mean of (image - reference)² / (reference² + 0.01); ``trimmed_rel_mse``,
    without the worst 0.1% of the pixels; ``mse``; ``psnr_db`` (infinite for equal pictures), ``ssim``
    and ``flip`` of the images clamped to [0, 1] under the sRGB curve (None where an image is too
    small); ``left_out``, pixels of the reference that are no numbers; ``not_finite``, those of the
    image, which make its errors infinite; ``overlap``, if only a part was compared.
    """
    return _tamis.compare(_image(image), _image(reference))


class Picture:
    """A picture for people, which notebooks show: a PNG file in memory."""

    def __init__(self, png: bytes) -> None:
        self.png = png
        """The file's bytes."""

    def save(self, path: Path) -> None:
        """Writes the PNG file."""
        with open(path, "wb") as file:
            file.write(self.png)

    def _repr_png_(self) -> bytes:
        return self.png

    def __repr__(self) -> str:
        width, height = (int.from_bytes(self.png[at : at + 4], "big") for at in (16, 20))
        return f"<tamis.Picture: {width} x {height} pixels>"


def show(image: Any, exposure: float = 0.0) -> Picture:
    """An image as a picture: clamped to [0, 1] and put through the sRGB curve.

    ``image`` is an array of linear light, (H, W, 3), (H, W, 4) with premultiplied colours or (H, W),
    or a file. ``exposure`` makes it brighter by so many stops, from -64 to 64.
    """
    return Picture(_tamis.png(_image(image), exposure))
