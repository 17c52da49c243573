"""The numbers that tell whether a scene is good training data, and a picture to look at."""

import numpy as np
from PIL import Image

# Share of the worst pixels that the trimmed error drops: a few pixels at the edges of lights decide the mean.
TRIM = 0.001


def relmse(image, reference):
    """Relative mean squared error: (mean, mean without the worst 0.1% of pixels)."""
    error = ((image - reference) ** 2 / (reference**2 + 0.01)).mean(-1).ravel()
    kept = np.sort(error)[: error.size - int(np.ceil(error.size * TRIM))]
    return error.mean(), kept.mean()


def reference_noise(first, second):
    """RelMSE of the mean of two independent halves against the truth, estimated from their difference."""
    mean = (first + second) / 2
    error = ((first - second) ** 2 / 4 / (mean**2 + 0.01)).mean(-1).ravel()
    kept = np.sort(error)[: error.size - int(np.ceil(error.size * TRIM))]
    return error.mean(), kept.mean()


def bias(image, variance, reference):
    """Mean of (image - reference) in standard errors; beyond 4 the two disagree.

    The channels of a pixel share their paths, so their errors are taken as fully correlated.
    """
    error = np.sqrt((np.sqrt(variance).sum(-1) ** 2).sum()) / variance.size
    return (image - reference).mean() / error


def calibration(image, variance, reference):
    """Estimated variance over squared error, both summed: near 1 where the samples are what they claim to be."""
    return variance.sum() / ((image - reference) ** 2).sum()


def planes(channels, prefix, components="RGB"):
    return np.stack([np.asarray(channels[prefix + c], np.float64) for c in components], -1)


def contact_sheet(path, channels, reference):
    """Noisy, reference, normal / albedo, secondary albedo, direct, as one PNG."""
    tone = lambda a: np.clip(a, 0, 1) ** (1 / 2.2)
    rows = [
        [tone(planes(channels, "")), tone(reference), planes(channels, "Normal.", "XYZ") * 0.5 + 0.5],
        [
            tone(planes(channels, "Albedo.")),
            tone(planes(channels, "SecondaryAlbedo.")),
            tone(planes(channels, "Direct.")),
        ],
    ]
    sheet = np.concatenate([np.concatenate(row, 1) for row in rows], 0)
    Image.fromarray((np.clip(sheet, 0, 1) * 255).astype("u1")).save(path)
