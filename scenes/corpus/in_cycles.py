"""Made scenes in Cycles: a stage that takes what the generator gives to Mitsuba's, and builds it in Blender.

Fog and the moving camera are left out, and lamps shine both ways.
"""

import mitsuba_stage  # noqa: F401  (the generator describes materials for Mitsuba; it must be set up before Blender)

import bpy
import numpy as np

import cycles_stage

METALS = {
    "Al": (0.9, 0.9, 0.91),
    "Au": (1, 0.77, 0.34),
    "Cu": (0.95, 0.6, 0.5),
    "Ag": (0.97, 0.96, 0.92),
    "Cr": (0.55, 0.56, 0.56),
}


def pattern(texture):
    """(colour or image, repetitions) of a texture as mitsuba_stage describes it."""
    if texture["type"] == "rgb":
        return tuple(texture["value"]), 1.0
    return np.array(texture["bitmap"]), float(np.array(texture["to_uv"].matrix)[0, 0])


def through(reflected, transmitted):
    """Diffuse both ways."""
    out = cycles_stage.diffuse(reflected)
    tree = out.node_tree
    front = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeBsdfDiffuse")
    back, both = tree.nodes.new("ShaderNodeBsdfTranslucent"), tree.nodes.new("ShaderNodeAddShader")
    back.inputs["Color"].default_value = (*transmitted, 1)
    tree.links.new(front.outputs[0], both.inputs[0])
    tree.links.new(back.outputs[0], both.inputs[1])
    end = next(n for n in tree.nodes if n.bl_idname == "ShaderNodeOutputMaterial")
    tree.links.new(both.outputs[0], end.inputs["Surface"])
    return out


def translated(material):
    """The Blender material of one that mitsuba_stage describes."""
    inner = material.get("bsdf", material)
    kind = inner["type"]
    # Mitsuba's alpha is the square of Blender's roughness.
    roughness = float(np.sqrt(inner.get("alpha", 0.0)))
    if kind == "diffuse":
        image, repeat = pattern(inner["reflectance"])
        return cycles_stage.diffuse(image, repeat)
    if "plastic" in kind:
        image, repeat = pattern(inner["diffuse_reflectance"])
        return cycles_stage.plastic(image, roughness, repeat)
    if "conductor" in kind:
        return cycles_stage.metal(METALS.get(inner["material"], (0.98, 0.98, 0.98)), roughness)
    if "dielectric" in kind:
        return cycles_stage.glass(roughness=roughness)
    return through(pattern(inner["reflectance"])[0], pattern(inner["transmittance"])[0])


class Stage(cycles_stage.Stage):
    def __init__(self):
        super().__init__()
        self.habits, self.cache = {}, {}

    def add(self, mesh, material, glow=None, share=1.0):
        if glow is not None:
            glow = np.broadcast_to(np.asarray(glow, float), 3)
            made = cycles_stage.glow(tuple(glow / glow.max()), float(glow.max()))
        else:
            if id(material) not in self.cache:
                self.cache[id(material)] = (translated(material), material)
            made = self.cache[id(material)][0]
        super().add(mesh, made)

    def spot(self, origin, target, intensity, cutoff):
        intensity = np.broadcast_to(np.asarray(intensity, float), 3)
        light = bpy.data.lights.new("spot", "SPOT")
        light.energy, light.color = float(intensity.max() * 4 * np.pi**2), intensity / intensity.max()
        light.spot_size, light.spot_blend, light.shadow_soft_size = np.radians(2 * cutoff), 0.2, 0.01
        lamp = bpy.data.objects.new("spot", light)
        lamp.location = origin
        aim = cycles_stage.Vector(np.subtract(target, origin))
        lamp.rotation_euler = aim.to_track_quat("-Z", "Y").to_euler()
        self.scene.collection.objects.link(lamp)

    def camera(self, origin, target, fov, aperture=None, focus=None):
        if not aperture:
            return super().camera(origin, target, fov)
        # Blender's lens: 36 mm of film, scene units of a metre.
        length = 0.018 / np.tan(np.radians(fov) / 2)
        super().camera(origin, target, fov, length / (2 * aperture), focus)

    def fog(self, *_):
        pass

    def motion(self, *_):
        pass


class Renderer(cycles_stage.Renderer):
    """With the calls of mitsuba_stage's renderer."""

    # Set by the command line.
    threads = 0

    def __init__(self, stage, size, clamp, max_depth):
        super().__init__(stage, size, clamp, max_depth)
        if self.threads:
            self.scene.render.threads = self.threads

    def set_clamp(self, clamp):
        self.scene.cycles.sample_clamp_indirect = clamp

    def expose_lamps(self, exposure):
        pass

    def each(self, spp, seed):
        samples = [self.sample(seed + i) for i in range(spp)]
        return {name: np.stack([s[name] for s in samples]) for name in samples[0]}

    def colour(self, spp, seed):
        return self.mean(spp, seed)
