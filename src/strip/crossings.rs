//! Which two edges of each triangle its strip crosses: the state that all stages work on.
//!
//! A triangle in the middle of a strip crosses two of its edges and skips the third, so its place in
//! the strips is one of three labels: the skipped edge. Two neighbours are *linked* (stand next to
//! each other in a strip) where both cross the edge between them. Where a strip crosses an edge and
//! turns to the other side than before (left after right), it goes on for one entry; where it turns
//! to the same side, it needs a swap, a second entry. Whether it does follows from the two labels
//! alone. So entries = triangles + 4 per strip + 1 per link with a swap, and the task is to choose
//! labels with the greatest sum of gains: 4 per link, 3 per link with a swap.

/// Rings longer than this are not looked for: they cost four entries each, and are rare.
const RING_LIMIT: u32 = 64;

/// Most merges tried at one end.
const TRIES: u32 = 3;

/// The state of each half-edge e of a triangle, by skipped edge. The fourth of each is no edge.
///
/// Its low two bits are its *turn*: 0 skipped, 1 the other crossed edge is the one after e, 2 it is the
/// one before. The rest is a signed number, by how much the other half-edge's number is greater: the walk
/// along a strip adds it, where working it out from the turn would take three times as long.
pub(super) const CROSSING: [[u8; 4]; 3] = [
    [0, crossed(1, 1), crossed(2, -1), 0],
    [crossed(2, 2), 0, crossed(1, -2), 0],
    [crossed(1, 1), crossed(2, -1), 0, 0],
];

const fn crossed(turn: u8, steps: i8) -> u8 {
    turn | (steps << 2) as u8
}

/// The turn of a state.
#[inline(always)]
const fn turn(state: u8) -> u8 {
    state & 3
}

/// Whether a strip that enters a triangle over a half-edge in this state leaves it over the one after.
#[inline(always)]
pub(super) fn turns_after(state: u8) -> bool {
    state & 1 == 1
}

/// The other half-edge that a strip crosses in the triangle of `h`, which it crosses in this state.
#[inline(always)]
pub(super) fn other(h: u32, state: u8) -> u32 {
    h.wrapping_add_signed((state as i8 >> 2).into())
}

/// The skipped edge by the turn of edge 0: the inverse of [`CROSSING`].
const SKIPPED: [u8; 3] = [0, 2, 1];

/// Entries that a link saves against two strips.
const LINK: i32 = 4;

/// Entries saved by a link between two turns: strips turn to alternating sides where both are alike,
/// since each is seen from its own side of the edge.
const fn gain(a: u8, b: u8) -> i32 {
    if a == 0 || b == 0 {
        0
    } else if a == b {
        LINK
    } else {
        LINK - 1
    }
}

/// [`gain`] by `a | b << 2`.
const GAIN: [i32; 16] = {
    let mut table = [0; 16];
    let mut i = 0;
    while i < 11 {
        table[i] = gain((i % 4) as u8, (i / 4) as u8);
        i += 1;
    }
    table
};

/// Entries saved by a link between two turns or states.
#[inline(always)]
fn gain_of(a: u8, b: u8) -> i32 {
    GAIN[usize::from(turn(a) | turn(b) << 2)]
}

/// The best skipped edge of a triangle, by the turns across its edges (two bits each): two bits for
/// each edge that is skipped now. `[0]` changes only for a gain, `[1]` for a tie too.
static BEST: [[u8; 64]; 2] = [best_labels(false), best_labels(true)];

const fn best_labels(move_on_tie: bool) -> [u8; 64] {
    let mut table = [0; 64];
    let mut across = 0;
    while across < 64 {
        let mut now = 0;
        while now < 3 {
            let mut best = now;
            let mut step = 1;
            while step < 3 {
                let label = (now + step) % 3;
                let (new, old) = (label_gain(label, across), label_gain(best, across));
                if new > old || (move_on_tie && best == now && new == old) {
                    best = label;
                }
                step += 1;
            }
            table[across] |= (best as u8) << (2 * now);
            now += 1;
        }
        across += 1;
    }
    table
}

