//! The shape of a mesh: its connected parts, and where fewer triangles over the same vertices fail to be
//! the same surface.

/// Connected parts and neighbours of an edge-manifold mesh.
#[derive(Debug)]
pub(super) struct Shape {
    /// Connected part of each vertex; [`NO_PART`] for one without a triangle.
    parts: Vec<u32>,
    /// Vertices - edges + triangles of each part.
    euler: Vec<i64>,
    /// Directed edges without their reverse, rising.
    open: Vec<[u32; 2]>,
    /// Neighbours of vertex `v`: `neighbours[starts[v]..starts[v + 1]]`, some of them twice.
    starts: Vec<u32>,
    neighbours: Vec<u32>,
}

/// What is wrong with triangles that should be a surface.
#[derive(Debug)]
pub(super) struct Faults {
    /// Vertices of faulty edges, triangles and fans.
    pub vertices: Vec<bool>,
    /// Parts with such vertices, or with another Euler characteristic.
    pub parts: Vec<bool>,
    /// True if a part has another Euler characteristic and no faulty vertex.
    pub unplaced: bool,
}

/// The part of a vertex without a triangle.
const NO_PART: u32 = u32::MAX;

/// An edge with the smaller vertex first, and whether it runs from the larger one.
type Edge = ([u32; 2], bool);

/// Every triangle's edges, sorted.
fn edges(triangles: &[[u32; 3]]) -> Vec<Edge> {
    let mut edges = Vec::with_capacity(3 * triangles.len());
    for &[a, b, c] in triangles {
        for (a, b) in [(a, b), (b, c), (c, a)] {
            edges.push(([a.min(b), a.max(b)], a > b));
        }
    }
    edges.sort_unstable();
    edges
}

/// The direction of an edge.
fn directed(&([a, b], turned): &Edge) -> [u32; 2] {
    if turned { [b, a] } else { [a, b] }
}

/// Which directed edges of those along one edge have no mate; `None` if there are more than two
/// triangles, or two that run the same way.
fn unmatched(same: &[Edge]) -> Option<Option<[u32; 2]>> {
    match same {
        [one] => Some(Some(directed(one))),
        [(_, false), (_, true)] => Some(None),
        _ => None,
    }
}

impl Shape {
    /// The shape of triangles over `vertices` vertices; `None` if an edge has more than two triangles, or
    /// two that run along it the same way.
    pub fn new(vertices: usize, triangles: &[[u32; 3]]) -> Option<Shape> {
        let mut parent: Vec<u32> = (0..vertices as u32).collect();
        let mut starts = vec![0u32; vertices + 1];
        for t in triangles {
            let roots = t.map(|v| root(&mut parent, v));
            let least = roots.into_iter().min().unwrap_or(0);
            roots.into_iter().for_each(|r| parent[r as usize] = least);
            t.iter().for_each(|&v| starts[v as usize + 1] += 2);
        }
        for v in 0..vertices {
            starts[v + 1] += starts[v];
        }
        let mut parts = vec![NO_PART; vertices];
        let mut euler = Vec::new();
        for v in 0..vertices {
            if starts[v] < starts[v + 1] {
                let root = root(&mut parent, v as u32) as usize;
                if root == v {
                    parts[v] = euler.len() as u32;
                    euler.push(0);
                } else {
                    parts[v] = parts[root];
                }
            }
        }
        let mut shape = Shape {
            parts,
            euler,
            open: Vec::new(),
            neighbours: vec![0; starts[vertices] as usize],
            starts,
        };
        let mut next = shape.starts.clone();
        for &[a, b, c] in triangles {
            for (v, others) in [(a, [b, c]), (b, [c, a]), (c, [a, b])] {
                let at = &mut next[v as usize];
                shape.neighbours[*at as usize..][..2].copy_from_slice(&others);
                *at += 2;
            }
        }
        for same in edges(triangles).chunk_by(|a, b| a.0 == b.0) {
            shape.open.extend(unmatched(same)?);
        }
        shape.open.sort_unstable();
        shape.euler = shape.euler_of(triangles);
        Some(shape)
    }

    /// The part of a triangle.
    pub fn part(&self, triangle: [u32; 3]) -> usize {
        self.parts[triangle[0] as usize] as usize
    }

