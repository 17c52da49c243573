"""The kinds of scenes. Each function fills a `Set` from its random generator; `generate` is the only way in."""

from dataclasses import dataclass

import numpy as np
from PIL import ImageFont

import sky
from corpus import things
from corpus.palette import Palette, black
from mitsuba_stage import Stage, diffuse, metal, mirror, plastic
from shapes import (
    Mesh,
    bar,
    blades,
    box,
    cylinder,
    grid,
    ground,
    lathe,
    letters,
    merged,
    quad,
    ring,
    scattered,
    smoothed,
    sphere,
    tube,
)

SIZES = [(128, 128), (128, 112), (144, 96), (112, 128), (128, 96), (144, 112)]


@dataclass
class Made:
    """A finished scene and how to render it."""

    stage: Stage
    size: tuple
    # The mean that the picture shall have, and the clamp on one indirect contribution, both after exposure.
    mean: float
    clamp: float
    max_depth: int


class Set:
    """A stage being filled, with its random generator and palette."""

    # The class of the stage: another renderer's takes its place.
    new_stage = Stage

    def __init__(self, rng, mood=None):
        self.rng, self.stage = rng, self.new_stage()
        self.pal = Palette(rng, mood)
        self.mean = float(rng.uniform(0.2, 0.5))
        self.depth = 8

    def chance(self, p):
        return self.rng.uniform() < p

    def pick(self, *options):
        return options[self.rng.integers(len(options))]

    def between(self, a, b, size=None):
        return self.rng.uniform(a, b, size)

    def put(self, parts, x=0.0, y=0.0, z=0.0, size=1.0, turn=0.0):
        for mesh, material, *glow in parts:
            share = {"share": 0.2} if glow else {}
            placed = mesh.scaled(size).turned("z", turn).moved(x, y, z)
            self.stage.add(placed, material, *(glow or [None]), **share)

    def lamp(self, mesh, radiance, share=1.0):
        self.stage.add(mesh, black(), tuple(np.broadcast_to(radiance, 3)), share)

    def look(self, origin, target, fov, lens=0.0):
        """The camera; `lens` is the chance of a thin lens, which is focused on the target or before or behind it."""
        origin, target = np.asarray(origin, float), np.asarray(target, float)
        away = np.linalg.norm(target - origin)
        if self.chance(lens):
            focus = origin + (target - origin) * self.pick(1.0, 1.0, 0.75, 1.3)
            self.stage.camera(origin, target, fov, aperture=away * self.between(0.008, 0.035), focus=focus)
        else:
            self.stage.camera(origin, target, fov)
        if self.chance(0.1):
            # The shutter stays open while the camera moves.
            self.stage.motion(self.rng.normal(0, 0.012, 3) * away, self.rng.normal(0, fov * 0.02))

    def daylight(self, height=128):
        """A sky: low or high sun behind clouds or not, dusk, or plain overcast."""
        kind = self.rng.choice(["sun", "haze", "overcast", "dusk", "studio"], p=[0.35, 0.2, 0.2, 0.15, 0.1])
        turn, seed = self.between(0, 360), int(self.rng.integers(1 << 30))
        if kind == "studio":
            lamps = [
                (
                    self.between(0, 360),
                    self.between(10, 75),
                    self.between(15, 60),
                    self.between(15, 50),
                    self.pal.lamp() * self.between(3, 25),
                )
                for _ in range(int(self.rng.integers(1, 4)))
            ]
            image = sky.studio(height, lamps, self.between(0.02, 0.4), seed)
        elif kind == "overcast":
            image = sky.sun_and_sky(
                height, 0, 45, (0, 0, 0), zenith=(0.7, 0.72, 0.76), horizon=(0.9, 0.9, 0.9), clouds=0.9, seed=seed
            )
        elif kind == "dusk":
            glow = np.array((1.5, 0.7, 0.3)) * self.between(2, 12)
            image = sky.sun_and_sky(
                height,
                0,
                self.between(2, 12),
                glow,
                6,
                zenith=(0.05, 0.08, 0.2),
                horizon=(0.5, 0.28, 0.2),
                ground=(0.03, 0.03, 0.03),
                seed=seed,
            )
        else:
            radius = self.between(1.5, 3) if kind == "sun" else self.between(5, 14)
            power = self.between(0.6, 2.2) * 9000 / radius**2 / 6
            image = sky.sun_and_sky(
                height,
                0,
                self.between(12, 70),
                np.array((1.08, 1.0, 0.88)) * power,
                radius,
                clouds=self.between(0, 0.9),
                seed=seed,
            )
        self.stage.environment(image, turn)

    def finish(self, clamp=None):
        if self.chance(0.35):
            # Some pictures as Cycles writes them.
            self.stage.habits |= {"facing": True, "lamp_albedo": 1.0}
        size = SIZES[self.rng.integers(len(SIZES))]
        return Made(self.stage, size, self.mean, clamp or float(self.pick(3, 5, 8)), self.depth)


# --- Rooms.


def wall(width, height, opening=None):
    """A wall in the XZ plane facing -Y, standing on z = 0; `opening` is (x, z, width, height) of a hole."""
    if opening is None:
        return quad(width, height).turned("x", 90).moved(0, 0, height / 2)
    x, z, w, h = opening
    left, right = x - w / 2 + width / 2, width / 2 - x - w / 2
    parts = [(left, height, -width / 2 + left / 2, height / 2), (right, height, width / 2 - right / 2, height / 2)]
    parts += [(w, z, x, z / 2), (w, height - z - h, x, (height + z + h) / 2)]
    pieces = []
    for a, b, cx, cz in parts:
        piece = quad(a, b)
        piece.uv = piece.uv + [cx - a / 2, cz - b / 2]
        pieces.append(piece.turned("x", 90).moved(cx, 0, cz))
    # The reveal: the wall's thickness.
    pieces += [box(0.02, 0.2, h).moved(x + s * (w / 2 + 0.01), 0.1, z) for s in (-1, 1)]
    pieces += [box(w, 0.2, 0.02).moved(x, 0.1, c) for c in (z - 0.02, z + h)]
    return merged(pieces)


