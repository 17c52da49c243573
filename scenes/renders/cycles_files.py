"""Renders the desk with Blender's Cycles, with the boxes ticked that users tick."""

import sys
import tempfile
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent))

import bpy
from mathutils import Vector

import cycles_stage as kit
import desk
import images
import listing

SAMPLES, SEED = 8, 1
REFERENCE_SAMPLES, REFERENCE_SEED = 3072, 1000


class Stage(kit.Stage):
    """A stage whose objects have names, which Cryptomatte writes down."""

    def add(self, name, mesh, material):
        super().add(mesh, material)
        self.scene.collection.objects[-1].name = name


def build(samples, seed):
    """The desk in a fresh Blender: what is not set here is as Blender has it."""
    stage = Stage()
    for name, mesh, material in desk.things(kit, kit.metal((0.9, 0.72, 0.45), 0.4)):
        stage.add(name, mesh, material)
    stage.add("Glow", desk.glow(), kit.glow(desk.GLOW["colour"], desk.GLOW["radiance"]))
    stage.lamp(desk.LAMP["origin"], desk.LAMP["target"], 280.0, desk.LAMP["width"], colour=desk.LAMP["colour"])
    stage.scene.collection.objects[-1].name = "Lamp"
    stage.camera(desk.EYE, desk.TARGET, desk.FOV)
    stage.scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0.06, 0.08, 0.11, 1)
    scene = stage.scene
    scene.name = "Desk"
    scene.render.engine = "CYCLES"
    scene.render.resolution_x, scene.render.resolution_y = desk.SIZE
    scene.render.resolution_percentage = 100
    scene.cycles.samples, scene.cycles.seed = samples, seed
    # Blender denoises on its own by default; who takes Tamis unticks that.
    scene.cycles.use_denoising = False
    return scene


def kind(scene, multilayer, depth, codec, interleave):
    settings = scene.render.image_settings
    settings.media_type = "MULTI_LAYER_IMAGE" if multilayer else "IMAGE"
    settings.file_format = "OPEN_EXR_MULTILAYER" if multilayer else "OPEN_EXR"
    settings.color_depth = depth
    settings.use_exr_interleave = interleave
    if codec:
        settings.exr_codec = codec


def passes(layer, *names):
    layer.cycles.denoising_store_passes = True
    for name in names:
        setattr(layer, f"use_pass_{name}", True)


def nothing(scene):
    pass


def data(scene):
    passes(scene.view_layers[0], "z")


def transparent(scene):
    scene.render.film_transparent = True
    passes(scene.view_layers[0], "z", "normal")


def many(scene):
    """Also the parts of diffuse light, Cryptomatte, and two light groups."""
    transparent(scene)
    layer = scene.view_layers[0]
    passes(layer, "position", "diffuse_direct", "diffuse_indirect", "diffuse_color", "cryptomatte_object")
    for group, name in (("key", "Lamp"), ("glow", "Glow")):
        layer.lightgroups.add(name=group)
        bpy.data.objects[name].lightgroup = group


def stereo(scene):
    passes(scene.view_layers[0])
    scene.render.use_multiview = True
    scene.render.image_settings.views_format = "MULTIVIEW"
    scene.camera.data.stereo.interocular_distance = 0.3
    scene.camera.data.stereo.convergence_distance = 5.5


def two_layers(scene):
    """Everything, and the desk without what lies on it."""
    first, second = scene.view_layers[0], scene.view_layers.new("Empty Desk")
    first.name = "Things"
    loose = bpy.data.collections.new("Loose")
    scene.collection.children.link(loose)
    for name in ("Box", "Glass", "Knot", "Ball"):
        loose.objects.link(bpy.data.objects[name])
        scene.collection.objects.unlink(bpy.data.objects[name])
    second.layer_collection.children["Loose"].exclude = True
    passes(first, "z")
    passes(second, "z")


def blurred(scene):
    """A lens, and a ball that rolls while the shutter is open."""
    passes(scene.view_layers[0], "z")
    lens = scene.camera.data.dof
    lens.use_dof, lens.aperture_fstop = True, 0.06
    lens.focus_distance = (Vector(desk.FOCUS) - scene.camera.location).length
    scene.render.use_motion_blur = True
    ball = bpy.data.objects["Ball"]
    for frame, x in ((0, -0.5), (2, 0.5)):
        ball.location.x = x
        ball.keyframe_insert("location", frame=frame)
    scene.frame_set(1)


