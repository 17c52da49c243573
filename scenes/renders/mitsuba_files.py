"""Renders the desk with Mitsuba 3, with the integrators and films that users write down."""

import sys
from fractions import Fraction
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import drjit as dr
import numpy as np
import OpenEXR

import desk
import images
import listing
import mitsuba_stage as kit

mi = kit.mi
SAMPLES, SEED = 8, 1
REFERENCE_ROUNDS, REFERENCE_ROUND, REFERENCE_SEED = 16, 512, 1000

PATH = {"type": "path", "max_depth": 8}
AOVS = {"type": "aov", "aovs": "albedo:albedo,shn:sh_normal,pos:position,z:depth", "my_path": PATH}
NESTED = {"type": "aov", "aovs": "alb:albedo,nn:sh_normal", "full": PATH, "direct": {"type": "direct"}}
MOMENT = {"type": "moment", "both": {"type": "aov", "aovs": "albedo:albedo,nn:sh_normal", "img": PATH}}
RGBA = {"pixel_format": "rgba"}
# A crop as a bucket of a larger frame. Mitsuba keeps nothing of where it was: both windows start at (0, 0).
CROP = {"crop_offset_x": 10, "crop_offset_y": 6, "crop_width": 56, "crop_height": 40}
# File: what the user wrote, in words and as integrator and film; DWAB level (none: Mitsuba's own PIZ); reference.
FILES = {
    "mitsuba_aov": (
        "`aov` (albedo:albedo,shn:sh_normal,pos:position,z:depth) around `path` named my_path; film as it is: half, "
        "rgb",
        (AOVS, {}), None, "mitsuba",
    ),
    "mitsuba_nested": (
        "`aov` (alb:albedo,nn:sh_normal) around `path` named full and `direct` named direct; film rgba",
        (NESTED, RGBA), None, "mitsuba",
    ),
    "mitsuba_moment": (
        "`moment` around `aov` (albedo:albedo,nn:sh_normal) around `path` named img; film as it is",
        (MOMENT, {}), None, "mitsuba",
    ),
    "mitsuba_rgba": (
        "`path`; film half, rgba, crop of 56x40; written with `quality=45`, which is DWAB",
        (PATH, RGBA | CROP), 45, "mitsuba_crop",
    ),
}  # fmt: skip


def shoot(integrator, film, samples, seed):
    """The film of a scene that has been rendered."""
    stage = kit.Stage()
    for _, mesh, material in desk.things(kit, kit.metal("Au", 0.25)):
        stage.add(mesh, material)
    glow = [desk.GLOW["radiance"] * c for c in desk.GLOW["colour"]]
    stage.add(desk.glow(), kit.diffuse(0.0), glow=glow)
    look = mi.ScalarTransform4f().look_at(desk.LAMP["origin"], desk.LAMP["target"], [0, 0, 1])
    stage.parts["lamp"] = {
        "type": "rectangle",
        "to_world": look @ mi.ScalarTransform4f().scale(desk.LAMP["width"] / 2),
        "emitter": {"type": "area", "radiance": kit.texture([60 * c for c in desk.LAMP["colour"]])},
    }
    stage.camera(desk.EYE, desk.TARGET, desk.FOV)
    film = {"type": "hdrfilm", "width": desk.SIZE[0], "height": desk.SIZE[1]} | film
    sensor = stage.view | {"film": film, "sampler": {"type": "independent"}}
    scene = mi.load_dict({"type": "scene", "sensor": sensor, "integrator": integrator, **stage.parts})
    # One thread adds samples to pixels in one order. Writing a file waits for a second thread for ever.
    threads = dr.thread_count()
    dr.set_thread_count(1)
    mi.render(scene, spp=samples, seed=seed)
    dr.sync_thread()
    dr.set_thread_count(max(threads, 2))
    return scene.sensors()[0].film()


def reference(crop):
    """The colour of many samples; in several rounds, which bounds the memory."""
    film = {"component_format": "float32", "pixel_format": "rgb"} | crop
    rounds = (shoot(PATH, film, REFERENCE_ROUND, REFERENCE_SEED + i) for i in range(REFERENCE_ROUNDS))
    return np.mean([np.array(film.develop(), np.float64)[..., :3] for film in rounds], 0)


