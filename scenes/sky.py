"""Latitude-longitude pictures of the sky, as light sources: high dynamic range, poles up and down.

Row 0 is the zenith. Directions: `azimuth` and `elevation` in degrees, in the frame of Mitsuba's `envmap`
turned by Stage.environment so that +Z is up.
"""

import numpy as np

import textures as tex


def directions(height):
    elevation = np.pi / 2 - (np.arange(height) + 0.5) / height * np.pi
    azimuth = (np.arange(2 * height) + 0.5) / (2 * height) * 2 * np.pi
    e, a = np.meshgrid(elevation, azimuth, indexing="ij")
    return np.stack([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)], -1)


def sun_and_sky(
    height,
    azimuth,
    elevation,
    sun,
    sun_radius=1.5,
    zenith=(0.16, 0.3, 0.62),
    horizon=(0.75, 0.78, 0.8),
    ground=(0.16, 0.14, 0.11),
    clouds=0.5,
    seed=0,
):
    """A sky with drifting clouds, a glow about the sun, and the sun itself as a disc of `sun` radiance."""
    d = directions(height)
    a, e = np.radians(azimuth), np.radians(elevation)
    toward = np.array([np.cos(e) * np.cos(a), np.cos(e) * np.sin(a), np.sin(e)])
    up = d[..., 2]
    image = tex.mix(horizon, zenith, np.clip(up, 0, 1) ** 0.45)
    field = np.concatenate([tex.noise(height, 1.6, seed, (2, 1))] * 2, 1)
    cover = tex.smoothstep(0.52, 0.72, field) * clouds * np.clip(up * 4, 0, 1)
    image = tex.mix(image, np.array([0.95, 0.95, 0.97]), cover)
    near = np.clip(d @ toward, -1, 1)
    image = image + np.array([1.0, 0.8, 0.55])[None, None] * (1.5 * np.clip(near, 0, 1) ** 60)[..., None]
    image = np.where((up < 0)[..., None], np.asarray(ground) * (0.7 + 0.6 * field)[..., None], image)
    # A soft rim keeps the disc's power independent of how pixels cut it.
    disc = tex.smoothstep(np.cos(np.radians(sun_radius * 1.2)), np.cos(np.radians(sun_radius * 0.8)), near)
    return image + np.asarray(sun, float) * disc[..., None]


def studio(height, lamps, ambient=0.03, seed=0):
    """A dark room with soft boxes: lamps are (azimuth, elevation, width, height, radiance), in degrees."""
    d = directions(height)
    azimuth = np.degrees(np.arctan2(d[..., 1], d[..., 0]))
    elevation = np.degrees(np.arcsin(d[..., 2]))
    image = (
        np.full((*d.shape[:2], 3), float(ambient))
        * (0.6 + 0.8 * np.concatenate([tex.noise(height, 1.5, seed)] * 2, 1))[..., None]
    )
    for a, e, wide, high, radiance in lamps:
        off = np.abs((azimuth - a + 180) % 360 - 180)
        inside = tex.smoothstep(wide / 2 + 1, wide / 2 - 1, off) * tex.smoothstep(
            high / 2 + 1, high / 2 - 1, np.abs(elevation - e)
        )
        image = tex.mix(image, np.asarray(radiance, float), inside)
    return image
