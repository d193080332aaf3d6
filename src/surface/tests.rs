//! Labels and meshes of random volumes against slow references and the laws of the rule.

mod checks;

use crate::grid::{Ambiguous, Dims, LATTICE, Placement, Tiling};
use crate::labels::{
    BandComponents, BandFaces, BandInput, Bits, CarriedComponents, Labels, NeededRows, PhaseLabels,
    ProvisionalLabels, RowKinds, RowStretch, Runs, SlabComponents, Span, Voxels, add_border_euler,
    keys_on_top, label_runs, sum_voxels,
};
use crate::measure::{AreaScale, VoxelSums};
use crate::surface::assign_pieces::Piece;
use crate::surface::*;
use crate::volume::{MemoryVolume, Volume};
use checks::{assert_same, check_mates};
use proptest::prelude::*;
use std::collections::{BTreeMap, BTreeSet};
use std::convert::Infallible;

/// A triangle of the whole volume: lattice positions, starting with the smallest.
type Triangle = [[i32; 3]; 3];

fn canonical(t: Triangle) -> Triangle {
    let first = (0..3).min_by_key(|&i| t[i]).unwrap();
    std::array::from_fn(|i| t[(first + i) % 3])
}

/// A piece of a tile in whole-volume terms.
struct WholePiece {
    object: u64,
    cell: u64,
    surface: u64,
    tile: [u32; 3],
    piece: Piece,
    triangles: Vec<Triangle>,
}

#[derive(Debug, Clone)]
struct Case {
    dims: Dims,
    values: Vec<u8>,
    macrocube: [u32; 3],
    rule: Ambiguous,
    cap: bool,
}

const THRESHOLD: f64 = 100.0;

impl Case {
    fn above(&self, v: [u32; 3]) -> bool {
        f64::from(self.values[self.dims.linear(v) as usize]) >= THRESHOLD
    }

    fn voxels(&self) -> impl Iterator<Item = [u32; 3]> + use<> {
        let [nx, ny, nz] = self.dims.0;
        (0..nz).flat_map(move |z| (0..ny).flat_map(move |y| (0..nx).map(move |x| [x, y, z])))
    }

    /// Component of each voxel by plain flood fill, numbered by first voxel, objects and cells apart.
    fn flood(&self) -> (Vec<u64>, u64, u64) {
        let mut label = vec![0u64; self.values.len()];
        let mut counts = [0u64; 2];
        for start in self.voxels() {
            if label[self.dims.linear(start) as usize] != 0 {
                continue;
            }
            let above = self.above(start);
            let wide = above == (self.rule == Ambiguous::Join);
            counts[usize::from(above)] += 1;
            let mut stack = vec![start];
            label[self.dims.linear(start) as usize] = counts[usize::from(above)];
            while let Some(v) = stack.pop() {
                for d in 0..27 {
                    let d = [d % 3 - 1, d / 3 % 3 - 1, d / 9 - 1];
                    let steps: i32 = d.iter().map(|s: &i32| s.abs()).sum();
                    if steps == 0 || steps > if wide { 2 } else { 1 } {
                        continue;
                    }
                    let n: [i64; 3] = std::array::from_fn(|a| i64::from(v[a]) + i64::from(d[a]));
                    if (0..3).any(|a| n[a] < 0 || n[a] >= i64::from(self.dims.0[a])) {
                        continue;
                    }
                    let n = n.map(|c| c as u32);
                    let i = self.dims.linear(n) as usize;
                    if self.above(n) == above && label[i] == 0 {
                        label[i] = counts[usize::from(above)];
                        stack.push(n);
                    }
                }
            }
        }
        (label, counts[1], counts[0])
    }