def window(x, y, width, height):
    return np.array([x, y], np.int32), np.array([x + width - 1, y + height - 1], np.int32)


def rewrite(source, tiled, parted):
    """What a studio's tools make of Mitsuba's file: tiles, and one part per layer."""
    part = images.parts(source)[0]
    channels = {name: channel.pixels for name, channel in part.channels.items()}
    kept = {"generatedBy": part.header["generatedBy"], "owner": "the desk", "exposure": 1.5, "frame": 7}
    tiles = OpenEXR.TileDescription()
    tiles.xSize = tiles.ySize = 32
    # A crop of a larger frame, and overscan around a smaller one.
    cropped = {"dataWindow": window(10, 6, *desk.SIZE), "displayWindow": window(0, 0, 96, 64)}
    overscan = {"dataWindow": window(-4, -4, *desk.SIZE), "displayWindow": window(0, 0, 64, 40)}
    header = kept | cropped | {
        "type": OpenEXR.tiledimage, "tiles": tiles, "compression": OpenEXR.ZIP_COMPRESSION,
        "lineOrder": OpenEXR.RANDOM_Y, "pixelAspectRatio": 1.5, "worldToCamera": np.eye(4, dtype=np.float32),
        "framesPerSecond": Fraction(24000, 1001),
        # Those of Rec. 709.
        "chromaticities": (0.64, 0.33, 0.3, 0.6, 0.15, 0.06, 0.3127, 0.329),
    }  # fmt: skip
    OpenEXR.File(header, channels).write(str(tiled))
    layers = {}
    for name, pixels in channels.items():
        layer, _, component = name.rpartition(".")
        layers.setdefault(layer, {})[component] = pixels
    others = {"": OpenEXR.PIZ_COMPRESSION, "shn": OpenEXR.ZIPS_COMPRESSION, "z": OpenEXR.NO_COMPRESSION}
    parts = []
    for i, (layer, planes) in enumerate(layers.items()):
        compression = others.get(layer, OpenEXR.ZIP_COMPRESSION)
        header = {"name": layer or "rgb", "type": OpenEXR.scanlineimage, "compression": compression}
        order = OpenEXR.INCREASING_Y if i else OpenEXR.DECREASING_Y
        parts.append(OpenEXR.Part(kept | overscan | header | {"lineOrder": order}, planes))
    OpenEXR.File(parts).write(str(parted))


def render(only):
    unknown = set(only) - set(FILES)
    if unknown:
        sys.exit(f"no such file: {', '.join(sorted(unknown))}; there are {', '.join(FILES)}")
    entries, done = {}, set()
    renderer = f"Mitsuba {mi.__version__}"
    for name, (written, how, quality, clean) in FILES.items():
        if only and name not in only:
            continue
        path = listing.FOLDER / f"{name}.exr"
        film = shoot(*how, SAMPLES, SEED)
        if quality:
            # The film's bitmap is in float, whatever the film writes.
            film.bitmap().convert(component_format=mi.Struct.Type.Float16).write(str(path), quality=quality)
        else:
            film.write(str(path))
        colours = [listing.colour(0, "", clean)]
        entries[path.name] = {"renderer": renderer, "ticked": written, "samples": SAMPLES, "colours": colours}
        if clean not in done:
            done.add(clean)
            image = reference(CROP if clean == "mitsuba_crop" else {})
            images.write_reference(listing.FOLDER / "reference" / f"{clean}.exr", image)
        print(path.name, flush=True)
        if name == "mitsuba_aov":
            others = {
                "mitsuba_tiled.exr": "tiles of 32x32 in random order, a crop, pixel aspect 1.5",
                "mitsuba_parts.exr": "a part for each layer, lines upwards in the first, overscan",
            }
            rewrite(path, *(listing.FOLDER / other for other in others))
            for other, words in others.items():
                entries[other] = entries[path.name] | {
                    "renderer": f"{renderer}, OpenEXR {OpenEXR.__version__}",
                    "ticked": f"`mitsuba_aov.exr` written again by PyPI's OpenEXR: {words}, more attributes",
                }
                print(other, flush=True)
    listing.add(entries)


if __name__ == "__main__":
    render(sys.argv[1:])
