//! One tile: its file, its layout against the shard's entry, and its geometry piece by piece.

use super::against::{Band, Mesh, Rule, Voxels};
use super::ahead::Fetched;
use super::closed::TILES;
use super::code::Code;
use super::edges::Edges;
use super::files::{self, Expected};
use super::labels::{CellLabels, CellsOfCube};
use super::parts::{PartSums, Weld};
use super::piece::{Flaw, Piece, Region};
use super::region_edge::{RegionEdge, TileEdge};
use super::report::{Issue, Issues};
use super::seen::Seen;
use super::sweep::{Component, FaceEdge, TileFront};
use super::walls::{self, Crossing, Slant, WallScale};
use crate::grid::{Placement, Tiling};
use crate::manifest::{Bounds, Layout, Manifest, TileEntry};
use crate::tile::MAX_NODES;
use crate::tile::read::{Fault, Tile};
use crate::volume::RegionVoxels;
use std::path::Path;

/// The context that all tiles of a set have in common.
pub(super) struct Context<'a> {
    pub root: &'a Path,
    pub manifest: &'a Manifest,
    pub tiling: Tiling,
    pub max_issues: usize,
    /// Turns the components of an area vector in lattice units into physical area, in the tables' unit.
    pub scale: [f64; 3],
    /// Where the grid lies, in the tables' unit, if its axes are not those of the world.
    pub rotated: Option<Placement>,
    /// The region of interest.
    pub edge: RegionEdge<'a>,
    /// How walls are measured, if the tiles tell of them: those of a part lack surfaces.
    pub walls: Option<WallScale>,
}

impl<'a> Context<'a> {
    /// `manifest` has been checked; `root` is the directory with symbolic links resolved. `region` are the voxels of the
    /// grid in its region of interest, if they are known.
    pub fn new(
        root: &'a Path,
        manifest: &'a Manifest,
        region: Option<&'a RegionVoxels>,
        max_issues: usize,
    ) -> Self {
        let measured = manifest.measured();
        let [x, y, z] = measured.spacing.map(|s| s / 256.0);
        Context {
            root,
            manifest,
            tiling: manifest.tiling(),
            max_issues,
            scale: [y * z, z * x, x * y],
            rotated: measured.is_rotated().then_some(measured),
            edge: RegionEdge::of(manifest, region),
            walls: (manifest.tables.walls.is_some() && !manifest.is_part())
                .then(|| WallScale::of(&measured)),
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
    pub strips: u64,
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
        self.strips += o.strips;
        self.bytes += o.bytes;
    }
}

/// The result of checking a tile.
pub(super) struct Outcome {
    /// `None` for a macrocube without a tile.
    pub front: Option<TileFront>,
    pub counts: Counts,
    pub voxels: Voxels,
    /// What voxels say of cells, if it is known of each which cell it is of.
    pub cells: CellsOfCube,
    pub issues: Issues,
}

/// Buffers that a thread keeps from tile to tile.
#[derive(Default)]
pub(super) struct Workspace {
    pub indices: Vec<u32>,
    pub list: Vec<[u32; 3]>,
    pub piece: Piece,
    /// Around the vertices of the primitive at hand, in lattice units, if its pieces are sound.
    pub span: Option<[[i32; 3]; 2]>,
    pub edges: Edges,
    pub surface_seen: Seen,
    pub cap_seen: Seen,
    pub mesh: Mesh,
    pub weld: Weld,
    /// Where lines cross the surface, if walls are looked for.
    pub crossings: Vec<Crossing>,
}

/// The samples to compare a tile with, and how.
#[derive(Clone, Copy)]
pub(super) struct Samples<'a> {
    pub band: &'a Band<'a>,
    pub rule: &'a Rule,
    /// The labels that cells were made by.
    pub labels: Option<&'a CellLabels<'a>>,
}