    /// Every triangle of the volume, straight from the table.
    fn reference(&self) -> BTreeSet<Triangle> {
        let table = case_table::cases(self.rule);
        let mut out = BTreeSet::new();
        for v in self
            .voxels()
            .filter(|v| (0..3).all(|a| v[a] + 1 < self.dims.0[a]))
        {
            let corner = |c: u8| {
                [
                    v[0] + u32::from(c & 1),
                    v[1] + u32::from(c >> 1 & 1),
                    v[2] + u32::from(c >> 2),
                ]
            };
            let case = (0..8u8).fold(0, |w, c| w | usize::from(self.above(corner(c))) << c);
            for t in 0..table[case].triangles as usize {
                let points = table[case].edges[t].map(|e| {
                    let low = corner(case_table::EDGE_LOWER[e as usize]);
                    let axis = case_table::edge_axis(e);
                    let mut high = low;
                    high[axis] += 1;
                    let at = |v| f64::from(self.values[self.dims.linear(v) as usize]);
                    let exact = 256.0 * (THRESHOLD - at(low)) / (at(high) - at(low));
                    let mut p = low.map(|c| 256 * c as i32);
                    p[axis] += exact.round().clamp(1.0, 255.0) as i32;
                    p
                });
                assert!(out.insert(canonical(points)), "one triangle twice");
            }
        }
        out
    }

    fn tiling(&self) -> Tiling {
        Tiling {
            dims: self.dims,
            macrocube: self.macrocube,
        }
    }

    fn settings(&self) -> MeshSettings {
        MeshSettings {
            threshold: THRESHOLD,
            rule: self.rule,
            cap: self.cap,
            area: AreaScale::new([1.0; 3]),
        }
    }

    /// Runs labelling and then, tile by tile, meshing with final ids.
    fn run(&self) -> Vec<WholePiece> {
        let dir = tempfile::tempdir().unwrap();
        let new = |name| ProvisionalLabels::new(&dir.path().join(name)).unwrap();
        let mut provisional = PhaseLabels {
            objects: new("objects"),
            cells: new("cells"),
            surfaces: new("surfaces"),
        };
        let mut classes = CarriedComponents::default();
        let volume =
            MemoryVolume::new(self.dims, Placement::default(), self.values.clone()).unwrap();
        let (mut slabs, mut bands_of) = (Vec::new(), Vec::new());
        let [_, rows, layers] = self.tiling().tiles();
        for tz in 0..layers {
            let bands: Vec<_> = (0..rows).map(|ty| self.label(&volume, ty, tz)).collect();
            slabs.push(self.join(&bands, &mut classes, &mut provisional));
            bands_of.push(bands);
        }
        let ids = resolve(provisional, &slabs);
        let mut pieces = Vec::new();
        for (tz, bands) in (0..).zip(&bands_of) {
            for (ty, band) in (0..).zip(bands) {
                let (slab, ids) = (&slabs[tz as usize], &ids[tz as usize]);
                let of_local = &slab.of_local[ty as usize];
                let id = |&label: &u32| ids[of_local[label as usize] as usize];
                let of_run: Vec<Id> = band.labels.of_run.iter().map(id).collect();
                let mut all = of_run.clone();
                all.sort_unstable();
                all.dedup();
                let class = |id: &Id| all.binary_search(id).unwrap() as u32;
                let class_of_run: Vec<u32> = of_run.iter().map(class).collect();
                let band = self.reload(&volume, band);
                for (tx, mesh) in (0..).zip(self.mesh(&band, &class_of_run, ty, tz)) {
                    pieces.extend(whole_pieces(&mesh, &all, [tx, ty, tz]));
                }
            }
        }
        pieces
    }

    /// What is left of a band after labelling, with the samples that its surface needs and no others.
    fn reload(&self, volume: &MemoryVolume<u8>, before: &LabelledBand) -> LabelledBand {
        let (kinds, mixed) = RowKinds::of(&before.bits);
        let mut band = LabelledBand::default();
        kinds.fill(&mut band.bits, before.bits.span.clone(), &mixed);
        assert_eq!(band.bits.words, before.bits.words);
        band.runs.number(&band.bits);
        let samples = before.bits.span.with_neighbours(self.dims);
        let needed = NeededRows::of(&kinds, &before.bits.span, &samples);
        assert!(kinds.has_surface() || needed.parts.is_empty());
        // of others, any value would show
        let wrong: Vec<u8> = before.voxels.samples().iter().map(|v| !v).collect();
        band.voxels = Voxels::of(samples.clone(), wrong);
        let nx = self.dims.0[0];
        let read = |rows: &RowStretch, out: &mut [u8]| {
            volume.read_box(0..nx, rows.y.clone(), rows.z.clone(), out)
        };
        band.voxels.load_rows(samples, &needed, read).unwrap();
        band
    }

