//! One tile: its file, its layout against the shard's entry, and its geometry piece by piece.

use super::against::{Band, Mesh, Rule, Voxels};
use super::code::Code;
use super::edges::Edges;
use super::files;
use super::piece::{Flaw, Piece, Region, Sums};
use super::report::{Issue, Issues};
use super::seen::Seen;
use super::sweep::{CAP, Component, FaceEdge, Ids, TileFront};
use crate::grid::Tiling;
use crate::manifest::{Bounds, Group, Manifest, Primitives, TileEntry};
use crate::tile::read::{Fault, Indices, PieceIds, Pieces, Primitive, Tile};
use std::path::Path;

/// What all tiles of a set have in common.
pub(super) struct Context<'a> {
    pub root: &'a Path,
    pub manifest: &'a Manifest,
    pub tiling: Tiling,
    pub max_issues: usize,
    /// Turns the components of an area vector in lattice units into physical area.
    pub scale: [f64; 3],
}

impl<'a> Context<'a> {
    /// `manifest` has been checked; `root` is the directory with symbolic links resolved.
    pub fn new(root: &'a Path, manifest: &'a Manifest, max_issues: usize) -> Self {
        let [x, y, z] = manifest.placement.spacing.map(|s| s / 256.0);
        Context {
            root,
            manifest,
            tiling: Tiling {
                dims: manifest.grid.dims,
                macrocube: manifest.grid.macrocube,
            },
            max_issues,
            scale: [y * z, z * x, x * y],
        }
    }

    /// The place of macrocube `grid`.
    pub fn region(&self, grid: [u32; 3]) -> Region {
        let cubes = |a: usize| self.tiling.cubes(a, grid[a]);
        Region {
            lo: std::array::from_fn(|a| cubes(a).start as i32 * 256),
            hi: std::array::from_fn(|a| cubes(a).end as i32 * 256),
            end: self.tiling.dims.0.map(|n| (n - 1) as i32 * 256),
        }
    }
}

/// Sums over tiles.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Counts {
    pub triangles: u64,
    pub cap_triangles: u64,
    pub vertices: u64,
    pub tile_vertices: u64,
    pub edges: u64,
    pub border_edges: u64,
    pub volume6: i128,
    pub indices: u64,
    pub bytes: u64,
}

impl Counts {
    pub fn add(&mut self, o: &Counts) {
        self.triangles += o.triangles;
        self.cap_triangles += o.cap_triangles;
        self.vertices += o.vertices;
        self.tile_vertices += o.tile_vertices;
        self.edges += o.edges;
        self.border_edges += o.border_edges;
        self.volume6 += o.volume6;
        self.indices += o.indices;
        self.bytes += o.bytes;
    }
}

/// What was found in a tile.
pub(super) struct Outcome {
    /// `None` for a macrocube without a tile.
    pub front: Option<TileFront>,
    pub counts: Counts,
    pub voxels: Voxels,
    pub issues: Issues,
}

/// Buffers that a thread keeps from tile to tile.
#[derive(Default)]
pub(super) struct Workspace {
    file: Vec<u8>,
    indices: Vec<u32>,
    list: Vec<[u32; 3]>,
    pub piece: Piece,
    edges: Edges,
    surface_seen: Seen,
    cap_seen: Seen,
    mesh: Mesh,
}

/// The samples to compare a tile with, and how.
pub(super) type Original<'a> = (&'a Band<'a>, &'a Rule);

