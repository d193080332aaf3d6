#!/usr/bin/env python3
"""Imports tiles into Blender, colours every cell by one of its custom properties, renders a picture.

    pip install bpy==5.0.1                       (needs Python 3.11; or run it with Blender itself)
    python examples/render_blender.py OUT picture.png --by sphericity
    blender --background --python examples/render_blender.py -- OUT picture.png --by sphericity

OUT is a directory that `alvis convert` or `alvis select` wrote. It renders with Cycles on the CPU, so
neither a display nor a graphics card is needed. With --blend the scene is kept for work by hand. Tiles
of more than 500 pieces (merged layout) come as one object without properties and stay grey.
"""

import argparse
import json
import math
import sys
from pathlib import Path

import bpy
from mathutils import Vector

# from dark blue over green to yellow, linear light
STOPS = [
    (0.0, (0.059, 0.0, 0.089)),
    (0.25, (0.043, 0.084, 0.262)),
    (0.5, (0.015, 0.283, 0.263)),
    (0.75, (0.113, 0.584, 0.119)),
    (1.0, (0.98, 0.8, 0.02)),
]


def tiles(directory):
    """The paths of all tiles, in the order of the index."""
    index = json.loads((directory / "index.json").read_text())
    for layer in index["layers"]:
        for tile in json.loads((directory / layer["path"]).read_text())["tiles"]:
            yield directory / tile["path"]


def load(directory):
    """Imports all tiles; returns the objects that are surface pieces."""
    for path in tiles(directory):
        bpy.ops.import_scene.gltf(filepath=str(path), loglevel=50)
    return [o for o in bpy.data.objects if o.type == "MESH"]


def plain():
    """A grey material for pieces without a value."""
    material = bpy.data.materials.new("plain")
    if material.node_tree is None:  # before Blender 5
        material.use_nodes = True
    shader = material.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (0.55, 0.55, 0.55, 1.0)
    shader.inputs["Roughness"].default_value = 0.6
    return material


def coloured(name, low, high):
    """A material that takes its colour from a custom property of the object that has it."""
    material = plain()
    material.name = name
    nodes, links = material.node_tree.nodes, material.node_tree.links
    value = nodes.new("ShaderNodeAttribute")
    value.attribute_type = "OBJECT"
    value.attribute_name = name
    share = nodes.new("ShaderNodeMapRange")
    share.inputs["From Min"].default_value = low
    share.inputs["From Max"].default_value = high
    ramp = nodes.new("ShaderNodeValToRGB")
    stops = ramp.color_ramp.elements
    for _ in STOPS[2:]:
        stops.new(0.5)
    for stop, (at, colour) in zip(stops, STOPS):
        stop.position = at
        stop.color = (*colour, 1.0)
    links.new(value.outputs["Fac"], share.inputs["Value"])
    links.new(share.outputs["Result"], ramp.inputs["Fac"])
    links.new(ramp.outputs["Color"], nodes["Principled BSDF"].inputs["Base Color"])
    return material


def paint(pieces, name, limits):
    """Gives every piece its material; returns the limits of the colours."""
    values = sorted(p[name] for p in pieces if isinstance(p.get(name), (int, float)))
    if not values:
        sys.exit(f"no piece has {name}")
    low, high = limits or (values[len(values) // 50], values[-1 - len(values) // 50])
    with_value, without = coloured(name, low, high), plain()
    for piece in pieces:
        piece.data.materials.clear()
        piece.data.materials.append(with_value if name in piece else without)
    return low, high


def light(strength, angle, direction):
    """A sun that shines in a direction."""
    data = bpy.data.lights.new("sun", "SUN")
    data.energy, data.angle = strength, angle
    sun = bpy.data.objects.new("sun", data)
    sun.rotation_euler = Vector(direction).to_track_quat("-Z", "Y").to_euler()
    bpy.context.collection.objects.link(sun)


def look(pieces, view):
    """A camera that sees all pieces from the direction `view`."""
    corners = [p.matrix_world @ Vector(c) for p in pieces for c in p.bound_box]
    size = max(max(c[a] for c in corners) - min(c[a] for c in corners) for a in range(3))
    away = Vector(view).normalized()
    data = bpy.data.cameras.new("camera")
    data.lens = 60
    # a scan of millimetres is a few thousandths of Blender's unit wide
    data.clip_start, data.clip_end = size / 100, size * 100
    camera = bpy.data.objects.new("camera", data)
    camera.rotation_euler = (-away).to_track_quat("-Z", "Y").to_euler()
    bpy.context.collection.objects.link(camera)
    scene = bpy.context.scene
    scene.camera = camera
    bpy.context.view_layer.update()
    graph = bpy.context.evaluated_depsgraph_get()
    place, _ = camera.camera_fit_coords(graph, [v for c in corners for v in c])
    camera.location = place + away * size * 0.03


def render(picture, size, samples):
    """Renders with Cycles on the CPU."""
    scene = bpy.context.scene
    scene.render.engine = "CYCLES"
    scene.cycles.device = "CPU"
    scene.cycles.samples = samples
    scene.cycles.use_denoising = True
    scene.render.resolution_x, scene.render.resolution_y = size
    scene.render.image_settings.file_format = "PNG"
    scene.render.image_settings.compression = 100
    # colours as the map has them
    scene.view_settings.view_transform = "Standard"
    world = bpy.data.worlds.new("white")
    if world.node_tree is None:  # before Blender 5
        world.use_nodes = True
    world.node_tree.nodes["Background"].inputs["Color"].default_value = (1, 1, 1, 1)
    world.node_tree.nodes["Background"].inputs["Strength"].default_value = 0.6
    scene.world = world
    scene.render.film_transparent = True
    scene.render.image_settings.color_mode = "RGBA"
    scene.render.filepath = str(Path(picture).absolute())
    bpy.ops.render.render(write_still=True)


def main(words):
    args = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    args.add_argument("tiles", type=Path, help="the directory of the tile set")
    args.add_argument("picture", help="the PNG to write")
    args.add_argument("--by", default="sphericity", help="the property that colours the cells")
    args.add_argument("--limits", type=float, nargs=2, metavar=("LOW", "HIGH"))
    args.add_argument("--size", type=int, nargs=2, default=(800, 600), metavar=("W", "H"))
    args.add_argument("--view", type=float, nargs=3, default=(1.0, -1.3, 0.75), metavar="V")
    args.add_argument("--samples", type=int, default=32, help="paths for each pixel")
    args.add_argument("--blend", help="keep the scene in this file")
    args = args.parse_args(words)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    pieces = load(args.tiles)
    bpy.context.view_layer.update()
    limits = paint(pieces, args.by, args.limits)
    light(2.5, math.radians(5), (-1.0, 0.4, -1.2))
    light(1.0, math.radians(30), (0.3, 1.0, -0.3))
    look(pieces, args.view)
    render(args.picture, args.size, args.samples)
    if args.blend:
        bpy.ops.wm.save_as_mainfile(filepath=str(Path(args.blend).absolute()))
    print(f"{args.picture}: {len(pieces)} pieces, {args.by} {limits[0]:.3g} to {limits[1]:.3g}")


if __name__ == "__main__":
    # Blender hands on what comes after --
    main(sys.argv[sys.argv.index("--") + 1 :] if "--" in sys.argv else sys.argv[1:])