def shell(s, w, d, h, plain=False):
    """Floor, ceiling, four walls (the camera's side is -Y), skirting and windows. Gives the windows' places."""
    pal, rng = s.pal, s.rng
    s.stage.add(quad(w, d), pal.floor() if not plain else diffuse(pal.colour(0)))
    ceiling = diffuse(float(s.between(0.6, 0.88)) * np.ones(3)) if s.chance(0.8) else pal.wall()
    s.stage.add(quad(w, d).turned("x", 180).moved(z=h), ceiling)
    paint = pal.wall()
    accent = pal.wall() if s.chance(0.4) else paint
    trim = pal.paint()
    windows = []
    for side, span, turn, at in (
        ("back", w, 0, (0, d / 2)),
        ("right", d, -90, (w / 2, 0)),
        ("front", w, 180, (0, -d / 2)),
        ("left", d, 90, (-w / 2, 0)),
    ):
        hole = None
        if side != "front" and s.chance(0.35):
            ww, hh = s.between(0.2, 0.5) * span, s.between(0.35, 0.62) * h
            hole = (s.between(-0.5, 0.5) * (span - ww - 0.3), min(s.between(0.15, 0.35) * h, h - hh - 0.1), ww, hh)
            windows.append((side, turn, at, hole))
        s.stage.add(wall(span, h, hole).turned("z", turn).moved(*at), accent if side == "back" else paint)
        if side != "front" and s.chance(0.6):
            s.stage.add(box(span, 0.03, 0.1).moved(0, -0.016, 0).turned("z", turn).moved(*at), trim)
    for side, turn, at, (x, z, ww, hh) in windows:
        n = int(rng.integers(1, 4))
        frame = [
            bar((x + ww * (i / n - 0.5), 0.1, z), (x + ww * (i / n - 0.5), 0.1, z + hh), 0.05) for i in range(n + 1)
        ]
        frame += [bar((x - ww / 2, 0.1, z + hh * t), (x + ww / 2, 0.1, z + hh * t), 0.05) for t in (0, 0.5, 1)]
        s.stage.add(merged(frame).turned("z", turn).moved(*at), trim)
        dress = rng.uniform()
        parts = []
        if dress < 0.25:
            parts = [(m.moved(x, -0.06, z), *r) for m, *r in things.slats(rng, pal, ww, hh * s.between(0.4, 1))]
        elif dress < 0.5:
            parts = [(m.moved(x - ww * 0.55, -0.12, 0.1), *r) for m, *r in things.drapes(rng, pal, ww * 0.4, z + hh)]
            parts += [(m.moved(x + ww * 0.55, -0.12, 0.1), *r) for m, *r in things.drapes(rng, pal, ww * 0.4, z + hh)]
        for mesh, material in parts:
            s.stage.add(mesh.turned("z", turn).moved(*at), material)
    return windows


def light_room(s, w, d, h, windows, even=False):
    """Daylight through the windows, lamps, or both."""
    lit = False
    if windows and s.chance(0.75):
        if s.chance(0.35):
            s.daylight()
        else:
            tint = np.array((0.85, 1.0, 1.2)) if s.chance(0.6) else s.pal.lamp()
            for side, turn, at, (x, z, ww, hh) in windows:
                panel = quad(ww * 1.2, hh * 1.2).turned("x", 90).moved(x, s.between(0.25, 0.8), z + hh / 2)
                s.lamp(panel.turned("z", turn).moved(*at), tint * s.between(6, 30))
        lit = True
    ways = ["panel", "pendant", "floor", "sconce", "spots", "softbox", "cove", "strip"]
    count = int(s.rng.integers(0 if lit else 1, 3))
    if even or (not lit and s.chance(0.25)):
        # Evenly lit: a large light behind the camera or under the ceiling.
        ways, count = ["softbox", "cove", "panel"], 2
    for way in s.rng.choice(ways, count, replace=False):
        tint = s.pal.lamp()
        if way == "panel":
            n = int(s.rng.integers(1, 4))
            a = s.between(0.3, 1.2)
            for i in range(n):
                s.lamp(
                    quad(a, a * s.pick(1, 2)).turned("x", 180).moved(0, (i + 0.5) / n * d - d / 2, h - 0.01), tint * 10
                )
        elif way == "pendant":
            x, y = s.between(-0.3, 0.3) * w, s.between(-0.1, 0.35) * d
            n = int(s.rng.integers(1, 4))
            for i in range(n):
                s.put(
                    things.pendant(s.rng, s.pal, tint * s.between(20, 70), h, s.between(0.3, 0.9)),
                    x + 0.45 * (i - n / 2),
                    y,
                )
        elif way == "floor":
            s.put(
                things.floor_lamp(s.rng, s.pal, tint * s.between(80, 250)),
                s.between(-0.4, 0.4) * w,
                s.between(0.1, 0.4) * d,
            )
        elif way == "sconce":
            n = int(s.rng.integers(1, 5))
            at = [((i + 0.5) / n * w - w / 2, d / 2 - 0.12, h * 0.65) for i in range(n)]
            s.lamp(scattered(sphere(0.06, 16), at), tint * s.between(40, 120), 0.6)
            s.stage.add(scattered(box(0.1, 0.12, 0.05), np.add(at, (0, 0.06, -0.1))), s.pal.metal())
        elif way == "spots":
            for _ in range(int(s.rng.integers(1, 4))):
                at = (s.between(-0.4, 0.4) * w, s.between(-0.3, 0.3) * d, h - 0.1)
                aim = (at[0] + s.between(-1, 1), at[1] + s.between(0, 2), 0.4)
                s.stage.spot(at, aim, tint * s.between(15, 60), s.between(14, 40))
        elif way == "softbox":
            s.lamp(quad(w * 0.8, h * 0.7).turned("x", -90).moved(0, -d / 2 + 0.03, h * 0.6), tint * s.between(2, 6))
        elif way == "strip":
            along = bar((-w / 2 + 0.1, d / 2 - 0.08, h - 0.1), (w / 2 - 0.1, d / 2 - 0.08, h - 0.1), 0.03)
            s.lamp(along, tint * s.between(20, 60))
        else:
            ledge = s.pal.paint()
            for x in (-1, 1):
                s.stage.add(box(0.25, d, 0.04).moved(x * (w / 2 - 0.13), 0, h - 0.35), ledge)
                s.lamp(quad(0.12, d * 0.95).moved(x * (w / 2 - 0.13), 0, h - 0.29), tint * s.between(10, 30))


