//! How far the surfaces of a node lie from those below it, measured again, by the code that measured it when the node was
//! made: that this is right is for its own tests.

use super::entries::Family;
use crate::lod::{NodePlace, error_of};
use crate::manifest::NodeEntry;
use crate::tile::node::SurfacePart;
use crate::verify::code::Code;
use crate::verify::report::Issues;

/// Share by which a measured error may differ: corners of triangles come in another order.
const ERROR: f64 = 1e-3;

/// Compares the error of a node with what its own surfaces and those of its children, one after another, give.
pub(super) fn check_error(
    entry: &NodeEntry,
    place: &NodePlace,
    family: &Family,
    (own, below): (&[SurfacePart], Vec<Vec<SurfacePart>>),
    issues: &mut Issues,
) {
    let most = family.children.iter().map(|c| c.error).fold(0.0, f64::max);
    let found = error_of(place, own, below, most);
    if (entry.error - found).abs() > ERROR * found {
        let message = format!(
            "found {}, its surfaces lie {found} voxels from those of the tiles, by those of the nodes below",
            entry.error
        );
        issues.add(Code::LodError, &entry.path, message);
    }
}
