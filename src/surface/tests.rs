//! Labels and meshes of random volumes against slow references and the laws of the rule.

mod checks;

use crate::grid::{Ambiguous, Dims, LATTICE, Placement, Tiling};
use crate::labels::{
    BandComponents, BandFaces, BandInput, Bits, CarriedComponents, CarryOver, PhaseLabels,
    ProvisionalLabels, Runs, Span, Voxels, add_border_euler, label_runs, sum_voxels,
};
use crate::measure::{AreaScale, VoxelSums};
use crate::surface::assign_pieces::Piece;
use crate::surface::*;
use crate::volume::MemoryVolume;
use checks::{assert_same, check_foreseen, check_joined, check_mates, check_often, one_next};
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

    /// Runs labelling and meshing tile by tile, with final ids.
    fn run(&self) -> Vec<WholePiece> {
        let tiling = Tiling {
            dims: self.dims,
            macrocube: self.macrocube,
        };
        let dir = tempfile::tempdir().unwrap();
        let new = |name| ProvisionalLabels::new(&dir.path().join(name)).unwrap();
        let mut provisional = PhaseLabels {
            objects: new("objects"),
            cells: new("cells"),
        };
        let mut classes = CarriedComponents::default();
        let volume =
            MemoryVolume::new(self.dims, Placement::default(), self.values.clone()).unwrap();
        let settings = MeshSettings {
            threshold: THRESHOLD,
            rule: self.rule,
            cap: self.cap,
            area: AreaScale::new([1.0; 3]),
        };
        let (mut slabs, mut bands_of) = (Vec::new(), Vec::new());
        let mut pieces = Vec::new();
        for tz in 0..tiling.tiles()[2] {
            let mut bands = Vec::new();
            for ty in 0..tiling.tiles()[1] {
                let (y, z) = (tiling.cubes(1, ty), tiling.cubes(2, tz));
                let span = Span {
                    nx: self.dims.0[0],
                    y: y.start..y.end + 1,
                    z: z.start..z.end + 1,
                };
                let mut voxels = Voxels::<u8>::default();
                voxels
                    .load(&volume, span.with_neighbours(self.dims))
                    .unwrap();
                let mut bits = Bits::default();
                bits.classify(&voxels, span, Some(100));
                let mut runs = Runs::default();
                runs.number(&bits);
                let (of_run, count) = label_runs(&bits, &runs, self.rule, Vec::new());
                let mut labels = {
                    let grid = (self.dims, &Placement::default());
                    sum_voxels(&bits, of_run, count, grid)
                };
                add_border_euler(&bits, &runs, &mut labels, self.rule, self.dims);
                bands.push((voxels, bits, runs, labels));
            }
            let edges: Vec<_> = bands
                .iter()
                .map(|(_, b, r, l)| {
                    let edges = BandFaces::of(b, r, l, self.dims);
                    let whole = |_: &VoxelSums| Ok::<_, Infallible>(());
                    let components = BandComponents::split(&l.components, &edges, whole);
                    (edges, components.unwrap())
                })
                .collect();
            let known: Vec<_> = edges
                .iter()
                .map(|(edges, components)| BandInput { edges, components })
                .collect();
            let slab = classes.join(&known, &mut provisional).unwrap();
            for (ty, (voxels, bits, runs, labels)) in bands.iter().enumerate() {
                for tx in 0..tiling.tiles()[0] {
                    let tile = TileBox::of(tiling, [tx, ty as u32, tz]);
                    let class_of_run: Vec<u32> = labels
                        .of_run
                        .iter()
                        .map(|&l| slab.of_local[ty][l as usize])
                        .collect();
                    let view = BandView {
                        voxels,
                        bits,
                        runs,
                        class_of_run: &class_of_run,
                        carry_over: None,
                    };
                    let mut mesh = TileMesh::default();
                    TileMesher::default().mesh(&view, &tile, &settings, &mut mesh);
                    check_mates(&mesh);
                    if !self.cap {
                        let made: u32 = mesh.pieces.iter().map(|p| p.vertices).sum();
                        let sizes = crate::surface::Sizes::of(bits, &tile);
                        assert_eq!(sizes.vertices, u64::from(made));
                        assert!(sizes.pieces >= mesh.pieces.len() as u64);
                    }
                    let mut plain = TileMesher::default();
                    plain.walk.plain = true;
                    let mut reference = TileMesh::default();
                    plain.mesh(&view, &tile, &settings, &mut reference);
                    assert_same(&mesh, &reference);
                    pieces.push((slabs.len(), mesh));
                }
            }
            slabs.push(slab);
            bands_of.push(bands);
        }
        for (tz, pair) in slabs.windows(2).enumerate() {
            for (ty, (voxels, bits, runs, labels)) in bands_of[tz].iter().enumerate() {
                let class = |&label: &u32| pair[0].of_local[ty][label as usize];
                let class_of_run: Vec<u32> = labels.of_run.iter().map(class).collect();
                let view = BandView {
                    voxels,
                    bits,
                    runs,
                    class_of_run: &class_of_run,
                    carry_over: Some(CarryOver::between(&pair[0], &pair[1])),
                };
                for tx in 0..tiling.tiles()[0] {
                    let tile = TileBox::of(tiling, [tx, ty as u32, tz as u32]);
                    check_joined(&view, &tile, &settings);
                }
            }
        }
        // resolve classes from the last slab back to the first
        let mut ranks = [
            provisional.cells.renumber().unwrap(),
            provisional.objects.renumber().unwrap(),
        ];
        let mut ids: Vec<Vec<u64>> = vec![Vec::new(); slabs.len()];
        for s in (0..slabs.len()).rev() {
            let slab = &slabs[s];
            let mut live = vec![None; slab.provisional.len()];
            if let Some(next) = slabs.get(s + 1) {
                for (i, &class) in slab.live.iter().enumerate() {
                    live[class as usize] = Some(ids[s + 1][next.carried_in[i] as usize]);
                }
            }
            ids[s] = slab
                .provisional
                .iter()
                .zip(&slab.above)
                .zip(live)
                .map(|((&provisional_id, &above), live)| {
                    live.unwrap_or_else(|| ranks[usize::from(above)].id(provisional_id).unwrap())
                })
                .collect();
        }
        check_often(&slabs);
        let mut out = Vec::new();
        for (s, mesh) in pieces {
            check_foreseen(&slabs[s], None, &ids[s], &mesh.pieces);
            if let Some(next) = slabs.get(s + 1) {
                let groups = one_next(&CarryOver::between(&slabs[s], next), &mesh.pieces);
                let firsts: Vec<Piece> = groups.iter().map(|g| mesh.pieces[g[0]]).collect();
                check_foreseen(&slabs[s], Some(next), &ids[s], &firsts);
            }
            for piece in &mesh.pieces {
                let vertex = |v: u32| {
                    let position =
                        mesh.chunk.numbers().as_chunks::<3>().0[(piece.first_vertex + v) as usize];
                    position.map(|c| (c * LATTICE as f32) as i32)
                };
                out.push(WholePiece {
                    object: ids[s][piece.object as usize],
                    cell: if piece.is_cap() {
                        0
                    } else {
                        ids[s][piece.cell as usize]
                    },
                    piece: *piece,
                    triangles: mesh.piece(piece)[1..]
                        .iter()
                        .map(|t| canonical(t.corners().map(vertex)))
                        .collect(),
                });
            }
        }
        out
    }
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