def furnish(s, w, d, count, top=2.0):
    """Furniture along the walls and some in the middle, without much overlap."""
    taken = []
    for _ in range(count):
        for _ in range(12):
            x, y = s.between(-0.5, 0.5) * (w - 0.9), s.between(-0.12, 0.5) * (d - 0.9)
            if all(np.hypot(x - a, y - b) > 0.95 for a, b in taken):
                break
        else:
            continue
        taken.append((x, y))
        near = np.argmin([w / 2 - x, x + w / 2, d / 2 - y])
        turn = [-90, 90, 0][near] + s.rng.normal(0, 8)
        make = things.FURNITURE[s.rng.integers(len(things.FURNITURE))]
        if make in (things.shelf, things.cabinet, things.sofa) and s.chance(0.8):
            # These stand against a wall.
            x, y = (w / 2 - 0.3, y) if near == 0 else (-w / 2 + 0.3, y) if near == 1 else (x, d / 2 - 0.3)
        s.put(make(s.rng, s.pal), x, y, 0, 1.0, turn)
        if make in (things.table, things.cabinet):
            for _ in range(int(s.rng.integers(0, 4))):
                z = 0.74 if make is things.table else 1.0
                kinds = things.QUIET if s.chance(0.6) else things.OBJECTS
                s.put(
                    things.some(s.rng, s.pal, kinds),
                    x + s.rng.normal(0, 0.2),
                    y + s.rng.normal(0, 0.15),
                    z,
                    s.between(0.2, 0.4),
                    s.between(0, 360),
                )


def hang(s, w, d, h, count):
    """Pictures and mirrors on the back and side walls."""
    for i in range(count):
        side = s.pick(0, 0, -90, 90)
        ww, hh = s.between(0.3, 1.0), s.between(0.3, 0.9)
        reach = {0: d / 2, -90: w / 2, 90: w / 2}[side]
        along = s.between(-0.35, 0.35) * (w if side == 0 else d)
        parts = things.picture(s.rng, s.pal, ww, hh)
        if s.chance(0.25):
            parts[0] = (parts[0][0], mirror())
        for mesh, material in parts:
            s.stage.add(mesh.moved(along, reach - 0.01, h * 0.58).turned("z", side), material)


def rug(s):
    s.stage.add(
        quad(s.between(1.2, 2.4), s.between(1.0, 2.0))
        .turned("z", s.pick(0, 0, 90, 20))
        .moved(s.between(-0.5, 0.5), s.between(0, 1), 0.008),
        s.pal.cloth(),
    )


def view_room(s, w, d, h, lens=0.08):
    eye = (s.between(-0.35, 0.35) * w, -d / 2 + s.between(0.15, 0.35) * d * 0.6, s.between(1.0, 1.7))
    aim = (s.between(-0.3, 0.3) * w, d / 2 - s.between(0, 1.5), s.between(0.5, 1.5))
    s.look(eye, aim, s.between(48, 78), lens)


def room(rng):
    """A furnished room."""
    s = Set(rng)
    w, d, h = s.between(3, 5.5), s.between(3.5, 6), s.between(2.4, 3.1)
    windows = shell(s, w, d, h)
    furnish(s, w, d, int(rng.integers(5, 12)))
    hang(s, w, d, h, int(rng.integers(0, 4)))
    if s.chance(0.5):
        rug(s)
    light_room(s, w, d, h, windows)
    view_room(s, w, d, h)
    s.depth = 9
    return s.finish()


def plain(rng):
    """Mostly empty walls in quiet colours, evenly lit, with a few things before them."""
    s = Set(rng, rng.choice(["quiet", "pale", "quiet", "pale", "grey", "earth"]))
    w, d, h = s.between(2.6, 4.5), s.between(2.8, 5), s.between(2.4, 3)
    windows = shell(s, w, d, h, plain=s.chance(0.6))
    furnish(s, w, d, int(rng.integers(2, 6)))
    hang(s, w, d, h, int(rng.integers(0, 2)))
    light_room(s, w, d, h, windows, even=s.chance(0.6))
    view_room(s, w, d, h)
    return s.finish()


def nook(rng):
    """The corner of a room from near by: silhouettes and shadow edges on plain walls."""
    s = Set(rng, rng.choice(["quiet", "pale", "earth", "grey", "dusk"]))
    s.stage.add(quad(6, 6), s.pal.floor())
    paint = s.pal.wall()
    s.stage.add(wall(6, 3.2).moved(0, 1.2), paint)
    if s.chance(0.7):
        s.stage.add(wall(6, 3.2).turned("z", s.pick(90, -90)).moved(s.pick(-1, 1) * 1.3), paint)
    for _ in range(int(rng.integers(1, 4))):
        kinds = s.pick(things.FURNITURE, things.QUIET, things.OBJECTS)
        size = 1.0 if kinds is things.FURNITURE else s.between(0.4, 0.9)
        s.put(things.some(rng, s.pal, kinds), s.between(-0.8, 0.8), s.between(-0.4, 0.8), 0, size, s.between(-40, 40))
    if s.chance(0.4):
        for mesh, material in things.picture(rng, s.pal, s.between(0.3, 0.8), s.between(0.3, 0.8)):
            s.stage.add(mesh.moved(s.between(-0.5, 0.5), 1.19, 1.3), material)
    # One light sets hard or soft shadows, another fills.
    at = (s.between(-2, 2), s.between(-2.5, -0.5), s.between(1.5, 3))
    tint = s.pal.lamp()
    if s.chance(0.25):
        s.stage.spot(at, (0, 0.6, 0.6), tint * 30, s.between(18, 40))
    else:
        r = s.pick(0.04, 0.12, 0.3, 0.6)
        s.lamp(sphere(r, 24).moved(*at), tint * 4 / r**2)
    if s.chance(0.8):
        s.lamp(quad(4, 4).turned("x", 180).moved(0, -1, 3.3), s.pal.lamp() * s.between(0.3, 1.5))
    s.look(
        (s.between(-0.8, 0.8), s.between(-2.6, -1.8), s.between(0.7, 1.5)),
        (s.between(-0.3, 0.3), 0.5, s.between(0.5, 0.9)),
        s.between(35, 60),
        0.15,
    )
    s.depth = 7
    return s.finish()


