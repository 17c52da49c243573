"""Tamis in Blender: a button that denoises the render that is there.

Install this file (Preferences > Add-ons > Install from Disk), and the package `tamis` for Blender's own
Python, from the root of the Tamis repository:

    BLENDER/5.0/python/bin/python3.11 -m pip install ./python

The panel is Render Properties > Tamis. Its button writes the passes of the current render into a
multilayer OpenEXR file, denoises that file, and opens the result as the image "Tamis": every view
layer and view, with all other passes as they are. The Render Result itself stays noisy: Blender
lets nothing but render engines write to it.

Albedo and normals come from the passes of View Layer Properties > Passes > Data > Denoising Data, which
the panel switches on for the next render. A render without them is denoised by its colour alone.
"""

import os
import tempfile
import threading

import bpy

bl_info = {
    "name": "Tamis",
    "description": "Denoises renders with analytic filters",
    "author": "The authors of Tamis",
    "version": (0, 1, 0),
    "blender": (4, 2, 0),
    "location": "Render Properties > Tamis",
    "category": "Render",
}

# What the denoised image is called.
RESULT = "Tamis"
NO_RENDER = "there is no render yet; render the scene first (F12)"
# From one look at the work to the next, in seconds.
PAUSE = 0.1
# Settings of a file that are ours for a moment, the kind of media first, as the others hang on it.
SETTINGS = ("media_type", "file_format", "color_depth", "exr_codec")
BACKENDS = [
    ("jit", "Processor", "Machine code: the same bits on every machine"),
    ("auto", "GPU if there is one", "Shaders on a GPU, or else machine code"),
]


def package():
    """The package `tamis`, or None if Blender's Python has none."""
    try:
        import tamis
    except ImportError:
        return None
    return tamis


# Blender needs the list that it is shown to be kept.
_choices = []


def choices(_self, _context):
    """The filters to choose from."""
    if not _choices:
        tamis = package()
        names = tamis.filters() if tamis else ["tamis"]
        _choices.extend((name, name, f"The filter {name}") for name in names)
    return _choices


def write_passes(scene, path):
    """Writes all passes of the current render into a multilayer OpenEXR file."""
    render = bpy.data.images.get("Render Result")
    if render is None:
        raise RuntimeError(NO_RENDER)
    settings = scene.render.image_settings
    # Versions before 5.0 have no kinds of media.
    kept = [(name, getattr(settings, name)) for name in SETTINGS if hasattr(settings, name)]
    try:
        if hasattr(settings, "media_type"):
            settings.media_type = "MULTI_LAYER_IMAGE"
        settings.file_format = "OPEN_EXR_MULTILAYER"
        settings.color_depth = "32"
        settings.exr_codec = "ZIP"
        render.save_render(path, scene=scene)
    except RuntimeError as error:
        # There is an image of that name before there is a render.
        raise RuntimeError(NO_RENDER if "any image data" in str(error) else str(error)) from error
    finally:
        for name, value in kept:
            setattr(settings, name, value)


def show(path):
    """Opens the result as an image, in the place of an older one."""
    image = bpy.data.images.load(path)
    older = bpy.data.images.get(RESULT)
    if older is not None:
        older.user_remap(image)
        bpy.data.images.remove(older)
    image.name = RESULT
    return image


class Cancelled(Exception):
    """Somebody does not want the result any more."""


class Work:
    """The denoising of one render, on a thread of its own."""

    def __init__(self, scene):
        tamis = package()
        if tamis is None:
            raise RuntimeError("Blender's Python has no package `tamis`; see the first lines of this add-on")
        told = scene.tamis
        self.options = {"filter": told.filter, "backend": told.backend, "strength": told.strength}
        self.output = bpy.path.abspath(told.output) or os.path.join(bpy.app.tempdir, "tamis.exr")
        self.folder = tempfile.TemporaryDirectory()
        self.input = os.path.join(self.folder.name, "passes.exr")
        try:
            write_passes(scene, self.input)
        except BaseException:
            self.folder.cleanup()
            raise
        self.done, self.of = 0, 1
        self.report, self.error = None, None
        self.cancelled = threading.Event()
        self.thread = threading.Thread(target=self._run, args=(tamis,))
        self.thread.start()

    def _run(self, tamis):
        try:
            self.report = tamis.denoise_file(self.input, self.output, progress=self._tell, **self.options)
        except Exception as error:
            self.error = error
        finally:
            self.folder.cleanup()

    def _tell(self, done, of):
        self.done, self.of = done, of
        if self.cancelled.is_set():
            raise Cancelled

    def is_over(self):
        """Whether there is a result or an error."""
        return not self.thread.is_alive()

    def result(self):
        """The image, once it is there. Raises what went wrong."""
        self.thread.join()
        if self.error is not None:
            raise self.error
        return show(self.output)


