"""Patterns as float arrays (height, width, 3) of linear colour, all tileable; no files are read.

Lists of colours come as linear RGB in 0..1.
"""

import numpy as np
from PIL import Image, ImageDraw, ImageFont


def noise(size, roughness=1.5, seed=0, stretch=(1, 1)):
    """Tileable fractal noise in 0..1: white noise shaped in the frequency domain.

    `roughness` is the fall-off of the spectrum (1: rough, 2.5: smooth clouds); `stretch` > 1 along (y, x)
    draws the pattern out in that direction.
    """
    rng = np.random.default_rng(seed)
    fy = np.fft.fftfreq(size)[:, None] * size * stretch[0]
    fx = np.fft.rfftfreq(size)[None] * size * stretch[1]
    f = np.hypot(fy, fx)
    f[0, 0] = np.inf
    field = np.fft.irfft2(np.fft.rfft2(rng.standard_normal((size, size))) / f**roughness, s=(size, size))
    # Rank-free equalisation: about 98% of the values stay inside 0..1.
    return np.clip(0.5 + field / field.std() * 0.21, 0, 1)


def mix(a, b, t):
    t = np.asarray(t)[..., None]
    return np.asarray(a) * (1 - t) + np.asarray(b) * t


def ramp(t, colours):
    """Colours blended along t in 0..1."""
    c = np.asarray(colours, float)
    x = np.clip(t, 0, 1) * (len(c) - 1)
    i = np.minimum(x.astype(int), len(c) - 2)
    return mix(c[i], c[i + 1], x - i)


def lattice(size):
    return np.meshgrid((np.arange(size) + 0.5) / size, (np.arange(size) + 0.5) / size, indexing="ij")


def smoothstep(a, b, x):
    t = np.clip((x - a) / (b - a), 0, 1)
    return t * t * (3 - 2 * t)


def checker(size, cells, a, b):
    y, x = lattice(size)
    return mix(a, b, (np.floor(x * cells) + np.floor(y * cells)) % 2)


def stripes(size, colours, count):
    y, x = lattice(size)
    c = np.asarray(colours, float)
    return c[(np.floor(x * count * len(c)) % len(c)).astype(int)]


def dots(size, cells, a, b, radius=0.3):
    y, x = lattice(size)
    row = np.floor(y * cells)
    d = np.hypot((x * cells + 0.5 * (row % 2)) % 1 - 0.5, y * cells % 1 - 0.5)
    return mix(b, a, smoothstep(radius * 0.9, radius * 1.1, d))


def wood(size, seed, light=(0.48, 0.27, 0.12), dark=(0.2, 0.09, 0.035), rings=9):
    """Grain along x: rings bent by smooth noise, with fine pores."""
    y, x = lattice(size)
    bend = noise(size, 2.2, seed, (1, 6))
    grain = 0.5 + 0.5 * np.sin(2 * np.pi * (rings * y + 5 * bend))
    pores = noise(size, 0.6, seed + 1, (1, 30))
    return np.clip(ramp(0.75 * grain**1.5 + 0.25 * bend, [light, dark]) * (0.75 + 0.5 * pores)[..., None], 0, 1)


