//! The strip kernel: greedy paths over triangle neighbours.

use super::NONE;

/// Bit of [`Stripifier::free`] that says the triangle is in a strip already.
const USED: u8 = 0x80;

/// Most triangles looked at each way round a vertex: keeps the work linear where one vertex has
/// thousands; marching cubes has 4 to 8 as a rule.
const TURN_LIMIT: usize = 16;

/// Makes strips; holds scratch that is cleared for each piece and never given back.
#[derive(Debug, Default)]
pub struct Stripifier {
    /// Per triangle the number of neighbours not yet in a strip, with [`USED`] once it is in one.
    free: Vec<u8>,
    /// Stacks of triangles by that number. Entries go stale when the number falls; every unused
    /// triangle is in the stack of its present number.
    starts: [Vec<u32>; 4],
}

/// Where a strip stands: it is about to write the apex of a triangle.
struct Front {
    /// The triangle.
    triangle: u32,
    /// Its edge (0, 1 or 2) that the last two entries run along.
    edge: u32,
    /// The entry before the last.
    before: u32,
    /// Whether the triangle has an even number in the strip.
    even: bool,
}

impl Stripifier {
    /// An empty workspace.
    pub fn new() -> Self {
        Self::default()
    }

    /// Appends one stitched strip for `triangles` to `out`; returns the number of strips joined in it.
    ///
    /// The appended part is a whole strip: its first entry counts as even, whatever stands before.
    /// Edge e of triangle t runs from `triangles[t][e]` to `triangles[t][(e + 1) % 3]`, and
    /// `mates[3 * t + e]` is the half-edge `3 * u + f` of the triangle u across it, which runs the
    /// other way, or [`NONE`]. Mates are mutual; the three indices of a triangle differ. Linear in
    /// time and memory, and always the same for the same input.
    ///
    /// # Panics
    /// If `mates` has not three entries per triangle, or one that is out of range.
    pub fn stripify(&mut self, triangles: &[[u32; 3]], mates: &[u32], out: &mut Vec<u32>) -> usize {
        assert_eq!(mates.len(), 3 * triangles.len(), "three mates per triangle");
        assert!(mates.len() < NONE as usize, "half-edges are u32");
        self.reset(mates);
        let base = out.len();
        let mut strips = 0;
        let mut next = self.start(mates);
        while let Some(half_edge) = next {
            if strips > 0 {
                join(triangles, half_edge, out);
            }
            strips += 1;
            let last = self.strip(triangles, mates, half_edge, (out, base));
            next = self.turn_about(mates, last).or_else(|| self.start(mates));
        }
        strips
    }

    fn reset(&mut self, mates: &[u32]) {
        for stack in &mut self.starts {
            stack.clear();
        }
        self.free.clear();
        self.free.extend(
            mates
                .chunks_exact(3)
                .map(|m| m.iter().filter(|&&h| h != NONE).count() as u8),
        );
        for (t, &free) in self.free.iter().enumerate().rev() {
            self.starts[usize::from(free)].push(t as u32);
        }
    }

    /// Number of free neighbours of the triangle across a half-edge, if that is unused.
    fn free_across(&self, mates: &[u32], half_edge: u32) -> Option<(u32, u8)> {
        let mate = mates[half_edge as usize];
        if mate == NONE {
            return None;
        }
        let free = self.free[(mate / 3) as usize];
        (free & USED == 0).then_some((mate, free))
    }

    /// The best triangle to start a strip anywhere: one with fewest free neighbours. Returns its
    /// half-edge over which the strip should leave it.
    fn start(&mut self, mates: &[u32]) -> Option<u32> {
        for count in 0..4 {
            while let Some(t) = self.starts[count].pop() {
                if usize::from(self.free[t as usize]) == count {
                    let exit = (3 * t..3 * t + 3)
                        .filter_map(|h| Some((self.free_across(mates, h)?.1, h)))
                        .min();
                    return Some(exit.map_or(3 * t, |(_, h)| h));
                }
            }
        }
        None
    }

