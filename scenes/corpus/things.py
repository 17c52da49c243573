"""Objects and furniture, each a list of (mesh, material) or (mesh, material, glow) standing on z = 0."""

import numpy as np
from PIL import ImageFont

from corpus.palette import black
from shapes import (
    Mesh,
    bar,
    blades,
    box,
    curtain,
    cylinder,
    displaced,
    knot,
    lathe,
    leaf,
    letters,
    merged,
    quad,
    ring,
    rounded_box,
    scattered,
    smoothed,
    sphere,
    spring,
    superquadric,
    surface,
    tube,
)

# --- Objects: about one unit tall and wide, any scene may scale them.


def profile(rng, height, points=7, low=0.12, high=0.5, hollow=False):
    """A smooth random outline for a lathe, closed at the bottom; `hollow` adds an inner wall."""
    z = np.linspace(0, 1, 24)
    knots = rng.uniform(low, high, points)
    r = np.clip(sum(k * np.maximum(0, 1 - np.abs(z * (points - 1) - i)) for i, k in enumerate(knots)), low, high)
    r = np.convolve(np.pad(r, 2, "edge"), np.ones(5) / 5, "valid")
    outer = [(0, 0), *zip(r, z * height)]
    if not hollow:
        return [*outer, (0, height)]
    inner = [(max(a - 0.04, 0.02), b) for a, b in zip(r[::-1], z[::-1] * height)]
    inner[-1] = (inner[-1][0], 0.05)
    return [*outer, *inner, (0, 0.05)]


def vase(rng, pal):
    return [(lathe(profile(rng, rng.uniform(0.6, 1.3), hollow=True), 40), pal.any())]


def turned(rng, pal):
    return [(lathe(profile(rng, rng.uniform(0.6, 1.4), int(rng.integers(5, 14)), 0.06), 40), pal.any())]


def goblet(rng, pal):
    h, w = rng.uniform(0.8, 1.2), rng.uniform(0.25, 0.4)
    stem = [(0, 0.03), (w * 0.8, 0.03), (0.05, 0.08), (0.04, h * 0.5), (w * 0.7, h * 0.6), (w, h)]
    return [(lathe([*stem, (w - 0.03, h), (w * 0.6, h * 0.63), (0, h * 0.56)], 40), pal.glass())]


def bowl(rng, pal):
    w = rng.uniform(0.35, 0.6)
    out = [(0, 0), (w * 0.4, 0), (w * 0.45, 0.04), (w * 0.85, w * 0.45), (w, w * 0.8)]
    parts = [(lathe([*out, (w - 0.04, w * 0.8), (w * 0.8, w * 0.47), (w * 0.3, 0.08), (0, 0.07)], 40), pal.any())]
    fruit = pal.any()
    for _ in range(int(rng.integers(0, 6))):
        r = rng.uniform(0.1, 0.18)
        a = rng.uniform(0, 6.3)
        parts.append((sphere(r, 24).moved(0.4 * w * np.cos(a), 0.4 * w * np.sin(a), w * rng.uniform(0.5, 0.85)), fruit))
    return parts


def quadric(rng, pal):
    e = rng.choice([0.15, 0.3, 0.6, 1.0, 1.6, 2.4], 2)
    size = rng.uniform(0.3, 0.55, 3)
    return [(superquadric(*e).scaled(*size).moved(z=size[2]), pal.any())]


def blob(rng, pal):
    mesh = displaced(sphere(0.45, 72), rng.uniform(0.04, 0.2), rng, rng.uniform(2, 7))
    return [(mesh.moved(z=0.5), pal.any())]


def bust(rng, pal):
    """Stacked rounded forms, dense and bumpy."""
    material = pal.any()
    z, parts = 0.0, []
    for r in sorted(rng.uniform(0.15, 0.4, 3), reverse=True):
        parts.append(displaced(superquadric(*rng.uniform(0.5, 1.3, 2), 60, 40).scaled(r), 0.03, rng, 12).moved(z=z + r))
        z += 1.6 * r
    return [(merged(parts), material)]