/// Reads and checks a tile.
pub(super) fn check(
    cx: &Context,
    entry: &TileEntry,
    at: &str,
    original: Option<Original>,
    ws: &mut Workspace,
) -> Outcome {
    let mut issues = Issues::new(cx.max_issues);
    let mut file = std::mem::take(&mut ws.file);
    let region = cx.region(entry.grid);
    let mut work = Work {
        cx,
        entry,
        at,
        region,
        counts: Counts::default(),
        box_seen: None,
        components: Vec::new(),
        faces: Default::default(),
        border: Vec::new(),
        cap_border: Vec::new(),
        sound: false,
        keep_mesh: original.is_some(),
        issues: &mut issues,
    };
    let expected = files::Expected {
        path: &entry.path,
        bytes: entry.bytes,
        checksum: &entry.checksum,
        at,
    };
    if files::read(cx.root, &expected, &mut file, work.issues) {
        work.counts.bytes = file.len() as u64;
        match Tile::read(&file) {
            Ok(tile) => work.tile(&tile, ws),
            Err(e) => {
                let code = match e.fault {
                    Fault::Container => Code::GlbContainer,
                    Fault::Json => Code::GltfSyntax,
                    Fault::Structure => Code::GltfStructure,
                    Fault::Accessor => Code::GltfAccessor,
                    Fault::Extras => Code::NodeExtras,
                };
                work.issue(code, &e.place, e.message);
            }
        }
    }
    let (counts, faces) = (work.counts, work.sound.then_some(work.faces));
    let components = work.components;
    ws.file = file;
    let mut voxels = Voxels::default();
    if let Some((band, rule)) = original {
        let mut flaws = Vec::new();
        if faces.is_none() {
            ws.mesh.begin(&region, rule.cap);
        }
        voxels = band.compare(&region, rule, &mut ws.mesh, &mut flaws);
        if !issues.broken() {
            differences(&entry.path, &flaws, &mut issues);
        }
    }
    Outcome {
        voxels,
        front: Some(TileFront {
            grid: entry.grid,
            region,
            path: entry.path.clone(),
            faces,
            components,
        }),
        counts,
        issues,
    }
}

/// Looks for sign changes in a macrocube that has no tile.
pub(super) fn empty(
    cx: &Context,
    grid: [u32; 3],
    (band, rule): Original,
    ws: &mut Workspace,
) -> Outcome {
    let mut issues = Issues::new(cx.max_issues);
    let mut flaws = Vec::new();
    let region = cx.region(grid);
    ws.mesh.begin(&region, rule.cap);
    let voxels = band.compare(&region, rule, &mut ws.mesh, &mut flaws);
    let path = format!("macrocube {} {} {}", grid[0], grid[1], grid[2]);
    differences(&path, &flaws, &mut issues);
    Outcome {
        front: None,
        counts: Counts::default(),
        voxels,
        issues,
    }
}

fn differences(path: &str, flaws: &[Flaw], issues: &mut Issues) {
    for f in flaws {
        let what = match f.code {
            Code::MissingVertex => "sign changes of the volume have no vertex",
            Code::ExtraVertex => "vertices lie where the volume has no sign change",
            Code::VertexMisplaced => "vertices are not where the samples put them",
            Code::BitsDiffer => "vertices have above where the volume has below",
            _ => "cubes have more or fewer triangles than their bits ask for",
        };
        let issue = Issue::new(f.code, path, format!("{} {what}", f.count));
        issues.push(issue.at(f.first));
    }
}

struct Work<'a, 'i> {
    cx: &'a Context<'a>,
    entry: &'a TileEntry,
    /// The entry's place in the shard.
    at: &'a str,
    region: Region,
    counts: Counts,
    box_seen: Option<[[i32; 3]; 2]>,
    components: Vec<(Component, bool)>,
    faces: [Vec<FaceEdge>; 6],
    /// Open edges on the volume's faces: of surfaces, and of caps.
    border: Vec<(usize, FaceEdge)>,
    cap_border: Vec<(usize, FaceEdge)>,
    /// True if the pieces are to be compared with a volume.
    keep_mesh: bool,
    /// False as long as the neighbours' edges cannot be held against this tile.
    sound: bool,
    issues: &'i mut Issues,
}

impl Work<'_, '_> {
    fn issue(&mut self, code: Code, pointer: &str, message: String) {
        let path = &self.entry.path;
        let path = if pointer.is_empty() {
            path.clone()
        } else {
            format!("{path}#{pointer}")
        };
        self.issues.add(code, path, message);
    }

    fn flaws(&mut self, node: usize, flaws: &[Flaw]) {
        for f in flaws {
            let what = match f.code {
                Code::PositionNotFinite => "vertices have a coordinate that is no finite number",
                Code::PositionOffLattice => {
                    "vertices are not strictly inside one lattice edge at a multiple of 1/256"
                }
                Code::PositionOutsideTile => "vertices lie outside the macrocube",
                Code::DuplicateVertex => "lattice edges have two vertices",
                Code::UnusedVertex => "vertices belong to no triangle",
                Code::TriangleOutsideCube => "triangles span more than one cube",
                Code::DegenerateTriangle => "triangles have no area",
                Code::DuplicateTriangle => "triangles occur twice",
                Code::FlippedTriangle => "triangles wind against their neighbours",
                Code::EdgeRepeated => "edges belong to more than two triangles",
                _ => "edges inside the tile belong to one triangle only",
            };
            let path = format!("{}#/nodes/{node}", self.entry.path);
            let issue = Issue::new(f.code, path, format!("{} {what}", f.count));
            self.issues.push(issue.at(f.first));
        }
    }