    /// A band with its labels.
    fn label(&self, volume: &MemoryVolume<u8>, ty: u32, tz: u32) -> LabelledBand {
        let (y, z) = (self.tiling().cubes(1, ty), self.tiling().cubes(2, tz));
        let span = Span {
            nx: self.dims.0[0],
            y: y.start..y.end + 1,
            z: z.start..z.end + 1,
        };
        let mut band = LabelledBand::default();
        let samples = span.with_neighbours(self.dims);
        band.voxels.load(volume, samples).unwrap();
        band.bits.classify(&band.voxels, span, Some(100));
        band.runs.number(&band.bits);
        let (of_run, count) = label_runs(&band.bits, &band.runs, self.rule, Vec::new());
        let place = Placement::default();
        band.labels = sum_voxels(&band.bits, of_run, count, self.dims, &place);
        let (bits, runs, labels) = (&band.bits, &band.runs, &mut band.labels);
        add_border_euler(bits, runs, labels, self.rule, self.dims);
        band
    }

    /// Joins the bands of a slab.
    fn join(
        &self,
        bands: &[LabelledBand],
        classes: &mut CarriedComponents,
        provisional: &mut PhaseLabels,
    ) -> SlabComponents {
        let sealed = bands.iter().map(|band| {
            let labels = &band.labels;
            let edges = BandFaces::of(&band.bits, &band.runs, labels, self.dims);
            let whole = |_: &VoxelSums| Ok::<_, Infallible>(());
            let on_top = keys_on_top(&band.bits, &band.runs, labels, self.dims);
            let components =
                BandComponents::split(&labels.components, &edges, on_top, self.dims, whole);
            (edges, components.unwrap())
        });
        let sealed: Vec<_> = sealed.collect();
        let known = sealed
            .iter()
            .map(|(edges, components)| BandInput { edges, components });
        let known: Vec<_> = known.collect();
        classes.join(&known, provisional).unwrap()
    }

    /// Meshes the tiles of a band, in the fast way and in the plain one.
    fn mesh(&self, band: &LabelledBand, class_of_run: &[u32], ty: u32, tz: u32) -> Vec<TileMesh> {
        let view = BandView {
            voxels: &band.voxels,
            bits: &band.bits,
            runs: &band.runs,
            class_of_run,
            cells: None,
        };
        let settings = self.settings();
        let tile = |tx| {
            let tile = TileBox::of(self.tiling(), [tx, ty, tz]);
            let mut mesh = TileMesh::default();
            let made = TileMesher::default().mesh(&view, &tile, &settings, &mut mesh);
            made.unwrap();
            check_mates(&mesh);
            if !self.cap {
                let made: u32 = mesh.pieces.iter().map(|p| p.vertices).sum();
                let sizes = crate::surface::Sizes::of(&band.bits, &tile);
                assert_eq!(sizes.vertices, u64::from(made));
                assert!(sizes.pieces >= mesh.pieces.len() as u64);
            }
            let mut plain = TileMesher::default();
            plain.walk.plain = true;
            let mut reference = TileMesh::default();
            let made = plain.mesh(&view, &tile, &settings, &mut reference);
            made.unwrap();
            assert_same(&mesh, &reference);
            mesh
        };
        (0..self.tiling().tiles()[0]).map(tile).collect()
    }
}

/// A band with its labels.
#[derive(Default)]
struct LabelledBand {
    voxels: Voxels<u8>,
    bits: Bits,
    runs: Runs,
    labels: Labels,
}

/// The surface that a component shares with one that begins before it, and its id among those of its phase.
type Id = (u64, u64);

