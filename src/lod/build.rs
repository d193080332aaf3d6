//! A node made of its children: their surfaces joined, coarser, with fins where the border has moved.

use super::border::Border;
use super::clusters::{Cluster, Clustering, Clusters, Kind, Rules};
use super::collapse::{Limits, collapse};
use super::curves::staying;
use super::distance::{Coarser, nearly_furthest};
use super::folds::Folded;
use super::gap::moved;
use super::mesh::{Joiner, Mesh, NORMAL, Surface};
use super::pinches::Pinched;
use super::place::{Placed, Placing};
use super::planes::{OnPlanes, Planes};
use super::quadric::Plane;
use super::rows::Rows;
use super::specks::{LEAST, Specks};
use super::triangles::{Sums, distinct};
use crate::grid::LATTICE;
use crate::strip::Stripifier;
use crate::tile::node::{NodePart, SurfacePart};

/// Surfaces of fewer triangles in a node stay as they are, as far as there is room.
const SMALL: usize = 100;
/// Their room: a share of the triangles that are wanted, on the first level, where none is to be lost, so many at least.
const SMALL_SHARE: f64 = 0.65;
const SMALL_ROOM: usize = 1000;

/// How far borders may move in their planes, in blocks.
const CURVE: f64 = 0.2;

/// How a node is made.
#[derive(Debug, Clone, Copy)]
pub struct Recipe {
    pub planes: Planes,
    pub rules: Rules,
    /// Share of the children's triangles to keep.
    pub ratio: f64,
    /// Triangles that are not too many in any case, as long as they are half of the children's at most.
    pub floor: usize,
    /// Made of tiles.
    pub is_first: bool,
    /// The widest fins of children, as [`Built::fin_width`].
    pub fin_width: u32,
}

impl Recipe {
    /// Triangles to reach of so many.
    fn target(&self, triangles: usize) -> usize {
        let share = (triangles as f64 * self.ratio).ceil() as usize;
        share.max(self.floor.min(triangles / 2))
    }

    /// Triangles of small surfaces that may be among those to reach.
    fn room(&self, target: usize) -> usize {
        (target as f64 * SMALL_SHARE) as usize
    }

    /// Faces of the volume on which surfaces end.
    fn open_faces(&self) -> OnPlanes {
        match self.rules.capped {
            true => 0,
            false => self.planes.faces,
        }
    }
}

/// A node.
#[derive(Debug)]
pub struct Built {
    /// Its surfaces by number, caps last, then their fins.
    pub parts: Vec<NodePart>,
    /// How many of the parts are fins.
    pub fin_rows: u32,
    /// Triangles of the surfaces.
    pub triangles: u64,
    pub fin_triangles: u64,
    pub strips: u64,
    /// Edges of the border in planes that are no faces of the volume.
    pub border_edges: u64,
    /// How far 99.9 % of the children's surfaces lie from its own at most, in voxels.
    pub error: f32,
    /// How far the border has moved in its planes, in lattice steps.
    pub gap: u32,
    /// Half the width of fins in lattice steps.
    pub fin_width: u32,
}

/// Makes a node of what its children hold.
pub fn build(
    children: impl Iterator<Item = Vec<SurfacePart>>,
    recipe: &Recipe,
    stripifier: &mut Stripifier,
) -> Built {
    let mut joiner = Joiner::new(&recipe.planes);
    children.for_each(|parts| joiner.add(parts));
    let mesh = joiner.finish();
    let border = Border::of(&mesh, &recipe.planes);
    let target = recipe.target(mesh.triangles.len());
    let kept = kept(&mesh.surfaces, recipe.room(target));
    let coarse = Coarse::of(&mesh, &border, kept, target, recipe);
    let mut coarse = match coarse.triangles.is_empty() {
        false => coarse,
        true => {
            let all = vec![true; mesh.surfaces.len()];
            Coarse::of(&mesh, &border, all, mesh.triangles.len(), recipe)
        }
    };
    // a node without a surface could not stand for its children
    if coarse.triangles.is_empty() {
        coarse.specks(&mesh, &border, recipe, 0).stand_in();
    }
    let inner = !recipe.planes.faces;
    let moved = moved(
        &mesh,
        &border,
        &coarse.clusters,
        &coarse.placed.points,
        inner,
    );
    let coarser = Coarser {
        points: &coarse.placed.points,
        triangles: &coarse.triangles,
        surface_of: &|v| coarse.clusters.all[v as usize].surface,
        width: recipe.rules.block,
        low: recipe.planes.low,
    };
    let rows = Rows {
        // triangles of tiles are so small that their corners will do
        error: nearly_furthest(&mesh, &coarser, !recipe.is_first),
        surfaces: &mesh.surfaces,
        coarse: &coarse,
        recipe,
    };
    rows.finish(moved, stripifier)
}