    fn tile(&mut self, tile: &Tile, ws: &mut Workspace) {
        if tile.matrix != self.cx.manifest.transform {
            let message = format!(
                "found {:?}, expected the manifest's transform {:?}",
                tile.matrix, self.cx.manifest.transform
            );
            self.issue(Code::RootMatrix, "/nodes/0/matrix", message);
        }
        let size: [u64; 3] =
            std::array::from_fn(|a| ((self.region.hi[a] - self.region.lo[a]) / 256) as u64 + 3);
        ws.surface_seen.begin(size);
        ws.cap_seen.begin(size);
        if self.keep_mesh {
            ws.mesh.begin(&self.region, self.cx.manifest.cap);
        }
        self.sound = true;
        let mut group = 0;
        for primitive in &tile.primitives {
            if self.sound {
                self.primitive(primitive, &mut group, ws);
            }
        }
        if !self.sound {
            return;
        }
        if group != self.entry.groups.len() {
            let message = format!(
                "found {group} pieces in the tile, expected {} groups as in {}",
                self.entry.groups.len(),
                self.at
            );
            self.issue(Code::GroupMismatch, "", message);
            self.sound = false;
            return;
        }
        let mut twice = Vec::new();
        for seen in [&mut ws.surface_seen, &mut ws.cap_seen] {
            if let Some((count, cell)) = seen.finish() {
                let place = |a: usize| (cell[a] as i32 - 1) * 256 + self.region.lo[a];
                twice.push(Flaw {
                    code: Code::DuplicateVertex,
                    count,
                    first: std::array::from_fn(place),
                });
            }
        }
        if !twice.is_empty() {
            self.flaws(0, &twice);
            self.sound = false;
            return;
        }
        self.close_border();
        self.count_tiles();
        self.compare_entry();
        for (face, edges) in self.faces.iter_mut().enumerate() {
            if face % 2 == 0 {
                edges.sort_unstable_by_key(|e| (e.b, e.a));
            } else {
                edges.sort_unstable_by_key(|e| (e.a, e.b));
            }
        }
    }

    fn primitive(&mut self, p: &Primitive, group: &mut usize, ws: &mut Workspace) {
        let node = p.node;
        let at = |what: &str| format!("/nodes/{node}{what}");
        let strips = self.cx.manifest.primitives == Primitives::Strips;
        let mode = if strips { 5 } else { 4 };
        if p.mode != mode {
            let message = format!("found mode {}, expected {mode}", p.mode);
            self.issue(Code::PrimitiveMode, &at("/mesh"), message);
            self.sound = false;
            return;
        }
        self.check_index_type(p);
        p.indices.read_into(&mut ws.indices);
        self.counts.indices += ws.indices.len() as u64;
        let vertices = p.positions.len();
        if let Some(bad) = ws.indices.iter().find(|&&i| i as usize >= vertices) {
            let message = format!("found index {bad}, expected one below {vertices}");
            self.issue(Code::IndexRange, &at("/mesh"), message);
            self.sound = false;
            return;
        }
        self.check_normals(p);
        ws.list.clear();
        if !decode(&ws.indices, strips, &mut ws.list) {
            let message = "a triangle names a vertex twice, or indices are left over".to_owned();
            self.issue(Code::DegenerateTriangle, &at("/mesh"), message);
            self.sound = false;
            return;
        }
        match &p.pieces {
            Pieces::One(ids) => {
                let label = Label {
                    ids: *ids,
                    node,
                    names: self.check_name(p, ids),
                };
                std::mem::swap(&mut ws.piece.triangles, &mut ws.list);
                self.piece(p.positions.iter(), &label, group, ws);
            }
            Pieces::Merged(rows, ids) => {
                if p.name != "cells" || p.mesh_name != "cells" {
                    let message =
                        format!("found {:?} and {:?}, expected cells", p.name, p.mesh_name);
                    self.issue(Code::NodeName, &at("/name"), message);
                }
                self.merged(p, rows, ids, group, ws);
            }
        }
        if self.sound {
            self.check_bounds(p);
        }
    }

