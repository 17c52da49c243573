"""Tries the add-on without a window: see scripts/try_blender."""

import pathlib
import sys
import tempfile

import bpy

import tamis

sys.path.insert(0, str(pathlib.Path(__file__).parent))
import tamis_denoise as add_on  # noqa: E402


def scene():
    """Blender's default cube, small and noisy."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.use_denoising = False
    scene.cycles.use_adaptive_sampling = False
    scene.render.resolution_x, scene.render.resolution_y = 160, 120
    scene.render.resolution_percentage = 100
    lamp = bpy.data.lights[0]
    # Soft shadows are what noise is in.
    lamp.shadow_soft_size = 3.0
    return scene


def render(scene, samples, seed):
    scene.cycles.samples, scene.cycles.seed = samples, seed
    bpy.ops.render.render()


def refused(what):
    """What Blender raises when an operator reports an error."""
    try:
        bpy.ops.render.tamis_denoise()
    except RuntimeError as error:
        assert what in str(error), error
    else:
        raise AssertionError(f"it was not refused: {what}")


def main():
    folder = pathlib.Path(tempfile.mkdtemp())
    add_on.register()
    here = scene()
    refused("there is no render yet")
    assert bpy.ops.render.tamis_passes() == {"FINISHED"}

    reference = folder / "reference.exr"
    render(here, 512, 1)
    add_on.write_passes(here, str(reference))
    render(here, 4, 2)
    noisy = folder / "noisy.exr"
    kept = [getattr(here.render.image_settings, name, None) for name in add_on.SETTINGS]
    add_on.write_passes(here, str(noisy))
    assert kept == [getattr(here.render.image_settings, name, None) for name in add_on.SETTINGS]

    here.tamis.output = str(folder / "clean.exr")
    assert bpy.ops.render.tamis_denoise() == {"FINISHED"}
    image = bpy.data.images[add_on.RESULT]
    assert pathlib.Path(bpy.path.abspath(image.filepath)) == folder / "clean.exr"
    errors = {
        name: tamis.compare(path, reference)["rel_mse"]
        for name, path in [("noisy", noisy), ("clean", folder / "clean.exr")]
    }
    print(errors)
    assert errors["clean"] < errors["noisy"] / 2
    fed = {
        entry["feature"]
        for entry in tamis.inspect(folder / "clean.exr")["features"]
        if entry["status"] != "absent"
    }
    assert {"color", "albedo", "normal", "depth"} <= fed

    # Once more, weaker and with another filter: the image is replaced, and nothing piles up.
    here.tamis.filter, here.tamis.strength = "tamis-fast", 0.5
    assert bpy.ops.render.tamis_denoise() == {"FINISHED"}
    assert [image.name for image in bpy.data.images].count(add_on.RESULT) == 1 and len(bpy.data.images) == 2
    expected = folder / "expected.exr"
    tamis.denoise_file(noisy, expected, filter="tamis-fast", strength=0.5)
    again = tamis.compare(folder / "clean.exr", expected)
    assert again["mse"] == 0, again

    work = add_on.Work(here)
    work.cancelled.set()
    try:
        work.result()
    except add_on.Cancelled:
        pass
    else:
        raise AssertionError("nobody wanted the result")
    assert not pathlib.Path(work.folder.name).exists()

    here.tamis.output = str(folder / "none" / "clean.exr")
    refused("none")
    add_on.unregister()
    print("the add-on works on Blender", bpy.app.version_string)


main()