def knotted(rng, pal):
    p, q = [(2, 3), (3, 2), (2, 5), (3, 4)][rng.integers(4)]
    mesh = knot(p, q, rng.uniform(0.04, 0.11)).turned("x", rng.uniform(0, 90)).scaled(0.6)
    return [(mesh.moved(z=-mesh.v[:, 2].min()), pal.any())]


def faceted(rng, pal):
    """A low ball with flat faces."""
    m = displaced(sphere(0.45, int(rng.integers(5, 12))), 0.08, rng)
    flat = Mesh(m.v[m.f].reshape(-1, 3), np.arange(m.f.size).reshape(-1, 3), m.uv[m.f].reshape(-1, 2))
    return [(flat.moved(z=0.42), pal.any())]


def books(rng, pal):
    parts, z = [], 0.0
    for _ in range(int(rng.integers(2, 7))):
        h = rng.uniform(0.05, 0.14)
        w, d = rng.uniform(0.5, 0.8), rng.uniform(0.4, 0.55)
        turn = rng.uniform(-20, 20)
        parts.append((box(w, d, h).turned("z", turn).moved(z=z), pal.paint()))
        parts.append((box(w - 0.02, d, h * 0.75).turned("z", turn).moved(0.015, 0.015, z + h * 0.12), pal.cloth()))
        z += h
    return parts


def cartons(rng, pal):
    a = rng.uniform(0.4, 0.9, 3)
    parts = [(box(*a), pal.any())]
    if rng.uniform() < 0.5:
        b = rng.uniform(0.25, 0.5, 3)
        parts.append((box(*b).turned("z", rng.uniform(0, 90)).moved(z=a[2]), pal.any()))
    return parts


def cushion(rng, pal):
    a = rng.uniform(0.5, 0.9, 3) * [1, 1, 0.6]
    return [(rounded_box(*a, min(a) * rng.uniform(0.15, 0.45)), pal.any())]


def mug(rng, pal):
    material = pal.any()
    cup = lathe([(0, 0), (0.28, 0), (0.3, 0.04), (0.3, 0.7), (0.26, 0.7), (0.26, 0.06), (0, 0.05)], 40)
    return [(cup, material), (ring(0.2, 0.045).turned("x", 90).moved(0.36, 0, 0.36), material)]


def candle(rng, pal):
    h = rng.uniform(0.4, 1.0)
    flame = lathe([(0, 0), (0.05, 0.05), (0.04, 0.13), (0, 0.24)], 12).moved(z=h + 0.04)
    glow = tuple(np.array((1.4, 0.95, 0.45)) * rng.uniform(6, 30))
    return [
        (cylinder(0.14, h), pal.wax()),
        (lathe([(0, 0), (0.3, 0), (0.32, 0.05), (0, 0.06)]), pal.metal()),
        (flame, black(), glow),
    ]


def plant(rng, pal):
    """Leaves over a pot."""
    pot = lathe([(0, 0), (0.2, 0), (0.28, 0.4), (0.24, 0.4), (0.2, 0.34), (0, 0.33)], 32)
    spray = []
    for _ in range(int(rng.integers(12, 40))):
        one = leaf(rng.uniform(0.35, 0.8), rng.uniform(0.08, 0.24), rng.uniform(0.1, 0.7), 5)
        spray.append(
            one.turned("y", -rng.uniform(10, 80)).turned("z", rng.uniform(0, 360)).moved(z=rng.uniform(0.35, 0.6))
        )
    return [(pot, pal.any()), (merged(spray), pal.leafage())]


def tuft(rng, pal):
    """Long thin grass or bristles: thinner than a pixel in most pictures."""
    n = int(rng.integers(60, 240))
    places = np.concatenate([rng.normal(0, 0.1, (n, 2)), np.zeros((n, 1))], 1)
    mesh = blades(places, rng.uniform(0.5, 1.1, n), rng.uniform(0.008, 0.03, n), rng, rng.uniform(0.3, 1.0))
    return [(mesh, pal.leafage() if rng.uniform() < 0.7 else pal.any())]


