"""Blender's Cycles behind the same few calls as mitsuba_stage.py: meshes, materials, lights, a camera, rendering."""

import contextlib
import os
import tempfile
from pathlib import Path

import bpy
import numpy as np
import OpenEXR
from mathutils import Vector

# Cycles renders the first sample of every pixel through the pixel's centre, so single-sample passes made of it are
# not antialiased and share their position. Sample 1 is the first that is drawn from the pixel's whole area, but
# Cycles writes its own position and depth passes for sample 0 only: materials write them to outputs of our own.
FIRST_SAMPLE = 1
# Light that left the first hit, split by lobe; Cycles stores it without the lobe's colour.
LOBES = ("Diffuse", "Glossy", "Transmission")


def picture(pattern):
    """An image datablock of linear values; row 0 is v = 0, as in Mitsuba."""
    pattern = np.asarray(pattern, np.float32)
    height, width = pattern.shape[:2]
    image = bpy.data.images.new("pattern", width, height, float_buffer=True, is_data=True)
    rgba = np.ones((height, width, 4), np.float32)
    rgba[..., :3] = pattern if pattern.ndim == 3 else pattern[..., None]
    image.pixels.foreach_set(rgba.ravel())
    image.update()
    return image


def connect(tree, socket, pattern, repeat):
    """Set a node's input to a number, a colour, or an image repeated `repeat` times per unit of u and v."""
    if np.ndim(pattern) == 0:
        socket.default_value = float(pattern) if socket.type == "VALUE" else (float(pattern),) * 3 + (1,)
    elif np.ndim(pattern) == 1:
        socket.default_value = (*map(float, pattern), 1)
    else:
        image = tree.nodes.new("ShaderNodeTexImage")
        image.image = picture(pattern)
        place = tree.nodes.new("ShaderNodeMapping")
        place.inputs["Scale"].default_value = (repeat, repeat, 1)
        source = tree.nodes.new("ShaderNodeTexCoord")
        tree.links.new(source.outputs["UV"], place.inputs["Vector"])
        tree.links.new(place.outputs["Vector"], image.inputs["Vector"])
        tree.links.new(image.outputs["Color"], socket)


def material(node, repeat=1.0, **inputs):
    """A material of one shader node; `inputs` are its sockets by name (underscores for blanks)."""
    out = bpy.data.materials.new(node)
    out.use_nodes = True
    tree = out.node_tree
    tree.nodes.clear()
    shader = tree.nodes.new(node)
    for name, value in inputs.items():
        connect(tree, shader.inputs[name.replace("_", " ")], value, repeat)
    tree.links.new(shader.outputs[0], tree.nodes.new("ShaderNodeOutputMaterial").inputs["Surface"])
    where, hit = tree.nodes.new("ShaderNodeOutputAOV"), tree.nodes.new("ShaderNodeOutputAOV")
    where.aov_name, hit.aov_name = "Where", "Hit"
    tree.links.new(tree.nodes.new("ShaderNodeNewGeometry").outputs["Position"], where.inputs["Color"])
    hit.inputs["Value"].default_value = 1.0
    return out


def diffuse(pattern, repeat=1.0):
    return material("ShaderNodeBsdfDiffuse", repeat, Color=pattern)


def plastic(pattern, roughness=0.05, repeat=1.0):
    return material("ShaderNodeBsdfPrincipled", repeat, Base_Color=pattern, Roughness=roughness)


def metal(colour, roughness=0.2, repeat=1.0):
    return material("ShaderNodeBsdfPrincipled", repeat, Base_Color=colour, Roughness=roughness, Metallic=1.0)


def glass(colour=(0.95, 0.97, 0.96), roughness=0.0):
    return material("ShaderNodeBsdfGlass", Color=colour, Roughness=roughness, IOR=1.5)


def glow(colour, strength):
    return material("ShaderNodeEmission", Color=colour, Strength=strength)


