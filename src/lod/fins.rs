//! Fins: rectangles in the planes of a node, along its border, that cover what could be seen through between its
//! border and that of a finer node beside it.

use super::gap::Segment;
use std::collections::HashMap;

/// How wide fins are and where their corners may lie.
#[derive(Debug, Clone, Copy)]
pub struct FinShape {
    /// Half the width in lattice steps: all that lies within it of a segment is covered.
    pub half_width: u32,
    /// Corners lie on multiples of so many lattice steps.
    pub step: i32,
    /// Corners lie in this box.
    pub limits: [[i32; 3]; 2],
}

impl FinShape {
    /// The corners of the fin of a segment, as a strip.
    ///
    /// Both ends reach out by the width, so that no gap is left where segments meet at an angle.
    pub fn corners(&self, segment: &Segment, points: &[[i32; 3]]) -> [[i32; 3]; 4] {
        let [p, q] = [segment.from, segment.to].map(|c| points[c as usize]);
        let axes = [(segment.axis + 1) % 3, (segment.axis + 2) % 3];
        let flat = |v: [i32; 3]| axes.map(|a| f64::from(v[a]));
        let (from, to) = (flat(p), flat(q));
        let along = [to[0] - from[0], to[1] - from[1]];
        let length = (along[0] * along[0] + along[1] * along[1]).sqrt();
        let unit = match length > 0.0 {
            true => along.map(|v| v / length),
            false => [1.0, 0.0],
        };
        // corners are rounded by less than a step along each axis
        let width = f64::from(self.half_width) + 0.75 * f64::from(self.step);
        let corner = |end: [f64; 2], point: [i32; 3], out: f64, side: f64| {
            let mut corner = point;
            let across = [-unit[1], unit[0]];
            for (i, a) in axes.into_iter().enumerate() {
                let v = end[i] + width * (out * unit[i] + side * across[i]);
                let [low, high] = self.limits.map(|limit| limit[a]);
                let steps = (v / f64::from(self.step)).round() as i32;
                corner[a] = (steps * self.step).clamp(low, high);
            }
            corner
        };
        [
            corner(from, p, -1.0, -1.0),
            corner(from, p, -1.0, 1.0),
            corner(to, q, 1.0, -1.0),
            corner(to, q, 1.0, 1.0),
        ]
    }
}

/// Segments in an order in which each begins where the one before ends, as far as curves go on.
pub fn in_a_row(segments: &[Segment]) -> Vec<Segment> {
    let mut at: HashMap<(u32, usize), Vec<u32>> = HashMap::new();
    for (i, s) in segments.iter().enumerate() {
        for end in [s.from, s.to] {
            at.entry((end, s.axis)).or_default().push(i as u32);
        }
    }
    let is_end = |v: u32, s: &Segment| at[&(v, s.axis)].len() == 1;
    // open curves first, from one of their ends, then what is left, which has none
    let (mut starts, mut rest) = (Vec::new(), Vec::new());
    for (i, s) in segments.iter().enumerate() {
        match (is_end(s.from, s), is_end(s.to, s)) {
            (true, _) => starts.push((i, s.from)),
            (_, true) => starts.push((i, s.to)),
            _ => rest.push((i, s.from)),
        }
    }
    let mut done = vec![false; segments.len()];
    let mut row = Vec::with_capacity(segments.len());
    for (first, mut from) in starts.into_iter().chain(rest) {
        let mut next = Some(first).filter(|&i| !done[i]);
        while let Some(i) = next {
            let s = segments[i];
            done[i] = true;
            let to = if s.from == from { s.to } else { s.from };
            row.push(Segment { from, to, ..s });
            from = to;
            let mut more = at[&(to, s.axis)].iter().map(|&i| i as usize);
            next = more.find(|&i| !done[i]);
        }
    }
    row
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn a_fin_lies_in_the_plane_and_covers_its_width() {
        let points = [[100, 640, 900], [100, 1640, 900]];
        let shape = FinShape {
            half_width: 200,
            step: 4,
            limits: [[-9999; 3], [9999; 3]],
        };
        for (from, to, length) in [(0, 1, 1000), (0, 0, 0)] {
            let segment = Segment { from, to, axis: 0 };
            let corners = shape.corners(&segment, &points);
            assert!(
                corners
                    .iter()
                    .all(|c| c[0] == 100 && c[1] % 4 == 0 && c[2] % 4 == 0)
            );
            let reach = |a: usize| {
                let all = corners.map(|c| c[a]);
                [*all.iter().min().unwrap(), *all.iter().max().unwrap()]
            };
            assert!(reach(1)[0] <= 440 && reach(1)[1] >= 640 + length + 200);
            assert!(reach(2)[0] <= 700 && reach(2)[1] >= 1100);
        }
    }

    #[test]
    fn curves_are_walked_from_end_to_end() {
        let segment = |from, to, axis| Segment { from, to, axis };
        // a loop, a curve whose segments come in no order, one in another plane at one of its vertices, and a point
        let all = [
            segment(1, 2, 0),
            segment(1, 3, 0),
            segment(2, 3, 0),
            segment(5, 8, 1),
            segment(5, 9, 1),
            segment(7, 9, 1),
            segment(7, 7, 2),
        ];
        let row = in_a_row(&all);
        let set = |row: &[Segment]| -> BTreeSet<Segment> {
            let rising = |s: &Segment| segment(s.from.min(s.to), s.from.max(s.to), s.axis);
            row.iter().map(rising).collect()
        };
        assert_eq!((row.len(), set(&row)), (all.len(), set(&all)));
        let breaks = row.windows(2).filter(|w| w[0].to != w[1].from).count();
        assert_eq!(breaks, 2, "{row:?}");
    }
}
