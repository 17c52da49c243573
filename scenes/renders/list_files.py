"""Prints what is in tests/renders as Markdown: a table of the files, and one of each file's parts and channels."""

import headers
import images
import listing

SHORT = {"float16": "half", "float32": "float", "uint32": "uint"}


def groups(part):
    """Channels by layer and type: `Layer.{R,G,B}` half."""
    found = {}
    for name, channel in part.channels.items():
        layer, dot, component = name.rpartition(".")
        found.setdefault((layer + dot, SHORT[channel.pixels.dtype.name]), []).append(component)
    for (layer, kind), components in found.items():
        names = components[0] if len(components) == 1 else "{" + ",".join(components) + "}"
        yield f"`{layer}{names}` {kind}"


def windows(header):
    sizes = []
    for name in ("dataWindow", "displayWindow"):
        (left, top), (right, bottom) = (corner.tolist() for corner in header[name])
        sizes.append(f"{right - left + 1}x{bottom - top + 1} at ({left}, {top})")
    return sizes[0] if sizes[0] == sizes[1] else f"{sizes[0]} of {sizes[1]}"


def main():
    files = listing.load()
    print("| file | kB | renderer | what was ticked or written | window | colour: reference |")
    print("| --- | ---: | --- | --- | --- | --- |")
    for name, entry in files.items():
        path = listing.FOLDER / name
        colours = "; ".join(
            f"part {c['part']} `{c['channels'][0]}`…: `{c['reference'].split('/')[1]}`" for c in entry["colours"]
        )
        window = windows(images.parts(path)[0].header)
        cells = [f"`{name}`", f"{path.stat().st_size / 1000:.0f}", entry["renderer"], entry["ticked"], window, colours]
        print("| " + " | ".join(cells) + " |")
    print("\n| file, part | storage | channels |")
    print("| --- | --- | --- |")
    for name in files:
        path = listing.FOLDER / name
        parts = images.parts(path)
        for number, part in enumerate(parts):
            header = part.header
            storage = header["compression"].name.removesuffix("_COMPRESSION").lower()
            storage = {"no": "none"}.get(storage, storage)
            storage += ", tiles" if "tiles" in header else ""
            order = header["lineOrder"].name.lower()
            storage += "" if order == "increasing_y" else f", {order}"
            storage += f", view {header['view']}" if header.get("view") else ""
            called = f" {number} `{header['name']}`" if len(parts) > 1 else ""
            print(f"| `{name}`{called} | {storage} | {', '.join(groups(part))} |")
    print("\n| file | attributes beside those that every file has |")
    print("| --- | --- |")
    usual = {"channels", "compression", "dataWindow", "displayWindow", "lineOrder", "pixelAspectRatio"}
    usual |= {"screenWindowCenter", "screenWindowWidth"}
    for name in files:
        _, parts = headers.read(listing.FOLDER / name)
        # Of several parts the first has the most.
        own = [f"`{a}` {kind}" for a, (kind, _) in sorted(parts[0].items()) if a not in usual]
        print(f"| `{name}`{', part 0' if len(parts) > 1 else ''} | {', '.join(own)} |")


if __name__ == "__main__":
    main()