    fn check_index_type(&mut self, p: &Primitive) {
        let wide = matches!(p.indices, Indices::U32(_));
        if wide != (p.positions.len() > 65_535) {
            let message = format!(
                "found {} bit indices for {} vertices, expected 16 bits up to 65535 vertices, else 32",
                if wide { 32 } else { 16 },
                p.positions.len()
            );
            self.issue(Code::IndexType, &format!("/nodes/{}/mesh", p.node), message);
        }
    }

    fn check_normals(&mut self, p: &Primitive) {
        let unit = |[x, y, z]: [f32; 3]| {
            let square = x * x + y * y + z * z;
            // a NaN compares false
            (square - 1.0).abs() <= 2e-3
        };
        if let Some(i) = p.normals.iter().position(|n| !unit(n)) {
            let count = p.normals.iter().filter(|n| !unit(*n)).count();
            let [n, v] = [p.normals, p.positions].map(|a| a.iter().nth(i).unwrap_or_default());
            let path = format!("{}#/nodes/{}", self.entry.path, p.node);
            let message = format!("{count} normals are not of length 1, the first is {n:?}");
            let issue = Issue::new(Code::NormalInvalid, path, message);
            self.issues.push(issue.at(v.map(|c| (c * 256.0) as i32)));
        }
    }

    /// Returns [`Component::names`].
    fn check_name(&mut self, p: &Primitive, ids: &PieceIds) -> u8 {
        let form = name_form(&p.name, ids);
        if p.name != p.mesh_name || form.is_none() {
            let message = format!(
                "found node {:?} with mesh {:?}, expected both named {}",
                p.name,
                p.mesh_name,
                if ids.cell == 0 {
                    format!("cap_object_{}", ids.object)
                } else {
                    format!("cell_{0} or cell_{0}_object_{1}", ids.cell, ids.object)
                }
            );
            self.issue(Code::NodeName, &format!("/nodes/{}/name", p.node), message);
        }
        form.unwrap_or(0)
    }

    /// Compares the accessor's bounds with those of the primitive's vertices.
    fn check_bounds(&mut self, p: &Primitive) {
        let mut lo = [f32::INFINITY; 3];
        let mut hi = [f32::NEG_INFINITY; 3];
        for v in p.positions.iter() {
            for a in 0..3 {
                lo[a] = lo[a].min(v[a]);
                hi[a] = hi[a].max(v[a]);
            }
        }
        let (lo, hi) = (lo.map(f64::from), hi.map(f64::from));
        if (p.min, p.max) != (lo, hi) {
            let message = format!(
                "the POSITION accessor states {:?} to {:?}, its values span {lo:?} to {hi:?}",
                p.min, p.max
            );
            self.issue(
                Code::AccessorBounds,
                &format!("/nodes/{}/mesh", p.node),
                message,
            );
        }
    }

    /// Splits a merged primitive into its pieces by the vertices' feature ids.
    fn merged(
        &mut self,
        p: &Primitive,
        rows: &[[u8; 4]],
        ids: &[PieceIds],
        group: &mut usize,
        ws: &mut Workspace,
    ) {
        let mut feature = Vec::with_capacity(rows.len());
        for row in rows {
            let value = f32::from_le_bytes(*row);
            if !(value >= 0.0 && value.fract() == 0.0 && (value as usize) < ids.len()) {
                let message = format!("found feature id {value}, expected a row of {}", ids.len());
                self.issue(
                    Code::GltfStructure,
                    &format!("/nodes/{}/mesh", p.node),
                    message,
                );
                self.sound = false;
                return;
            }
            feature.push(value as u32);
        }
        let list = std::mem::take(&mut ws.list);
        let of = |t: &[u32; 3]| feature[t[0] as usize];
        if let Some(t) = list
            .iter()
            .find(|t| t.iter().any(|&i| feature[i as usize] != of(t)))
        {
            let message = format!("triangle {t:?} has vertices of several features");
            self.issue(
                Code::SurfaceMixed,
                &format!("/nodes/{}/mesh", p.node),
                message,
            );
            self.sound = false;
            return;
        }
        let mut by_feature: Vec<u32> = (0..list.len() as u32).collect();
        by_feature.sort_by_key(|&t| of(&list[t as usize]));
        let mut order: Vec<u32> = (0..feature.len() as u32).collect();
        order.sort_by_key(|&v| feature[v as usize]);
        let points: Vec<[f32; 3]> = p.positions.iter().collect();
        let mut local = vec![0u32; points.len()];
        let (mut triangles, mut vertices) = (&by_feature[..], &order[..]);
        for (row, ids) in ids.iter().enumerate() {
            let row = row as u32;
            let v = vertices.partition_point(|&v| feature[v as usize] == row);
            let t = triangles.partition_point(|&t| of(&list[t as usize]) == row);
            let (own, rest) = vertices.split_at(v);
            vertices = rest;
            for (i, &v) in own.iter().enumerate() {
                local[v as usize] = i as u32;
            }
            let (mine, rest) = triangles.split_at(t);
            triangles = rest;
            ws.piece.triangles.clear();
            let numbered = mine
                .iter()
                .map(|&t| list[t as usize].map(|i| local[i as usize]));
            ws.piece.triangles.extend(numbered);
            let label = Label {
                ids: *ids,
                node: p.node,
                names: 0,
            };
            self.piece(own.iter().map(|&v| points[v as usize]), &label, group, ws);
            if !self.sound {
                break;
            }
        }
        ws.list = list;
    }