    fn take(&mut self, mates: &[u32], t: u32) {
        self.free[t as usize] |= USED;
        for &mate in &mates[3 * t as usize..3 * t as usize + 3] {
            if mate != NONE {
                let u = mate / 3;
                let free = &mut self.free[u as usize];
                *free -= 1;
                if *free & USED == 0 {
                    self.starts[usize::from(*free)].push(u);
                }
            }
        }
    }

    /// Writes the strip that starts with the triangle of `exit` and leaves it over that half-edge.
    /// Returns the last triangle's half-edge that starts at the last entry.
    fn strip(
        &mut self,
        triangles: &[[u32; 3]],
        mates: &[u32],
        exit: u32,
        (out, base): (&mut Vec<u32>, usize),
    ) -> u32 {
        let (t, e) = (exit / 3, exit % 3);
        let corner = triangles[t as usize];
        let even = (out.len() - base) % 2 == 0;
        let edge = if even { (e + 2) % 3 } else { (e + 1) % 3 };
        let before = corner[((e + 2) % 3) as usize];
        let second = corner[(if even { e } else { (e + 1) % 3 }) as usize];
        out.extend([before, second]);
        let mut last = second;
        let mut front = Front {
            triangle: t,
            edge,
            before,
            even,
        };
        loop {
            self.take(mates, front.triangle);
            let tip = (front.edge + 2) % 3;
            let apex = triangles[front.triangle as usize][tip as usize];
            let half_edges = 3 * front.triangle;
            let (ahead, aside) = if front.even {
                ((front.edge + 1) % 3, tip)
            } else {
                (tip, (front.edge + 1) % 3)
            };
            let ahead = self.free_across(mates, half_edges + ahead);
            let aside = self.free_across(mates, half_edges + aside);
            let (mate, swap) = match (ahead, aside) {
                (Some(a), Some(b)) if b.1 < a.1 => (b.0, true),
                (Some(a), _) => (a.0, false),
                (None, Some(b)) => (b.0, true),
                (None, None) => {
                    out.push(apex);
                    return half_edges + tip;
                }
            };
            if swap {
                out.push(front.before);
            } else {
                front.before = last;
            }
            out.push(apex);
            last = apex;
            front.even = front.even == swap;
            front.triangle = mate / 3;
            front.edge = mate % 3;
        }
    }

    /// The unused triangle with fewest free neighbours round the vertex where half-edge `from`
    /// starts; returns its half-edge opposite that vertex.
    fn turn_about(&self, mates: &[u32], from: u32) -> Option<u32> {
        let (after, before) = (|h| h - h % 3 + (h + 1) % 3, |h| h - h % 3 + (h + 2) % 3);
        let mut best: Option<(u8, u32)> = None;
        let mut consider = |h: u32, opposite: u32| {
            let free = self.free[(h / 3) as usize];
            if free & USED == 0 && best.is_none_or(|(least, _)| free < least) {
                best = Some((free, opposite));
            }
        };
        let mut out_going = from;
        for _ in 0..TURN_LIMIT {
            let mate = mates[out_going as usize];
            if mate == NONE {
                break;
            }
            consider(mate, before(mate));
            out_going = after(mate);
            if out_going == from {
                return best.map(|(_, h)| h);
            }
        }
        let mut in_coming = before(from);
        for _ in 0..TURN_LIMIT {
            let mate = mates[in_coming as usize];
            if mate == NONE {
                break;
            }
            consider(mate, after(mate));
            in_coming = before(mate);
        }
        best.map(|(_, h)| h)
    }
}

/// Writes the repeats between the last entry and a strip that starts elsewhere; nothing where it
/// starts at the last entry's vertex.
fn join(triangles: &[[u32; 3]], exit: u32, out: &mut Vec<u32>) {
    let last = out[out.len() - 1];
    let first = triangles[(exit / 3) as usize][((exit + 2) % 3) as usize];
    if last != first {
        out.extend([last, first]);
    }
}
