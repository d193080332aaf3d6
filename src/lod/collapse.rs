//! Fewer triangles by collapsing edges: meshoptimizer's quadrics, which move no vertex.

use meshopt::{SimplifyOptions, VertexDataAdapter, simplify_with_locks, typed_to_bytes};

/// What is left of triangles.
#[derive(Debug)]
pub struct Collapsed {
    pub triangles: Vec<[u32; 3]>,
    /// The error that is estimated, in voxels.
    pub error: f32,
}

/// How far edges may be collapsed.
#[derive(Debug, Clone, Copy)]
pub struct Limits {
    /// Triangles to reach.
    pub triangles: usize,
    /// The largest error in voxels.
    pub error: f32,
}

/// Collapses edges until so many triangles are left, or no more can. Places are in voxels; vertices that are `locked`
/// stay.
pub fn collapse(
    triangles: Vec<[u32; 3]>,
    places: &[[f32; 3]],
    locked: &[bool],
    limits: Limits,
) -> Collapsed {
    let stays = |triangles| Collapsed {
        triangles,
        error: 0.0,
    };
    if triangles.len() <= limits.triangles {
        return stays(triangles);
    }
    let bytes = typed_to_bytes(places);
    let Ok(vertices) = VertexDataAdapter::new(bytes, size_of::<[f32; 3]>(), 0) else {
        return stays(triangles);
    };
    let mut error = 0.0;
    let left = simplify_with_locks(
        triangles.as_flattened(),
        &vertices,
        locked,
        3 * limits.triangles,
        limits.error,
        SimplifyOptions::ErrorAbsolute,
        Some(&mut error),
    );
    Collapsed {
        triangles: left.as_chunks::<3>().0.to_vec(),
        error,
    }
}
