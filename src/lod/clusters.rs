//! Which vertices of a node become one: those of a block of space that are connected inside it by edges of their
//! surface, so that two sheets of a thin wall stay apart.
//!
//! Vertices of the border are joined along the border alone, which the nodes on both sides of a plane have in common.
//! Those on two planes stay, and so do all vertices of surfaces that are kept as they are.

use super::border::Border;
use super::mesh::Mesh;
use super::planes::{OnPlanes, axes, axis_of};
use std::collections::HashMap;

/// What blocks count from, so that places a little below 0 are in one as well.
const BELOW: i32 = 1 << 12;

/// How vertices of a level become fewer.
#[derive(Debug, Clone, Copy)]
pub struct Rules {
    /// Width of a block in lattice steps, an even number.
    pub block: i32,
    /// New vertices lie on multiples of so many lattice steps.
    pub step: i32,
    /// Surfaces are closed by caps, so that their curves on the volume's faces have mates, too.
    pub capped: bool,
}

impl Rules {
    /// The block of a place.
    #[inline]
    fn block_of(&self, p: [i32; 3]) -> [i32; 3] {
        p.map(|v| ((v + BELOW) as u32 / self.block as u32) as i32)
    }

    /// The middle of a block, in lattice steps.
    pub fn middle(&self, block: [i32; 3]) -> [i32; 3] {
        block.map(|b| b * self.block + self.block / 2 - BELOW)
    }
}

/// Where the vertex of a cluster may lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// Strictly between the node's planes.
    Inner,
    /// Where it is.
    Stays,
    /// On the border, in the plane across this axis.
    Border(usize),
}

/// Vertices that become one.
#[derive(Debug, Clone, Copy)]
pub struct Cluster {
    pub kind: Kind,
    pub surface: u32,
    /// The block, or of vertices that stay their place.
    pub block: [i32; 3],
    /// Another cluster whose place it takes, or itself: surfaces and caps have their common vertices twice.
    pub leader: u32,
    pub count: i64,
    /// Sum of places relative to the middle of the block.
    pub sum: [i64; 3],
    pub normal: [i64; 3],
    /// The planes of one of its vertices if it is of the border.
    pub planes: OnPlanes,
}

/// The clusters of a mesh.
#[derive(Debug)]
pub struct Clusters {
    pub all: Vec<Cluster>,
    /// That of each vertex.
    pub of_vertex: Vec<u32>,
}

/// Beyond all blocks as one number.
const NO_BLOCK: u64 = 1 << 63;

/// Sets of vertices, of which the smallest stands for a set.
struct Sets(Vec<u32>);

impl Sets {
    fn find(&mut self, mut v: u32) -> u32 {
        loop {
            let up = self.0[v as usize];
            if up == v {
                return v;
            }
            let top = self.0[up as usize];
            self.0[v as usize] = top;
            v = top;
        }
    }

    fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

impl Clusters {
    /// Those of a mesh with this border; surfaces that are `kept` stay as they are inside of the node.
    pub fn of(mesh: &Mesh, border: &Border, kept: &[bool], rules: &Rules) -> Self {
        let mut sets = Sets((0..mesh.points.len() as u32).collect());
        join_inside(mesh, border, kept, rules, &mut sets);
        join_along(mesh, border, rules, &mut sets);
        if rules.capped {
            join_twins(mesh, border, &mut sets);
        }
        number(mesh, border, kept, rules, &mut sets)
    }
}

/// Joins the ends of edges inside a block, borders apart.
fn join_inside(mesh: &Mesh, border: &Border, kept: &[bool], rules: &Rules, sets: &mut Sets) {
    let block = |v: usize| {
        if border.of_vertex[v] != 0 || kept[mesh.surface_of[v] as usize] {
            return NO_BLOCK | v as u64;
        }
        let [x, y, z] = rules.block_of(mesh.points[v]).map(|b| b as u64);
        z << 42 | y << 21 | x
    };
    let blocks: Vec<u64> = (0..mesh.points.len()).map(block).collect();
    for t in &mesh.triangles {
        let of = t.map(|v| blocks[v as usize]);
        for k in 0..3 {
            let j = (k + 1) % 3;
            // each edge inside comes from both sides
            if of[k] == of[j] && t[k] < t[j] {
                sets.join(t[k], t[j]);
            }
        }
    }
}

/// Joins vertices of the border that an edge of it connects inside a block and a plane.
fn join_along(mesh: &Mesh, border: &Border, rules: &Rules, sets: &mut Sets) {
    let stays = |v: u32| axes(border.of_vertex[v as usize]) > 1;
    for edge in &border.edges {
        let ends = [edge.from, edge.to].map(|v| rules.block_of(mesh.points[v as usize]));
        if ends[0] == ends[1] && !stays(edge.from) && !stays(edge.to) {
            sets.join(edge.from, edge.to);
        }
    }
}

/// Joins the vertices of the border at one place on a face of the volume, which a surface and a cap have in common.
fn join_twins(mesh: &Mesh, border: &Border, sets: &mut Sets) {
    let mut first: HashMap<[i32; 3], u32> = HashMap::new();
    for (v, _) in border
        .of_vertex
        .iter()
        .enumerate()
        .filter(|(_, bits)| **bits != 0)
    {
        let one = *first.entry(mesh.points[v]).or_insert(v as u32);
        if one != v as u32 {
            sets.join(one, v as u32);
        }
    }
}

/// Numbers the sets by their first vertices, one cluster for each surface in a set, and sums up their vertices.
fn number(mesh: &Mesh, border: &Border, kept: &[bool], rules: &Rules, sets: &mut Sets) -> Clusters {
    let mut all: Vec<Cluster> = Vec::with_capacity(mesh.points.len() / 3);
    let mut of_vertex: Vec<u32> = Vec::with_capacity(mesh.points.len());
    // of sets with vertices of several surfaces
    let mut followers: HashMap<(u32, u32), u32> = HashMap::new();
    for v in 0..mesh.points.len() {
        let (point, surface, bits) = (mesh.points[v], mesh.surface_of[v], border.of_vertex[v]);
        let root = sets.find(v as u32) as usize;
        let kind = match bits {
            0 if kept[surface as usize] => Kind::Stays,
            0 => Kind::Inner,
            _ if axes(bits) > 1 => Kind::Stays,
            _ => Kind::Border(axis_of(bits)),
        };
        let new = |leader| Cluster {
            kind,
            surface,
            block: match kind {
                Kind::Stays => point,
                _ => rules.block_of(point),
            },
            leader,
            count: 0,
            sum: [0; 3],
            normal: [0; 3],
            planes: bits,
        };
        let next = all.len() as u32;
        let own = if root == v {
            all.push(new(next));
            next
        } else {
            let leader = of_vertex[root];
            match all[leader as usize].surface == surface {
                true => leader,
                false => *followers.entry((leader, surface)).or_insert_with(|| {
                    all.push(new(leader));
                    next
                }),
            }
        };
        of_vertex.push(own);
        let leader = all[own as usize].leader;
        let middle = rules.middle(all[leader as usize].block);
        let sums = &mut all[leader as usize];
        sums.count += 1;
        if sums.kind != Kind::Stays {
            for a in 0..3 {
                sums.sum[a] += i64::from(point[a] - middle[a]);
            }
        }
        let normal = &mut all[own as usize].normal;
        for a in 0..3 {
            normal[a] += i64::from(mesh.normals[v][a]);
        }
    }
    Clusters { all, of_vertex }
}