def wet(rng):
    """A kitchen or bathroom: tiles, sinks, mirrors, glass and metal."""
    s = Set(rng)
    w, d, h = s.between(2.4, 4), s.between(2.4, 4), s.between(2.3, 2.7)
    windows = shell(s, w, d, h)
    image, repeat = s.pal.pattern(["tiles", "bricks", "ornament", "checker", "marble"])
    glaze = plastic(image, s.between(0.05, 0.2), repeat=repeat)
    s.stage.add(wall(w, s.between(1, h - 0.2)).moved(0, d / 2 - 0.012), glaze)
    # A counter along the back wall with what stands on it.
    top, body = s.pal.coat() if s.chance(0.5) else glaze, s.pal.wood() if s.chance(0.5) else s.pal.paint()
    s.stage.add(box(w, 0.6, 0.05).moved(0, d / 2 - 0.32, 0.86), top)
    n = int(w / 0.6)
    s.stage.add(
        merged([box(w / n - 0.015, 0.56, 0.76).moved((i + 0.5) / n * w - w / 2, d / 2 - 0.3, 0.08) for i in range(n)]),
        body,
    )
    s.stage.add(
        merged(
            [
                bar(
                    ((i + 0.3) / n * w - w / 2, d / 2 - 0.6, 0.75),
                    ((i + 0.7) / n * w - w / 2, d / 2 - 0.6, 0.75),
                    0.015,
                )
                for i in range(n)
            ]
        ),
        s.pal.metal(),
    )
    steel = metal("Cr", 0.12)
    x = s.between(-0.3, 0.3) * w
    s.stage.add(
        tube([(x, d / 2 - 0.1, 0.9), (x, d / 2 - 0.1, 1.15), (x, d / 2 - 0.2, 1.22), (x, d / 2 - 0.32, 1.15)], 0.015),
        steel,
    )
    s.stage.add(
        lathe([(0.2, 0.03), (0.24, 0.04), (0.24, 0), (0.05, -0.0)]).moved(x, d / 2 - 0.32, 0.912),
        plastic((0.8, 0.8, 0.78)),
    )
    for _ in range(int(rng.integers(3, 9))):
        s.put(
            things.some(rng, s.pal, things.QUIET + [things.goblet, things.rack, things.goblet]),
            s.between(-0.45, 0.45) * w,
            d / 2 - s.between(0.15, 0.5),
            0.91,
            s.between(0.14, 0.3),
            s.between(0, 360),
        )
    if s.chance(0.5):
        for mesh, material in ((quad(s.between(0.5, 1.2), 0.7).turned("x", 90), mirror()),):
            s.stage.add(mesh.moved(x, d / 2 - 0.03, 1.6), material)
    if s.chance(0.5):
        s.put(things.shelf(rng, s.pal), -w / 2 + 0.2, s.between(-0.2, 0.8), 0, 1, 90)
    if s.chance(0.5):
        s.put(things.table(rng, s.pal), s.between(-0.3, 0.3), 0.1, 0, 0.9)
    light_room(s, w, d, h, windows)
    view_room(s, w, d, h)
    s.depth = 9
    return s.finish()


def corridor(rng):
    """A long hall with repeated columns, doors, beams or arches."""
    s = Set(rng)
    w, d, h = s.between(1.8, 3.5), s.between(7, 14), s.between(2.4, 3.6)
    shell(s, w, d, h)
    n = int(rng.integers(3, 8))
    kind = s.pick("columns", "doors", "ribs", "shelves", "lockers")
    material, trim = s.pal.wall() if s.chance(0.5) else s.pal.coat(), s.pal.paint()
    for i in range(n):
        y = (i + 0.5) / n * d - d / 2
        for side in (-1, 1):
            x = side * w / 2
            if kind == "columns":
                shaft = s.pick(cylinder(0.13, h, 24), box(0.22, 0.22, h))
                s.stage.add(shaft.moved(x - side * 0.25, y), material)
            elif kind == "doors":
                s.stage.add(box(0.06, 0.9, 2.0).moved(x, y), trim)
                s.stage.add(sphere(0.035, 16).moved(x - side * 0.07, y + 0.35, 1.0), s.pal.metal())
            elif kind == "shelves":
                s.put(things.shelf(rng, s.pal), x - side * 0.16, y, 0, 1, -90 * side)
            elif kind == "lockers":
                s.stage.add(box(0.4, d / n - 0.06, 1.8).moved(x - side * 0.2, y), s.pick(material, trim))
        if kind == "ribs":
            s.stage.add(
                merged(
                    [
                        box(w, 0.15, 0.2).moved(0, y, h - 0.2),
                        box(0.15, 0.15, h).moved(-w / 2, y),
                        box(0.15, 0.15, h).moved(w / 2, y),
                    ]
                ),
                material,
            )
    tint = s.pal.lamp()
    for i in range(n):
        if s.chance(0.8):
            y = (i + 0.5) / n * d - d / 2
            if n % 2:
                s.lamp(quad(w * 0.4, 0.3).turned("x", 180).moved(0, y, h - 0.02), tint * 8)
            else:
                s.lamp(sphere(0.09, 16).moved(0, y, h - 0.3), tint * 30)
    if s.chance(0.4):
        s.lamp(quad(w * 0.9, h * 0.9).turned("x", 90).moved(0, d / 2 - 0.02, h / 2), s.pal.lamp() * s.between(1, 6))
    for _ in range(int(rng.integers(0, 5))):
        s.put(
            things.some(rng, s.pal, things.FURNITURE + things.OBJECTS),
            s.between(-0.3, 0.3) * w,
            s.between(-0.2, 0.4) * d,
            0,
            s.between(0.5, 0.9),
            s.between(0, 360),
        )
    s.look(
        (s.between(-0.2, 0.2) * w, -d / 2 + 0.3, s.between(0.8, 1.7)),
        (s.between(-0.3, 0.3) * w, d / 2, s.between(0.8, 1.5)),
        s.between(50, 75),
    )
    if s.chance(0.2):
        s.stage.fog(s.between(0.02, 0.08), (0.95, 0.95, 0.95), (0, 0, 1.5), d * 0.7)
    return s.finish()