const fn label_gain(label: usize, across: usize) -> i32 {
    gain(turn(CROSSING[label][0]), (across & 3) as u8)
        + gain(turn(CROSSING[label][1]), (across >> 2 & 3) as u8)
        + gain(turn(CROSSING[label][2]), (across >> 4) as u8)
}

/// The next half-edge of the same triangle.
#[inline(always)]
pub(super) fn after(h: u32) -> u32 {
    h + 1 - 3 * u32::from(h & 3 == 2)
}

/// The half-edge before it in the same triangle.
#[inline(always)]
pub(super) fn before(h: u32) -> u32 {
    h + 2 - 3 * u32::from(h & 3 != 0)
}

/// The three half-edges of a triangle.
#[inline(always)]
pub(super) fn edges(t: u32) -> std::ops::Range<u32> {
    4 * t..4 * t + 3
}

/// The labels of a mesh piece, as states of its half-edges.
pub(super) struct Crossings<'a> {
    /// The mates as the caller gave them.
    pub mates: &'a [u32],
    /// Per half-edge as in [`CROSSING`]. A triangle that is in no strip yet, or written
    /// already, has zeros, as triangle 0 has, which stands for none.
    pub states: &'a mut [[u8; 4]],
    /// Triangles that may be ends of strips. Some are stale, and an end may be missing after an exchange
    /// that saved entries without a merge: writing finds those by itself.
    pub ends: &'a mut Vec<u32>,
}