/// Resolves classes from the last slab back to the first.
fn resolve(mut provisional: PhaseLabels, slabs: &[SlabComponents]) -> Vec<Vec<Id>> {
    let ranks = |labels: &mut ProvisionalLabels| {
        labels.spill().unwrap();
        labels.renumber().unwrap()
    };
    let mut surfaces = ranks(&mut provisional.surfaces);
    let mut of_phase = [&mut provisional.cells, &mut provisional.objects].map(ranks);
    let mut ids: Vec<Vec<Id>> = vec![Vec::new(); slabs.len()];
    for s in (0..slabs.len()).rev() {
        let slab = &slabs[s];
        let mut of_slab: Vec<Option<Id>> = vec![None; slab.provisional.len()];
        if let Some(next) = slabs.get(s + 1) {
            for (i, &class) in slab.live.iter().enumerate() {
                of_slab[class as usize] = Some(ids[s + 1][next.carried_in[i] as usize]);
            }
        }
        let id = |(class, known): (usize, Option<Id>)| {
            known.unwrap_or_else(|| {
                let ranks = &mut of_phase[usize::from(slab.above[class])];
                let surface = surfaces.id(slab.surfaces[class]).unwrap() - 1;
                (surface, ranks.id(slab.provisional[class]).unwrap())
            })
        };
        ids[s] = of_slab.into_iter().enumerate().map(id).collect();
    }
    ids
}

/// The pieces of a tile whose classes have these ids.
fn whole_pieces(mesh: &TileMesh, ids: &[Id], tile: [u32; 3]) -> Vec<WholePiece> {
    let whole = |piece: &Piece| {
        let vertex = |v: u32| {
            let positions = mesh.chunk.numbers().as_chunks::<3>().0;
            let position = positions[(piece.first_vertex + v) as usize];
            position.map(|c| (c * LATTICE as f32) as i32)
        };
        let triangles = mesh.piece(piece)[1..].iter();
        let object = ids[piece.object as usize];
        let cell = match piece.is_cap() {
            true => (0, 0),
            false => ids[piece.cell as usize],
        };
        WholePiece {
            object: object.1,
            cell: cell.1,
            surface: object.0.max(cell.0),
            tile,
            piece: *piece,
            triangles: triangles
                .map(|t| canonical(t.corners().map(vertex)))
                .collect(),
        }
    };
    mesh.pieces.iter().map(whole).collect()
}

fn cases() -> impl Strategy<Value = Case> {
    // a row of bits has up to four words, and a tile's begin anywhere in them
    let long = || prop_oneof![3 => 1u32..9, 1 => 60u32..200];
    let dims = (long(), 2u32..9, 2u32..9).prop_map(|(x, y, z)| [x.max(2), y, z]);
    let macrocube = (long(), 1u32..9, 1u32..9).prop_map(<[u32; 3]>::from);
    let rule = prop_oneof![Just(Ambiguous::Separate), Just(Ambiguous::Join)];
    (dims, macrocube, rule, 0u8..4).prop_flat_map(|(dims, macrocube, rule, kind)| {
        let n = dims.iter().product::<u32>() as usize;
        // noise of several densities; values next to and at the threshold make ties
        let value = match kind {
            0 => (60u8..140).boxed(),
            1 => (95u8..250).boxed(),
            2 => prop_oneof![4 => 0u8..100, 1 => Just(100u8)].boxed(),
            _ => prop_oneof![Just(99u8), Just(100u8), Just(101u8)].boxed(),
        };
        prop::collection::vec(value, n).prop_map(move |values| Case {
            dims: Dims(dims),
            values,
            macrocube,
            rule,
            cap: false,
        })
    })
}