def gallery(rng):
    """White walls, objects on plinths, paintings, spots."""
    s = Set(rng, rng.choice(["pale", "quiet", "grey", "earth"]))
    w, d, h = s.between(4, 7), s.between(4, 7), s.between(2.8, 4)
    windows = shell(s, w, d, h)
    hang(s, w, d, h, int(rng.integers(2, 6)))
    white = diffuse(0.75 * np.ones(3))
    for i in range(int(rng.integers(2, 6))):
        x, y, tall = s.between(-0.35, 0.35) * w, s.between(-0.15, 0.35) * d, s.between(0.5, 1.1)
        s.stage.add(box(0.5, 0.5, tall).moved(x, y), white if s.chance(0.7) else s.pal.coat())
        s.put(things.some(rng, s.pal), x, y, tall, s.between(0.5, 0.8), s.between(0, 360))
        if s.chance(0.5):
            s.stage.spot(
                (x + s.between(-1, 1), y - 1.2, h - 0.1),
                (x, y, tall + 0.3),
                s.pal.lamp() * s.between(10, 40),
                s.between(10, 25),
            )
    light_room(s, w, d, h, windows, even=s.chance(0.4))
    view_room(s, w, d, h)
    return s.finish()


def stairs(rng):
    """Steps, railings, beams and landings: many straight edges."""
    s = Set(rng)
    w, d, h = s.between(3, 5), s.between(4, 6), s.between(3, 5)
    windows = shell(s, w, d, h)
    n, wide, x = int(rng.integers(6, 14)), s.between(0.8, 1.6), s.between(-0.3, 0.3) * w
    rise, run = h * 0.7 / n, s.between(0.22, 0.32)
    step = s.pal.wood() if s.chance(0.5) else s.pal.wall()
    solid = s.chance(0.6)
    steps = [
        box(wide, run, rise * (i + 1) if solid else 0.05).moved(x, i * run - 1, 0 if solid else rise * (i + 1))
        for i in range(n)
    ]
    s.stage.add(merged(steps), step)
    side = x + wide / 2 * s.pick(-1, 1)
    posts = [
        bar((side, i * run - 1, rise * (i + 1)), (side, i * run - 1, rise * (i + 1) + 0.9), 0.02) for i in range(n)
    ]
    posts.append(bar((side, -1, rise + 0.9), (side, (n - 1) * run - 1, rise * n + 0.9), 0.05))
    s.stage.add(merged(posts), s.pal.metal() if s.chance(0.5) else s.pal.paint())
    for i in range(int(rng.integers(0, 5))):
        y = s.between(-0.3, 0.5) * d
        s.stage.add(bar((-w / 2, y, h - 0.5), (w / 2, y, h - 0.5 + s.pick(0, 0.4)), 0.15, 0.2), step)
    furnish(s, w, d, int(rng.integers(1, 6)))
    light_room(s, w, d, h, windows)
    view_room(s, w, d, h)
    return s.finish()


# --- On a table.


def backdrop(s):
    """A table top, and behind it a wall, a bent paper, or nothing."""
    kind = s.pick("paper", "wall", "none", "wall")
    if kind == "paper":
        t = np.linspace(0, np.pi / 2, 9)
        line = [(-6, 0), *[(2 + 1.5 * np.sin(a), 1.5 - 1.5 * np.cos(a)) for a in t], (3.5, 6)]
        rows = np.array([[(x, y, z) for y, z in line] for x in (-8, 8)], float).transpose(1, 0, 2)
        s.stage.add(
            smoothed(Mesh(rows.reshape(-1, 3), grid(1, len(line) - 1)[:, ::-1], rows.reshape(-1, 3)[:, :2])),
            diffuse(s.pal.colour(0.2)),
        )
        return
    top = s.pick(s.pal.wood, s.pal.floor, s.pal.cloth, s.pal.paint)()
    s.stage.add(quad(9, 7).moved(0, 0.5), top)
    if kind == "wall":
        s.stage.add(wall(16, 8).moved(0, 4.0, -1), s.pal.wall())


def table_light(s):
    """A studio: environment, soft boxes, or one small lamp."""
    pick = s.rng.uniform()
    if pick < 0.4:
        s.daylight()
        return
    for _ in range(int(s.rng.integers(1, 4))):
        a, e, r = s.between(0, 2 * np.pi), s.between(0.3, 1.3), s.between(3, 5)
        at = np.array([np.cos(a) * np.cos(e), np.sin(a) * np.cos(e), np.sin(e)]) * r
        if at[1] > 3:
            at[1] = 3
        size = s.pick(0.1, 0.3, 0.8, 1.5)
        s.lamp(sphere(size, 20).moved(*at), s.pal.lamp() * 8 / size**2)
    if s.chance(0.7):
        s.stage.environment(np.ones((8, 16, 3)) * s.pal.lamp() * s.between(0.05, 0.5))


def spread(s, count, reach, kinds, low=0.5, high=1.1):
    taken = []
    for _ in range(count):
        for _ in range(15):
            x, y = s.between(-1, 1) * reach, s.between(-0.6, 1) * reach
            if all(np.hypot(x - a, y - b) > 0.75 for a, b in taken):
                break
        else:
            continue
        taken.append((x, y))
        s.put(things.some(s.rng, s.pal, kinds), x, y, 0, s.between(low, high), s.between(0, 360))


def tabletop(rng):
    s = Set(rng)
    backdrop(s)
    spread(s, int(rng.integers(4, 14)), s.between(0.9, 1.8), things.OBJECTS)
    table_light(s)
    s.look((s.between(-1.5, 1.5), s.between(-5, -3), s.between(0.8, 3)), (0, 0.3, 0.4), s.between(28, 45), 0.45)
    return s.finish()


