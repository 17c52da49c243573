"""Writing the data's EXR files: one part, scanlines, ZIP."""

import numpy as np
import OpenEXR

# Bits of mantissa kept in float channels: what is cut off is far below the noise, and zeros compress.
FINE, COARSE = 17, 9
# The same for compact files, of which many have to fit.
COMPACT_FINE, COMPACT, COMPACT_COARSE = 10, 7, 2
# The smallest value that half float holds with all its bits.
HALF_MIN = 2.0**-14


def rounded(a, bits):
    """Float32 with `bits` bits of mantissa, rounded to nearest."""
    raw = np.ascontiguousarray(a, np.float32).view(np.uint32).astype(np.uint64)
    drop = 23 - bits
    raw = (raw + (1 << (drop - 1))) >> drop << drop
    return raw.astype(np.uint32).view(np.float32)


def storage(name, a):
    """The cheapest type in which the channel loses nothing that matters."""
    if "Variance" in name:
        # Variances span far more than half float's range.
        return rounded(a, COARSE)
    if name.startswith(("Position", "Depth")):
        return rounded(a, FINE)
    half = np.asarray(a, np.float32)
    if np.abs(half).max() > 65000:
        return rounded(a, FINE)
    return half.astype(np.float16)


def compact_storage(name, a, colour_bits):
    """As `storage`, with fewer bits: still far below the noise of a few samples."""
    if "Variance" in name:
        kept = rounded(a, COMPACT_COARSE)
        # Variances often leave half float's range at the small end.
        fits = kept.max() < 65000 and np.mean((kept > 0) & (kept < HALF_MIN)) < 0.01
    else:
        fine = name.startswith(("Position", "Depth"))
        kept = rounded(a, COMPACT_FINE if fine else colour_bits if name in "RGB" else COMPACT)
        fits = np.abs(kept).max() < 65000
    return kept.astype(np.float16) if fits else kept


def write(path, channels, compact=None):
    """Write a dict of name -> (height, width); refuses what is not finite.

    `compact`: bits of mantissa kept of colour in a compact file.
    """
    for name, a in channels.items():
        if not np.isfinite(a).all():
            raise ValueError(
                f"{path}: channel {name} holds {np.count_nonzero(~np.isfinite(a))} values that are not finite"
            )
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    kept = (lambda name, a: compact_storage(name, a, compact)) if compact else storage
    stored = {name: np.ascontiguousarray(kept(name, a)) for name, a in channels.items()}
    for name, a in stored.items():
        if not np.isfinite(a.astype(np.float32)).all():
            raise ValueError(f"{path}: channel {name} overflows its type")
    OpenEXR.File(header, stored).write(str(path))


def read(path):
    """A dict of name -> float32 array."""
    part = OpenEXR.File(str(path), separate_channels=True).parts[0]
    return {name: channel.pixels.astype(np.float32) for name, channel in part.channels.items()}
