"""Loads tile sets in a program and says what it got: desktop.py PROGRAM JOB OUT.

JOB is a JSON object: for each set the tiles' files. OUT gets {"version": ..., "sets": {set: ...}}. A program
that crashes leaves no OUT.
"""

import json
import sys
from importlib.metadata import version
from pathlib import Path

import numpy as np
from measure import Sum


def plain(value):
    return value.item() if hasattr(value, "item") else value


def trimesh(file: str, out: Sum) -> None:
    import trimesh

    scene = trimesh.load(file, process=False)
    for name in scene.graph.nodes_geometry:
        matrix, geometry = scene.graph[name]
        mesh = scene.geometry[geometry]
        out.names.append(name)
        out.add(mesh.vertices, mesh.faces, mesh.vertex_normals, matrix)
        parent = scene.graph.transforms.parents[name]
        edge = scene.graph.transforms.edge_data.get((parent, name), {})
        extras = edge.get("extras") or edge.get("metadata") or edge
        if "cell" in extras:
            out.extras[f"{Path(file).name} {name}"] = {k: plain(v) for k, v in extras.items() if k in KEYS}


def open3d(file: str, out: Sum) -> None:
    import open3d

    model = open3d.io.read_triangle_model(file)
    for part in model.meshes:
        mesh = part.mesh
        out.names.append(part.mesh_name)
        out.add(mesh.vertices, mesh.triangles, mesh.vertex_normals)
    if not model.meshes:
        raise RuntimeError("no mesh")


def vtk(file: str, out: Sum) -> None:
    from vtkmodules.util.numpy_support import vtk_to_numpy
    from vtkmodules.vtkFiltersCore import vtkTriangleFilter
    from vtkmodules.vtkIOGeometry import vtkGLTFReader

    reader = vtkGLTFReader()
    reader.SetFileName(file)
    reader.Update()
    blocks = reader.GetOutput().NewTreeIterator()
    blocks.InitTraversal()
    while not blocks.IsDoneWithTraversal():
        block = blocks.GetCurrentDataObject()
        made = vtkTriangleFilter()
        made.SetInputData(block)
        made.Update()
        mesh = made.GetOutput()
        normals = block.GetPointData().GetNormals()
        cells = vtk_to_numpy(mesh.GetPolys().GetConnectivityArray())
        points = vtk_to_numpy(mesh.GetPoints().GetData())
        out.add(points, cells, None if normals is None else vtk_to_numpy(normals))
        blocks.GoToNextItem()


def meshlab(file: str, out: Sum) -> None:
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(file)
    for mesh in meshes:
        out.names.append(mesh.label())
        out.add(mesh.vertex_matrix(), mesh.face_matrix(), mesh.vertex_normal_matrix(), mesh.transform_matrix())


def assimp(file: str, out: Sum) -> None:
    import pyassimp

    with pyassimp.load(file, processing=0x8) as scene:  # aiProcess_Triangulate
        def walk(node, matrix):
            matrix = matrix @ np.asarray(node.transformation, np.float64)
            for mesh in node.meshes:
                out.names.append(node.name)
                faces = np.asarray([f for f in mesh.faces if len(f) == 3])
                out.add(mesh.vertices, faces, mesh.normals, matrix)
                data = node.metadata
                if data is not None:
                    pairs = {str(k): plain(v.data) for k, v in zip(data.keys, data.values)}
                    out.extras[f"{Path(file).name} {node.name}"] = {k: v for k, v in pairs.items() if k in KEYS}
            for child in node.children:
                walk(child, matrix)

        walk(scene.rootnode, np.eye(4))


def blender(file: str, out: Sum) -> None:
    import bpy

    bpy.ops.wm.read_factory_settings(use_empty=True)
    bpy.ops.import_scene.gltf(filepath=file)
    bpy.context.view_layer.update()
    for thing in bpy.data.objects:
        if thing.type != "MESH":
            continue
        mesh = thing.data
        points = np.empty(3 * len(mesh.vertices), np.float32)
        mesh.vertices.foreach_get("co", points)
        mesh.calc_loop_triangles()
        triangles = np.empty(3 * len(mesh.loop_triangles), np.int32)
        mesh.loop_triangles.foreach_get("vertices", triangles)
        # vertex normals of the file are custom normals of corners
        corners = np.empty(3 * len(mesh.loops), np.float32)
        mesh.corner_normals.foreach_get("vector", corners)
        at = np.empty(len(mesh.loops), np.int32)
        mesh.loops.foreach_get("vertex_index", at)
        normals = np.zeros((len(mesh.vertices), 3))
        normals[at] = corners.reshape(-1, 3)
        out.names.append(thing.name)
        out.add(points, triangles, normals, np.array(thing.matrix_world))
        if "cell" in thing:
            out.extras[f"{Path(file).name} {thing.name}"] = {k: plain(thing[k]) for k in KEYS if k in thing}


def assimp_version() -> str:
    import pyassimp.core

    library = pyassimp.core._assimp_lib.dll
    return f"{library.aiGetVersionMajor()}.{library.aiGetVersionMinor()}.{library.aiGetVersionPatch()}"


KEYS = ("cell", "object", "surface", "volume", "sphericity")
PROGRAMS = {
    "trimesh": (trimesh, lambda: version("trimesh")),
    "open3d": (open3d, lambda: version("open3d")),
    "vtk": (vtk, lambda: version("vtk")),
    "meshlab": (meshlab, lambda: version("pymeshlab").split(".post")[0]),
    "assimp": (assimp, assimp_version),
    "blender": (blender, lambda: __import__("bpy").app.version_string),
}


def main() -> None:
    program, job, out = sys.argv[1:4]
    load, release = PROGRAMS[program]
    sets = {}
    for name, files in json.loads(Path(job).read_text()).items():
        total = Sum()
        try:
            for file in files:
                load(file, total)
            sets[name] = total.result()
        except Exception as error:  # a refusal is a finding like any other
            sets[name] = {"error": f"{type(error).__name__}: {error}"[:300]}
    Path(out).write_text(json.dumps({"version": release(), "sets": sets}, default=float))


main()