def closeup(rng):
    """One or two things fill the picture, often out of focus at the edges."""
    s = Set(rng)
    backdrop(s)
    spread(s, int(rng.integers(1, 4)), 0.5, things.OBJECTS, 0.8, 1.3)
    if s.chance(0.5):
        spread(s, 4, 3.0, things.OBJECTS)
    table_light(s)
    s.look(
        (s.between(-0.8, 0.8), s.between(-2.6, -1.6), s.between(0.5, 1.6)),
        (s.between(-0.2, 0.2), 0.2, 0.4),
        s.between(28, 42),
        0.5,
    )
    return s.finish()


def caustics(rng):
    """Glass and metal under a small light."""
    s = Set(rng)
    s.stage.add(quad(12, 12), diffuse(s.pal.colour(0.1)) if s.chance(0.6) else s.pal.floor())
    if s.chance(0.6):
        s.stage.add(wall(12, 6).moved(0, 2.2), s.pal.wall())
    kinds = [
        things.goblet,
        things.quadric,
        things.orb,
        things.vase,
        things.bowl,
        things.knotted,
        things.blob,
        things.cage,
    ]
    for role, make in (("matt", s.pal.glass), ("coat", s.pal.metal), ("figured", s.pal.glass)):
        for _ in range(2):
            s.pal.made.setdefault(role, []).append(make())
    s.pal.made["matt"] *= 2
    s.pal.made["coat"] *= 2
    s.pal.made["figured"] *= 2
    spread(s, int(rng.integers(2, 7)), 1.2, kinds)
    r = s.pick(0.15, 0.3, 0.5)
    s.lamp(sphere(r, 24).moved(s.between(-2, 2), s.between(-1, 1.5), s.between(2.5, 4)), s.pal.lamp() * 6 / r**2)
    s.stage.environment(np.ones((8, 16, 3)) * s.pal.lamp() * s.between(0.05, 0.3))
    s.look((s.between(-1, 1), -4, s.between(1.2, 3)), (0, 0.2, 0.4), s.between(30, 42), 0.15)
    return s.finish()


def printed(rng):
    """Flat printed paper, cloth and boards: texture without geometry, and the shadows on it."""
    s = Set(rng)
    s.stage.add(quad(8, 8), s.pal.figured())
    for i in range(int(rng.integers(3, 10))):
        w, h = s.between(0.6, 1.6), s.between(0.6, 1.6)
        sheet = quad(w, h)
        if s.chance(0.7):
            sheet.uv = sheet.uv / [w, h]
        s.stage.add(
            sheet.turned("z", s.between(-40, 40)).moved(*s.between(-1.5, 1.5, 2), 0.004 * (i + 1)),
            s.pal.printed() if s.chance(0.7) else s.pal.figured(),
        )
    spread(s, int(rng.integers(0, 5)), 1.3, things.OBJECTS, 0.3, 0.7)
    table_light(s)
    s.look((s.between(-1, 1), s.between(-2.5, -0.5), s.between(2, 3.5)), (0, 0, 0), s.between(30, 50), 0.25)
    return s.finish()


# --- Outdoors.


def earth(s, size=120, hilly=0.0):
    image, repeat = s.pal.pattern(["gravel", "noise", "noise", "bricks", "terrazzo", "tiles"])
    material = diffuse(image, repeat=repeat * 0.5) if s.chance(0.7) else diffuse(s.pal.colour(0.05))
    s.stage.add(ground(size, hilly, s.rng, pitch=6 / size * s.between(0.5, 2)) if hilly else quad(size, size), material)


def weather(s, reach):
    if s.chance(0.3):
        s.stage.fog(s.between(0.2, 1.2) / reach, np.array((0.9, 0.94, 0.98)) * s.between(0.85, 1.0), (0, 0, 0), reach)


def exterior(rng):
    """Houses, trees and fences under a sky."""
    s = Set(rng)
    earth(s)
    for _ in range(int(rng.integers(1, 5))):
        s.put(
            things.house(rng, s.pal, s.between(4, 9), s.between(4, 8), s.between(2.8, 8)),
            s.between(-9, 9),
            s.between(4, 22),
            0,
            1,
            s.between(-40, 40),
        )
    for _ in range(int(rng.integers(1, 8))):
        make = s.pick(things.tree, things.conifer)
        s.put(make(rng, s.pal, s.between(2, 6)), s.between(-8, 8), s.between(-1, 14), 0, 1, s.between(0, 360))
    if s.chance(0.5):
        s.put(things.fence(rng, s.pal, s.between(4, 12)), s.between(-4, 4), s.between(-1, 2), 0, 1, s.between(-25, 25))
    for _ in range(int(rng.integers(1, 7))):
        s.put(
            things.some(rng, s.pal, things.OBJECTS + [things.rock] * 6),
            s.between(-3, 3),
            s.between(-3, 3),
            0,
            s.between(0.6, 1.2),
            s.between(0, 360),
        )
    s.daylight()
    weather(s, 40)
    s.look(
        (s.between(-4, 4), s.between(-9, -6), s.between(1.0, 4)),
        (s.between(-2, 2), 6, s.between(1, 2.5)),
        s.between(38, 62),
        0.1,
    )
    s.depth = 6
    return s.finish()


