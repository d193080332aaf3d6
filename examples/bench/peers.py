"""What else makes a surface of the same raw volume: one JSON line per run.

    peers.py FILE NX NY NZ u8|u16|i16|f32 THRESHOLD vtk|script

vtk     vtkFlyingEdges3D with normals on all cores; reading the file and the import are left out, and
        the best of three runs counts: the surface stays in memory
script  what people write: cc3d labels, scikit-image's surface, one GLB by trimesh; all of it counts

    pip install numpy vtk scikit-image connected-components-3d trimesh
"""

import importlib.metadata
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np


def flying_edges(samples: np.ndarray, value: float) -> dict:
    import vtk
    from vtk.util.numpy_support import numpy_to_vtk

    vtk.vtkSMPTools.SetBackend("STDThread")
    image = vtk.vtkImageData()
    image.SetDimensions(*samples.shape[::-1])
    image.GetPointData().SetScalars(numpy_to_vtk(samples.ravel(), deep=False))
    edges = vtk.vtkFlyingEdges3D()
    edges.SetInputData(image)
    edges.ComputeNormalsOn()
    edges.ComputeScalarsOff()
    edges.ComputeGradientsOff()
    edges.SetValue(0, value)
    seconds = []
    for _ in range(3):
        edges.Modified()
        start = time.perf_counter()
        edges.Update()
        seconds.append(time.perf_counter() - start)
    return {"seconds": min(seconds), "triangles": edges.GetOutput().GetNumberOfPolys()}


def script(samples: np.ndarray, value: float, start: float) -> dict:
    import cc3d
    import trimesh
    from skimage.measure import marching_cubes

    cc3d.connected_components(samples < value, connectivity=6, binary_image=True)
    vertices, faces, normals, _ = marching_cubes(samples, value)
    with tempfile.TemporaryDirectory() as directory:
        mesh = trimesh.Trimesh(vertices, faces, vertex_normals=normals, process=False)
        mesh.export(Path(directory) / "surface.glb")
    return {"seconds": time.perf_counter() - start, "triangles": len(faces)}


def main() -> None:
    path, nx, ny, nz, kind, value, peer = sys.argv[1:]
    start = time.perf_counter()
    samples = np.fromfile(path, {"u8": "u1", "u16": "<u2", "i16": "<i2", "f32": "<f4"}[kind]).reshape(int(nz), int(ny), int(nx))
    if peer == "vtk":
        found = flying_edges(samples, float(value))
        found["version"] = "VTK " + importlib.metadata.version("vtk")
    else:
        found = script(samples, float(value), start)
        found["version"] = "scikit-image " + importlib.metadata.version("scikit-image")
    found["peak_rss_bytes"] = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024
    print(json.dumps(found))


if __name__ == "__main__":
    main()
