"""Filters every file of tests/renders with `tamis denoise IN -o OUT` and compares what comes out with what went in.

    check.py [TAMIS] [--keep FOLDER] [--only NAME...]

Of each colour that files.json names the error against the reference must have become smaller. Where there are
several, each must be what comes out of a file that has this view or layer alone: so each was filtered with its own
features. All else must be there
as it was: parts, channels and their types and bits, attributes and their types and bytes. New is one attribute whose
name begins with `tamis`. Prints a table, and what differs; exit status 1 if anything does.
"""

import argparse
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
import OpenEXR

import headers
import images
import listing

PROVENANCE = "tamis"
# A value shown in a complaint is cut after so many characters.
SHOWN = 60
# RelMSE between a colour and the same filtered alone: above half float's rounding, far below what a wrong feature does.
SAME = 1e-5


def shown(attribute):
    kind, value = attribute
    text = repr(value)
    return f"{kind} {text if len(text) <= SHOWN else text[:SHOWN] + '...'}"


def label(number, attributes):
    """A part as complaints call it."""
    known = attributes.get("name")
    return f"part {number} `{known[1].decode('utf-8', 'replace')}`" if known and known[1] else f"part {number}"


def compare_headers(before, after):
    """What differs between the headers of two files, as (part, attribute, difference)."""
    (flags, old), (new_flags, new) = before, after
    for flag, word in ((headers.TILED, "tiled"), (headers.DEEP, "deep"), (headers.MULTIPART, "multi-part")):
        if (flags ^ new_flags) & flag:
            yield "file", "version", f"the flag for {word} files is now {'on' if new_flags & flag else 'off'}"
    if not new_flags & headers.LONG_NAMES and any(len(n.encode()) > headers.SHORT for n in headers.names(new)):
        yield "file", "version", "the flag for long names is off, and there are some"
    if len(old) != len(new):
        yield "file", "parts", f"{len(old)} before, {len(new)} after"
    for number, (was, now) in enumerate(zip(old, new)):
        part = label(number, was)
        for name in sorted(was.keys() | now.keys()):
            if name == "channels":
                # With the pixels, by name.
                continue
            if name not in now:
                yield part, name, f"is gone; was {shown(was[name])}"
            elif name not in was:
                if not name.startswith(PROVENANCE):
                    yield part, name, f"is new: {shown(now[name])}"
            elif was[name] != now[name]:
                yield part, name, f"was {shown(was[name])}, is {shown(now[name])}"
        added = [name for name in now if name.startswith(PROVENANCE) and name not in was]
        if len(added) > 1:
            yield part, ", ".join(added), f"more than one new attribute begins with {PROVENANCE}"
    if not any(name.startswith(PROVENANCE) for part in new for name in part):
        yield "file", f"{PROVENANCE}*", "no new attribute says where the file is from"


def differing(old, new):
    """How two channels differ, or nothing."""
    if old.dtype != new.dtype:
        return f"was {old.dtype}, is {new.dtype}"
    if old.shape != new.shape:
        return f"was {old.shape[1]}x{old.shape[0]}, is {new.shape[1]}x{new.shape[0]}"
    # Bits, so that NaN equals itself and -0 is not 0.
    bits = f"u{old.dtype.itemsize}"
    wrong = np.ascontiguousarray(old).view(bits) != np.ascontiguousarray(new).view(bits)
    if not wrong.any():
        return None
    y, x = np.argwhere(wrong)[0]
    where = f"{wrong.sum()} of {wrong.size} values differ, the first at column {x}, row {y}"
    return f"{where}: was {old[y, x]}, is {new[y, x]}"


def compare_pixels(before, after, parts, colours):
    """What differs between channels, as (part, channel, difference); of colours, their type and size alone."""
    filtered = {(c["part"], channel) for c in colours for channel in c["channels"]}
    for number, (old, new) in enumerate(zip(before, after)):
        part = label(number, parts[number])
        for name in sorted(old.channels.keys() | new.channels.keys()):
            if name not in new.channels:
                yield part, name, "is gone"
            elif name not in old.channels:
                yield part, name, "is new"
            else:
                was, now = old.channels[name], new.channels[name]
                if (was.xSampling, was.ySampling, was.pLinear) != (now.xSampling, now.ySampling, now.pLinear):
                    yield part, name, "its sampling or pLinear differ"
                wrong = differing(was.pixels, now.pixels)
                if (number, name) not in filtered:
                    if wrong:
                        yield part, name, wrong
                elif was.pixels.dtype != now.pixels.dtype or was.pixels.shape != now.pixels.shape:
                    yield part, name, wrong
                elif wrong is None:
                    yield part, name, "this colour was not filtered: the bits are those of before"