/// Checks a tile that has been read. Called as it is named, for the counts of its instructions.
#[inline(never)]
pub(super) fn check(
    cx: &Context,
    entry: &TileEntry,
    fetched: &mut Fetched,
    original: Option<Samples>,
    ws: &mut Workspace,
) -> Outcome {
    let mut issues = std::mem::replace(&mut fetched.issues, Issues::new(0));
    let (at, bytes) = (fetched.at.as_str(), fetched.file.get());
    let mut work = Work::new(cx, entry, at, &mut issues);
    work.keep_mesh = original.is_some();
    if fetched.found {
        files::compare(&Expected::tile(entry, at), bytes, work.issues);
        work.counts.bytes = bytes.len() as u64;
        match Tile::read(bytes) {
            Ok(tile) => {
                work.tile(&tile, ws);
                work.check_closed(&tile);
            }
            Err(e) => work.issue(code_of(e.fault), &e.place, e.message),
        }
    }
    let (counts, region) = (work.counts, work.region);
    let faces = work.sound.then_some(work.faces);
    let (components, parts) = (work.components, work.parts);
    let (mut voxels, mut cells) = (Voxels::default(), CellsOfCube::default());
    if let Some(Samples { band, rule, labels }) = original {
        let mut flaws = Vec::new();
        if faces.is_none() {
            ws.mesh.begin(&region, rule.cap);
        }
        voxels = band.compare(&region, rule, &mut ws.mesh, &mut flaws);
        if !issues.broken() {
            differences(&entry.path, &flaws, &mut issues);
        }
        if let Some(labels) = labels {
            let begins = ws.weld.begins().filter(|_| faces.is_some());
            cells = labels.compare(&region, &ws.mesh, cx.rotated.as_ref(), begins);
            if let Some(misplaced) = cells.misplaced.take().filter(|_| !issues.broken()) {
                issues.push(misplaced.issue(&entry.path));
            }
        }
    }
    let chords = match &cx.walls {
        Some(scale) if faces.is_some() && !issues.broken() => {
            if let Some(labels) = original.and_then(|samples| samples.labels) {
                let unknown = ws.crossings.iter_mut().filter(|at| at.cell == 0);
                unknown.for_each(|at| at.cell = labels.cell_at(at.voxel_below()));
            }
            let of_volume: Option<Vec<Slant>> =
                original.map(|samples| samples.band.slants(&ws.crossings, scale));
            walls::of_tile(&ws.crossings, ws.weld.noted(), of_volume.as_deref(), scale)
        }
        _ => walls::TileChords::default(),
    };
    Outcome {
        voxels,
        cells,
        front: Some(TileFront {
            grid: entry.grid,
            region,
            path: entry.path.clone(),
            faces,
            components,
            parts,
            chords,
        }),
        counts,
        issues,
    }
}

/// The code of what keeps a tile from being read.
fn code_of(fault: Fault) -> Code {
    match fault {
        Fault::Container => Code::GlbContainer,
        Fault::Json => Code::GltfSyntax,
        Fault::Structure => Code::GltfStructure,
        Fault::Accessor => Code::GltfAccessor,
        Fault::Compression => Code::MeshoptBuffer,
        Fault::Extras => Code::NodeExtras,
    }
}

/// Looks for sign changes in a macrocube that has no tile.
pub(super) fn empty(
    cx: &Context,
    grid: [u32; 3],
    original: Samples,
    ws: &mut Workspace,
) -> Outcome {
    let Samples { band, rule, labels } = original;
    let mut issues = Issues::new(cx.max_issues);
    let mut flaws = Vec::new();
    let region = cx.region(grid);
    ws.mesh.begin(&region, rule.cap);
    let voxels = band.compare(&region, rule, &mut ws.mesh, &mut flaws);
    let path = format!("macrocube {} {} {}", grid[0], grid[1], grid[2]);
    differences(&path, &flaws, &mut issues);
    let found = labels
        .map(|labels| labels.compare(&region, &ws.mesh, cx.rotated.as_ref(), std::iter::empty()));
    Outcome {
        front: None,
        counts: Counts::default(),
        voxels,
        cells: found.unwrap_or_default(),
        issues,
    }
}

fn differences(path: &str, flaws: &[Flaw], issues: &mut Issues) {
    for f in flaws {
        let what = match f.code {
            Code::MissingVertex => "sign changes of the volume have no vertex",
            Code::ExtraVertex => "vertices lie where the volume has no sign change",
            Code::VertexMisplaced => "vertices are not where the samples put them",
            Code::NormalDiffers => "normals are not those of the volume's gradient",
            Code::BitsDiffer => "vertices have above where the volume has below",
            _ => "cubes have more or fewer triangles than their bits ask for",
        };
        let issue = Issue::new(f.code, path, format!("{} {what}", f.count));
        issues.push(issue.at(f.first));
    }
}

/// A tile that is being checked; `layout` and `geometry` do the rest of the work.
pub(super) struct Work<'a, 'i> {
    pub cx: &'a Context<'a>,
    pub entry: &'a TileEntry,
    /// The entry's place in the shard.
    pub at: &'a str,
    pub region: Region,
    pub counts: Counts,
    pub box_seen: Option<[[i32; 3]; 2]>,
    pub components: Vec<(Component, bool)>,
    /// Parts of surfaces, where cells are parts of components.
    pub parts: Vec<PartSums>,
    pub faces: [Vec<FaceEdge>; 6],
    /// Open edges on the volume's faces: of surfaces, and of caps.
    pub border: Vec<(usize, FaceEdge)>,
    pub cap_border: Vec<(usize, FaceEdge)>,
    /// The region of interest in the tile.
    pub edge: TileEdge<'a>,
    /// True if the pieces are to be compared with a volume.
    pub keep_mesh: bool,
    /// False as long as the neighbours' edges cannot be held against this tile.
    pub sound: bool,
    pub issues: &'i mut Issues,
}

impl<'a, 'i> Work<'a, 'i> {
    fn new(cx: &'a Context, entry: &'a TileEntry, at: &'a str, issues: &'i mut Issues) -> Self {
        Work {
            cx,
            entry,
            at,
            region: cx.region(entry.grid),
            counts: Counts::default(),
            box_seen: None,
            components: Vec::new(),
            parts: Vec::new(),
            faces: Default::default(),
            border: Vec::new(),
            cap_border: Vec::new(),
            sound: false,
            edge: TileEdge::none(),
            keep_mesh: false,
            issues,
        }
    }
}