    /// Checks one piece; its triangles are in `ws.piece`, its positions in `points`.
    fn piece(
        &mut self,
        points: impl Iterator<Item = [f32; 3]>,
        label: &Label,
        group: &mut usize,
        ws: &mut Workspace,
    ) {
        let (ids, node) = (label.ids, label.node);
        let index = *group;
        *group += 1;
        let mut flaws = Vec::new();
        let piece = &mut ws.piece;
        piece.cap = ids.cell == 0;
        let owned = piece.read_points(points, &self.region, &mut flaws);
        let found = Group {
            cell: ids.cell,
            object: ids.object,
            surface: ids.surface,
            vertices: piece.points.len() as u64,
            triangles: piece.triangles.len() as u64,
        };
        if !self.check_group(index, &found, ids, node) {
            self.sound = false;
            return;
        }
        if flaws.is_empty() {
            self.mark_seen(ws);
            self.geometry(label, owned, &mut flaws, ws);
        }
        if !flaws.is_empty() {
            self.flaws(node, &flaws);
            // a hole inside the tile does not spoil its planes
            self.sound = flaws.iter().all(|f| f.code == Code::Hole);
        }
    }

    /// Compares a piece with the shard's group.
    fn check_group(&mut self, index: usize, found: &Group, ids: PieceIds, node: usize) -> bool {
        let legal = if found.cell == 0 {
            self.cx.manifest.cap && found.surface == 0
        } else {
            found.surface > 0
        };
        let expected = self.entry.groups.get(index);
        if expected == Some(found) && ids.triangles == found.triangles && legal && found.object > 0
        {
            return true;
        }
        let message = format!(
            "found cell {}, object {}, surface {} with {} vertices and {} triangles ({} stated), expected {}",
            found.cell,
            found.object,
            found.surface,
            found.vertices,
            found.triangles,
            ids.triangles,
            expected.map_or("no group".to_owned(), |g| format!(
                "{g:?} as in {}",
                self.at
            ))
        );
        self.issue(
            Code::GroupMismatch,
            &format!("/nodes/{node}/extras"),
            message,
        );
        false
    }

    fn mark_seen(&mut self, ws: &mut Workspace) {
        let piece = &ws.piece;
        let seen = if piece.cap {
            &mut ws.cap_seen
        } else {
            &mut ws.surface_seen
        };
        let [mut lo, mut hi] = self.box_seen.unwrap_or([[i32::MAX; 3], [i32::MIN; 3]]);
        for (p, state) in piece.points.iter().zip(&piece.state) {
            let cell = std::array::from_fn(|a| (((p[a] - self.region.lo[a]) >> 8) + 1) as u64);
            seen.insert(cell, state & 3);
            for a in 0..3 {
                lo[a] = lo[a].min(p[a]);
                hi[a] = hi[a].max(p[a]);
            }
        }
        self.box_seen = Some([lo, hi]);
    }