/// Which surfaces stay as they are: small ones that need no more than what all of those that are larger can have, too.
fn kept(surfaces: &[Surface], room: usize) -> Vec<bool> {
    let mut small: Vec<usize> = (0..surfaces.len())
        .filter(|&i| surfaces[i].triangles < SMALL)
        .collect();
    small.sort_by_key(|&i| (surfaces[i].triangles, surfaces[i].key));
    let (mut left, mut others) = (room, small.len());
    let mut kept = vec![false; surfaces.len()];
    for i in small {
        if surfaces[i].triangles > left / others {
            break;
        }
        left -= surfaces[i].triangles;
        others -= 1;
        kept[i] = true;
    }
    kept
}

/// How many small surfaces do not stay as they are.
fn others(surfaces: &[Surface], kept: &[bool]) -> usize {
    let all = surfaces.iter().zip(kept);
    all.filter(|(s, kept)| s.triangles < SMALL && !**kept)
        .count()
}

/// Surfaces of a node with fewer triangles.
pub struct Coarse {
    pub clusters: Clusters,
    pub placed: Placed,
    pub triangles: Vec<[u32; 3]>,
}

impl Coarse {
    fn of(mesh: &Mesh, border: &Border, kept: Vec<bool>, target: usize, recipe: &Recipe) -> Self {
        let Recipe { planes, rules, .. } = recipe;
        let most = f64::from(rules.block) * CURVE;
        let pinned = staying(mesh, border, planes, rules, most);
        let clustering = Clustering {
            mesh,
            border,
            kept: &kept,
            pinned: &pinned,
            open_faces: recipe.open_faces(),
            rules,
        };
        let clusters = clustering.clusters();
        let placing = Placing {
            mesh,
            border,
            clusters: &clusters,
            planes,
            rules,
        };
        let (placed, triangles) = clustered(&placing);
        let is_kept = |t: &[u32; 3]| kept[clusters.all[t[0] as usize].surface as usize];
        let (small, rest): (Vec<_>, Vec<_>) = triangles.into_iter().partition(is_kept);
        let voxels = |p: &[i32; 3]| -> [f32; 3] {
            std::array::from_fn(|a| (p[a] - planes.low[a]) as f32 / LATTICE as f32)
        };
        let places: Vec<[f32; 3]> = placed.points.iter().map(voxels).collect();
        let locked = locked(border, &clusters, recipe);
        // a node that is mostly border cannot get as coarse as others
        let left = recipe.room(target).saturating_sub(small.len());
        let specks = left.min(LEAST * others(&mesh.surfaces, &kept));
        let limits = Limits {
            triangles: target.saturating_sub(small.len() + specks).max(target / 2),
            error: (rules.block / 2) as f32 / LATTICE as f32,
        };
        let collapsed = collapse(rest, &places, &locked, limits);
        let all = small.into_iter().chain(collapsed).collect();
        let mut coarse = Coarse {
            triangles: distinct(all, &placed.points, |v| clusters.all[v as usize].surface),
            clusters,
            placed,
        };
        let room = left.max(if recipe.is_first { SMALL_ROOM } else { 0 });
        let mut small = coarse.specks(mesh, border, recipe, room);
        if !recipe.is_first {
            small.give_up(target);
        }
        small.bring_back();
        coarse.part_pinches(recipe);
        coarse.smooth_folds(recipe);
        coarse
    }

