"""Does check.py find what is wrong? Results made by hand from the files of tests/renders, right ones and wrong ones.

OpenEXR adds a `type` to files of one part that have none (Blender's and Mitsuba's), so what goes in is written by it
as well.
"""

import sys
import tempfile
import unittest
from pathlib import Path

import numpy as np
import OpenEXR

import check
import images
import listing

FILES = listing.load()
# Written again, its lossy channels change: see test_lossy.
LOSSY = "cycles_dwaa.exr"


class Result:
    """A file and what a filter made of it, both to be changed before they are written and compared."""

    def __init__(self, name):
        self.name, self.colours = name, FILES[name]["colours"]
        self.source = OpenEXR.File(str(listing.FOLDER / name), separate_channels=True)
        self.file = OpenEXR.File(str(listing.FOLDER / name), separate_channels=True)
        self.parts = self.file.parts
        for colour in self.colours:
            clean = images.parts(listing.FOLDER / colour["reference"])[0]
            for name, c in zip(colour["channels"], "RGB"):
                self.set(colour["part"], name, clean.channels[c].pixels.astype(np.float32) * 1.01)
        for number in {colour["part"] for colour in self.colours}:
            self.parts[number].header["tamisFilter"] = "by hand"

    def set(self, number, name, pixels, dtype=None):
        """Put pixels into a channel, of its own type or another."""
        channel = self.parts[number].channels[name]
        channel.pixels = np.ascontiguousarray(pixels, dtype or channel.pixels.dtype)

    def pixels(self, number, name):
        return self.parts[number].channels[name].pixels.copy()

    def complaints(self, parts=None):
        with tempfile.TemporaryDirectory() as folder:
            before, after = Path(folder) / "before.exr", Path(folder) / "after.exr"
            self.source.write(str(before))
            (OpenEXR.File(parts) if parts else self.file).write(str(after))
            return [": ".join(what) for what in check.compare(before, after, self.colours)[1]]


