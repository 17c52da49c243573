"""Reading and writing images with PyPI's OpenEXR."""

import numpy as np
import OpenEXR


def parts(path):
    return OpenEXR.File(str(path), separate_channels=True).parts


def planes(part, names):
    """Channels of a part as (height, width, count), in f64."""
    return np.stack([np.asarray(part.channels[name].pixels, np.float64) for name in names], -1)


def write_reference(path, image):
    """R, G, B in half float: the rounding is far below what any filter leaves."""
    stored = {c: np.ascontiguousarray(image[..., i], np.float16) for i, c in enumerate("RGB")}
    if not all(np.isfinite(a).all() for a in stored.values()):
        raise ValueError(f"{path}: not finite in half float")
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    OpenEXR.File(header, stored).write(str(path))


def relmse(image, reference):
    """Mean over pixels and channels of (image - reference)^2 / (reference^2 + 0.01), as in scenes/measure.py."""
    return float(((image - reference) ** 2 / (reference**2 + 0.01)).mean())