    /// The number of parts.
    pub fn count(&self) -> usize {
        self.euler.len()
    }

    fn euler_of(&self, triangles: &[[u32; 3]]) -> Vec<i64> {
        let mut euler = vec![0; self.euler.len()];
        let mut used = vec![false; self.parts.len()];
        for &t in triangles {
            euler[self.part(t)] += 1;
            t.iter().for_each(|&v| used[v as usize] = true);
        }
        for (v, _) in used.iter().enumerate().filter(|(_, used)| **used) {
            euler[self.parts[v] as usize] += 1;
        }
        let mut edges = edges(triangles);
        edges.dedup_by_key(|e| e.0);
        for ([a, _], _) in edges {
            euler[self.parts[a as usize] as usize] -= 1;
        }
        euler
    }

    /// Where other triangles, over the same vertices, are not the same surface: at an edge that has no mate
    /// and had one, or has too many; at a triangle that comes twice, in whatever direction; where two fans
    /// of triangles touch. Parts that are not `alive` are not looked at.
    pub fn faults(&self, fewer: &[[u32; 3]], alive: &[bool]) -> Faults {
        let mut faulty = vec![false; self.parts.len()];
        let mut open = Vec::with_capacity(self.open.len());
        for same in edges(fewer).chunk_by(|a, b| a.0 == b.0) {
            match unmatched(same) {
                Some(edge) => open.extend(edge),
                None => same[0].0.iter().for_each(|&v| faulty[v as usize] = true),
            }
        }
        open.sort_unstable();
        let differs = |a: &[[u32; 2]], b: &[[u32; 2]]| -> Vec<u32> {
            let missing = a.iter().filter(|e| b.binary_search(e).is_err());
            missing.flatten().copied().collect()
        };
        for v in [differs(&open, &self.open), differs(&self.open, &open)].concat() {
            faulty[v as usize] |= alive[self.parts[v as usize] as usize];
        }
        let mut corners = fewer.to_vec();
        corners.iter_mut().for_each(|t| t.sort_unstable());
        corners.sort_unstable();
        for twice in corners.windows(2).filter(|w| w[0] == w[1]) {
            twice[0].iter().for_each(|&v| faulty[v as usize] = true);
        }
        fans(fewer, &mut faulty);
        let mut parts = vec![false; self.count()];
        for (v, _) in faulty.iter().enumerate().filter(|(_, f)| **f) {
            parts[self.parts[v] as usize] = true;
        }
        let euler = self.euler_of(fewer);
        let mut unplaced = false;
        for (part, faulty) in parts.iter_mut().enumerate() {
            if alive[part] && !*faulty && euler[part] != self.euler[part] {
                *faulty = true;
                unplaced = true;
            }
        }
        Faults {
            vertices: faulty,
            parts,
            unplaced,
        }
    }

    /// Adds to `locked` all vertices that are nearer, by the number of edges, to a faulty vertex of the
    /// triangles than to another one of them, and those next to them.
    pub fn lock_around(&self, faults: &Faults, fewer: &[[u32; 3]], locked: &mut [bool]) {
        let mut reached = vec![false; self.parts.len()];
        let mut front = Vec::new();
        for &v in fewer.as_flattened() {
            if !std::mem::replace(&mut reached[v as usize], true) {
                front.push((v, faults.vertices[v as usize]));
            }
        }
        let mut at = 0;
        while let Some(&(v, bad)) = front.get(at) {
            at += 1;
            locked[v as usize] |= bad;
            let range = self.starts[v as usize] as usize..self.starts[v as usize + 1] as usize;
            for &n in &self.neighbours[range] {
                locked[n as usize] |= bad;
                if !std::mem::replace(&mut reached[n as usize], true) {
                    front.push((n, bad));
                }
            }
        }
    }
}