    fn geometry(&mut self, label: &Label, owned: u64, flaws: &mut Vec<Flaw>, ws: &mut Workspace) {
        let piece = &mut ws.piece;
        let mut sums = piece.sum_triangles(self.cx.scale, flaws);
        sums.vertices = owned;
        if !flaws.is_empty() {
            return;
        }
        let matched = ws.edges.match_up(piece.points.len(), &piece.triangles);
        if matched.repeated.is_some() || piece.contradicts() {
            let first = matched.repeated.map(|e| piece.points[e[0] as usize]);
            piece.diagnose(first, flaws);
            return;
        }
        sums.edges = matched.pairs;
        if self.keep_mesh {
            ws.mesh.add(piece);
        }
        ws.edges.connect(piece.points.len(), &piece.triangles);
        self.place_open_edges(piece, &mut ws.edges, &mut sums, flaws);
        self.counts.triangles += sums.triangles;
        self.counts.vertices += sums.vertices;
        self.counts.tile_vertices += piece.points.len() as u64;
        self.counts.edges += sums.edges;
        self.counts.volume6 += sums.volume6;
        if piece.cap {
            self.counts.cap_triangles += sums.triangles;
            return;
        }
        self.add_components(label, &sums, ws);
    }

    /// Sorts the piece's open edges by the plane they lie on; the rest are a hole.
    fn place_open_edges(
        &mut self,
        piece: &Piece,
        edges: &mut Edges,
        sums: &mut Sums,
        flaws: &mut Vec<Flaw>,
    ) {
        let mut holes = 0;
        let mut first = [0; 3];
        for i in 0..edges.open.len() {
            let [tail, head] = edges.open[i];
            let [a, b] = [tail, head].map(|v| piece.points[v as usize]);
            let on = |&f: &usize| a[f / 2] == b[f / 2] && a[f / 2] == self.region.plane(f);
            let Some(face) = (0..6).find(on) else {
                if holes == 0 {
                    first = std::array::from_fn(|x| (a[x] + b[x]) / 2);
                }
                holes += 1;
                continue;
            };
            let part = if piece.cap { CAP } else { edges.part(tail) };
            let edge = FaceEdge::new(face / 2, a, b, part);
            if !self.region.outer(face) {
                self.faces[face].push(edge);
            } else if piece.cap {
                self.cap_border.push((face, edge));
            } else {
                self.border.push((face, edge));
                sums.border += 1;
            }
        }
        if holes > 0 {
            flaws.push(Flaw {
                code: Code::Hole,
                count: holes,
                first,
            });
        }
    }

    /// Makes the piece's connected parts components of the tile. The first carries all the sums:
    /// if the parts are one surface, they meet elsewhere and are added up then.
    fn add_components(&mut self, label: &Label, sums: &Sums, ws: &mut Workspace) {
        let base = self.components.len();
        let roots: Vec<u32> = ws.edges.parts().collect();
        let ids = Ids {
            surface: label.ids.surface,
            cell: label.ids.cell,
            object: label.ids.object,
        };
        for i in 0..roots.len() {
            let first = i == 0;
            let component = Component {
                ids,
                sums: if first { *sums } else { Sums::default() },
                tiles: u64::from(first),
                cell_tiles: 0,
                object_tiles: 0,
                names: label.names,
            };
            self.components.push((component, false));
        }
        for face in &mut self.faces {
            // this piece's edges are the last ones, and still name a vertex
            let own = face
                .iter_mut()
                .rev()
                .take_while(|e| e.part != CAP && e.part & PLACED == 0);
            for edge in own {
                let part = roots.binary_search(&edge.part).unwrap_or_default() + base;
                self.components[part].1 = true;
                edge.part = part as u32 | PLACED;
            }
        }
    }

    /// Matches the surface's border with the caps', or counts it.
    fn close_border(&mut self) {
        for face in &mut self.faces {
            for edge in face.iter_mut().filter(|e| e.part != CAP) {
                edge.part &= !PLACED;
            }
        }
        if !self.cx.manifest.cap {
            self.counts.border_edges += self.border.len() as u64;
            self.counts.edges += self.border.len() as u64;
            return;
        }
        let key = |&(face, e): &(usize, FaceEdge)| (face, e.a, e.b);
        let reverse = |&(face, e): &(usize, FaceEdge)| (face, e.b, e.a);
        self.border.sort_unstable_by_key(key);
        self.cap_border.sort_unstable_by_key(reverse);
        let meet = self
            .border
            .iter()
            .map(key)
            .eq(self.cap_border.iter().map(reverse));
        self.counts.edges += self.border.len() as u64;
        if meet {
            return;
        }
        let caps: std::collections::HashSet<_> = self.cap_border.iter().map(reverse).collect();
        let own: std::collections::HashSet<_> = self.border.iter().map(key).collect();
        let lone = |(face, e): &(usize, FaceEdge)| e.middle(face / 2, self.region.plane(*face));
        let bare: Vec<_> = self
            .border
            .iter()
            .filter(|e| !caps.contains(&key(e)))
            .collect();
        let loose: Vec<_> = self
            .cap_border
            .iter()
            .filter(|e| !own.contains(&reverse(e)))
            .collect();
        if let Some(first) = bare.first().or(loose.first()) {
            let message = format!(
                "{} edges on the volume's faces have no cap, {} edges of caps have no surface",
                bare.len(),
                loose.len()
            );
            let issue = Issue::new(Code::Hole, &self.entry.path, message).at(lone(first));
            self.issues.push(issue);
        }
    }