def street(rng):
    """A row of fronts with lamps, by day or in the evening."""
    s = Set(rng)
    earth(s, 80)
    for side in (-1, 1):
        y = -4.0
        while y < 26:
            w = s.between(4, 8)
            s.put(
                things.house(rng, s.pal, w - 0.05, 5, s.between(3, 10)), side * s.between(5.6, 6.4), y + w / 2, 0, 1, 90
            )
            y += w
    curb = s.pal.wall()
    for side in (-1, 1):
        s.stage.add(box(1.4, 40, 0.14).moved(side * 2.9, 10), curb)
    evening = s.chance(0.45)
    for i in range(4):
        glow = s.pal.lamp() * (s.between(40, 90) if evening else 0.3)
        s.put(things.street_lamp(rng, s.pal, glow), s.pick(-2.4, 2.4), i * 5.0, 0)
    for _ in range(int(rng.integers(2, 8))):
        s.put(
            things.some(
                rng,
                s.pal,
                [things.tree, things.cartons, things.rack, things.plant, things.ladder, things.stool, things.sign],
            ),
            s.pick(-1, 1) * s.between(1.2, 2.8),
            s.between(-2, 14),
            0,
            s.between(0.6, 1.1),
            s.between(0, 360),
        )
    if evening:
        s.stage.environment(np.ones((8, 16, 3)) * np.array((0.5, 0.7, 1.2)) * s.between(0.02, 0.15))
    else:
        s.daylight()
    weather(s, 35)
    s.look(
        (s.between(-1.5, 1.5), s.between(-8, -5), s.between(1.2, 2.5)),
        (s.between(-1.5, 1.5), 10, s.between(1.2, 2.5)),
        s.between(45, 65),
    )
    s.depth = 6
    return s.finish()


def landscape(rng):
    """Hills, rocks, grass and trees, with haze now and then."""
    s = Set(rng, rng.choice(["earth", "earth", "quiet", "dusk"]))
    hills = s.between(0.4, 1.6)
    earth(s, 60, hills)
    for _ in range(int(rng.integers(4, 14))):
        make = s.pick(things.tree, things.conifer, things.rock, things.rock)
        s.put(
            make(rng, s.pal, s.between(0.8, 4)),
            s.between(-8, 8),
            s.between(-3, 18),
            s.between(-1, 0.2),
            1,
            s.between(0, 360),
        )
    if s.chance(0.6):
        n = int(rng.integers(1500, 6000))
        at = np.stack([s.between(-3, 3, n), s.between(-6.5, 2, n), np.full(n, -0.4)], 1)
        s.stage.add(blades(at, s.between(0.4, 1.0, n), s.between(0.01, 0.04, n), rng, 0.6), s.pal.leafage())
    if s.chance(0.3):
        s.stage.add(quad(120, 120).moved(z=-0.4), plastic((0.02, 0.05, 0.06)) if s.chance(0.5) else mirror())
    s.daylight()
    weather(s, 35)
    s.look(
        (s.between(-2, 2), -9, 1.2 * hills + s.between(1.2, 3.5)),
        (s.between(-2, 2), 5, s.between(0, 1.5)),
        s.between(38, 60),
        0.15,
    )
    s.depth = 6
    return s.finish()


def fine(rng):
    """Things thinner than a pixel: nets, wires, grass, twigs, railings before something plain or bright."""
    s = Set(rng)
    s.stage.add(quad(30, 30), s.pal.floor())
    if s.chance(0.6):
        s.stage.add(wall(20, 8).moved(0, 4), s.pal.wall())
    for _ in range(int(rng.integers(2, 5))):
        y, t = s.between(-0.8, 2.5), s.between(0.004, 0.02)
        kind = s.pick("net", "wires", "tufts", "bare", "rings", "fence")
        if kind == "net":
            n = int(rng.integers(8, 30))
            lines = [bar((x, y, 0), (x, y, 2), t) for x in np.linspace(-1.5, 1.5, n)]
            lines += [bar((-1.5, y, z), (1.5, y, z), t) for z in np.linspace(0, 2, n)]
            s.stage.add(merged(lines).turned("z", s.between(-25, 25)), s.pal.any())
        elif kind == "wires":
            x = np.linspace(-4, 4, 24)
            lines = [
                tube(
                    np.stack(
                        [x, y + 0 * x, s.between(0.5, 2.5) + s.between(0, 0.06) * x**2 + s.between(-0.2, 0.2) * x], 1
                    ),
                    t,
                    5,
                )
                for _ in range(int(rng.integers(4, 14)))
            ]
            s.stage.add(merged(lines), s.pal.any())
        elif kind == "tufts":
            for _ in range(6):
                s.put(things.tuft(rng, s.pal), s.between(-1.5, 1.5), y + s.between(-0.5, 0.5), 0, s.between(0.6, 1.4))
        elif kind == "bare":
            tip, lines = np.array([s.between(-1, 1), y, 0.0]), []
            for _ in range(40):
                a = tip + [0, 0, s.between(0, 1)]
                lines.append(tube(np.array([a, a + rng.normal(0, 0.35, 3) + [0, 0, 0.5]]), [t * 1.5, t * 0.4], 5))
            s.stage.add(merged(lines), s.pal.wood())
        elif kind == "rings":
            for _ in range(12):
                s.stage.add(
                    ring(s.between(0.1, 0.5), t, 40, 5)
                    .turned("x", s.between(0, 180))
                    .moved(s.between(-1.3, 1.3), y, s.between(0.2, 1.8)),
                    s.pal.metal(),
                )
        else:
            s.put(things.fence(rng, s.pal, 4, 1.4), 0, y, 0, 1, s.between(-20, 20))
    s.daylight() if s.chance(0.6) else table_light(s)
    s.look(
        (s.between(-1, 1), s.between(-4.5, -3), s.between(0.8, 1.8)),
        (0, 0.5, s.between(0.7, 1.1)),
        s.between(32, 50),
        0.2,
    )
    s.depth = 6
    return s.finish()


# --- Odd light.


