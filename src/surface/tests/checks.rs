//! Laws of one slab's classes and of one tile.

use crate::labels::{CarryOver, SlabComponents};
use crate::manifest::Primitives;
use crate::strip::{NONE, STRIDE, Stripifier, Triangle as Numbered, connect};
use crate::surface::{BandView, MeshSettings, Piece, TileBox, TileMesh, TileMesher};
use crate::sys::group_by::groups;
use crate::tile::{Body, Grouped};
use std::collections::{BTreeSet, HashMap};

/// Components of a slab before have merged often when one in eight of those that came over has so far.
pub fn check_often(slabs: &[SlabComponents]) {
    let (mut carried, mut merged) = (0, 0);
    for slab in slabs {
        let distinct: BTreeSet<u32> = slab.carried_in.iter().copied().collect();
        carried += slab.carried_in.len();
        merged += slab.carried_in.len() - distinct.len();
        assert_eq!(slab.merge_often, 8 * merged > carried);
    }
}

/// Pieces that turn out to be one were foreseen to, and those are foreseen whose classes are the same or both
/// go on.
pub fn check_foreseen(
    slab: &SlabComponents,
    next: Option<&SlabComponents>,
    ids: &[u64],
    pieces: &[Piece],
) {
    let goes_on = |class: u32| {
        let live = slab.live.iter().position(|&c| c == class);
        live.is_some_and(|at| next.is_none_or(|next| next.live.contains(&next.carried_in[at])))
    };
    let cell = |p: &Piece| (!p.is_cap()).then_some(p.cell);
    let may = |a: u32, b: u32| a == b || goes_on(a) && goes_on(b);
    let id = |class: u32| ids[class as usize];
    let pairs = || (0..pieces.len()).flat_map(|j| (0..j).map(move |i| (&pieces[i], &pieces[j])));
    let foreseen = pairs().any(|(a, b)| {
        let cells = match (cell(a), cell(b)) {
            (Some(a), Some(b)) => may(a, b),
            (a, b) => a == b,
        };
        may(a.object, b.object) && cells
    });
    let one =
        pairs().any(|(a, b)| id(a.object) == id(b.object) && cell(a).map(id) == cell(b).map(id));
    assert!(foreseen || !one);
    let classes = |p: &Piece| [p.object, cell(p).unwrap_or(u32::MAX)];
    assert_eq!(
        slab.may_become_one(next, pieces.iter().map(classes)),
        foreseen
    );
}

/// Pieces that are one in the next slab, by their first ones.
pub fn one_next(carry_over: &CarryOver, pieces: &[Piece]) -> Vec<Vec<usize>> {
    let pairs = pieces.iter().map(|p| carry_over.of_pair(p.pair()));
    groups(&pairs.collect::<Vec<_>>())
}

/// A tile whose pieces are joined while it is made has the bytes of one whose pieces are joined afterwards.
pub fn check_joined(view: &BandView<u8>, tile: &TileBox, settings: &MeshSettings) {
    let write = |carry_over, primitives| {
        let mut mesh = TileMesh::default();
        let view = BandView {
            carry_over,
            ..*view
        };
        TileMesher::default().mesh(&view, tile, settings, &mut mesh);
        let body = Body::write(&mut mesh, primitives, &mut Stripifier::default());
        (body, mesh)
    };
    let carry_over = view.carry_over.expect("the next slab is known");
    for primitives in [Primitives::Strips, Primitives::Triangles] {
        let (apart, mesh) = write(None, primitives);
        let groups = one_next(&carry_over, &mesh.pieces);
        let expected = Grouped::new(&apart, mesh.chunk.bytes(), &groups, primitives);
        let (joined, mesh) = write(Some(carry_over), primitives);
        assert_eq!(joined.pieces, expected.body.pieces);
        assert_eq!(joined.bytes, expected.body.bytes);
        assert!(mesh.chunk.bytes() == expected.bytes());
    }
}

/// Mates are mutual, run the opposite way, and are missing only where no triangle has the reverse.
pub fn check_mates(mesh: &TileMesh) {
    for piece in &mesh.pieces {
        let made = &mesh.piece(piece)[1..];
        let triangles: Vec<_> = made.iter().map(Numbered::corners).collect();
        let mut all = HashMap::new();
        for (t, corners) in triangles.iter().enumerate() {
            for e in 0..3 {
                let edge = (corners[e], corners[(e + 1) % 3]);
                let half_edge = STRIDE * (t as u32 + 1) + e as u32;
                assert!(all.insert(edge, half_edge).is_none(), "three at an edge");
            }
        }
        for (corners, made) in triangles.iter().zip(made) {
            for e in 0..3 {
                let reverse = (corners[(e + 1) % 3], corners[e]);
                assert_eq!(made.mates[e], all.get(&reverse).copied().unwrap_or(NONE));
            }
        }
        assert_eq!(numbers(&connect(&triangles)[1..]), numbers(made));
    }
}

/// The way without branches and the plain one make the same triangles in the same order.
pub fn assert_same(mesh: &TileMesh, reference: &TileMesh) {
    assert_eq!(mesh.pieces.len(), reference.pieces.len());
    for (a, b) in mesh.pieces.iter().zip(&reference.pieces) {
        assert_eq!(a.faces(), b.faces());
        assert_eq!(a.sums, b.sums);
        let [a, b] = [mesh.piece(a), reference.piece(b)];
        assert_eq!(numbers(&a[1..]), numbers(&b[1..]));
    }
}

/// Corners and mates.
fn numbers(triangles: &[Numbered]) -> Vec<[[u32; 3]; 2]> {
    triangles.iter().map(|t| [t.corners(), t.mates]).collect()
}