/// Marks vertices whose triangles are more than one fan. Those of faulty edges are left out.
fn fans(triangles: &[[u32; 3]], faulty: &mut [bool]) {
    let mut corners: Vec<(u32, [u32; 2])> = Vec::with_capacity(3 * triangles.len());
    for &[a, b, c] in triangles {
        corners.extend([(a, [b, c]), (b, [c, a]), (c, [a, b])]);
    }
    corners.sort_unstable();
    for star in corners.chunk_by(|a, b| a.0 == b.0) {
        let vertex = star[0].0 as usize;
        if faulty[vertex] {
            continue;
        }
        let [mut head, mut tail] = star[0].1;
        let mut rest: Vec<[u32; 2]> = star[1..].iter().map(|s| s.1).collect();
        while let Some(i) = rest.iter().position(|e| e[0] == tail || e[1] == head) {
            let [from, to] = rest.swap_remove(i);
            if from == tail {
                tail = to;
            } else {
                head = from;
            }
        }
        faulty[vertex] = !rest.is_empty();
    }
}

fn root(parent: &mut [u32], mut v: u32) -> u32 {
    while parent[v as usize] != v {
        let up = parent[parent[v as usize] as usize];
        parent[v as usize] = up;
        v = up;
    }
    v
}

#[cfg(test)]
mod tests {
    use super::*;

    const TETRAHEDRON: [[u32; 3]; 4] = [[0, 1, 2], [0, 3, 1], [1, 3, 2], [2, 3, 0]];

    fn marked(flags: &[bool]) -> Vec<usize> {
        (0..flags.len()).filter(|&v| flags[v]).collect()
    }

    #[test]
    fn faults_are_where_the_surface_changes() {
        // a tetrahedron, another one far off, and an open square of four triangles around vertex 12
        let moved = |by: u32| TETRAHEDRON.map(|t| t.map(|v| v + by));
        let square = [[8, 9, 12], [9, 10, 12], [10, 11, 12], [11, 8, 12]];
        let all = [&TETRAHEDRON[..], &moved(4), &square].concat();
        let shape = Shape::new(13, &all).unwrap();
        assert_eq!((shape.count(), shape.euler.clone()), (3, vec![2, 2, 1]));
        assert_eq!(shape.open.len(), 4);
        assert!(marked(&shape.faults(&all, &[true; 3]).vertices).is_empty());
        // the square without its middle
        let fewer = [&TETRAHEDRON[..], &moved(4), &[[8, 9, 10], [10, 11, 8]]].concat();
        assert!(marked(&shape.faults(&fewer, &[true; 3]).vertices).is_empty());
        // a lost part, a triangle and its back, a lost triangle
        let lost = [&TETRAHEDRON[..], &square].concat();
        assert_eq!(shape.faults(&lost, &[true; 3]).parts, [false, true, false]);
        assert!(shape.faults(&lost, &[true; 3]).unplaced);
        let flat = [&TETRAHEDRON[..], &[[4, 5, 6], [6, 5, 4]], &square].concat();
        assert_eq!(marked(&shape.faults(&flat, &[true; 3]).vertices), [4, 5, 6]);
        assert_eq!(
            marked(&shape.faults(&all[1..], &[true; 3]).vertices),
            [0, 1, 2]
        );
        let others = shape.faults(&flat[4..], &[false, true, true]);
        assert_eq!(marked(&others.vertices), [4, 5, 6]);
        assert_eq!(shape.faults(&flat, &[true; 3]).parts, [false, true, false]);
        // what lies nearest to a faulty vertex
        let mut locked = vec![false; 13];
        let faults = shape.faults(&flat, &[true; 3]);
        assert!(!faults.unplaced);
        shape.lock_around(&faults, &flat, &mut locked);
        assert_eq!(marked(&locked), [4, 5, 6, 7]);
    }

    #[test]
    fn touching_fans_and_crowded_edges_are_faults() {
        let two = [&TETRAHEDRON[..], &TETRAHEDRON.map(|t| t.map(|v| v + 4))].concat();
        let shape = Shape::new(8, &two).unwrap();
        let touching: Vec<[u32; 3]> = two
            .iter()
            .map(|t| t.map(|v| if v == 4 { 3 } else { v }))
            .collect();
        assert!(marked(&shape.faults(&touching, &[true; 2]).vertices).contains(&3));
        let hinge: Vec<[u32; 3]> = two
            .iter()
            .map(|t| t.map(|v| [0, 1, 2, 3, 2, 3, 6, 7][v as usize]))
            .collect();
        assert!(Shape::new(8, &hinge).is_none());
        assert!(marked(&shape.faults(&hinge, &[true; 2]).vertices).starts_with(&[2, 3]));
    }
}