def compare(source, result, colours):
    """Rows of (part, colour, error before, error after), and what is wrong as (part, channel, difference)."""
    wrong, rows = [], []
    try:
        before, after = headers.read(source), headers.read(result)
        old, new = images.parts(source), images.parts(result)
    except Exception as error:
        return rows, [("file", "", f"cannot be read: {error}")]
    wrong += compare_headers(before, after)
    wrong += compare_pixels(old, new, before[1], colours)
    for colour in colours:
        number, names = colour["part"], colour["channels"]
        part = label(number, before[1][number])
        clean = images.planes(images.parts(listing.FOLDER / colour["reference"])[0], "RGB")
        noisy = images.planes(old[number], names)
        error, left = images.relmse(noisy, clean), None
        if number < len(new) and all(name in new[number].channels for name in names):
            filtered = images.planes(new[number], names)
            if filtered.shape == clean.shape:
                left = images.relmse(filtered, clean)
                # Also catches what is not finite.
                if not left < error:
                    wrong.append((part, names[0], f"RelMSE was {error:.4f}, is {left:.4f}"))
        rows.append((part, names[0].removesuffix("R").rstrip(".") or "R G B", error, left))
    return rows, wrong


def alone(parts, colour):
    """The channels of a colour's view and layer, named as if there were no others, and the name of its red."""
    own, red = parts[colour["part"]], colour["channels"][0]
    layer = red.split(".")[0] + "."
    # Views are parts of their own, or components of the channels' names.
    views = own.header.get("multiView", [])
    view = next((f".{v}." for v in views if f".{v}." in red), ".")
    found = {}
    for part in parts:
        if part.header.get("view") == own.header.get("view"):
            for name, channel in part.channels.items():
                if name.startswith(layer) and view in name:
                    found[name.replace(view, ".")] = channel.pixels
    return found, red.replace(view, ".")


def filtered_alone(tamis, parts, colour, folder):
    """A colour as it comes out of a file that has nothing else, or what went wrong."""
    channels, red = alone(parts, colour)
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage}
    # Sample counts.
    header |= {name: value for name, value in parts[0].header.items() if name.startswith("cycles.")}
    source, result = folder / "alone.exr", folder / "alone_filtered.exr"
    OpenEXR.File(header, channels).write(str(source))
    wrong = run(tamis, source, result)
    if wrong:
        return None, wrong
    written = images.parts(result)[0]
    names = [red[:-1] + c for c in "RGB"]
    return images.planes(written, names if red in written.channels else "RGB"), None


def run(tamis, source, result):
    """Runs `tamis denoise`; what went wrong, or nothing."""
    command = [tamis, "denoise", str(source), "-o", str(result)]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    except subprocess.TimeoutExpired:
        return "tamis took more than five minutes"
    if done.returncode != 0:
        return f"tamis ended with status {done.returncode}: {' '.join(done.stderr.split())}"
    return None


def check(tamis, name, entry, folder):
    """Rows and complaints, as of `compare`, after running `tamis` on one file."""
    source, result, colours = listing.FOLDER / name, folder / name, entry["colours"]
    failed = run(tamis, source, result)
    if failed:
        return [], [("file", "", failed)]
    rows, wrong = compare(source, result, colours)
    if len(colours) > 1:
        old, new = images.parts(source), images.parts(result)
        for colour, (part, _, _, left) in zip(colours, rows):
            # Where it is missing, that is said already.
            if left is None:
                continue
            with tempfile.TemporaryDirectory() as temporary:
                own, failed = filtered_alone(tamis, old, colour, Path(temporary))
            if own is not None:
                between = images.relmse(images.planes(new[colour["part"]], colour["channels"]), own)
                if not between <= SAME:
                    failed = f"is not what this view or layer alone gives: RelMSE between them {between:.2e}"
            if failed:
                wrong.append((part, colour["channels"][0], failed))
    return rows, wrong


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("tamis", nargs="?", default="target/release/tamis", help="the program")
    parser.add_argument("--keep", type=Path, help="a folder for the results; without, they are removed")
    parser.add_argument("--only", nargs="+", help="names of files")
    arguments = parser.parse_args()
    files = {name: e for name, e in listing.load().items() if not arguments.only or name in arguments.only}
    if not files:
        parser.error(f"no such file in {listing.LIST}")
    failures = []
    with tempfile.TemporaryDirectory() as temporary:
        folder = arguments.keep or Path(temporary)
        folder.mkdir(parents=True, exist_ok=True)
        print("| file | part | colour | RelMSE before | after | differences |")
        print("| --- | --- | --- | ---: | ---: | ---: |")
        for name, entry in files.items():
            rows, wrong = check(arguments.tamis, name, entry, folder)
            failures += [(name, *what) for what in wrong]
            for part, colour, error, left in rows or [("", "", None, None)]:
                numbers = ["-" if x is None else f"{x:.4f}" for x in (error, left)]
                count = str(len(wrong)) if wrong else "none"
                print("| " + " | ".join([name, part, colour, *numbers, count]) + " |", flush=True)
    for name, part, channel, what in failures:
        print(f"{name}: {part}: {channel + ': ' if channel else ''}{what}")
    bad = len({failure[0] for failure in failures})
    print(f"{len(files) - bad} of {len(files)} files are right, {bad} are not.")
    sys.exit(1 if failures else 0)


if __name__ == "__main__":
    main()