impl Crossings<'_> {
    /// The numbers of all triangles.
    pub(super) fn triangles(&self) -> std::ops::Range<u32> {
        1..self.states.len() as u32
    }

    /// State of a half-edge.
    #[inline(always)]
    pub(super) fn state(&self, h: u32) -> u8 {
        self.states.as_flattened()[h as usize]
    }

    /// State of the half-edge across `h`; 0 at a border.
    #[inline(always)]
    pub(super) fn across(&self, h: u32) -> u8 {
        self.state(self.mates[h as usize])
    }

    /// Entries saved across `h`: 0 where it is no link.
    #[inline(always)]
    pub(super) fn gain(&self, h: u32) -> i32 {
        gain_of(self.state(h), self.across(h))
    }

    /// The other edge that the strip crosses in the triangle of `h`, which crosses `h`.
    #[inline(always)]
    pub(super) fn other(&self, h: u32) -> u32 {
        other(h, self.state(h))
    }

    /// Whether the triangle is in no strip yet, or written already.
    #[inline(always)]
    pub(super) fn is_blank(&self, t: u32) -> bool {
        self.states[t as usize] == [0; 4]
    }

    /// Takes the triangle out of the mesh.
    #[inline(always)]
    pub(super) fn blank(&mut self, t: u32) {
        self.states[t as usize] = [0; 4];
    }

    /// Number of links of a triangle, and the half-edge of the last of them.
    pub(super) fn links(&self, t: u32) -> (u32, Option<u32>) {
        let linked = edges(t).filter(|&h| self.gain(h) != 0);
        linked.fold((0, None), |(n, _), h| (n + 1, Some(h)))
    }

    /// Makes the triangle of `h` skip that edge.
    #[inline(always)]
    pub(super) fn skip(&mut self, h: u32) {
        self.states[(h / 4) as usize] = CROSSING[(h % 4) as usize];
    }

    /// The half-edge that a triangle skips.
    #[inline(always)]
    fn skipped(&self, t: u32) -> u32 {
        4 * t + u32::from(SKIPPED[usize::from(turn(self.states[t as usize][0]))])
    }

    /// Gives each triangle in turn the label that is best beside its neighbours' present ones, with
    /// a change on every other tie or so: ends of strips wander then, and merge where they meet.
    pub(super) fn settle(&mut self) {
        let mut noise = 1u32;
        for t in self.triangles() {
            let h = 4 * t;
            let across = |e: u32| turn(self.across(h + e)) << (2 * e);
            let across = across(0) | across(1) | across(2);
            let now = self.skipped(t) - h;
            // a linear congruence modulo 2^32; its high bits are random enough
            noise = noise.wrapping_mul(0x915f_77f5).wrapping_add(0x1_2345);
            let label = BEST[(noise >> 31) as usize][usize::from(across & 63)] >> (2 * now) & 3;
            if u32::from(label) != now {
                let was: [bool; 3] = std::array::from_fn(|e| self.gain(h + e as u32) != 0);
                self.skip(h + u32::from(label));
                let is: [bool; 3] = std::array::from_fn(|e| self.gain(h + e as u32) != 0);
                for e in (0..3).filter(|&e| was[e] && !is[e]) {
                    self.ends.push(self.mates[h as usize + e] / 4);
                }
                if is.iter().filter(|&&l| l).count() < 2 {
                    self.ends.push(t);
                }
            }
        }
    }

    /// Tries to merge each end of a strip with another strip, over an edge that both may cross or by an
    /// [exchange](Self::exchange).
    pub(super) fn merge_ends(&mut self) {
        let listed = self.ends.len();
        for i in 0..listed {
            let t = self.ends[i];
            for _ in 0..TRIES {
                if self.links(t).0 == 2 || !self.merge(t) {
                    break;
                }
            }
        }
    }

    /// Tries both labels that keep the links of an end, and each edge that they offer.
    fn merge(&mut self, t: u32) -> bool {
        let edges = edges(t);
        let sum = |c: &Self| edges.clone().map(|h| c.gain(h)).sum::<i32>();
        let (now, old) = (sum(self), self.skipped(t));
        let linked: [bool; 3] = std::array::from_fn(|e| self.gain(4 * t + e as u32) != 0);
        for label in edges.clone().filter(|h| !linked[(h % 4) as usize]) {
            self.skip(label);
            let gain = sum(self) - now;
            if gain > 0 && !edges.clone().any(|h| self.closes(h)) {
                return true;
            }
            for h in edges.clone().filter(|&h| h != label) {
                if self.gain(h) == 0 && self.exchange(h, gain) {
                    return true;
                }
            }
            self.skip(old);
        }
        false
    }

    /// The triangle of `h` crosses `h` but the one across does not. Lets that one cross too and skip
    /// one of its other edges in turn; who was linked there becomes an end. `saved` is what was saved so
    /// far. Leaves everything as it was if it saves nothing.
    fn exchange(&mut self, h: u32, saved: i32) -> bool {
        let mate = self.mates[h as usize];
        if mate == super::NONE {
            return false;
        }
        if self.state(mate) != 0 {
            return saved > 0 && !self.closes(h);
        }
        // the triangle across crosses its two other sides, in turns 1 and 2; to cross `mate` and
        // one of them changes these round, whichever it is
        let sides = [after(mate), before(mate)];
        let near = self.state(h);
        let far = sides.map(|side| self.across(side));
        let was = [gain_of(1, far[0]), gain_of(2, far[1])];
        let saved = saved - was[0] - was[1];
        let options = [
            saved + gain_of(2, near) + gain_of(1, far[1]),
            saved + gain_of(1, near) + gain_of(2, far[0]),
        ];
        for k in 0..2 {
            if options[k] > 0 {
                self.skip(sides[k]);
                if !self.closes(h) {
                    let lost = self.mates[sides[k] as usize];
                    self.ends.extend((was[k] != 0).then_some(lost / 4));
                    return true;
                }
                self.skip(mate);
            }
        }
        false
    }

    /// Whether the strip that leaves a triangle over `h` comes back to it within
    /// [`RING_LIMIT`] triangles: a ring saves nothing, since it must be cut open again. Looks at the link made
    /// last only; rings left elsewhere are few.
    fn closes(&self, start: u32) -> bool {
        let mut h = start;
        let mut linked = self.gain(h) != 0;
        for _ in 0..RING_LIMIT {
            if !linked {
                return false;
            }
            h = self.other(self.mates[h as usize]);
            if h == start {
                return true;
            }
            linked = self.across(h) != 0;
        }
        false
    }
}