class Stage:
    """A scene in the making; Blender holds one at a time."""

    def __init__(self):
        bpy.ops.wm.read_factory_settings(use_empty=True)
        self.scene = bpy.context.scene
        self.scene.world = bpy.data.worlds.new("world")
        self.scene.world.use_nodes = True
        self.scene.world.node_tree.nodes["Background"].inputs["Color"].default_value = (0, 0, 0, 1)

    def add(self, mesh, material):
        data = bpy.data.meshes.new("part")
        data.from_pydata(np.asarray(mesh.v).tolist(), [], np.asarray(mesh.f).tolist())
        data.uv_layers.new().data.foreach_set("uv", np.asarray(mesh.uv, np.float32)[np.asarray(mesh.f).ravel()].ravel())
        if mesh.n is not None:
            data.polygons.foreach_set("use_smooth", np.ones(len(mesh.f), bool))
            data.normals_split_custom_set_from_vertices(np.asarray(mesh.n).tolist())
        data.materials.append(material)
        self.scene.collection.objects.link(bpy.data.objects.new("part", data))

    def lamp(self, origin, target, power, width, height=None, colour=(1, 1, 1)):
        """A rectangular lamp that the camera does not see."""
        light = bpy.data.lights.new("lamp", "AREA")
        light.shape, light.size, light.size_y = "RECTANGLE", width, height or width
        light.energy, light.color = power, colour
        lamp = bpy.data.objects.new("lamp", light)
        lamp.location = origin
        lamp.rotation_euler = Vector(np.subtract(target, origin)).to_track_quat("-Z", "Y").to_euler()
        lamp.visible_camera = False
        self.scene.collection.objects.link(lamp)

    def environment(self, image, turn=0.0):
        """Light from infinitely far: a latitude-longitude image with row 0 at the zenith."""
        tree = self.scene.world.node_tree
        node, place, source = (tree.nodes.new("ShaderNode" + n) for n in ("TexEnvironment", "Mapping", "TexCoord"))
        node.image = picture(np.asarray(image)[::-1])
        place.inputs["Rotation"].default_value = (0, 0, np.radians(turn))
        tree.links.new(source.outputs["Generated"], place.inputs["Vector"])
        tree.links.new(place.outputs["Vector"], node.inputs["Vector"])
        tree.links.new(node.outputs["Color"], tree.nodes["Background"].inputs["Color"])

    def camera(self, origin, target, fov, f_number=None, focus=None):
        """A pinhole, or a lens with an f-number (for scene units of a metre) focused on the point `focus`."""
        data = bpy.data.cameras.new("camera")
        data.angle_x = np.radians(fov)
        data.clip_start, data.clip_end = 1e-3, 1e5
        camera = bpy.data.objects.new("camera", data)
        camera.location = origin
        camera.rotation_euler = Vector(np.subtract(target, origin)).to_track_quat("-Z", "Y").to_euler()
        if f_number:
            data.dof.use_dof, data.dof.aperture_fstop = True, f_number
            data.dof.focus_distance = float(np.linalg.norm(np.subtract(focus, origin)))
        self.scene.collection.objects.link(camera)
        self.scene.camera = camera
        self.eye = np.array(origin, float)


@contextlib.contextmanager
def silence():
    """Blender reports each render on the process's standard output."""
    saved, null = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(null, 1)
    try:
        yield
    finally:
        os.dup2(saved, 1)
        os.close(saved)
        os.close(null)