class TamisSettings(bpy.types.PropertyGroup):
    """How a scene is denoised."""

    filter: bpy.props.EnumProperty(name="Filter", description="With what renders are denoised", items=choices)
    backend: bpy.props.EnumProperty(name="On", description="What runs the filter", items=BACKENDS)
    strength: bpy.props.FloatProperty(
        name="Strength",
        description="How much of the result is taken; the rest is the noisy render",
        min=0.0,
        max=1.0,
        default=1.0,
        subtype="FACTOR",
    )
    output: bpy.props.StringProperty(
        name="File",
        description="Where the result is written, as OpenEXR; into Blender's folder for the session if empty",
        subtype="FILE_PATH",
    )


class TAMIS_OT_denoise(bpy.types.Operator):
    """Denoise the current render with Tamis, and open the result as an image"""

    bl_idname = "render.tamis_denoise"
    bl_label = "Denoise Render"

    def invoke(self, context, _event):
        if bpy.app.background:
            return self.execute(context)
        if not self._start(context.scene):
            return {"CANCELLED"}
        manager = context.window_manager
        self.timer = manager.event_timer_add(PAUSE, window=context.window)
        manager.progress_begin(0, 1)
        manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        manager = context.window_manager
        if event.type == "ESC":
            self.work.cancelled.set()
        elif event.type == "TIMER":
            manager.progress_update(self.work.done / self.work.of)
            if self.work.is_over():
                manager.event_timer_remove(self.timer)
                manager.progress_end()
                return self._finish()
        return {"PASS_THROUGH"}

    def execute(self, context):
        return self._finish() if self._start(context.scene) else {"CANCELLED"}

    def _start(self, scene):
        try:
            self.work = Work(scene)
        except RuntimeError as error:
            self.report({"ERROR"}, str(error))
            return False
        return True

    def _finish(self):
        try:
            self.work.result()
        except Cancelled:
            self.report({"INFO"}, "Denoising was cancelled")
            return {"CANCELLED"}
        except Exception as error:
            self.report({"ERROR"}, str(error))
            return {"CANCELLED"}
        told = self.work.report
        for text in told["warnings"]:
            self.report({"WARNING"}, text)
        took = f"{told['seconds']:.1f} s on {told['backend']}"
        self.report({"INFO"}, f"Denoised in {took}: {'; '.join(told['feeds'])}")
        return {"FINISHED"}


class TAMIS_OT_passes(bpy.types.Operator):
    """Have Cycles write albedo, normals and depth from the next render on, in all view layers"""

    bl_idname = "render.tamis_passes"
    bl_label = "Switch On Denoising Data"

    def execute(self, context):
        for layer in context.scene.view_layers:
            layer.cycles.denoising_store_passes = True
        return {"FINISHED"}


class TAMIS_PT_panel(bpy.types.Panel):
    bl_label = "Tamis"
    bl_idname = "TAMIS_PT_panel"
    bl_space_type = "PROPERTIES"
    bl_region_type = "WINDOW"
    bl_context = "render"

    def draw(self, context):
        layout = self.layout
        layout.use_property_split = True
        scene = context.scene
        if package() is None:
            layout.label(text="Blender's Python has no package `tamis`", icon="ERROR")
            layout.label(text="Its installation: see the first lines of this add-on")
            return
        for name in ("filter", "backend", "strength", "output"):
            layout.prop(scene.tamis, name)
        is_cycles = scene.render.engine == "CYCLES"
        if is_cycles and not all(layer.cycles.denoising_store_passes for layer in scene.view_layers):
            layout.operator(TAMIS_OT_passes.bl_idname, icon="INFO")
        layout.operator(TAMIS_OT_denoise.bl_idname, icon="IMAGE_DATA")


CLASSES = (TamisSettings, TAMIS_OT_denoise, TAMIS_OT_passes, TAMIS_PT_panel)


def register():
    for each in CLASSES:
        bpy.utils.register_class(each)
    bpy.types.Scene.tamis = bpy.props.PointerProperty(type=TamisSettings)


def unregister():
    del bpy.types.Scene.tamis
    for each in reversed(CLASSES):
        bpy.utils.unregister_class(each)


if __name__ == "__main__":
    register()
