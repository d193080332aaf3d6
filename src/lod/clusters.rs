//! Which vertices of a node become one: those of a block of space that are connected inside it by edges of their
//! surface, so that two sheets of a thin wall stay apart.
//!
//! Vertices of the border are joined along the border alone, which the nodes on both sides of a plane have in common.
//! Those on two planes stay, four of each loop that would vanish, and all vertices of surfaces that are kept as they are.

use super::border::{Border, BorderEdge};
use super::mesh::{Mesh, NORMAL};
use super::planes::{OnPlanes, axes, axis_of};
use std::cmp::Reverse;
use std::collections::{BTreeMap, HashMap};

/// What blocks count from, so that places a little below 0 are in one as well.
const BELOW: i32 = 1 << 12;

/// How vertices of a level become fewer.
#[derive(Debug, Clone, Copy)]
pub struct Rules {
    /// Width of a block in lattice steps, an even number.
    pub block: i32,
    /// Width of a block of the border, likewise.
    pub border_block: i32,
    /// Vertices become one if the length of the mean of their normals is at least this: in blocks, and in those half as
    /// wide into which others are torn.
    pub agree: [f32; 2],
    /// New vertices lie on multiples of so many lattice steps.
    pub step: i32,
    /// Surfaces are closed by caps, so that their curves on the volume's faces have mates, too.
    pub capped: bool,
}

impl Rules {
    /// Width of the blocks of a kind of clusters.
    #[inline]
    fn width(&self, kind: Kind) -> i32 {
        match kind {
            Kind::Border(_) => self.border_block,
            _ => self.block,
        }
    }

    /// The middle of a cluster's block, in lattice steps; of none that stays.
    #[inline]
    pub fn middle(&self, cluster: &Cluster) -> [i32; 3] {
        let width = self.width(cluster.kind);
        cluster.block.map(|b| b * width + width / 2 - BELOW)
    }
}

