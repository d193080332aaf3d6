#!/usr/bin/env python3
"""Draws a tile set as a picture: each cell in a colour by one of its measures.

    pip install vtk numpy
    python examples/render_tiles.py OUT picture.png --by sphericity

OUT is a directory that `alvis convert` wrote. The script needs no display. It reads the GLB tiles
by itself, strips and lists alike, and takes ids and measures from the nodes' extras; it shows how
little a reader needs. Tiles of more than 500 pieces (merged layout) have no extras on their nodes
and are left out with a message.
"""

import argparse
import json
import struct
import sys
from pathlib import Path

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, numpy_to_vtkIdTypeArray


def read_glb(path):
    """The JSON of a GLB and its BIN chunk."""
    data = path.read_bytes()
    magic, version, _, length, _ = struct.unpack_from("<4sIIII", data)
    if (magic, version) != (b"glTF", 2):
        raise ValueError(f"{path}: not a GLB")
    return json.loads(data[20 : 20 + length]), memoryview(data)[20 + length + 8 :]


def accessor(doc, blob, index):
    """An accessor's elements, one per row."""
    a = doc["accessors"][index]
    view = doc["bufferViews"][a["bufferView"]]
    dtype = {5123: "<u2", 5125: "<u4", 5126: "<f4"}[a["componentType"]]
    width = {"SCALAR": 1, "VEC3": 3}[a["type"]]
    start = view.get("byteOffset", 0) + a.get("byteOffset", 0)
    return np.frombuffer(blob, dtype, a["count"] * width, start).reshape(-1, width)


def triangles(mode, indices):
    """The triangles of a strip or list, without the degenerate ones that join strips."""
    if mode == 4:
        return indices.reshape(-1, 3)
    t = np.stack([indices[:-2], indices[1:-1], indices[2:]], axis=1)
    t[1::2] = t[1::2, [1, 0, 2]]
    return t[(t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 2] != t[:, 0])]


def pieces(path):
    """Positions in metres, normals, triangles and extras of each surface piece of a tile."""
    doc, blob = read_glb(path)
    root = doc["nodes"][0]
    matrix = np.array(root["matrix"]).reshape(4, 4).T
    turn = np.linalg.inv(matrix[:3, :3]).T
    for child in root["children"]:
        node = doc["nodes"][child]
        if "extras" not in node:
            print(f"{path}: merged layout, left out", file=sys.stderr)
            continue
        primitive = doc["meshes"][node["mesh"]]["primitives"][0]
        attributes = primitive["attributes"]
        points = accessor(doc, blob, attributes["POSITION"]) @ matrix[:3, :3].T + matrix[:3, 3]
        normals = accessor(doc, blob, attributes["NORMAL"]) @ turn.T
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        indices = accessor(doc, blob, primitive["indices"]).ravel().astype(np.int64)
        yield points, normals, triangles(primitive.get("mode", 4), indices), node["extras"]


def load(directory, measure, closed):
    """One mesh of all tiles, with the measure of its cell at every point, and the unit of length."""
    points, normals, faces, values, first, unit = [], [], [], [], 0, ""
    for path in sorted(Path(directory).glob("tiles/*/*.glb")):
        for p, n, t, extras in pieces(path):
            value = extras.get(measure)
            unit = extras.get("unit", unit)
            if closed and (value is None or extras.get("touches_border")):
                continue
            points.append(p)
            normals.append(n)
            faces.append(t + first)
            values.append(np.full(len(p), np.nan if value is None else value))
            first += len(p)
    if not points:
        sys.exit(f"{directory}: no piece has {measure}")
    return [np.concatenate(parts) for parts in (points, normals, faces, values)], unit


def label(measure, unit):
    """`equivalent diameter [mm]`."""
    power = {"equivalent_diameter": "", "area": "^2", "volume": "^3", "mesh_volume": "^3"}
    name = measure.replace("_", " ")
    return f"{name} [{unit}{power[measure]}]" if measure in power else name


def mesh(points, normals, faces, values):
    """The same as VTK keeps it."""
    data = vtk.vtkPolyData()
    vertices = vtk.vtkPoints()
    vertices.SetData(numpy_to_vtk(points, deep=True))
    data.SetPoints(vertices)
    cells = vtk.vtkCellArray()
    offsets = np.arange(0, 3 * len(faces) + 1, 3, dtype=np.int64)
    cells.SetData(
        numpy_to_vtkIdTypeArray(offsets, deep=True),
        numpy_to_vtkIdTypeArray(np.ascontiguousarray(faces.ravel()), deep=True),
    )
    data.SetPolys(cells)
    data.GetPointData().SetNormals(numpy_to_vtk(normals, deep=True))
    data.GetPointData().SetScalars(numpy_to_vtk(values, deep=True))
    return data