def dark(rng):
    """A dark frame with one lit subject."""
    s = Set(rng)
    s.mean = float(s.between(0.02, 0.1))
    s.stage.add(quad(12, 12), s.pal.floor())
    if s.chance(0.6):
        s.stage.add(wall(12, 5).moved(0, 2.5), s.pal.wall())
    s.put(things.some(rng, s.pal), s.between(-0.5, 0.5), 0.2, 0, s.between(0.8, 1.4), s.between(0, 360))
    for _ in range(int(rng.integers(0, 5))):
        s.put(things.some(rng, s.pal), s.between(-2, 2), s.between(-0.5, 2), 0, s.between(0.5, 1), s.between(0, 360))
    at = (s.between(-1.5, 1.5), s.between(-1.5, 0.5), s.between(2, 3.5))
    pick = rng.uniform()
    if pick < 0.45:
        s.stage.spot(at, (0, 0.2, 0.4), s.pal.lamp() * 30, s.between(8, 20))
    elif pick < 0.75:
        s.put(things.candle(rng, s.pal), s.between(-0.8, 0.8), -0.3, 0, s.between(0.6, 1))
    else:
        # A lamp in a hood.
        s.lamp(sphere(0.07, 16).moved(*at), s.pal.lamp() * 500)
        s.stage.add(lathe([(0.3, -0.15), (0.1, 0.2), (0, 0.22)]).moved(*at), s.pal.paint())
    if s.chance(0.6):
        s.stage.environment(np.ones((8, 16, 3)) * s.between(0.002, 0.015))
    if s.chance(0.3):
        s.stage.fog(s.between(0.03, 0.12), (0.95, 0.95, 0.95), (0, 0, 1), 5)
    s.look((s.between(-1, 1), s.between(-4, -2.6), s.between(0.7, 1.8)), (0, 0.2, 0.5), s.between(32, 50), 0.2)
    return s.finish()


def night(rng):
    """Many visible lamps, bright signs and their reflections."""
    s = Set(rng, rng.choice(["dusk", "vivid", "grey", "quiet"]))
    s.mean = float(s.between(0.08, 0.3))
    s.stage.add(quad(30, 30), s.pal.floor() if s.chance(0.6) else plastic(s.pal.colour(), 0.12))
    if s.chance(0.7):
        s.stage.add(wall(20, 8).moved(0, 4.5), s.pal.wall())
    spread(s, int(rng.integers(2, 8)), 1.8, things.OBJECTS, 0.6, 1.2)
    for _ in range(int(rng.integers(1, 4))):
        kind = s.pick("string", "tubes", "sign", "orbs", "screen")
        tint = s.pal.lamp() if s.chance(0.6) else s.between(0.05, 1.6, 3)
        if kind == "string":
            n = int(rng.integers(6, 24))
            x, z = np.linspace(-3, 3, n), s.between(1.2, 2.2)
            at = np.stack([x, np.full(n, s.between(0, 3)), z + 0.25 * np.cos(2 * x)], 1)
            s.lamp(scattered(sphere(s.between(0.03, 0.08), 12), at), tint * s.between(8, 25))
        elif kind == "tubes":
            at = s.between(-1.5, 1.5, 2)
            path = np.stack(
                [
                    np.linspace(-1, 1, 20) * s.between(0.4, 1.2) + at[0],
                    np.full(20, s.between(1, 4.3)),
                    1.2 + 0.4 * np.sin(np.linspace(0, s.between(1, 9), 20)),
                ],
                1,
            )
            s.lamp(tube(path, 0.03), tint * s.between(4, 12))
        elif kind == "sign":
            mesh = letters(
                str(s.pick("BAR", "OPEN", "N 7", "HOTEL", "24")), s.between(0.4, 0.9), 0.06, ImageFont.load_default(20)
            )
            s.lamp(mesh.moved(s.between(-1, 1), s.between(1.5, 4.3), s.between(0.8, 1.8)), tint * s.between(3, 12))
        elif kind == "orbs":
            n = int(rng.integers(2, 6))
            at = np.stack([s.between(-2, 2, n), s.between(-0.5, 3, n), s.between(0.15, 0.3, n)], 1)
            s.lamp(scattered(sphere(0.15, 20), at), tint * s.between(4, 12))
        else:
            s.lamp(quad(1.6, 0.9).turned("x", 90).moved(s.between(-1, 1), s.between(2, 4), 1.0), tint * s.between(1, 4))
    s.stage.environment(np.ones((8, 16, 3)) * np.array((0.6, 0.8, 1.3)) * s.between(0.003, 0.03))
    if s.chance(0.2):
        s.stage.fog(s.between(0.02, 0.08), (0.9, 0.9, 0.95), (0, 1, 1), 7)
    s.look(
        (s.between(-1.5, 1.5), s.between(-5, -3.5), s.between(0.6, 2)),
        (0, 0.8, s.between(0.5, 0.9)),
        s.between(35, 52),
        0.3,
    )
    return s.finish()


def abstract(rng):
    """Shapes in empty space: silhouettes against nothing, or against a plain or shaded background."""
    s = Set(rng)
    n = int(rng.integers(4, 22))
    kinds = [
        things.quadric,
        things.blob,
        things.knotted,
        things.faceted,
        things.cage,
        things.orb,
        things.turned,
        things.coil,
        things.sign,
    ]
    for _ in range(n):
        s.put(
            things.some(rng, s.pal, kinds),
            *s.between(-1.6, 1.6, 3) - [0, 0, 0.4],
            s.between(0.4, 1.2),
            s.between(0, 360),
        )
    back = s.pick("nothing", "nothing", "plain", "sky")
    if back == "sky":
        s.daylight()
    elif back == "plain":
        s.stage.environment(np.ones((8, 16, 3)) * s.pal.lamp() * s.between(0.3, 1))
    if back == "nothing" or s.chance(0.5):
        for _ in range(int(rng.integers(1, 4))):
            at = rng.normal(0, 1, 3)
            at = at / np.linalg.norm(at) * s.between(4, 7)
            at[1] = -abs(at[1])
            r = s.pick(0.2, 0.6, 1.2)
            s.lamp(sphere(r, 20).moved(*at), s.pal.lamp() * 12 / r**2)
    s.look((s.between(-2, 2), -5, s.between(-1, 2)), (0, 0, 0), s.between(30, 46), 0.25)
    if back == "nothing":
        s.mean *= 0.5
    return s.finish()


KINDS = {
    f.__name__: f
    for f in (
        room, plain, nook, wet, corridor, gallery, stairs, tabletop, closeup, caustics, printed, exterior, street,
        landscape, fine, dark, night, abstract,
    )
}  # fmt: skip


def generate(kind, seed, stage=Stage):
    """The scene of this kind and seed; the same on every machine but for rounding."""
    Set.new_stage = stage
    return KINDS[kind](np.random.default_rng([seed, list(KINDS).index(kind)]))
