//! Fewer triangles by collapsing edges: meshoptimizer's quadrics, which move no vertex.

use meshopt::{SimplifyOptions, VertexDataAdapter, simplify_with_locks, typed_to_bytes};

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
) -> Vec<[u32; 3]> {
    if triangles.len() <= limits.triangles {
        return triangles;
    }
    let bytes = typed_to_bytes(places);
    let Ok(vertices) = VertexDataAdapter::new(bytes, size_of::<[f32; 3]>(), 0) else {
        return triangles;
    };
    let left = simplify_with_locks(
        triangles.as_flattened(),
        &vertices,
        locked,
        3 * limits.triangles,
        limits.error,
        SimplifyOptions::ErrorAbsolute,
        None,
    );
    left.as_chunks::<3>().0.to_vec()
}