def colours(low, high):
    """A colour map from dark blue over green to yellow; grey where there is no value."""
    table = vtk.vtkColorTransferFunction()
    stops = [(0.27, 0.0, 0.33), (0.23, 0.32, 0.55), (0.13, 0.57, 0.55), (0.37, 0.79, 0.38)]
    stops.append((0.99, 0.91, 0.15))
    for i, colour in enumerate(stops):
        table.AddRGBPoint(low + (high - low) * i / (len(stops) - 1), *colour)
    table.SetNanColor(0.9, 0.9, 0.9)
    return table


def scale(table, title):
    """The colour map with its values, at the right."""
    bar = vtk.vtkScalarBarActor()
    bar.SetLookupTable(table)
    bar.SetTitle(title)
    bar.SetNumberOfLabels(3)
    bar.SetLabelFormat("{:.3g}")
    bar.UnconstrainedFontSizeOn()
    bar.SetVerticalTitleSeparation(10)
    for text in (bar.GetTitleTextProperty(), bar.GetLabelTextProperty()):
        text.SetFontSize(26)
        text.SetColor(0.1, 0.1, 0.1)
        text.BoldOff()
        text.ItalicOff()
        text.ShadowOff()
    bar.SetPosition(0.85, 0.15)
    bar.SetPosition2(0.08, 0.7)
    return bar


def draw(data, title, limits, size, view):
    """Renders off screen."""
    mapper = vtk.vtkPolyDataMapper()
    mapper.SetInputData(data)
    mapper.SetLookupTable(colours(*limits))
    mapper.SetScalarRange(*limits)
    actor = vtk.vtkActor()
    actor.SetMapper(mapper)
    actor.GetProperty().SetAmbient(0.2)
    actor.GetProperty().SetSpecular(0.2)
    actor.GetProperty().SetSpecularPower(30)
    renderer = vtk.vtkRenderer()
    renderer.SetBackground(1, 1, 1)
    renderer.AddActor(actor)
    renderer.AddViewProp(scale(mapper.GetLookupTable(), title))
    window = vtk.vtkRenderWindow()
    window.SetOffScreenRendering(1)
    # twice the size, then averaged: smooth edges with any driver
    window.SetMultiSamples(0)
    window.SetSize(2 * size[0], 2 * size[1])
    window.AddRenderer(renderer)
    camera = renderer.GetActiveCamera()
    camera.SetPosition(*view)
    camera.SetViewUp(0, 1, 0)
    renderer.ResetCamera()
    camera.Zoom(1.02)
    # the scale is at the right, so the body goes a little to the left
    camera.SetWindowCenter(0.16, 0)
    renderer.ResetCameraClippingRange()
    window.Render()
    grab = vtk.vtkWindowToImageFilter()
    grab.SetInput(window)
    grab.ReadFrontBufferOff()
    half = vtk.vtkImageShrink3D()
    half.SetInputConnection(grab.GetOutputPort())
    half.SetShrinkFactors(2, 2, 1)
    half.AveragingOn()
    half.Update()
    return half.GetOutput()


def main():
    args = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    args.add_argument("tiles", help="the directory of the tile set")
    args.add_argument("picture", help="the PNG to write")
    args.add_argument("--by", default="sphericity", help="the measure that colours the cells")
    args.add_argument("--all", action="store_true", help="draw cells at the border too")
    args.add_argument("--limits", type=float, nargs=2, metavar=("LOW", "HIGH"))
    args.add_argument("--size", type=int, nargs=2, default=(900, 640), metavar=("W", "H"))
    args.add_argument("--view", type=float, nargs=3, default=(1.0, 0.75, 1.3), metavar="V")
    args = args.parse_args()
    (points, normals, faces, values), unit = load(args.tiles, args.by, not args.all)
    limits = args.limits or np.nanpercentile(values, [2, 98])
    title = label(args.by, unit)
    image = draw(mesh(points, normals, faces, values), title, limits, args.size, args.view)
    writer = vtk.vtkPNGWriter()
    writer.SetCompressionLevel(9)
    writer.SetFileName(args.picture)
    writer.SetInputData(image)
    writer.Write()
    print(f"{args.picture}: {len(faces)} triangles, {args.by} {limits[0]:.3g} to {limits[1]:.3g}")


if __name__ == "__main__":
    main()