def cage(rng, pal):
    """A ball of wires."""
    n, t = int(rng.integers(5, 12)), rng.uniform(0.006, 0.02)
    hoops = [ring(0.45, t, 40, 6).turned("x", 90).turned("z", 180 * i / n) for i in range(n)]
    hoops += [ring(0.45 * np.cos(a), t, 40, 6).moved(z=0.45 * np.sin(a)) for a in np.linspace(-1.2, 1.2, n // 2)]
    parts = [(merged(hoops).moved(z=0.46), pal.metal() if rng.uniform() < 0.5 else pal.paint())]
    if rng.uniform() < 0.5:
        parts.append((sphere(0.2, 32).moved(z=0.46), pal.any()))
    return parts


def coil(rng, pal):
    return [(spring(0.3, rng.uniform(0.5, 1.0), rng.uniform(4, 12), rng.uniform(0.015, 0.05)), pal.any())]


def chain(rng, pal):
    t = np.linspace(0, 1, 16)
    path = np.stack([t - 0.5, 0.25 * np.sin(5 * t + rng.uniform(0, 6)), 0 * t + 0.06], 1)
    links = [
        ring(0.055, 0.014, 20, 6)
        .scaled(1.3, 1, 1)
        .turned("x", 90 * (i % 2))
        .turned("z", rng.uniform(-40, 40))
        .moved(*p)
        for i, p in enumerate(path)
    ]
    return [(merged(links), pal.metal())]


def beads(rng, pal):
    n = int(rng.integers(15, 50))
    at = np.concatenate([rng.uniform(-0.5, 0.5, (n, 2)), np.full((n, 1), 0.06)], 1)
    return [
        (scattered(sphere(0.06, 16), at[: n // 2]), pal.any()),
        (scattered(sphere(0.06, 16), at[n // 2 :]), pal.any()),
    ]


def sign(rng, pal):
    """Block letters; sometimes they glow."""
    text = "".join(rng.choice(list("ABCDEFGHKMNOPRSTUVXYZ0123456789&"), int(rng.integers(1, 5))))
    mesh = letters(
        text, rng.uniform(0.5, 0.9), rng.uniform(0.08, 0.25), ImageFont.load_default(int(rng.integers(14, 30)))
    )
    if rng.uniform() < 0.15:
        return [(mesh, black(), tuple(pal.lamp() * rng.uniform(1, 4)))]
    return [(mesh, pal.any())]


def blocks(rng, pal):
    """Toy bricks piled up."""
    parts = []
    for _ in range(int(rng.integers(5, 12))):
        a = rng.uniform(0.12, 0.35, 3)
        turn = rng.uniform(0, 90)
        at = (*rng.uniform(-0.4, 0.4, 2), rng.choice([0, 0, 0.2]))
        parts.append((box(*a).turned("z", turn).moved(*at), pal.any()))
    return parts


def drape(rng, pal):
    """A cloth thrown over something round."""
    h, k = rng.uniform(0.3, 0.8), rng.uniform(3, 7)

    def shape(u, v):
        x, y = (u - 0.5) * 1.3, (v - 0.5) * 1.3
        r = np.hypot(x, y)
        a = np.arctan2(y, x)
        fall = h * np.exp(-((r / 0.35) ** 4)) + 0.06 * r * np.sin(k * a + 3 * r) * (r > 0.2) * 1.2
        return np.stack([x, y, np.maximum(fall, 0.01)], 1)

    return [(surface(shape, 50, 50), pal.cloth())]


def rack(rng, pal):
    """Thin bars side by side."""
    n, w = int(rng.integers(5, 16)), rng.uniform(0.01, 0.04)
    parts = [bar((x, 0, 0), (x, 0, 0.9), w) for x in np.linspace(-0.45, 0.45, n)]
    parts += [bar((-0.48, 0, z), (0.48, 0, z), w * 1.4) for z in (0.05, 0.9)]
    return [(merged(parts), pal.any())]


def card(rng, pal):
    """A printed card that leans back."""
    w, h = rng.uniform(0.5, 0.9), rng.uniform(0.5, 0.9)
    sheet = quad(w, h)
    sheet.uv = sheet.uv / [w, h]
    tilt = rng.uniform(50, 85)
    return [(sheet.turned("x", tilt).moved(z=h / 2 * np.sin(np.radians(tilt))), pal.printed())]


def pane_of_glass(rng, pal):
    return [(box(rng.uniform(0.4, 0.8), 0.03, rng.uniform(0.5, 1.0)), pal.glass())]


def orb(rng, pal):
    r = rng.uniform(0.25, 0.45)
    return [(sphere(r, 48).moved(z=r), pal.any())]


OBJECTS = [
    vase, turned, goblet, bowl, quadric, blob, bust, knotted, faceted, books, cartons, cushion, mug, candle, plant,
    tuft, cage, coil, chain, beads, sign, blocks, drape, rack, card, pane_of_glass, orb, quadric, blob, cartons,
]  # fmt: skip
QUIET = [vase, turned, bowl, quadric, books, cartons, cushion, mug, plant, drape, orb, card, blob]


def some(rng, pal, kinds=OBJECTS):
    """Any object."""
    return kinds[rng.integers(len(kinds))](rng, pal)


# --- Furniture, in metres.


def table(rng, pal, width=1.4, depth=0.8, height=0.74):
    top, leg = pal.wood() if rng.uniform() < 0.7 else pal.paint(), rng.uniform(0.03, 0.08)
    x, y = width / 2 - leg, depth / 2 - leg
    legs = [box(leg, leg, height).moved(a * x, b * y, 0) for a in (-1, 1) for b in (-1, 1)]
    return [
        (box(width, depth, 0.04).moved(z=height - 0.04), top),
        (merged(legs), top if rng.uniform() < 0.6 else pal.metal()),
    ]


def chair(rng, pal):
    wood, s = pal.wood() if rng.uniform() < 0.6 else pal.paint(), rng.uniform(0.4, 0.5)
    parts = [box(s, s, 0.04).moved(z=0.44)]
    parts += [
        bar((x * s, y * s, 0), (x * s * 0.9, y * s * 0.9, 0.45), 0.035) for x in (-0.45, 0.45) for y in (-0.45, 0.45)
    ]
    parts += [
        bar((x * s, 0.45 * s, 0.46), (x * s, 0.55 * s, 0.95), 0.02)
        for x in np.linspace(-0.42, 0.42, int(rng.integers(2, 8)))
    ]
    parts += [bar((-0.48 * s, 0.55 * s, 0.93), (0.48 * s, 0.55 * s, 0.93), 0.05)]
    out = [(merged(parts), wood)]
    if rng.uniform() < 0.4:
        out.append((rounded_box(s * 0.9, s * 0.9, 0.06, 0.03).moved(z=0.48), pal.cloth()))
    return out


def sofa(rng, pal):
    w, r = rng.uniform(0.8, 2.0), rng.uniform(0.03, 0.1)
    cloth = pal.cloth()
    parts = [
        rounded_box(w, 0.8, 0.42, r),
        rounded_box(w, 0.22, 0.85, r).moved(0, 0.36, 0),
        rounded_box(0.2, 0.85, 0.6, r).moved(-w / 2, 0, 0),
        rounded_box(0.2, 0.85, 0.6, r).moved(w / 2, 0, 0),
    ]
    out = [(merged(parts), cloth)]
    for x in rng.uniform(-w / 3, w / 3, int(rng.integers(0, 3))):
        out.append((rounded_box(0.4, 0.14, 0.38, 0.06).turned("x", -15).moved(x, 0.18, 0.44), pal.cloth()))
    return out


def bed(rng, pal):
    sheet = smoothed(rounded_box(1.5, 2.0, 0.25, 0.1, 5))
    return [
        (box(1.6, 2.1, 0.3), pal.wood()),
        (sheet.moved(z=0.28), pal.cloth()),
        (box(1.6, 0.06, 1.0).moved(0, 1.05, 0), pal.wood()),
        (merged([rounded_box(0.6, 0.4, 0.16, 0.07).moved(x, 0.72, 0.5) for x in (-0.36, 0.36)]), pal.cloth()),
    ]


def shelf(rng, pal):
    """A bookcase, partly filled."""
    w, h, n = rng.uniform(0.7, 1.6), rng.uniform(1.0, 2.1), int(rng.integers(3, 6))
    wood = pal.wood() if rng.uniform() < 0.6 else pal.paint()
    boards = [box(w, 0.3, 0.025).moved(0, 0, z) for z in np.linspace(0.05, h, n)]
    boards += [box(0.025, 0.3, h).moved(x, 0, 0) for x in (-w / 2, w / 2)]
    out = [(merged(boards), wood), (box(w, 0.01, h).moved(0, 0.15, 0), wood)]
    gap = (h - 0.05) / (n - 1)
    for z in np.linspace(0.05, h, n)[:-1]:
        x = -w / 2 + 0.04
        while x < w / 2 - 0.1:
            if rng.uniform() < 0.55:
                t, tall = rng.uniform(0.02, 0.06), gap * rng.uniform(0.5, 0.85)
                out.append(
                    (
                        box(t, 0.2, tall).moved(x + t / 2, 0, z + 0.025),
                        pal.paint() if rng.uniform() < 0.7 else pal.cloth(),
                    )
                )
                x += t + 0.003
            elif rng.uniform() < 0.2:
                for part in some(rng, pal, QUIET):
                    out.append((part[0].scaled(gap * 0.5).moved(x + gap * 0.25, 0, z + 0.025), *part[1:]))
                x += gap * 0.6
            else:
                x += rng.uniform(0.05, 0.25)
    return out


def cabinet(rng, pal):
    w, h, n = rng.uniform(0.6, 1.6), rng.uniform(0.6, 1.0), int(rng.integers(2, 5))
    body = pal.wood() if rng.uniform() < 0.5 else pal.paint()
    doors = [box(w / n - 0.02, 0.02, h - 0.1).moved(-w / 2 + w / n * (i + 0.5), -0.23, 0.06) for i in range(n)]
    knobs = [sphere(0.018, 12).moved(-w / 2 + w / n * (i + 0.8), -0.26, h * 0.6) for i in range(n)]
    return [(box(w, 0.44, h), body), (merged(doors), body), (merged(knobs), pal.metal())]


def stool(rng, pal):
    h = rng.uniform(0.4, 0.7)
    wood = pal.wood()
    legs = [
        bar((0.2 * np.cos(a), 0.2 * np.sin(a), 0), (0.12 * np.cos(a), 0.12 * np.sin(a), h), 0.03)
        for a in (0.5, 2.6, 4.7)
    ]
    return [(cylinder(0.19, 0.04).moved(z=h), wood), (merged(legs), wood)]


def ladder(rng, pal):
    parts = [bar((x, 0, 0), (x, 0.5, 1.9), 0.04) for x in (-0.2, 0.2)]
    parts += [bar((-0.2, 0.5 * t, 1.9 * t), (0.2, 0.5 * t, 1.9 * t), 0.025) for t in np.linspace(0.1, 0.92, 7)]
    return [(merged(parts), pal.wood())]


def floor_lamp(rng, pal, glow):
    """A stand, a shade that lets light through, and a bulb."""
    h = rng.uniform(1.2, 1.6)
    shade = lathe([(rng.uniform(0.16, 0.24), 0), (rng.uniform(0.08, 0.18), 0.26)], 32).moved(z=h - 0.05)
    return [
        (lathe([(0, 0), (0.14, 0), (0.14, 0.02), (0.012, 0.04), (0.012, h), (0, h)], 24), pal.metal()),
        (shade, pal.wax()),
        (sphere(0.04, 16).moved(z=h + 0.06), black(), tuple(glow)),
    ]


def pendant(rng, pal, glow, ceiling, drop):
    """A lamp on a cable; its origin is the ceiling's place above it."""
    kind = rng.integers(3)
    z = ceiling - drop
    out = [(bar((0, 0, z + 0.1), (0, 0, ceiling), 0.008), pal.metal())]
    if kind == 0:
        return out + [(sphere(rng.uniform(0.06, 0.16), 24).moved(z=z), black(), tuple(glow))]
    if kind == 1:
        shade = lathe([(0.22, 0), (0.12, 0.12), (0.03, 0.16)], 32).moved(z=z - 0.03)
        return out + [(shade, pal.paint()), (sphere(0.04, 16).moved(z=z), black(), tuple(glow))]
    shade = lathe([(0.2, 0), (0.22, 0.1), (0.2, 0.22)], 32).moved(z=z - 0.1)
    return out + [(shade, pal.wax()), (sphere(0.04, 16).moved(z=z), black(), tuple(glow))]


def picture(rng, pal, width, height):
    """In the XZ plane, facing -Y, centred."""
    sheet = quad(width, height)
    sheet.uv = sheet.uv / [width, height]
    out = [(sheet.turned("x", 90).moved(y=-0.015), pal.printed())]
    if rng.uniform() < 0.8:
        w, h, t = width / 2, height / 2, rng.uniform(0.015, 0.05)
        frame = [bar((-w - t, -0.01, z), (w + t, -0.01, z), t) for z in (-h - t / 2, h + t / 2)]
        frame += [bar((x, -0.01, -h), (x, -0.01, h), t) for x in (-w - t / 2, w + t / 2)]
        out.append((merged(frame), pal.wood() if rng.uniform() < 0.5 else pal.metal()))
    return out


def drapes(rng, pal, width, height):
    """A curtain in the XZ plane, standing on z = 0."""
    return [
        (curtain(width, height, int(rng.integers(4, 9)), 0.05, rng), pal.cloth() if rng.uniform() < 0.6 else pal.wax())
    ]


def slats(rng, pal, width, height):
    """Blinds in the XZ plane, standing on z = 0."""
    n, tilt = int(height / rng.uniform(0.04, 0.09)), rng.uniform(10, 70)
    slat = box(width, 0.045, 0.003).turned("x", tilt)
    return [(merged([slat.moved(z=z) for z in np.linspace(0, height, n)]), pal.paint())]


FURNITURE = [table, chair, sofa, shelf, cabinet, stool, chair, plant, ladder]


# --- Outdoors, in metres.


def tree(rng, pal, height=3.0):
    trunk = np.array([(0, 0, 0), (0.1, 0, 0.3), (0.0, 0.1, 0.6)]) * height + rng.normal(0, 0.05, (3, 3)) * [1, 1, 0]
    trunk[0, 2] = 0
    parts = [tube(trunk, [0.04 * height, 0.03 * height, 0.015 * height], 8)]
    for _ in range(6):
        a, z = rng.uniform(0, 6.3), rng.uniform(0.4, 0.6) * height
        tip = trunk[2] + np.array([np.cos(a), np.sin(a), rng.uniform(0.2, 1.2)]) * height * 0.25
        parts.append(
            tube(
                np.array([(trunk[1] + trunk[2]) / 2 * [1, 1, 0] + [0, 0, z], tip]), [0.015 * height, 0.004 * height], 6
            )
        )
    bark = pal.wood()
    if rng.uniform() < 0.25:
        return [(merged(parts), bark)]
    n = int(rng.integers(150, 500))
    d = rng.standard_normal((n, 3))
    d = d / np.linalg.norm(d, axis=1, keepdims=True) * rng.uniform(0.5, 1, (n, 1)) ** 0.4
    at = d * np.array([0.32, 0.32, 0.28]) * height + [0, 0, 0.75 * height]
    size = rng.uniform(0.05, 0.1) * height
    one = [
        leaf(size, size * 0.5, 0.3, 4).turned("y", rng.uniform(-80, 80)).turned("z", rng.uniform(0, 360))
        for _ in range(12)
    ]
    crown = merged([scattered(m, at[i::12], rng.uniform(0, 360, len(at[i::12]))) for i, m in enumerate(one)])
    return [(merged(parts), bark), (crown, pal.leafage())]


def conifer(rng, pal, height=3.0):
    cones = [
        lathe([(0.28 * height * (1 - t), t * height * 0.9), (0.02, (t + 0.4 * (1.1 - t)) * height)], 9)
        for t in np.linspace(0.1, 0.8, int(rng.integers(3, 7)))
    ]
    return [(cylinder(0.03 * height, 0.3 * height, 8), pal.wood()), (merged(cones), pal.leafage())]


def rock(rng, pal, size=1.0):
    mesh = displaced(sphere(1.0, 40), 0.2, rng, 1.8, 4).scaled(*(size * rng.uniform(0.4, 0.7, 3)))
    return [(mesh.moved(z=size * 0.2), pal.keep("stone", pal.figured, 2))]


def house(rng, pal, width, depth, height):
    """Walls with windows and doors in relief, and a roof."""
    wall = pal.keep("house", pal.wall, 3)
    out = [(box(width, depth, height), wall)]
    frames, panes = [], []
    storeys, columns = max(1, int(height / 2.8)), max(1, int(width / 2.2))
    for side, span, turn, off in ((0, width, 0, depth / 2), (1, depth, 90, width / 2)):
        n = columns if side == 0 else max(1, int(depth / 2.2))
        for i in range(storeys):
            for j in range(n):
                x, z = (j + 0.5) / n * span - span / 2, (i + 0.35) / storeys * height
                for face in (-1, 1):
                    frames.append(box(1.1, 0.1, 1.5).moved(x, face * off, z).turned("z", turn))
                    panes.append(box(0.9, 0.16, 1.3).moved(x, face * off, z + 0.1).turned("z", turn))
    out += [(merged(frames), pal.paint())]
    lit = rng.uniform(size=len(panes)) < rng.choice([0, 0, 0.4])
    dark = [p for p, on in zip(panes, lit) if not on]
    bright = [p for p, on in zip(panes, lit) if on]
    if dark:
        out.append((merged(dark), pal.keep("panes", pal.coat, 1)))
    if bright:
        out.append((merged(bright), black(), tuple(pal.lamp() * rng.uniform(0.5, 2))))
    roof = pal.keep("roof", pal.wall, 2)
    if rng.uniform() < 0.6:
        a, b, h = width / 2 + 0.3, depth / 2 + 0.3, rng.uniform(0.3, 0.6) * depth
        v = np.array([(-a, -b, 0), (a, -b, 0), (a, b, 0), (-a, b, 0), (-a, 0, h), (a, 0, h)], float)
        f = np.array([(0, 1, 5), (0, 5, 4), (2, 3, 4), (2, 4, 5), (1, 2, 5), (3, 0, 4)])
        flat = Mesh(v[f].reshape(-1, 3), np.arange(18).reshape(-1, 3), v[f].reshape(-1, 3)[:, :2])
        out.append((flat.moved(z=height), roof))
    else:
        out.append((box(width + 0.4, depth + 0.4, 0.25).moved(z=height), roof))
    return out


def fence(rng, pal, length, height=1.1):
    n, w = int(length / rng.uniform(0.1, 0.25)), rng.uniform(0.02, 0.08)
    parts = [box(w, 0.03, height * rng.uniform(0.9, 1)).moved(x, 0, 0) for x in np.linspace(-length / 2, length / 2, n)]
    parts += [box(length, 0.04, 0.06).moved(0, 0.03, z) for z in (0.25 * height, 0.8 * height)]
    return [(merged(parts), pal.wood() if rng.uniform() < 0.6 else pal.paint())]


def street_lamp(rng, pal, glow):
    h = rng.uniform(2.6, 3.6)
    return [
        (lathe([(0, 0), (0.12, 0), (0.1, 0.3), (0.05, 0.35), (0.04, h), (0, h)], 16), pal.metal()),
        (sphere(0.14, 20).moved(z=h + 0.14), black(), tuple(glow)),
    ]
