//! How often tiles are written.

use crate::checkpoint::Checkpointer;
use crate::convert::conversion::Conversion;
use crate::convert::finalize::batches::count_distinct;
use crate::convert::identity;
use crate::convert::plan::plan;
use crate::convert::resolve::resolve;
use crate::convert::scan::scan;
use crate::convert::{ConvertOptions, predicted_memory};
use crate::error::Error;
use crate::grid::{Dims, Placement};
use crate::progress::Quiet;
use crate::tileset::TilesetWriter;
use crate::volume::{MemoryVolume, Volume, Watch};
use std::path::Path;

/// Pairs of rods in every second slab of 10, joined by bridges in the one behind.
fn rods() -> MemoryVolume<u8> {
    let dims = Dims([33, 33, 61]);
    let [nx, ny, nz] = dims.0;
    let above = |x: u32, y: u32, z: u32| {
        let rod = (1..17).contains(&(z % 20)) && (x % 8 == 2 || x % 8 == 6);
        let bridge = (14..17).contains(&(z % 20)) && (2..7).contains(&(x % 8));
        y % 4 == 2 && (rod || bridge)
    };
    let row = |y, z| (0..nx).map(move |x| if above(x, y, z) { 200 } else { 50 });
    let slice = |z| (0..ny).flat_map(move |y| row(y, z));
    let samples = (0..nz).flat_map(slice).collect();
    MemoryVolume::new(dims, Placement::default(), samples).unwrap()
}

fn options(memory: u64) -> ConvertOptions {
    ConvertOptions {
        threshold: 128.0,
        macrocube: [16, 16, 10],
        threads: 2,
        memory,
        ..ConvertOptions::default()
    }
}

/// Tiles by layer that the sweep writes in more pieces than they have in the end.
fn to_write_anew(volume: &MemoryVolume<u8>, memory: u64, work: &Path) -> Vec<usize> {
    let options = options(memory);
    let plan = plan(volume, volume.header().dims, &options).unwrap();
    let watch = Watch::new(volume.header(), false);
    let job = Conversion {
        volume,
        grid: volume,
        region: None,
        options: &options,
        plan: &plan,
        watch: &watch,
        progress: &Quiet,
    };
    let identity = identity::of(&options.input, &job.asked());
    let mut checkpointer = Checkpointer::new(work, &identity, false, job.layers()).unwrap();
    let writer = job.tile_writer(work);
    std::fs::create_dir(work.join("tiles")).unwrap();
    let set = TilesetWriter::new(work).unwrap();
    (0..job.layers()).for_each(|z| set.make_layer_directory(z).unwrap());
    let scanned = scan(&job, &plan.pool(), &writer, &mut checkpointer).unwrap();
    let resolved = resolve(scanned.output, 1 << 20, work).unwrap();
    let (mut slabs, mut spool, mut ids) = (resolved.slabs, resolved.pieces, resolved.ids);
    let mut anew = Vec::new();
    for i in 0..slabs.len() {
        let slab = slabs.get(i).unwrap().unwrap();
        let (ids, tiles) = (ids.of(i).unwrap(), spool.get(&slab.tiles).unwrap());
        let more = tiles.iter().filter(|tile| {
            let pieces = tile.pieces(&mut spool).unwrap();
            let ids: Vec<_> = pieces.iter().map(|p| ids.of(p)).collect();
            count_distinct(&ids) < ids.len()
        });
        anew.push(more.count());
    }
    anew
}

#[test]
fn tiles_are_written_once_where_the_next_slab_tells_what_is_one() {
    let volume = rods();
    let anew = |memory| {
        let work = tempfile::tempdir().unwrap();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(2).build();
        let run = || to_write_anew(&volume, memory, work.path());
        pool.unwrap().install(run)
    };
    let smallest = match predicted_memory(&volume, &options(1)) {
        Err(Error::Memory { needed, .. }) => needed,
        other => panic!("{other:?}"),
    };
    assert_eq!(anew(smallest), [4, 0, 4, 0, 4, 0]);
    // in the first slab nothing tells yet that components often turn out to be one
    assert_eq!(anew(1 << 30), [4, 0, 0, 0, 0, 0]);
}
