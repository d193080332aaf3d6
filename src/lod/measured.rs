//! What follows of levels that are there, for the verifier: how far a node lies from what is below it, and the numbers of
//! a level.

use super::distance::{Coarser, nearly_furthest};
use super::level::{LevelPlan, rising};
use super::mesh::{Joiner, SurfaceKey};
use super::planes::Planes;
use crate::error::Result;
use crate::grid::Tiling;
use crate::manifest::{Level, Manifest};
use crate::tile::node::SurfacePart;
use std::collections::HashMap;

/// A node, by its place in the grid of a level.
pub(crate) struct NodePlace {
    pub tiling: Tiling,
    pub level: u32,
    pub place: [u32; 3],
    /// See [`Level::block`].
    pub block: u32,
}

/// The error of a node of these parts, whose children have those and errors up to `below`, in voxels.
pub(crate) fn error_of(
    node: &NodePlace,
    own: &[SurfacePart],
    children: Vec<Vec<SurfacePart>>,
    below: f64,
) -> f64 {
    let planes = Planes::of(node.tiling, node.level, node.place);
    let mut joiner = Joiner::new(&planes);
    children.into_iter().for_each(|parts| joiner.add(parts));
    let mesh = joiner.finish();
    let surfaces = (0..).zip(&mesh.surfaces);
    let numbers: HashMap<SurfaceKey, u32> = surfaces.map(|(i, s)| (s.key, i)).collect();
    let (mut points, mut triangles, mut surface_of) = (Vec::new(), Vec::new(), Vec::new());
    for part in own {
        // what nothing below has is reported as such
        if let Some(&surface) = numbers.get(&SurfaceKey::of(&part.extras)) {
            let first = points.len() as u32;
            points.extend_from_slice(&part.points);
            surface_of.resize(points.len(), surface);
            triangles.extend(part.triangles.iter().map(|t| t.map(|v| first + v)));
        }
    }
    let coarser = Coarser {
        points: &points,
        triangles: &triangles,
        surface_of: &|v| surface_of[v as usize],
        width: node.block.clamp(1, 1 << 24) as i32,
        low: planes.low,
    };
    let added = nearly_furthest(&mesh, &coarser, node.level > 1);
    rising(below, added.into())
}

/// The width of blocks and the steps of positions of a level above another one, or above the tiles.
///
/// # Errors
/// As of [`LevelPlan::new`].
pub(crate) fn block_and_step(
    manifest: &Manifest,
    below: Option<&Level>,
    ratio: f64,
) -> Result<[u32; 2]> {
    let rules = LevelPlan::new(manifest, below, ratio)?.rules;
    Ok([rules.block as u32, rules.step as u32])
}