impl Work<'_, '_> {
    pub(super) fn issue(&mut self, code: Code, pointer: &str, message: String) {
        let path = &self.entry.path;
        let path = if pointer.is_empty() {
            path.clone()
        } else {
            format!("{path}#{pointer}")
        };
        self.issues.add(code, path, message);
    }

    pub(super) fn flaws(&mut self, node: usize, flaws: &[Flaw]) {
        for f in flaws {
            let what = match f.code {
                Code::PositionNotFinite => "vertices have a coordinate that is no finite number",
                Code::PositionOffLattice => {
                    "vertices are not strictly inside one lattice edge at a multiple of 1/256"
                }
                Code::PositionOutsideTile => "vertices lie outside the macrocube",
                Code::DuplicateVertex => "lattice edges have two vertices",
                Code::SeamDiffers => "vertices are not those of the other parts of the surface",
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
        self.check_form(tile);
        self.load_edge();
        ws.surface_seen.begin(size);
        if self.cx.manifest.cap {
            // else no cap gets as far as this
            ws.cap_seen.begin(size);
        }
        if self.keep_mesh {
            ws.mesh.begin(&self.region, self.cx.manifest.cap);
        }
        self.sound = true;
        ws.weld.begin();
        ws.crossings.clear();
        let mut group = 0;
        for primitive in &tile.primitives {
            if self.sound {
                self.primitive(primitive, &mut group, ws);
            }
        }
        if self.sound {
            self.end_surface(ws);
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
            twice.extend(self.repeated(seen, true));
        }
        if !twice.is_empty() {
            self.flaws(0, &twice);
            self.sound = false;
            return;
        }
        self.close_border();
        self.check_begins(&mut ws.weld);
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

    /// Finds what of the tile is in the region of interest.
    fn load_edge(&mut self) {
        match self.cx.edge.in_tile(&self.region, self.cx.manifest) {
            Ok(edge) => self.edge = edge,
            Err(e) => {
                let at = "index.json#/region";
                self.issues.add(Code::VolumeMismatch, at, e.to_string());
            }
        }
    }

    /// Looks for what no tile of the format has, though the surface can be read in spite of it.
    fn check_closed(&mut self, tile: &Tile) {
        match TILES[usize::from(tile.is_merged())].walk(tile.json()) {
            Ok(found) => {
                for (pointer, message) in found {
                    self.issue(Code::ForeignMember, &pointer, message);
                }
            }
            Err(e) => self.issue(Code::GltfSyntax, "", e.to_string()),
        }
        for (pointer, message) in tile.unusual() {
            self.issue(Code::GltfUnused, &pointer, message);
        }
    }

    /// Compares how the tile stores things with what the manifest states.
    fn check_form(&mut self, tile: &Tile) {
        let m = self.cx.manifest;
        if tile.encoding != m.encoding {
            let message = format!("found {:?}, expected {:?}", tile.encoding, m.encoding);
            self.issue(Code::TileEncoding, "/extensionsRequired", message);
        }
        let pieces = self.entry.groups.len();
        let merged = match m.layout {
            Layout::Nodes => false,
            Layout::Merged => true,
            Layout::Auto => pieces > MAX_NODES,
        };
        // a tile of a part may have had more pieces in the whole, and stays as it was
        let was_larger = m.layout == Layout::Auto && tile.is_merged() && m.is_part();
        if tile.is_merged() == merged || was_larger {
            return;
        }
        let name = |merged| match merged {
            true => "one mesh for all",
            false => "a node for each",
        };
        let (found, expected) = (name(tile.is_merged()), name(merged));
        let message = format!("found {found} of {pieces} pieces, expected {expected}");
        self.issue(Code::TileEncoding, "/nodes", message);
    }

    /// Counts this tile once for each cell and each object in it, on the first of its components.
    fn count_tiles(&mut self) {
        let mut cells = std::collections::HashSet::new();
        let mut objects = std::collections::HashSet::new();
        // where cells are parts of components, those of the tile have no ids
        let whole = self.components.iter_mut().map(|(c, _)| c);
        let whole = whole.filter(|c| c.ids.cell != 0);
        let mut surfaces = std::collections::HashSet::new();
        for part in &mut self.parts {
            // a cell of two components may have two parts of one surface
            let is_first = surfaces.insert(part.component.ids.surface);
            part.component.tiles = u64::from(is_first);
        }
        let parts = self.parts.iter_mut().map(|part| &mut part.component);
        for c in whole.chain(parts) {
            c.cell_tiles = u64::from(cells.insert(c.ids.cell));
            c.object_tiles = u64::from(objects.insert(c.ids.object));
        }
    }

    fn compare_entry(&mut self) {
        let e = self.entry;
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
        compare("strips", e.strips, c.strips);
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