/// The block of a place.
#[inline]
fn block_of(p: [i32; 3], width: i32) -> [i32; 3] {
    p.map(|v| ((v + BELOW) as u32 / width as u32) as i32)
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

impl Clusters {
    /// Adds one of which no vertex has become a part; of the border, `planes` are those it lies on, where it stays.
    pub fn add_one(&mut self, surface: u32, normal: [i64; 3], planes: OnPlanes) {
        self.all.push(Cluster {
            kind: if planes == 0 {
                Kind::Inner
            } else {
                Kind::Stays
            },
            surface,
            block: [0; 3],
            leader: self.all.len() as u32,
            count: 0,
            sum: [0; 3],
            normal,
            planes,
        });
    }
}

/// Beyond all blocks as one number.
const NO_BLOCK: u64 = 1 << 63;
/// The bit from which on a block's number says how often it has been halved.
const TORN: u32 = 60;

/// Sets of vertices, of which the smallest stands for a set.
pub struct Sets(Vec<u32>);

impl Sets {
    /// Of one vertex each.
    pub fn new(vertices: usize) -> Self {
        Sets((0..vertices as u32).collect())
    }

    pub fn find(&mut self, mut v: u32) -> u32 {
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

    pub fn join(&mut self, a: u32, b: u32) {
        let (a, b) = (self.find(a), self.find(b));
        self.0[a.max(b) as usize] = a.min(b);
    }
}

/// What decides which vertices become one.
#[derive(Clone, Copy)]
pub struct Clustering<'a> {
    pub mesh: &'a Mesh,
    pub border: &'a Border,
    /// Surfaces that stay as they are, borders between nodes apart.
    pub kept: &'a [bool],
    /// Vertices of the border that stay so that it moves little.
    pub pinned: &'a [bool],
    /// Faces of the volume on which surfaces end.
    pub open_faces: OnPlanes,
    pub rules: &'a Rules,
}

impl Clustering<'_> {
    /// The clusters.
    pub fn clusters(&self) -> Clusters {
        let mut sets = Sets::new(self.mesh.points.len());
        let mut stays = self.staying();
        let places = self.keep_small_loops(&mut stays, &mut sets);
        self.join_inside(&mut sets);
        self.join_along(&stays, &mut sets);
        if self.rules.capped {
            self.join_twins(&mut sets);
        }
        self.number(&stays, &places, &mut sets)
    }

    /// Which vertices stay where they are.
    fn staying(&self) -> Vec<bool> {
        let of_vertex = &self.border.of_vertex;
        let stays = |v: usize| {
            let bits = of_vertex[v];
            let is_kept = self.kept[self.mesh.surface_of[v] as usize];
            axes(bits) > 1 || self.pinned[v] || is_kept && bits & !self.open_faces == 0
        };
        (0..of_vertex.len()).map(stays).collect()
    }

    /// Loops of the border that would have fewer than three vertices keep some: they would vanish, and with them small
    /// cells that a plane cuts. The others come to lie at the nearest of those. A loop is the same for the nodes on
    /// both sides of its plane, and all of it follows from its places. Returns the places of those that moved.
    fn keep_small_loops(&self, stays: &mut [bool], sets: &mut Sets) -> HashMap<u32, [i32; 3]> {
        let point = |v: u32| self.mesh.points[v as usize];
        let mut places = HashMap::new();
        for mut own in self.small_loops(stays.len()) {
            own.sort_unstable_by_key(|&v| point(v));
            let corners = corners(own.iter().map(|&v| point(v)));
            let mut first: HashMap<[i32; 3], u32> = HashMap::new();
            for v in own {
                if std::mem::replace(&mut stays[v as usize], true) {
                    continue;
                }
                let nearest = corners.iter().min_by_key(|c| squared(**c, point(v)));
                let place = *nearest.unwrap_or(&point(v));
                sets.join(*first.entry(place).or_insert(v), v);
                places.insert(v, place);
            }
        }
        places
    }

    /// The vertices of loops of the border that blocks would leave fewer than three of.
    fn small_loops(&self, vertices: usize) -> impl Iterator<Item = Vec<u32>> + use<> {
        let ends = |v: u32| axes(self.border.of_vertex[v as usize]) > 1;
        let [mut loops, mut parts] = [(); 2].map(|()| Sets::new(vertices));
        for edge in &self.border.edges {
            if ends(edge.from) || ends(edge.to) {
                continue;
            }
            loops.join(edge.from, edge.to);
            if self.is_in_one_block(edge) {
                parts.join(edge.from, edge.to);
            }
        }
        let mut found: Vec<(u32, u32)> = Vec::new();
        for edge in &self.border.edges {
            for (v, other) in [(edge.from, edge.to), (edge.to, edge.from)] {
                if ends(v) {
                    continue;
                }
                let own = loops.find(v);
                found.push((own, parts.find(v)));
                if ends(other) {
                    // no loop, but a curve from one plane to another
                    found.extend([(own, u32::MAX), (own, u32::MAX - 1), (own, u32::MAX - 2)]);
                }
            }
        }
        found.sort_unstable();
        found.dedup();
        let few = found
            .chunk_by(|a, b| a.0 == b.0)
            .filter(|parts| parts.len() < 3);
        let mut small: BTreeMap<u32, Vec<u32>> = few.map(|f| (f[0].0, Vec::new())).collect();
        if !small.is_empty() {
            let mut all = self
                .border
                .edges
                .iter()
                .flat_map(|e| [e.from, e.to])
                .collect::<Vec<_>>();
            all.sort_unstable();
            all.dedup();
            for v in all {
                if let Some(own) = small.get_mut(&loops.find(v)) {
                    own.push(v);
                }
            }
        }
        small.into_values()
    }

    fn is_in_one_block(&self, edge: &BorderEdge) -> bool {
        let block = |v: u32| block_of(self.mesh.points[v as usize], self.rules.border_block);
        block(edge.from) == block(edge.to)
    }

    /// Joins the ends of edges inside a block, borders apart. Where the normals of what is joined do not agree, as
    /// around a thin neck or along a sharp fold, blocks are half as wide, and again.
    fn join_inside(&self, sets: &mut Sets) {
        let Clustering { mesh, rules, .. } = self;
        let block = |v: usize| {
            if self.border.of_vertex[v] != 0 || self.kept[mesh.surface_of[v] as usize] {
                return NO_BLOCK | v as u64;
            }
            number_of(block_of(mesh.points[v], rules.block))
        };
        let mut blocks: Vec<u64> = (0..mesh.points.len()).map(block).collect();
        join_equal(&mesh.triangles, &blocks, sets);
        let mut torn: Vec<u32> = (0..blocks.len() as u32).collect();
        torn.retain(|&v| blocks[v as usize] & NO_BLOCK == 0);
        let mut triangles = Vec::new();
        let mut sums = vec![[0.0; 4]; blocks.len()];
        for (depth, least) in rules.agree.into_iter().enumerate() {
            self.retain_disagreeing(&mut torn, least, sets, &mut sums);
            let width = rules.block >> (depth + 1);
            for v in torn.iter().map(|&v| v as usize) {
                let half = number_of(block_of(mesh.points[v], width));
                blocks[v] = (depth as u64 + 1) << TORN | half;
                sets.0[v] = v as u32;
            }
            if depth == 0 {
                let is_torn = |v: u32| (1..4).contains(&(blocks[v as usize] >> TORN));
                let joins = |t: &&[u32; 3]| t.iter().filter(|&&v| is_torn(v)).count() > 1;
                triangles.extend(mesh.triangles.iter().filter(joins));
            }
            join_equal(&triangles, &blocks, sets);
        }
    }

    /// Keeps those vertices in whose set the mean of the normals is shorter than `least`.
    fn retain_disagreeing(
        &self,
        vertices: &mut Vec<u32>,
        least: f32,
        sets: &mut Sets,
        sums: &mut [[f32; 4]],
    ) {
        vertices.iter().for_each(|&v| sums[v as usize] = [0.0; 4]);
        for &v in vertices.iter() {
            let sum = &mut sums[sets.find(v) as usize];
            let [x, y, z] = self.mesh.normals[v as usize].map(f32::from);
            *sum = [sum[0] + x, sum[1] + y, sum[2] + z, sum[3] + 1.0];
        }
        let least = least * NORMAL;
        vertices.retain(|&v| {
            let [x, y, z, count] = sums[sets.find(v) as usize];
            x * x + y * y + z * z < (least * count) * (least * count)
        });
    }

    /// Joins vertices of the border that an edge of it connects inside a block and a plane.
    fn join_along(&self, stays: &[bool], sets: &mut Sets) {
        for edge in &self.border.edges {
            let moves = |v: u32| !stays[v as usize];
            if moves(edge.from) && moves(edge.to) && self.is_in_one_block(edge) {
                sets.join(edge.from, edge.to);
            }
        }
    }

    /// Joins the vertices of the border at one place on a face of the volume, which a surface and a cap have in common.
    fn join_twins(&self, sets: &mut Sets) {
        let mut first: HashMap<[i32; 3], u32> = HashMap::new();
        let of_border = self.border.of_vertex.iter().enumerate();
        for (v, _) in of_border.filter(|(_, bits)| **bits != 0) {
            let one = *first.entry(self.mesh.points[v]).or_insert(v as u32);
            if one != v as u32 {
                sets.join(one, v as u32);
            }
        }
    }

    /// Numbers the sets by their first vertices, one cluster for each surface in a set, and sums up their vertices.
    fn number(&self, stays: &[bool], places: &HashMap<u32, [i32; 3]>, sets: &mut Sets) -> Clusters {
        let Clustering { mesh, rules, .. } = self;
        let mut all: Vec<Cluster> = Vec::with_capacity(mesh.points.len() / 3);
        let mut of_vertex: Vec<u32> = Vec::with_capacity(mesh.points.len());
        // of sets with vertices of several surfaces
        let mut followers: HashMap<(u32, u32), u32> = HashMap::new();
        for v in 0..mesh.points.len() {
            let (point, surface) = (mesh.points[v], mesh.surface_of[v]);
            let cluster = |leader: u32| {
                let place = match stays[v] {
                    true => places.get(&(v as u32)).unwrap_or(&point),
                    false => &point,
                };
                self.cluster(v, *place, stays[v], leader)
            };
            let root = sets.find(v as u32) as usize;
            let next = all.len() as u32;
            let own = if root == v {
                all.push(cluster(next));
                next
            } else {
                let leader = of_vertex[root];
                match all[leader as usize].surface == surface {
                    true => leader,
                    false => *followers.entry((leader, surface)).or_insert_with(|| {
                        all.push(cluster(leader));
                        next
                    }),
                }
            };
            of_vertex.push(own);
            let leader = all[own as usize].leader;
            let sums = &mut all[leader as usize];
            sums.count += 1;
            if sums.kind != Kind::Stays {
                let middle = rules.middle(sums);
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

    /// That of one vertex at a place, with nothing summed up yet.
    fn cluster(&self, v: usize, point: [i32; 3], stays: bool, leader: u32) -> Cluster {
        let planes = self.border.of_vertex[v];
        let kind = match planes {
            _ if stays => Kind::Stays,
            0 => Kind::Inner,
            _ => Kind::Border(axis_of(planes)),
        };
        Cluster {
            kind,
            surface: self.mesh.surface_of[v],
            block: match kind {
                Kind::Stays => point,
                _ => block_of(point, self.rules.width(kind)),
            },
            leader,
            count: 0,
            sum: [0; 3],
            normal: [0; 3],
            planes,
        }
    }
}

/// So many corners of a loop stay.
const CORNERS: usize = 4;

/// Up to four of some places in rising order: the first, then each the furthest from those before.
fn corners(places: impl Iterator<Item = [i32; 3]> + Clone) -> Vec<[i32; 3]> {
    let mut all: Vec<[i32; 3]> = places.clone().take(1).collect();
    while (1..CORNERS).contains(&all.len()) {
        let away = |p: &[i32; 3]| all.iter().map(|q| squared(*p, *q)).min();
        // the first of several
        let next = places.clone().map(|p| (away(&p), Reverse(p))).max();
        match next {
            Some((Some(1..), Reverse(p))) => all.push(p),
            _ => break,
        }
    }
    all
}

/// The squared distance of two places.
fn squared(p: [i32; 3], q: [i32; 3]) -> i64 {
    let side = |a: usize| i64::from(p[a]) - i64::from(q[a]);
    (0..3).map(|a| side(a) * side(a)).sum()
}

/// A block as one number.
fn number_of(block: [i32; 3]) -> u64 {
    let [x, y, z] = block.map(|b| b as u64);
    z << 40 | y << 20 | x
}

/// Joins the ends of edges that are in one block.
fn join_equal(triangles: &[[u32; 3]], blocks: &[u64], sets: &mut Sets) {
    for t in triangles {
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