def planks(size, count, seed, **colours):
    """Boards along x, each with its own piece of wood and dark joints."""
    rng = np.random.default_rng(seed)
    board = wood(size, seed, **colours)
    height = size // count
    out = np.empty((height * count, size, 3))
    for i in range(count):
        piece = np.roll(board, rng.integers(size, size=2), (0, 1))[:height] * rng.uniform(0.65, 1.15)
        piece[: max(1, height // 24)] *= 0.2
        end = rng.integers(size)
        piece[:, end : end + max(1, size // 300)] *= 0.2
        out[i * height : (i + 1) * height] = piece
    return np.clip(out, 0, 1)


def bricks(size, rows, columns, face, joint, seed, joint_width=0.08):
    """Staggered bricks (or tiles), each of its own shade, with mottling."""
    rng = np.random.default_rng(seed)
    y, x = lattice(size)
    row = np.floor(y * rows).astype(int)
    u = (x * columns + 0.5 * (row % 2)) % columns
    shade = rng.uniform(0.55, 1.25, (rows, columns))[row, np.floor(u).astype(int)]
    wear = noise(size, 1.1, seed)
    edge = np.minimum(np.minimum(u % 1, 1 - u % 1) * rows / columns, np.minimum(y * rows % 1, 1 - y * rows % 1))
    body = np.asarray(face) * (shade * (0.6 + 0.8 * wear))[..., None]
    return np.clip(mix(joint, body, smoothstep(joint_width * 0.4, joint_width * 0.7, edge)), 0, 1)


def tiles(size, cells, a, b, joint, seed, joint_width=0.03):
    """Square tiles in two colours, chosen at random, with joints."""
    rng = np.random.default_rng(seed)
    y, x = lattice(size)
    pick = rng.uniform(0, 1, (cells, cells))[np.floor(y * cells).astype(int), np.floor(x * cells).astype(int)]
    u, v = x * cells % 1, y * cells % 1
    edge = np.minimum(np.minimum(u, 1 - u), np.minimum(v, 1 - v))
    return mix(joint, mix(a, b, pick), edge > joint_width)


def ornament(size, cells, colours, seed):
    """Patterned cement tiles: rings, stars and petals around each cell's centre."""
    y, x = lattice(size)
    u, v = x * cells % 1 - 0.5, y * cells % 1 - 0.5
    r, t = np.hypot(u, v), np.arctan2(v, u)
    level = np.zeros((size, size), int)
    level[r < 0.44 + 0.05 * np.cos(8 * t)] = 1
    level[r < 0.33 + 0.07 * np.cos(4 * t)] = 2
    level[r < 0.17 + 0.05 * np.cos(8 * t)] = 3
    level[r < 0.07] = 1
    level[np.maximum(abs(u), abs(v)) > 0.485] = 3
    wear = 0.8 + 0.3 * noise(size, 1.0, seed)
    return np.clip(np.asarray(colours, float)[level] * wear[..., None], 0, 1)


def marble(size, seed, base=(0.75, 0.73, 0.7), vein=(0.16, 0.17, 0.2)):
    veins = np.abs(noise(size, 1.7, seed) - 0.5) + 0.4 * np.abs(noise(size, 1.3, seed + 1) - 0.5)
    return mix(vein, base, smoothstep(0.0, 0.14, veins))


def terrazzo(
    size, seed, base=(0.62, 0.6, 0.56), chips=((0.5, 0.2, 0.14), (0.12, 0.13, 0.14), (0.3, 0.36, 0.3), (0.7, 0.55, 0.3))
):
    """Stone chips in a light ground."""
    out = np.broadcast_to(np.asarray(base, float), (size, size, 3)).copy()
    for i, chip in enumerate(chips):
        out[noise(size, 0.85, seed + i) > 0.68] = chip
    return out


def weave(size, threads, warp, weft, seed=0):
    """Cloth: over and under, each thread rounded and slightly uneven."""
    y, x = lattice(size)
    over = (np.floor(x * threads) + np.floor(y * threads)) % 2
    bulge = np.where(over, np.sin(np.pi * (x * threads % 1)), np.sin(np.pi * (y * threads % 1)))
    shade = (0.45 + 0.55 * bulge) * (0.8 + 0.4 * noise(size, 0.8, seed))
    return np.clip(mix(warp, weft, over) * shade[..., None], 0, 1)


def gravel(size, seed, colours=((0.5, 0.46, 0.4), (0.25, 0.24, 0.23), (0.62, 0.58, 0.5), (0.34, 0.27, 0.2))):
    """Speckled ground with large stains."""
    fine, coarse = noise(size, 0.5, seed), noise(size, 1.8, seed + 1)
    return np.clip(ramp(fine, colours) * (0.55 + 0.8 * coarse)[..., None], 0, 1)


def words(rng, letters):
    vowels, rest = "aeiou", "bcdfghlmnprstv"
    text = ""
    while len(text) < letters:
        text += "".join(rng.choice(list(rest)) + rng.choice(list(vowels)) for _ in range(rng.integers(1, 5))) + " "
    return text[:letters]


def page(width, height, seed, columns=2, line=14, paper=(0.86, 0.84, 0.78), ink=(0.02, 0.02, 0.025), picture=True):
    """A printed page of invented words with a headline and a picture."""
    rng = np.random.default_rng(seed)
    image = Image.new("L", (width, height), 255)
    draw = ImageDraw.Draw(image)
    margin = width // 18
    draw.text((margin, margin // 2), words(rng, 60).title(), font=ImageFont.load_default(line * 3), fill=0)
    top = margin // 2 + line * 4
    draw.line((margin, top, width - margin, top), fill=0, width=max(1, line // 6))
    gap = (width - 2 * margin) // columns
    font = ImageFont.load_default(line)
    for c in range(columns):
        y, x = top + line // 2, margin + c * gap
        while y < height - margin:
            if picture and c == columns - 1 and top + height // 8 < y < height * 0.6:
                y += line
                continue
            clip = Image.new("L", (gap - line, int(line * 1.3)), 255)
            ImageDraw.Draw(clip).text((0, 0), words(rng, 120), font=font, fill=20)
            image.paste(clip, (x, y))
            y += int(line * 1.3)
    if picture:
        x, y = margin + (columns - 1) * gap, top + height // 8
        side = (gap - line, max(8, int(height * 0.6) - y - line))
        art = Image.fromarray((noise(512, 1.6, seed) * 255).astype("u1")).resize(side)
        image.paste(art.point(lambda p: 255 if p > 150 else (120 if p > 100 else 20)), (x, y))
    return mix(ink, paper, np.asarray(image) / 255.0)


def poster(size, seed, palette):
    """Overlapping discs, bars and letters in flat colours."""
    rng = np.random.default_rng(seed)
    eight = [tuple(int(255 * c ** (1 / 2.2)) for c in p) for p in palette]
    image = Image.new("RGB", (size, size), eight[0])
    draw = ImageDraw.Draw(image)
    for _ in range(26):
        colour = eight[rng.integers(1, len(eight))]
        x, y = rng.integers(0, size, 2)
        r = int(rng.uniform(0.03, 0.2) * size)
        kind = rng.integers(4)
        if kind == 0:
            draw.ellipse((x - r, y - r, x + r, y + r), fill=colour)
        elif kind == 1:
            draw.rectangle((x - r, y - r // 5, x + r, y + r // 5), fill=colour)
        elif kind == 2:
            draw.polygon([(x, y - r), (x + r, y + r), (x - r, y + r // 2)], fill=colour)
        else:
            draw.text(
                (x - r, y - r), words(rng, 2).strip().upper() or "A", font=ImageFont.load_default(r * 2), fill=colour
            )
    return (np.asarray(image) / 255.0) ** 2.2


def spines(width, height, count, seed, palette):
    """The backs of books in a row: coloured bands with bars and titles."""
    rng = np.random.default_rng(seed)
    image = Image.new("RGB", (width, height), (0, 0, 0))
    draw = ImageDraw.Draw(image)
    edges = np.cumsum(rng.uniform(0.5, 1.5, count))
    edges = np.concatenate([[0], edges / edges[-1] * width]).astype(int)
    for a, b in zip(edges, edges[1:]):
        colour = tuple(int(255 * c ** (1 / 2.2)) for c in palette[rng.integers(len(palette))])
        draw.rectangle((a, 0, b - 2, height), fill=colour)
        pale = tuple(min(255, c + 110) for c in colour)
        for y in rng.uniform(0.05, 0.95, 2):
            draw.rectangle((a, y * height, b - 2, y * height + 5), fill=pale)
        strip = Image.new("RGB", (height, max(8, b - a - 3)), colour)
        ImageDraw.Draw(strip).text(
            (height // 6, 0), words(rng, 24).upper(), font=ImageFont.load_default(max(8, (b - a) * 2 // 3)), fill=pale
        )
        image.paste(strip.rotate(90, expand=True).crop((0, 0, max(1, b - a - 3), int(height * 0.7))), (a, height // 5))
    return (np.asarray(image) / 255.0) ** 2.2