class Renderer:
    """Renders a finished stage; every call with another `seed` is independent."""

    def __init__(self, stage, size, clamp, max_depth):
        self.eye, self.size = stage.eye, size
        self.scene = scene = stage.scene
        render, cycles = scene.render, scene.cycles
        render.engine = "CYCLES"
        render.resolution_x, render.resolution_y, render.resolution_percentage = *size, 100
        render.use_persistent_data = True
        render.threads_mode, render.threads = "FIXED", os.cpu_count()
        render.image_settings.media_type = "MULTI_LAYER_IMAGE"
        render.image_settings.file_format = "OPEN_EXR_MULTILAYER"
        render.image_settings.color_depth = "32"
        cycles.device = "CPU"
        cycles.pixel_filter_type = "BOX"
        # Independent pixels (the default would spread the error as blue noise), and no light skipped.
        cycles.sampling_pattern = "TABULATED_SOBOL"
        cycles.light_sampling_threshold = 0
        # The same number of samples everywhere, none of them denoised.
        cycles.use_adaptive_sampling = cycles.use_denoising = False
        cycles.max_bounces = max_depth
        cycles.diffuse_bounces = cycles.glossy_bounces = cycles.transmission_bounces = max_depth
        cycles.caustics_reflective = cycles.caustics_refractive = True
        cycles.blur_glossy = 0
        cycles.sample_clamp_direct, cycles.sample_clamp_indirect = 0, clamp
        layer = bpy.context.view_layer
        layer.use_pass_combined = layer.use_pass_normal = True
        layer.use_pass_emit = layer.use_pass_environment = True
        for lobe in LOBES:
            setattr(layer, f"use_pass_{lobe.lower()}_direct", True)
            setattr(layer, f"use_pass_{lobe.lower()}_color", True)
        layer.cycles.denoising_store_passes = True
        for name, kind in (("Where", "COLOR"), ("Hit", "VALUE")):
            output = layer.aovs.add()
            output.name, output.type = name, kind

    def passes(self, spp, seed):
        """Pass name -> (height, width, channels)."""
        cycles = self.scene.cycles
        cycles.samples, cycles.seed = FIRST_SAMPLE + spp, seed
        cycles.use_sample_subset, cycles.sample_offset, cycles.sample_subset_length = True, FIRST_SAMPLE, spp
        with tempfile.TemporaryDirectory() as folder:
            self.scene.render.filepath = str(Path(folder) / "passes.exr")
            with silence():
                bpy.ops.render.render(write_still=True)
            file = OpenEXR.File(self.scene.render.filepath, separate_channels=True)
            found = {}
            for part in file.parts:
                for name, channel in part.channels.items():
                    group, component = name.removeprefix("ViewLayer.").rsplit(".", 1)
                    found.setdefault(group, {})[component] = np.array(channel.pixels, np.float64)
        order = "XYZRGB"
        return {
            group: np.stack([channels[c] for c in order if c in channels], -1)
            for group, channels in found.items()
            if any(c in order for c in channels)
        }

    def sample(self, seed):
        """One sample per pixel: a dict of channel name to (height, width) array."""
        found = self.passes(1, seed)
        hit = found["Hit"] > 0.5
        position = np.where(hit, found["Where"], 0)
        depth = np.where(hit, np.linalg.norm(position - self.eye, axis=-1, keepdims=True), 0)
        albedo = found["Diffuse Color"]
        # Cycles counts lights as white; they have no albedo here.
        lit = found["Emission"].max(-1, keepdims=True) > 0
        second = np.maximum(found["Denoising Albedo"] - albedo, 0) * (hit & ~lit)
        direct = sum(found[f"{lobe} Direct"] * found[f"{lobe} Color"] for lobe in LOBES)
        direct = direct + found["Emission"] + found["Environment"]
        out = {}
        for prefix, plane in (
            ("", found["Combined"]),
            ("Position.", position),
            ("Normal.", found["Normal"] * hit),
            ("Albedo.", np.clip(albedo, 0, 1)),
            ("SecondaryAlbedo.", np.clip(second, 0, 1)),
            ("Depth.", depth),
            ("Direct.", direct),
        ):
            components = {"Position.": "XYZ", "Normal.": "XYZ", "Depth.": "Z"}.get(prefix, "RGB")
            out |= {prefix + c: plane[..., i] for i, c in enumerate(components)}
        return out

    def mean(self, spp, seed):
        """The mean colour of `spp` samples, (height, width, 3)."""
        return self.passes(spp, seed)["Combined"][..., :3]
