"""Analytic filters for Monte Carlo noise.

Arrays in, arrays out::

    import tamis

    clean = tamis.denoise(color, albedo=albedo, normal=normal)

Files in, files out::

    tamis.denoise_file("render.exr", "clean.exr")

Images are NumPy arrays of shape (H, W, 3), rows from the top, of linear light; depths and the like
are (H, W). Samples are float32 or float16, at any strides, and are not copied before they are read.
Do not write to an array while it is being filtered.

Everything that goes wrong is a :class:`tamis.Error`, and also a ``ValueError``, ``TypeError`` or
``FileNotFoundError`` where it is one.
"""

from ._denoise import Denoiser, denoise, denoise_file
from ._errors import (
    Error,
    ImageWarning,
    InvalidTypeError,
    InvalidValueError,
    MissingFileError,
)
from ._filters import filters
from ._images import Picture, compare, inspect, read, show
from ._search import Search, tune
from ._tamis import VERSION as __version__
from ._tamis import Filter

__all__ = [
    "Denoiser",
    "Error",
    "Filter",
    "ImageWarning",
    "InvalidTypeError",
    "InvalidValueError",
    "MissingFileError",
    "Picture",
    "Search",
    "__version__",
    "compare",
    "denoise",
    "denoise_file",
    "filters",
    "inspect",
    "read",
    "show",
    "tune",
]