    /// What may come back of surfaces that are gone.
    fn specks<'a>(
        &'a mut self,
        mesh: &'a Mesh,
        border: &'a Border,
        recipe: &'a Recipe,
        room: usize,
    ) -> Specks<'a> {
        Specks {
            mesh,
            border,
            planes: &recipe.planes,
            open_faces: recipe.open_faces(),
            step: recipe.rules.step,
            block: recipe.rules.block,
            clusters: &mut self.clusters,
            points: &mut self.placed.points,
            triangles: &mut self.triangles,
            room,
        }
    }

    /// Turns triangles back that face against their normals.
    fn smooth_folds(&mut self, recipe: &Recipe) {
        let clusters = &mut self.clusters.all;
        let mut normals: Vec<[i64; 3]> = clusters.iter().map(|c| c.normal).collect();
        // on a plane another vertex may lie at the same place, as those of a cap do, and would stay there
        let inside = self
            .placed
            .points
            .iter()
            .map(|p| recipe.planes.bits(*p) == 0);
        let inside: Vec<bool> = inside.collect();
        let is_free = |v: u32| clusters[v as usize].kind == Kind::Inner && inside[v as usize];
        let mut folded = Folded {
            points: &mut self.placed.points,
            normals: &mut normals,
            triangles: &self.triangles,
            is_free: &is_free,
            planes: &recipe.planes,
            step: recipe.rules.step,
            most: f64::from(recipe.rules.block),
        };
        folded.smooth();
        for (cluster, normal) in clusters.iter_mut().zip(normals) {
            cluster.normal = normal;
        }
    }

    /// Takes edges apart along which a surface touches itself.
    fn part_pinches(&mut self, recipe: &Recipe) {
        let mut pinched = Pinched {
            points: &mut self.placed.points,
            triangles: &mut self.triangles,
            planes: &recipe.planes,
            step: recipe.rules.step,
        };
        for added in pinched.part() {
            let surface = self.clusters.all[added.beside as usize].surface;
            let normal = added.normal.normalize_or_zero() * f64::from(NORMAL);
            self.clusters
                .add_one(surface, normal.to_array().map(|v| v as i64), 0);
        }
    }
}

/// Places and triangles of the clusters of a mesh.
fn clustered(placing: &Placing) -> (Placed, Vec<[u32; 3]>) {
    let (mesh, clusters) = (placing.mesh, placing.clusters);
    let mut quadrics = placing.quadrics();
    let mut sums = Sums::new(clusters.all.len(), mesh.triangles.len() / 4);
    let low = placing.planes.low;
    let place = |v: u32| {
        let [x, y, z] = mesh.points[v as usize];
        let voxels = |v: i32, low: i32| (v - low) as f32 * (1.0 / LATTICE as f32);
        [voxels(x, low[0]), voxels(y, low[1]), voxels(z, low[2])]
    };
    for &t in &mesh.triangles {
        let [a, b, c] = t.map(|v| clusters.of_vertex[v as usize]);
        let [p, q, r] = t.map(place);
        let (ux, uy, uz) = (q[0] - p[0], q[1] - p[1], q[2] - p[2]);
        let (vx, vy, vz) = (r[0] - p[0], r[1] - p[1], r[2] - p[2]);
        let normal = [uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx];
        let plane = Plane::new(normal, p);
        let mut add = |cluster: u32| {
            let quadric = &mut quadrics[cluster as usize];
            if quadric.wanted {
                quadric.add(&plane);
            }
        };
        add(a);
        if b != a {
            add(b);
        }
        if c != a && c != b {
            add(c);
            if a != b {
                sums.add([a, b, c]);
            }
        }
    }
    let (mut placed, left) = (placing.place(&quadrics), sums.left());
    placing.unfold(&quadrics, &left, &mut placed);
    (placed, left)
}

/// Which vertices must not move: those that stay, those that others have in common with this node, and on open faces
/// of the volume those beside a vertex on a plane between nodes: without them the curve on the face could come to run
/// along that plane, where no other node continues it.
fn locked(border: &Border, clusters: &Clusters, recipe: &Recipe) -> Vec<bool> {
    let faces = recipe.open_faces();
    let is_locked = |c: &Cluster| match c.kind {
        Kind::Inner => false,
        Kind::Stays => true,
        Kind::Border(_) => c.planes & !faces != 0,
    };
    let mut locked: Vec<bool> = clusters.all.iter().map(is_locked).collect();
    for edge in border.edges.iter().filter(|e| e.planes & faces != 0) {
        let ends = [edge.from, edge.to];
        if ends
            .iter()
            .any(|&v| border.of_vertex[v as usize] & !faces != 0)
        {
            ends.iter()
                .for_each(|&v| locked[clusters.of_vertex[v as usize] as usize] = true);
        }
    }
    locked
}
