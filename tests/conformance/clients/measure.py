"""What is measured of a tile set as a program has loaded it, with numpy alone."""

import numpy as np


class Sum:
    """Adds up the parts of all tiles of a set: triangles, signed volume, winding, distinct places."""

    def __init__(self):
        self.triangles = self.agree = 0
        self.volume = 0.0
        self.places = []
        self.names = []
        self.extras = {}

    def add(self, positions, triangles, normals, matrix=None) -> None:
        """One mesh: n x 3 positions, m x 3 indices, n x 3 normals or nothing, and its 4 x 4 matrix."""
        p = np.asarray(positions, np.float64).reshape(-1, 3)
        t = np.asarray(triangles, np.int64).reshape(-1, 3)
        n = np.zeros_like(p) if normals is None or len(normals) != len(p) else np.asarray(normals, np.float64)
        if matrix is not None:
            m = np.asarray(matrix, np.float64)
            p = p @ m[:3, :3].T + m[:3, 3]
            n = n @ np.linalg.inv(m[:3, :3])
        # joints of strips draw nothing
        t = t[(t[:, 0] != t[:, 1]) & (t[:, 1] != t[:, 2]) & (t[:, 0] != t[:, 2])]
        a, b, c = p[t[:, 0]], p[t[:, 1]], p[t[:, 2]]
        face = np.cross(b - a, c - a)
        self.triangles += len(t)
        self.volume += float(np.einsum("ij,ij->i", a, np.cross(b, c)).sum()) / 6
        self.agree += int((np.einsum("ij,ij->i", face, n[t].sum(1)) > 0).sum())
        # minus zero is zero
        self.places.append(np.unique((p[np.unique(t)] + 0.0).astype(np.float32), axis=0))

    def result(self) -> dict:
        places = np.concatenate(self.places) if self.places else np.zeros((0, 3), np.float32)
        return {
            "triangles": self.triangles,
            "volume": self.volume,
            "agree": self.agree,
            "places": len(np.unique(places, axis=0)),
            "names": sorted(self.names),
            "extras": self.extras,
        }