proptest! {
    #![proptest_config(ProptestConfig { cases: 400, ..ProptestConfig::default() })]

    #[test]
    fn tiles_are_the_reference_mesh_with_the_reference_labels(case in cases()) {
        let pieces = case.run();
        let mut made = BTreeSet::new();
        let (labels, objects, cells) = case.flood();
        let voxel = |p: [i32; 3], up: bool| {
            let v = p.map(|c| (c / 256) as u32 + u32::from(up && c % 256 != 0));
            labels[case.dims.linear(v) as usize]
        };
        for w in &pieces {
            for t in &w.triangles {
                prop_assert!(made.insert(*t));
                for &p in t {
                    let low = p.map(|c| (c / 256) as u32);
                    let lower_above = case.above(low);
                    prop_assert_eq!(voxel(p, !lower_above), w.object);
                    prop_assert_eq!(voxel(p, lower_above), w.cell);
                }
            }
        }
        prop_assert_eq!(&made, &case.reference());
        // surfaces are the (object, cell) pairs; with objects and cells they are a tree
        let pairs: BTreeSet<_> = pieces.iter().map(|w| (w.object, w.cell)).collect();
        prop_assert_eq!(pairs.len() as u64 + 1, objects + cells);
        // and are numbered by their smallest keys, which labels have told before there was any
        let mut keys: BTreeMap<(u64, u64), u64> = BTreeMap::new();
        for w in &pieces {
            let key = keys.entry((w.object, w.cell)).or_insert(u64::MAX);
            *key = w.piece.key.min(*key);
        }
        let mut order: Vec<u64> = keys.values().copied().collect();
        order.sort_unstable();
        for w in &pieces {
            let key = keys[&(w.object, w.cell)];
            prop_assert_eq!(w.surface, order.binary_search(&key).unwrap() as u64 + 1);
        }
        // each tile has one piece of each
        let tiles: BTreeSet<_> = pieces.iter().map(|w| (w.tile, w.surface)).collect();
        prop_assert_eq!(tiles.len(), pieces.len());
    }

    #[test]
    fn sums_obey_eulers_law_and_do_not_depend_on_tiles(case in cases()) {
        let sums = |case: &Case| {
            let mut all: BTreeMap<(u64, u64), (crate::measure::MeshSums, u64)> = BTreeMap::new();
            for w in case.run() {
                let entry = all.entry((w.object, w.cell)).or_insert((Default::default(), u64::MAX));
                entry.0.merge(&w.piece.sums);
                entry.1 = entry.1.min(w.piece.key);
            }
            all
        };
        let tiled = sums(&case);
        let whole = sums(&Case { macrocube: [256; 3], ..case.clone() });
        prop_assert_eq!(&tiled, &whole);
        let vertices: BTreeSet<[i32; 3]> = case.reference().into_iter().flatten().collect();
        let counted: u64 = tiled.values().map(|s| s.0.vertices).sum();
        prop_assert_eq!(counted, vertices.len() as u64);
    }

    #[test]
    fn caps_close_the_surface_of_every_object(case in cases()) {
        let case = Case { cap: true, ..case };
        let pieces = case.run();
        let mut edges: BTreeMap<([i32; 3], [i32; 3]), i32> = BTreeMap::new();
        let mut triangles = 0;
        let mut volume6: BTreeMap<u64, i128> = BTreeMap::new();
        let mut vertices = BTreeSet::new();
        for w in &pieces {
            *volume6.entry(w.object).or_default() += w.piece.sums.volume6;
            for t in &w.triangles {
                triangles += 1;
                vertices.extend(*t);
                for e in 0..3 {
                    *edges.entry((t[e], t[(e + 1) % 3])).or_default() += 1;
                }
            }
        }
        for (&(a, b), &count) in &edges {
            prop_assert_eq!(count, 1);
            prop_assert!(edges.contains_key(&(b, a)));
        }
        let counted: u64 = pieces.iter().map(|w| w.piece.sums.vertices).sum();
        prop_assert_eq!(counted, vertices.len() as u64);
        // the outer shell of an object spans more than its holes
        prop_assert!(volume6.values().all(|&v| v > 0));
        let open = Case { cap: false, ..case.clone() }.run();
        let open_triangles: usize = open.iter().map(|w| w.triangles.len()).sum();
        let caps: usize = pieces.iter().filter(|w| w.piece.is_cap()).map(|w| w.triangles.len()).sum();
        prop_assert_eq!(open_triangles + caps, triangles);
    }
}
