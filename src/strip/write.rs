//! Writes labelled triangles as one stitched strip.

use super::crossings::{Crossings, after, before, other, turns_after};

/// Ends of strips that are to be written, by the parity that the first triangle should have so that
/// the strip's first turn needs no swap.
#[derive(Debug, Default)]
pub(super) struct Queue {
    ends: [Vec<u32>; 2],
}

impl Queue {
    /// Fills the queue with the half-edges over which strips leave their end triangles.
    fn fill(&mut self, crossings: &Crossings) {
        self.ends.iter_mut().for_each(Vec::clear);
        for &t in crossings.ends.iter().rev() {
            let (links, link) = crossings.links(t);
            if links < 2 {
                let exit = link.unwrap_or(4 * t);
                self.ends[parity(crossings, exit)].push(exit);
            }
        }
    }

    /// The next end that is not written yet: of the wanted parity if there is one.
    fn next(&mut self, crossings: &Crossings, parity: usize) -> Option<u32> {
        for stack in [parity, 1 - parity] {
            while let Some(exit) = self.ends[stack].pop() {
                if !crossings.is_blank(exit / 4) {
                    return Some(exit);
                }
            }
        }
        None
    }
}

/// The parity at which a strip should start: 0 where its second triangle is left over the edge before
/// the one it is entered by, since odd triangles go on to that side without a swap.
fn parity(crossings: &Crossings, exit: u32) -> usize {
    if crossings.gain(exit) == 0 {
        return 0;
    }
    let entry = crossings.mates[exit as usize];
    usize::from(crossings.other(entry) == after(entry))
}

/// Writes all strips, joined to one, behind `out`; returns their number. Blanks every triangle.
pub(super) fn write_strips(
    corners: &[u32],
    crossings: &mut Crossings,
    queue: &mut Queue,
    out: &mut Vec<u32>,
) -> usize {
    touch(corners);
    let base = out.len();
    let mut strips = 0;
    let mut write = |exit: u32, crossings: &mut Crossings, out: &mut Vec<u32>| {
        if strips > 0 {
            let first = corners[before(exit) as usize];
            out.extend([out[out.len() - 1], first]);
        }
        strips += 1;
        let even = (out.len() - base).is_multiple_of(2);
        write_strip(corners, crossings, (exit, even), out);
    };
    queue.fill(crossings);
    while let Some(exit) = queue.next(crossings, (out.len() - base) % 2) {
        write(exit, crossings, out);
    }
    // rings, and strips whose ends were not listed
    for t in crossings.triangles() {
        if !crossings.is_blank(t) {
            write(opening(crossings, t), crossings, out);
        }
    }
    strips
}

/// Reads a value of each cache line in order, which the processor does ahead of time; strips come along
/// here and there, and would wait for each. A quarter of all time for strips went there.
fn touch(corners: &[u32]) {
    const LINE: usize = 64 / size_of::<u32>();
    let lines = corners.iter().step_by(LINE);
    std::hint::black_box(lines.fold(0, |all, &corner| all ^ corner));
}

/// Where to start the strip or ring of triangle `t`: the end that lies behind its last link, or, in a
/// ring, past a link with a swap, which is the cheapest to give up.
fn opening(crossings: &Crossings, t: u32) -> u32 {
    let Some(start) = crossings.links(t).1 else {
        return 4 * t;
    };
    let mut swap = start;
    let mut h = start;
    for _ in crossings.triangles() {
        let mate = crossings.mates[h as usize];
        let next = crossings.other(mate);
        if crossings.gain(next) == 0 {
            return mate;
        }
        if crossings.gain(next) < crossings.gain(swap) {
            swap = next;
        }
        h = next;
        if h == start {
            break;
        }
    }
    crossings.other(swap)
}

/// Writes the strip that leaves its first triangle over `exit`, in which the first triangle has an
/// even number if so told.
fn write_strip(
    corners: &[u32],
    crossings: &mut Crossings,
    (exit, even): (u32, bool),
    out: &mut Vec<u32>,
) {
    // the first triangle as if it had been entered over the edge from which `exit` needs no swap
    let mut entry = if even { before(exit) } else { after(exit) };
    let mut earlier = corners[before(exit) as usize];
    let mut later = corners[(if even { exit } else { after(exit) }) as usize];
    out.extend([earlier, later]);
    let mut odd = !even;
    let mut turns = even;
    // where the strip goes on and how
    let mut next = crossings.mates[exit as usize];
    let mut state = match crossings.state(exit) {
        0 => 0,
        _ => crossings.state(next),
    };
    // Entries gather here, two written and one or two kept: a branch would be mispredicted at
    // every second swap.
    let mut block = [0; 64];
    let mut filled = 0;
    while state != 0 {
        let apex = corners[before(entry) as usize];
        let swap = turns == odd;
        block[filled] = if swap { earlier } else { apex };
        block[filled + 1] = apex;
        filled += 1 + usize::from(swap);
        if filled > block.len() - 2 {
            out.extend_from_slice(&block[..filled]);
            filled = 0;
        }
        earlier = if swap { earlier } else { later };
        later = apex;
        crossings.blank(entry / 4);
        // an entry more or less turns the parity, so that the next triangle is odd after a turn to
        // the edge after the entry, with a swap or without
        odd = turns;
        entry = next;
        turns = turns_after(state);
        next = crossings.mates[other(entry, state) as usize];
        state = crossings.state(next);
    }
    crossings.blank(entry / 4);
    out.extend_from_slice(&block[..filled]);
    out.push(corners[before(entry) as usize]);
}
