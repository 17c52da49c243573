"""Colours, patterns and materials, drawn for one scene: few of them, in one mood, as in a furnished place."""

import colorsys

import numpy as np

import textures as tex
from mitsuba_stage import diffuse, glass, metal, plastic, translucent

# Saturation and value (both ranges), and a share of surfaces that get a pattern.
MOODS = {
    "quiet": ((0.03, 0.22), (0.45, 0.85), 0.15),
    "pale": ((0.0, 0.1), (0.7, 0.92), 0.1),
    "earth": ((0.25, 0.6), (0.25, 0.7), 0.35),
    "vivid": ((0.45, 0.85), (0.4, 0.85), 0.4),
    "grey": ((0.0, 0.04), (0.15, 0.8), 0.25),
    "dusk": ((0.1, 0.4), (0.15, 0.45), 0.3),
}
SIZE = 256


class Palette:
    def __init__(self, rng, mood=None):
        self.rng = rng
        self.mood = mood or rng.choice(list(MOODS), p=[0.36, 0.2, 0.18, 0.06, 0.1, 0.1])
        self.saturation, self.value, self.busy = MOODS[self.mood]
        # Two neighbouring hues and an accent; most places are in warm or cool tones, some in any.
        base = rng.choice(
            [rng.normal(0.09, 0.035), rng.normal(0.58, 0.05), rng.normal(0.33, 0.07), rng.uniform()],
            p=[0.52, 0.22, 0.1, 0.16],
        )
        self.hues = [base, base + rng.uniform(0.03, 0.12), base + rng.uniform(0.35, 0.65)]
        self.made = {}

    def chance(self, p):
        return self.rng.uniform() < p

    def colour(self, accent=0.15):
        """Linear RGB in the scene's mood."""
        rng = self.rng
        hue = self.hues[2] if self.chance(accent) else self.hues[rng.integers(2)]
        saturation, value = rng.uniform(*self.saturation), rng.uniform(*self.value)
        if self.chance(accent * 0.35):
            saturation = rng.uniform(0.5, 0.95)
        shown = colorsys.hsv_to_rgb((hue + rng.normal(0, 0.02)) % 1, saturation, value)
        return tuple(float(c) ** 2.2 for c in shown)

    def shades(self, count):
        return [self.colour(0.3) for _ in range(count)]

    def pattern(self, kinds=None):
        """An image, and how often it repeats per unit of texture coordinates."""
        rng, seed = self.rng, int(self.rng.integers(1 << 30))
        a, b, c, d = self.shades(4)
        dark = tuple(0.35 * x for x in a)
        kinds = kinds or [
            "noise", "cells", "stripes", "checker", "dots", "wood", "planks", "bricks", "tiles", "ornament",
            "marble", "terrazzo", "weave", "gravel", "poster", "page",
        ]  # fmt: skip
        kind = rng.choice(kinds)
        n = int(rng.integers(2, 9))
        made = {
            "noise": lambda: tex.ramp(tex.noise(SIZE, rng.uniform(0.7, 2.2), seed), [a, b, c]),
            "cells": lambda: tex.ramp(np.floor(tex.noise(SIZE, 1.6, seed) * n) / n, [a, b, c]),
            "stripes": lambda: tex.stripes(SIZE, [a, b] if n < 6 else [a, b, a, c], n),
            "checker": lambda: tex.checker(SIZE, 2 * n, a, dark),
            "dots": lambda: tex.dots(SIZE, 2 * n, a, b),
            "wood": lambda: tex.wood(SIZE, seed, *self.timber(), n + 3),
            "planks": lambda: tex.planks(SIZE * 2, n + 2, seed, light=self.timber()[0], dark=self.timber()[1]),
            "bricks": lambda: tex.bricks(SIZE * 2, 2 * n, n, a, b, seed),
            "tiles": lambda: tex.tiles(SIZE * 2, n + 2, a, b, dark, seed),
            "ornament": lambda: tex.ornament(SIZE * 2, 3, [a, b, c, d], seed),
            "marble": lambda: tex.marble(SIZE * 2, seed, a, dark),
            "terrazzo": lambda: tex.terrazzo(SIZE * 2, seed, a, (b, c, dark)),
            "weave": lambda: tex.weave(SIZE, 8 * n, a, b, seed),
            "gravel": lambda: tex.gravel(SIZE, seed, (a, dark, b, c)),
            "poster": lambda: tex.poster(SIZE * 2, seed, [a, b, c, d, (0.02, 0.02, 0.03), (0.8, 0.78, 0.72)]),
            "page": lambda: tex.page(SIZE * 2, SIZE * 2, seed, 2, 14 + n),
        }[kind]()
        repeat = {"poster": 0.5, "page": 0.7, "weave": 2.0, "gravel": 1.5}.get(kind, rng.uniform(0.5, 1.3))
        return np.clip(made, 0, 1), repeat

    def timber(self):
        """Light and dark of one kind of wood."""
        light, dark = [
            ((0.48, 0.27, 0.12), (0.2, 0.09, 0.035)),
            ((0.6, 0.45, 0.28), (0.42, 0.28, 0.15)),
            ((0.22, 0.11, 0.06), (0.08, 0.035, 0.02)),
            ((0.5, 0.48, 0.43), (0.3, 0.28, 0.25)),
        ][self.rng.integers(4)]
        return light, dark

    def keep(self, role, make, most):
        """One of at most `most` materials of this role in the scene."""
        kept = self.made.setdefault(role, [])
        if len(kept) < most:
            kept.append(make())
            return kept[-1]
        return kept[self.rng.integers(len(kept))]

    def wall(self):
        """Mostly plain paint."""
        if self.chance(self.busy * 0.8):
            image, repeat = self.pattern(["stripes", "ornament", "noise", "bricks", "dots", "tiles", "weave", "wood"])
            return diffuse(image, repeat=repeat)
        colour = np.asarray(self.colour(0.08))
        if self.mood != "dusk" and self.chance(0.7):
            # Real walls are light.
            colour = 0.25 + 0.6 * colour / max(colour.max(), 0.05) * self.rng.uniform(0.7, 1)
        return diffuse(np.clip(colour, 0.02, 0.88))

    def floor(self):
        pick = self.rng.uniform()
        if pick < 0.3:
            colour = self.colour(0.1)
            return diffuse(colour) if self.chance(0.6) else plastic(colour, self.rng.uniform(0.1, 0.3))
        image, repeat = self.pattern(
            ["planks", "planks", "tiles", "marble", "terrazzo", "weave", "ornament", "noise", "checker"]
        )
        if pick < 0.7:
            return diffuse(image, repeat=repeat)
        return plastic(image, self.rng.uniform(0.06, 0.3), repeat=repeat)

    def wood(self):
        def make():
            light, dark = self.timber()
            image = tex.wood(SIZE, int(self.rng.integers(1 << 30)), light, dark)
            return diffuse(image, repeat=1) if self.chance(0.5) else plastic(image, self.rng.uniform(0.08, 0.25))

        return self.keep("wood", make, 2)

    def cloth(self):
        def make():
            if self.chance(0.5):
                return diffuse(self.colour())
            image, repeat = self.pattern(["weave", "stripes", "dots", "checker", "ornament", "weave"])
            return diffuse(image, repeat=repeat * 2)

        return self.keep("cloth", make, 3)

    def paint(self):
        """A plain lacquer or matt paint."""
        return self.keep("paint", lambda: diffuse(self.colour()) if self.chance(0.5) else self.coat(), 4)

    def coat(self):
        roughness = None if self.chance(0.5) else self.rng.uniform(0.05, 0.3)
        if self.chance(0.3):
            image, repeat = self.pattern()
            return plastic(image, roughness, repeat=repeat)
        return plastic(self.colour(0.3), roughness)

    def metal(self):
        def make():
            name = str(self.rng.choice(["Al", "Au", "Cu", "Ag", "Cr"]))
            return metal(name, self.rng.uniform(0.05, 0.4) if self.chance(0.8) else None)

        return self.keep("metal", make, 2)

    def glass(self):
        return self.keep("glass", lambda: glass(None if self.chance(0.75) else self.rng.uniform(0.05, 0.3)), 2)

    def wax(self):
        def make():
            colour = np.asarray(self.colour(0.3))
            colour = 0.25 + 0.7 * colour / max(colour.max(), 0.05)
            share = self.rng.uniform(0.3, 0.6)
            return translucent(np.clip(colour * (1 - share), 0, 1), np.clip(colour * share, 0, 1))

        return self.keep("wax", make, 2)

    def leafage(self):
        def make():
            green = [np.array(c) for c in ((0.05, 0.14, 0.03), (0.12, 0.2, 0.04), (0.2, 0.12, 0.03), (0.05, 0.1, 0.06))]
            green = green[self.rng.integers(4)] * self.rng.uniform(0.8, 1.6)
            return translucent(green, green * 0.7) if self.chance(0.5) else diffuse(green)

        return self.keep("leafage", make, 2)

    def printed(self):
        def make():
            image, _ = self.pattern(["poster", "page", "ornament", "noise", "poster"])
            return diffuse(image)

        return self.keep("printed", make, 4)

    def any(self):
        """A material for an object."""
        pick = self.rng.uniform()
        for share, make in (
            (0.3, lambda: self.keep("matt", lambda: diffuse(self.colour(0.3)), 4)),
            (0.22, lambda: self.keep("coat", self.coat, 3)),
            (0.16, lambda: self.keep("figured", self.figured, 3)),
            (0.13, self.metal),
            (0.09, self.glass),
            (0.1, self.wax),
        ):
            if pick < share:
                return make()
            pick -= share
        return self.wood()

    def figured(self):
        image, repeat = self.pattern()
        return diffuse(image, repeat=repeat * 2)

    def lamp(self):
        """The colour of a lamp's light, of mean 1."""
        warm = np.array([(1.25, 1.0, 0.7), (1.1, 1.0, 0.9), (1, 1, 1), (0.9, 1.0, 1.12), (1.4, 0.95, 0.45)])
        colour = warm[self.rng.choice(5, p=[0.35, 0.2, 0.2, 0.15, 0.1])]
        if self.mood == "vivid" and self.chance(0.3):
            colour = self.rng.uniform(0.15, 1.5, 3)
        return colour / colour.mean()


def black():
    return diffuse(0.0)