    /// Counts this tile once for each cell and each object in it, on the first of its components.
    fn count_tiles(&mut self) {
        let mut cells = std::collections::HashSet::new();
        let mut objects = std::collections::HashSet::new();
        for (c, _) in &mut self.components {
            c.cell_tiles = u64::from(cells.insert(c.ids.cell));
            c.object_tiles = u64::from(objects.insert(c.ids.object));
        }
    }

    fn compare_entry(&mut self) {
        let e = self.entry;
        let strips = self.cx.manifest.primitives == Primitives::Strips;
        let c = &self.counts;
        let mut wrong = Vec::new();
        let mut compare = |name: &str, stated: u64, found: u64| {
            if stated != found {
                wrong.push(format!("{name} {found}, stated {stated}"));
            }
        };
        compare("vertices", e.vertices, c.tile_vertices);
        compare("triangles", e.triangles, c.triangles);
        compare("indices", e.indices, c.indices);
        // each strip has at least a triangle, and its triangles take two indices more
        let strips_fit = if strips {
            e.strips >= e.groups.len() as u64
                && e.strips <= c.triangles
                && c.indices >= c.triangles + 2 * e.strips
        } else {
            e.strips == 0
        };
        if !strips_fit {
            wrong.push(format!(
                "{} strips cannot hold {} triangles in {} indices",
                e.strips, c.triangles, c.indices
            ));
        }
        if !wrong.is_empty() {
            let message = format!("found {}", wrong.join("; "));
            self.issues.add(Code::TileCount, self.at, message);
        }
        if let Some([lo, hi]) = self.box_seen {
            let [min, max] = [lo, hi].map(|p| p.map(|c| f64::from(c) / 256.0));
            let found = Bounds { min, max };
            if found != e.bounds {
                let message = format!("found {found:?}, stated {:?}", e.bounds);
                self.issues
                    .add(Code::TileBox, format!("{}/box", self.at), message);
            }
        }
    }
}

/// What a piece says of itself.
struct Label {
    ids: PieceIds,
    node: usize,
    names: u8,
}

/// Marks [`FaceEdge::part`] as a component's number rather than a vertex's.
const PLACED: u32 = 1 << 31;

/// Which form the name of a surface piece has: 1 for the cell alone, 2 with the object, 0 for a cap.
fn name_form(name: &str, ids: &PieceIds) -> Option<u8> {
    if ids.cell == 0 {
        (name == format!("cap_object_{}", ids.object)).then_some(0)
    } else if name == format!("cell_{}", ids.cell) {
        Some(1)
    } else {
        (name == format!("cell_{}_object_{}", ids.cell, ids.object)).then_some(2)
    }
}

/// Decodes strips, or a list, to triangles. False if a list has indices left over or names a vertex
/// twice in a triangle; in a strip such triangles are joints.
fn decode(indices: &[u32], strips: bool, out: &mut Vec<[u32; 3]>) -> bool {
    let joint = |t: &[u32; 3]| t[0] == t[1] || t[1] == t[2] || t[0] == t[2];
    if !strips {
        let (triangles, rest) = indices.as_chunks::<3>();
        out.extend_from_slice(triangles);
        return rest.is_empty() && !out.iter().any(joint);
    }
    for (k, w) in indices.windows(3).enumerate() {
        let t = if k % 2 == 0 {
            [w[0], w[1], w[2]]
        } else {
            [w[1], w[0], w[2]]
        };
        if !joint(&t) {
            out.push(t);
        }
    }
    true
}
