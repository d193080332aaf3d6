//! Foams with few walls beside a filled field of view.

use super::*;

/// A scan whose samples are exactly what `of` says.
fn exact([nx, ny, nz]: [u32; 3], of: impl Fn([f64; 3]) -> f64) -> MemoryVolume<u16> {
    let at = |i: u32| [i % nx, i / nx % ny, i / nx / ny].map(f64::from);
    let samples = (0..nx * ny * nz).map(|i| of(at(i)) as u16).collect();
    MemoryVolume::new(Dims([nx, ny, nz]), Placement::default(), samples).unwrap()
}

/// Open cells: struts along the edges of a Voronoi tessellation, whose seeds lie in a grid, moved at random.
struct Struts {
    seeds: Vec<[f64; 3]>,
    cells: [usize; 3],
}

/// The side of the grid of seeds, and how thick struts are.
const PITCH: f64 = 11.0;
const THICK: f64 = 1.1;

impl Struts {
    fn new(dims: [u32; 3]) -> Self {
        let cells = dims.map(|n| (f64::from(n) / PITCH) as usize + 3);
        let mut state = 1u64;
        let mut unit = || {
            state = state
                .wrapping_mul(6364136223846793005)
                .wrapping_add(1442695040888963407);
            (state >> 40) as f64 / (1u64 << 24) as f64
        };
        let seed = |i: usize| {
            let at = [
                i % cells[0],
                i / cells[0] % cells[1],
                i / cells[0] / cells[1],
            ];
            at.map(|cell| (cell as f64 - 1.0 + unit()) * PITCH)
        };
        let seeds = (0..cells.iter().product()).map(seed).collect();
        Struts { seeds, cells }
    }

    /// What the scan shows at a place: air, or a strut in the cylinder.
    fn at(&self, place: [f64; 3], [cx, cy, r]: [f64; 3]) -> f64 {
        let [x, y, z] = place;
        let mixed = place.iter().fold(17u32, |sum, v| {
            let sum = (sum ^ *v as u32).wrapping_mul(2_654_435_761);
            sum ^ sum >> 15
        });
        let is_solid = libm::hypot(x - cx, y - cy) <= r && self.is_strut([x, y, z]);
        1000.0 + f64::from(mixed % 200) + if is_solid { 2600.0 } else { 0.0 }
    }

    /// Three seeds are nearly as near as each other.
    fn is_strut(&self, place: [f64; 3]) -> bool {
        let cell = place.map(|v| (v / PITCH) as usize + 1);
        let mut near = [f64::INFINITY; 3];
        for i in 0..27 {
            let at = [i % 3, i / 3 % 3, i / 9].map(|d| d as isize - 1);
            let at: [usize; 3] = std::array::from_fn(|a| (cell[a] as isize + at[a]) as usize);
            if (0..3).any(|a| at[a] >= self.cells[a]) {
                continue;
            }
            let seed = self.seeds[(at[2] * self.cells[1] + at[1]) * self.cells[0] + at[0]];
            let square = (0..3).map(|a| (seed[a] - place[a]) * (seed[a] - place[a]));
            let far = square.sum::<f64>().sqrt();
            let rank = near.iter().filter(|known| **known <= far).count();
            near[rank.min(2)..].rotate_right(1);
            if rank < 3 {
                near[rank] = far;
            }
        }
        near[2] - near[0] < THICK
    }
}

/// The air beside a sparse foam is far brighter than the fill, which is not the air.
#[test]
fn a_sparse_foam_in_a_filled_field_of_view_is_found() {
    let dims = [150, 150, 24];
    let (foam, struts) = ([72.0, 77.0, 50.0], Struts::new(dims));
    let inside = (0..24 * 100 * 100).map(|i| [i % 100, i / 100 % 100, i / 10_000].map(f64::from));
    let inside =
        inside.filter(|p| libm::hypot(p[0] + 22.0 - foam[0], p[1] + 27.0 - foam[1]) < 49.0);
    let solid = inside
        .clone()
        .filter(|[x, y, z]| struts.is_strut([x + 22.0, y + 27.0, *z]));
    let share = solid.count() as f64 / inside.count() as f64;
    assert!((0.03..0.15).contains(&share), "{share}");
    for fill in [None, Some(0.0), Some(500.0), Some(900.0), Some(9000.0)] {
        let volume = exact(dims, |p| {
            let is_beyond = libm::hypot(p[0] - 74.5, p[1] - 74.5) > 74.0;
            fill.filter(|_| is_beyond)
                .unwrap_or_else(|| struts.at(p, foam))
        });
        let found = find(&volume).unwrap();
        assert_near(&found, foam, 0.0);
        assert!(told(&found, "field of view").is_empty(), "{found:?}");
    }
}

/// A sample that fills the field of view is taken, and told to be all of it.
#[test]
fn what_ends_where_the_scan_does_is_told() {
    let (dims, view) = ([110, 110, 12], [54.5, 54.5, 53.0]);
    let struts = Struts::new(dims);
    let volume = exact(dims, |p| {
        let is_beyond = libm::hypot(p[0] - view[0], p[1] - view[1]) > view[2];
        if is_beyond { 0.0 } else { struts.at(p, view) }
    });
    let found = find(&volume).unwrap();
    assert_near(&found, view, 0.0);
    assert_eq!(told(&found, "field of view").len(), 1, "{found:?}");
}