class Check(unittest.TestCase):
    def expect(self, result, *words, parts=None):
        """One complaint, which has all the words."""
        found = result.complaints(parts)
        self.assertEqual(len(found), 1, found)
        for word in words:
            self.assertIn(word, found[0])

    def test_right(self):
        for name in FILES:
            if name != LOSSY:
                with self.subTest(name):
                    self.assertEqual(Result(name).complaints(), [])

    def test_lossy(self):
        """Parts that were coded again with loss, though nobody changed them; the bytes copied are found the same."""
        source, colours = listing.FOLDER / LOSSY, FILES[LOSSY]["colours"]
        untouched = check.compare(source, source, colours)[1]
        self.assertEqual({part for part, _, _ in untouched}, {"file", "part 0 `ViewLayer.Combined`"})
        result = Result(LOSSY)
        with tempfile.TemporaryDirectory() as folder:
            after = Path(folder) / "after.exr"
            result.file.write(str(after))
            found = check.compare(listing.FOLDER / LOSSY, after, result.colours)[1]
        self.assertEqual({channel[:-2] for _, channel, _ in found}, {
            "ViewLayer.Denoising Albedo", "ViewLayer.Denoising Normal",
        })  # fmt: skip

    def test_a_bit_of_a_feature(self):
        result = Result("cycles_multilayer.exr")
        pixels = result.pixels(2, "ViewLayer.Position.Y")
        pixels.view(np.uint32)[20, 30] ^= 1
        result.set(2, "ViewLayer.Position.Y", pixels)
        self.expect(result, "part 2", "ViewLayer.Position.Y", "1 of 3456", "column 30, row 20")

    def test_the_sign_of_zero(self):
        result = Result("mitsuba_aov.exr")
        pixels = result.pixels(0, "pos.X")
        self.assertEqual(pixels[0, -1], 0)
        pixels[0, -1] = -0.0
        result.set(0, "pos.X", pixels)
        self.expect(result, "pos.X", "1 of 3456")

    def test_alpha(self):
        result = Result("cycles_rgba.exr")
        result.set(0, "A", result.pixels(0, "A") * 0.5)
        self.expect(result, "A: ", "3456 of 3456")

    def test_types(self):
        result = Result("mitsuba_aov.exr")
        result.set(0, "z.T", result.pixels(0, "z.T"), np.float32)
        self.expect(result, "z.T", "was float16, is float32")
        result = Result("mitsuba_aov.exr")
        result.set(0, "G", result.pixels(0, "G"), np.float32)
        self.expect(result, "G", "was float16, is float32")

    def test_channels(self):
        result = Result("mitsuba_nested.exr")
        del result.parts[0].channels["direct.A"]
        self.expect(result, "direct.A", "is gone")
        result = Result("mitsuba_aov.exr")
        result.parts[0].channels["A"] = OpenEXR.Channel("A", result.pixels(0, "R"))
        self.expect(result, "A: is new")

    def test_the_error(self):
        result = Result("cycles_blur.exr")
        result.set(0, "ViewLayer.Combined.B", result.pixels(0, "ViewLayer.Combined.B") * 2)
        self.expect(result, "RelMSE was")
        result = Result("cycles_blur.exr")
        broken = result.pixels(0, "ViewLayer.Combined.B")
        broken[3, 3] = np.nan
        result.set(0, "ViewLayer.Combined.B", broken)
        self.expect(result, "RelMSE was", "is nan")

    def test_one_eye_alone(self):
        for name in ("cycles_stereo.exr", "cycles_stereo_interleaved.exr", "cycles_layers.exr"):
            result = Result(name)
            second = result.colours[1]
            noisy = images.parts(listing.FOLDER / name)[second["part"]]
            for channel in second["channels"]:
                result.set(second["part"], channel, noisy.channels[channel].pixels)
            found = result.complaints()
            self.assertEqual(sum("not filtered" in line for line in found), 3, found)
            self.assertEqual(sum("RelMSE" in line for line in found), 1, found)

    def test_alone(self):
        """What is left of a file for one view or layer."""
        for name in ("cycles_stereo.exr", "cycles_stereo_interleaved.exr"):
            parts = images.parts(listing.FOLDER / name)
            both = [check.alone(parts, colour) for colour in FILES[name]["colours"]]
            for channels, red in both:
                self.assertEqual(red, "ViewLayer.Combined.R")
                self.assertEqual(len(channels), 11)
                self.assertIn("ViewLayer.Denoising Normal.X", channels)
            depth = "ViewLayer.Denoising Depth.Z"
            self.assertFalse(np.array_equal(both[0][0][depth], both[1][0][depth]))
        parts = images.parts(listing.FOLDER / "cycles_layers.exr")
        channels, red = check.alone(parts, FILES["cycles_layers.exr"]["colours"][1])
        self.assertEqual(red, "Empty Desk.Combined.R")
        self.assertEqual({name.split(".")[0] for name in channels}, {"Empty Desk"})
        self.assertEqual(len(channels), 12)

    def test_a_filter_that_mixes_views(self):
        """`check` as a whole, with programs that write the references, or the left one for both eyes."""
        program = """#!{python}
import sys
sys.path.insert(0, {folder!r})
from pathlib import Path
import test_check
source, result = Path(sys.argv[2]), sys.argv[4]
if source.name == "alone.exr":
    # The eye is known by its colour.
    parts = test_check.images.parts(source)
    names = ["ViewLayer.Combined." + c for c in "RGB"]
    made = test_check.Result("cycles_stereo.exr")
    for number in (0, 1):
        if (made.source.parts[number].channels[names[0]].pixels == parts[0].channels[names[0]].pixels).all():
            planes = {{c: made.pixels(number, name) for c, name in zip("RGB", names)}}
            test_check.OpenEXR.File({{}}, planes).write(result)
else:
    made = test_check.Result("cycles_stereo.exr")
    if {mixed}:
        for c in "RGB":
            name = "ViewLayer.Combined." + c
            made.set(1, name, 0.5 * made.source.parts[1].channels[name].pixels + 0.5 * made.pixels(1, name))
    made.file.write(result)
"""
        for mixed in (False, True):
            with tempfile.TemporaryDirectory() as folder:
                path = Path(folder) / "tamis"
                here = str(Path(__file__).resolve().parent)
                path.write_text(program.format(python=sys.executable, folder=here, mixed=mixed))
                path.chmod(0o755)
                _, wrong = check.check(str(path), "cycles_stereo.exr", FILES["cycles_stereo.exr"], Path(folder))
            self.assertEqual([part for part, _, _ in wrong], ["part 1 `ViewLayer.Combined-right`"] * mixed, wrong)

    def test_attributes(self):
        def changed(name, number, attribute, value):
            result = Result(name)
            result.parts[number].header[attribute] = value
            return result

        self.expect(changed("cycles_stereo.exr", 3, "view", "left"), "part 3", "view", "b'right'", "b'left'")
        stereo = changed("cycles_stereo_interleaved.exr", 0, "multiView", ["right", "left"])
        self.expect(stereo, "multiView")
        self.expect(changed("cycles_rgba.exr", 0, "cycles.ViewLayer.samples", "9"), "cycles.ViewLayer.samples")
        self.expect(changed("cycles_rgba.exr", 0, "note", "hello"), "note", "is new")
        self.expect(changed("cycles_rgba.exr", 0, "tamisToo", "hello"), "more than one")
        self.expect(changed("cycles_rgba.exr", 0, "name", "rgba"), "name", "b'rgba'")
        zips = OpenEXR.ZIPS_COMPRESSION
        self.expect(changed("mitsuba_aov.exr", 0, "compression", zips), "compression")
        self.expect(changed("mitsuba_parts.exr", 0, "lineOrder", OpenEXR.INCREASING_Y), "part 0", "lineOrder")
        self.expect(changed("mitsuba_tiled.exr", 0, "lineOrder", OpenEXR.INCREASING_Y), "lineOrder")
        self.expect(changed("mitsuba_tiled.exr", 0, "pixelAspectRatio", 1.0), "pixelAspectRatio")
        self.expect(changed("mitsuba_tiled.exr", 0, "exposure", 2), "exposure", "was float", "is int")
        window = (np.array([0, 0], np.int32), np.array([71, 47], np.int32))
        self.expect(changed("mitsuba_tiled.exr", 0, "dataWindow", window), "dataWindow")
        self.expect(changed("mitsuba_tiled.exr", 0, "displayWindow", window), "displayWindow")
        tiles = OpenEXR.TileDescription()
        tiles.xSize = tiles.ySize = 16
        self.expect(changed("mitsuba_tiled.exr", 0, "tiles", tiles), "tiles")
        for name in ("owner", "worldToCamera", "framesPerSecond", "chromaticities"):
            result = Result("mitsuba_tiled.exr")
            del result.parts[0].header[name]
            self.expect(result, name, "is gone")
        result = Result("cycles_rgba.exr")
        del result.parts[0].header["tamisFilter"]
        self.expect(result, "tamis*")

    def test_tiles_to_lines(self):
        result = Result("mitsuba_tiled.exr")
        del result.parts[0].header["tiles"]
        result.parts[0].header["type"] = OpenEXR.scanlineimage
        result.parts[0].header["lineOrder"] = OpenEXR.INCREASING_Y
        found = result.complaints()
        for word in ("tiled files is now off", "lineOrder", "tiles: is gone", "type"):
            self.assertTrue(any(word in line for line in found), found)

    def test_parts(self):
        result = Result("cycles_layers.exr")
        found = result.complaints(result.parts[:-1])
        self.assertEqual(found, ["file: parts: 10 before, 9 after"])
        result = Result("cycles_layers.exr")
        result.parts[4].header["name"] = "Things.Depth of all"
        self.expect(result, "part 4", "name")

    def test_what_is_no_image(self):
        with tempfile.TemporaryDirectory() as folder:
            after = Path(folder) / "after.exr"
            after.write_bytes(b"\x76\x2f\x31\x01\x02\0\0\0chan")
            source = listing.FOLDER / "cycles_rgba.exr"
            for path in (after, Path(folder) / "none.exr"):
                found = check.compare(source, path, FILES["cycles_rgba.exr"]["colours"])[1]
                self.assertIn("cannot be read", found[0][2])


if __name__ == "__main__":
    unittest.main()