ONE = [("ViewLayer", "")]
EYES = [("ViewLayer", "left"), ("ViewLayer", "right")]
# File: what is ticked, in words and as a function; several layers or not; bits; codec (none: Blender's own choice);
# interleaved or not; (layer, view) of each colour; references. The left eye is where the single camera is, and the
# layer `Things` holds all of the scene, so several files share `cycles_opaque`.
FILES = {
    "cycles_multilayer": (
        "MultiLayer, half; film transparent; Z, Normal, Position, Denoising Data, Diffuse Direct, Indirect and Color, "
        "Cryptomatte Object, light groups `key` and `glow`",
        (many, True, "16", None, False), ONE, ["cycles_transparent"],
    ),
    "cycles_interleaved": (
        "MultiLayer, half, Interleave; film transparent; Z, Normal, Denoising Data",
        (transparent, True, "16", None, True), ONE, ["cycles_transparent"],
    ),
    "cycles_dwaa": (
        "MultiLayer, float, DWAA; Z, Denoising Data",
        (data, True, "32", "DWAA", False), ONE, ["cycles_opaque"],
    ),
    "cycles_rgba": (
        "OpenEXR, half; nothing else",
        (nothing, False, "16", None, False), ONE, ["cycles_opaque"],
    ),
    "cycles_stereo": (
        "MultiLayer, half; Stereoscopy with Multi-View; Denoising Data",
        (stereo, True, "16", None, False), EYES, ["cycles_opaque", "cycles_right"],
    ),
    "cycles_stereo_interleaved": (
        "MultiLayer, half, Interleave; Stereoscopy with Multi-View; Denoising Data",
        (stereo, True, "16", None, True), EYES, ["cycles_opaque", "cycles_right"],
    ),
    "cycles_layers": (
        "MultiLayer, half; view layers `Things` and `Empty Desk`; Z, Denoising Data",
        (two_layers, True, "16", None, False), [("Things", ""), ("Empty Desk", "")], ["cycles_opaque", "cycles_empty"],
    ),
    "cycles_blur": (
        "MultiLayer, float, ZIP; depth of field, motion blur; Z, Denoising Data",
        (blurred, True, "32", "ZIP", False), ONE, ["cycles_blur"],
    ),
}  # fmt: skip


def shoot(path, samples, seed, tick, multilayer, depth, codec, interleave, adaptive=True):
    scene = build(samples, seed)
    scene.cycles.use_adaptive_sampling = adaptive
    kind(scene, multilayer, depth, codec, interleave)
    tick(scene)
    scene.render.use_file_extension = False
    scene.render.filepath = str(path)
    with kit.silence():
        bpy.ops.render.render(write_still=True)


def find(parts, layer, view):
    """The part's number and the channels' prefix of a layer's colour: Blender has four ways to name it."""
    for number, part in enumerate(parts):
        if part.header.get("view", "") not in ("", view):
            continue
        for prefix in ("", f"{layer}.Combined.", f"{layer}.Combined.{view}."):
            if prefix + "R" in part.channels:
                return number, prefix
    raise ValueError(f"no colour of layer {layer}, view {view}")


def render(only):
    unknown = set(only) - set(FILES)
    if unknown:
        sys.exit(f"no such file: {', '.join(sorted(unknown))}; there are {', '.join(FILES)}")
    entries, done = {}, set()
    for name, (ticked, how, colours, references) in FILES.items():
        if only and name not in only:
            continue
        path = listing.FOLDER / f"{name}.exr"
        shoot(path, SAMPLES, SEED, *how)
        found = [find(images.parts(path), *colour) for colour in colours]
        entries[path.name] = {
            "renderer": f"Blender {bpy.app.version_string} Cycles",
            "ticked": ticked,
            "samples": SAMPLES,
            "colours": [listing.colour(*place, reference) for place, reference in zip(found, references)],
        }
        if not done.issuperset(references):
            done.update(references)
            with tempfile.TemporaryDirectory() as folder:
                clean = Path(folder) / "clean.exr"
                tick = how[0]
                shoot(clean, REFERENCE_SAMPLES, REFERENCE_SEED, tick, True, "32", "ZIP", False, adaptive=False)
                parts = images.parts(clean)
                for colour, reference in zip(colours, references):
                    number, prefix = find(parts, *colour)
                    image = images.planes(parts[number], [prefix + c for c in "RGB"])
                    images.write_reference(listing.FOLDER / "reference" / f"{reference}.exr", image)
        print(path.name, flush=True)
    listing.add(entries)


if __name__ == "__main__":
    render(sys.argv[1:])
