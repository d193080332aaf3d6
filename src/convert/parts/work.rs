//! The rounds of one part: the stages of a conversion, on its layers.

use crate::checkpoint::{Checkpointer, Identity, LABELS, Marks, Scratch, TILES};
use crate::convert::cells::KeptBits;
use crate::convert::components::{Components, SumUp, sum_up};
use crate::convert::conversion::Conversion;
use crate::convert::finalize::{FinalizeInput, finalize};
use crate::convert::id_places::IdPlaces;
use crate::convert::known_band::KnownBands;
use crate::convert::label::{Filter, LabelInput, Labelled, LeftOut, Seam, left_out, sweep};
use crate::convert::memory::{SLABS, TABLES};
use crate::convert::mesh::{MeshInput, MeshOutput, mesh};
use crate::convert::parts::directory::{Attempt, Directory, Doer, Done, FileSum, Made};
use crate::convert::parts::ids::{IdsOfPart, open_labels};
use crate::convert::parts::labels::write_pairs;
use crate::convert::parts::records::{read_records, write_records};
use crate::convert::parts::rounds::{Round, Rounds};
use crate::convert::parts::small::small_beyond;
use crate::convert::parts::split::{CellsToMesh, MeshedPart, write_columns, write_meshed};
use crate::convert::parts::walls::{write_areas, write_walls};
use crate::convert::resolve::{Each, resolve};
use crate::convert::tables::write_tables;
use crate::convert::totals::ScannedSums;
use crate::convert::walls::WallsInput;
use crate::convert::{ConvertOptions, read_twice};
use crate::error::{Error, Result};
use crate::manifest::{COMPONENTS, LayerRecord, NECKS, Totals, WALLS};
use crate::measure::MeshSums;
use crate::split::NeckRule;
use crate::sys::memory_pool::{MemoryPool, MemoryReservation};
use crate::sys::spill_file::SpillFile;
use crate::sys::state_codec::{Decoder, Encoder};
use crate::tileset::{TilesetWriter, make_directories};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// The file that tells what a part has in common with others.
pub const SEAM: &str = "seam";
/// The file of the sums over the caps of a part.
const CAPS: &str = "caps";
/// The file of the layers of a part that have tiles.
pub const LAYERS: &str = "layers";
/// The tables, of which a part has the rows of what begins there.
const CSV: [&str; 3] = ["cells.csv", "objects.csv", "surfaces.csv"];

/// The tables of a conversion.
pub fn tables(options: &ConvertOptions) -> Vec<&'static str> {
    let parts: &[&str] = match options.has_parts() {
        true => &[COMPONENTS, NECKS],
        false => &[],
    };
    let walls: &[&str] = if options.walls { &[WALLS] } else { &[] };
    [&CSV, parts, walls].concat()
}

/// What labelling a part, or searching it, has found.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct LabelsOfPart {
    /// What the filters before left out that lies in this part alone.
    pub left_out: LeftOut,
    /// NaN samples.
    pub nan: u64,
}

/// What finishing a part has made.
#[derive(Debug, Clone, Copy, Serialize, Deserialize)]
pub struct FinishedPart {
    /// Sums over its tiles and the components that begin in it.
    pub totals: Totals,
    /// Voxels below of the components that begin in it.
    pub voxels_below: u64,
    /// Bytes of its shards and its rows of tables.
    pub index_and_tables: u64,
}

/// The labels of a part.
struct KnownLabels {
    /// As the part has left them.
    done: Done<LabelsOfPart>,
    /// The components of the whole volume that they are.
    ids: IdsOfPart,
}

/// What a part works on.
pub struct PartWork<'a> {
    /// The conversion of its layers.
    pub job: &'a Conversion<'a>,
    /// Where all parts work.
    pub directory: &'a Directory,
    /// The rounds.
    pub rounds: Rounds,
    /// Its number.
    pub part: u32,
}

impl PartWork<'_> {
    /// Does a round.
    ///
    /// # Errors
    /// Those of a conversion; [`Error::Format`] if what was left by rounds before is damaged.
    pub fn run(&self, round: Round) -> Result<()> {
        let number = self.rounds.number(round);
        let attempt = self.directory.attempt(number, Doer::Part(self.part))?;
        match round {
            Round::Search(sweep) => self.label(attempt, sweep),
            Round::Label => self.label(attempt, LABELS),
            Round::Basins => self.basins(attempt, self.rule()),
            Round::Saddles => self.saddles(attempt, self.rule()),
            Round::Mesh => self.mesh(attempt),
            Round::Finish => self.finish(attempt),
        }
    }

    /// How cells are split, in a round that there is for that.
    fn rule(&self) -> NeckRule {
        let rule = self.job.options.split;
        rule.expect("a plan's rounds are those of its options")
    }

    /// What an attempt leaves of its sweep, and whether its files are on the disk.
    ///
    /// # Errors
    /// [`Error::Io`].
    pub(super) fn checkpointer(&self, attempt: &Attempt) -> Result<Checkpointer> {
        let identity = Identity::new(self.directory.plan.identity.clone());
        let dust = self.job.options.min_voxels > 1;
        Checkpointer::new(&attempt.dir, &identity, dust, self.job.made.end)
    }

    /// Says that an attempt is whole, once its files are on the disk if others of it are.
    ///
    /// # Errors
    /// [`Error::Io`], [`Error::InputChanged`].
    pub(super) fn done<T: Serialize>(
        &self,
        attempt: Attempt,
        mut checkpointer: Checkpointer,
        made: Made<T>,
    ) -> Result<()> {
        self.job.check_inputs()?;
        checkpointer.disk().finish()?;
        drop(checkpointer);
        self.directory.finish(attempt, made).map(|_| ())
    }

    /// Searches the part for small components, or labels it.
    fn label(&self, attempt: Attempt, number: usize) -> Result<()> {
        let (job, memory) = (self.job, self.job.plan.pool());
        let mut checkpointer = self.checkpointer(&attempt)?;
        let work = &attempt.dir;
        let (swept, left_out) = read_twice(job, work, |volume, is_slow| {
            let input = LabelInput {
                job,
                volume,
                is_slow,
                memory: &memory,
                work,
            };
            let filters = self.filters(&input, number)?;
            let swept = sweep(&input, number, &filters, &mut checkpointer)?;
            Ok((swept, left_out(&filters)))
        })?;
        swept.seam.write(&work.join(SEAM))?;
        let mut files = vec![FileSum::of(work, SEAM)?];
        let mut nan = 0;
        if number == LABELS {
            let labels = Scratch::of_sweep(work, LABELS);
            if let Some(labelled) = Labelled::read(&labels, &swept.marks, job.made)? {
                nan = labelled.nan;
                if let Some(rule) = job.options.split {
                    let mut bits = KeptBits::new(job.plan.tiling, job.made, &labelled.bands);
                    files.extend(write_columns(job, rule, &mut bits, work)?);
                }
            }
        }
        let made = Made {
            marks: swept.marks,
            files,
            result: LabelsOfPart { left_out, nan },
        };
        self.done(attempt, checkpointer, made)
    }

    /// The filters of the searches before a sweep.
    fn filters(&self, input: &LabelInput, sweep: usize) -> Result<Vec<Filter>> {
        let searches = self.rounds.searches();
        let before = searches.filter(|&number| number < sweep);
        before.map(|number| self.filter(input, number)).collect()
    }

    fn filter(&self, input: &LabelInput, sweep: usize) -> Result<Filter> {
        let (directory, part) = (self.directory, self.part);
        let round = self.rounds.number(Round::Search(sweep));
        let done: Done<LabelsOfPart> = directory.done_by(round, part)?;
        done.check_marks()?;
        let seam = Seam::read(&done.file(SEAM)?.0)?;
        let beyond = small_beyond(&directory.merged(round, part)?, &seam, part)?;
        let files = Scratch::of_sweep(&done.dir, sweep);
        let filter = Filter::read(input, sweep, &files, &done.marks, &beyond)?;
        filter.ok_or_else(|| directory.gone(part))
    }

    /// What labelling the part has found, and what merging has made of it.
    fn labels(&self) -> Result<KnownLabels> {
        let (directory, part) = (self.directory, self.part);
        let round = self.rounds.number(Round::Label);
        let done: Done<LabelsOfPart> = directory.done_by(round, part)?;
        let seam = Seam::read(&done.file(SEAM)?.0)?;
        let ids = IdsOfPart::read(&directory.merged(round, part)?, &seam, part)?;
        Ok(KnownLabels { done, ids })
    }

    /// Writes the geometry of the part's tiles.
    fn mesh(&self, attempt: Attempt) -> Result<()> {
        let (job, directory, part) = (self.job, self.directory, self.part);
        let KnownLabels { done, ids } = self.labels()?;
        done.check_marks()?;
        let mut labelled = open_labels(directory, &done, part)?;
        let shared = ids.bytes();
        let work = &attempt.dir;
        let mut checkpointer = self.checkpointer(&attempt)?;
        make_directories(work)?;
        let Labelled { slabs, spool, .. } = &mut labelled;
        let mut resolved = resolve(slabs, spool, ids.numbering, work)?;
        let (memory, writer) = (job.plan.pool(), job.tile_writer(work));
        let mut held = MemoryReservation::new(&memory, SLABS);
        held.grow_to(shared)?;
        let set = TilesetWriter::new(work)?;
        let mut each = job.made.each();
        each.try_for_each(|z| set.make_layer_directory(z))?;
        let known = KnownBands {
            tiling: job.plan.tiling,
            first: job.made.first,
            kept: &labelled.bands,
            ids: &resolved.bands,
        };
        let cells = self.given_cells(known, &memory, work)?;
        let given = cells.as_ref().map(|cells| &cells.given);
        let in_others = cells
            .as_ref()
            .map_or(&ids.shared.cells, |cells| &cells.shared);
        let (walls, meshed) = read_twice(job, work, |volume, _| {
            let input = WallsInput {
                job,
                volume,
                known,
                rows: given.map(|given| &given.rows),
                memory: &memory,
                work,
            };
            let walls = job.options.walls.then(|| write_walls(&input, in_others));
            let input = MeshInput {
                job,
                volume,
                memory: &memory,
                writer: &writer,
                known,
                cells: given,
            };
            Ok((walls.transpose()?, mesh(&input, &mut checkpointer)?))
        })?;
        let mut output = meshed.output;
        meshed.last_layer.commit(&mut checkpointer)?;
        let _tables = self.table_memory(&memory);
        let input = SumUp {
            labelled: &mut labelled,
            resolved: &mut resolved,
            meshed: &mut output,
            places: ids.places,
        };
        let (mut files, result) = self.records(input, cells, &ids.shared, work)?;
        files.extend(walls.into_iter().flatten());
        write_caps(&work.join(CAPS), &output.caps)?;
        files.push(FileSum::of(work, CAPS)?);
        let mut marks = Marks::default();
        output.mark(&checkpointer.files(TILES), &mut marks)?;
        let made = Made {
            marks,
            files,
            result,
        };
        self.done(attempt, checkpointer, made)
    }

    /// The cells of the part, where they are parts of components.
    fn given_cells(
        &self,
        known: KnownBands,
        memory: &Arc<MemoryPool>,
        work: &Path,
    ) -> Result<Option<CellsToMesh>> {
        let options = self.job.options;
        match (&options.labels, options.split) {
            (Some(labels), _) => self.labelled_cells(labels, known, memory, work),
            (None, Some(rule)) => self.cells_to_mesh(rule, known, memory, work),
            (None, None) => return Ok(None),
        }
        .map(Some)
    }

    /// Sums up what was found of components, surfaces and cells, and writes it.
    fn records(
        &self,
        input: SumUp,
        cells: Option<CellsToMesh>,
        shared: &Each<Vec<u64>>,
        work: &Path,
    ) -> Result<(Vec<FileSum>, MeshedPart)> {
        let memory = self.job.plan.tables();
        let (given, own_files, in_others) = match cells {
            Some(cells) => (Some(cells.given), cells.files, Some(cells.shared)),
            None => (None, Vec::new(), None),
        };
        let mut components = sum_up(input, given, memory, work)?;
        let mut files = own_files;
        if self.job.options.walls {
            files.push(write_areas(&components, work)?);
        }
        let Some(in_others) = in_others else {
            files.extend(write_records(work, &components, shared)?);
            return Ok((files, MeshedPart::default()));
        };
        let (part, made) = (self.part, &mut components);
        if self.job.options.labels.is_some() {
            files.push(write_pairs(made, &shared.cells, work)?);
        }
        let (records, result) = write_meshed(work, part, made, shared, &in_others)?;
        Ok(([files, records].concat(), result))
    }

    /// What the whole volume knows of the part's components, surfaces and cells, when it is meshed.
    fn components(
        &self,
        done: &Done<MeshedPart>,
        places: Each<IdPlaces>,
        work: &Path,
    ) -> Result<Components> {
        let (directory, part) = (self.directory, self.part);
        let (round, options) = (self.rounds.number(Round::Mesh), self.job.options);
        let mut components = if options.labels.is_some() {
            let merged = directory.merged(round, part)?;
            self.labelled_components(places, done, &merged, work)?
        } else if options.split.is_some() {
            let merged = directory.merged(round, part)?;
            self.split_components(places, done, &merged, work)?
        } else {
            let empty = Components::none_yet(places, self.job.plan.tables(), work)?;
            read_records(empty, done, &directory.merged::<()>(round, part)?, part)?
        };
        if options.walls {
            self.add_walls(&mut components, round, work)?;
        }
        Ok(components)
    }

    /// The memory that tables may take.
    fn table_memory(&self, memory: &Arc<MemoryPool>) -> MemoryReservation {
        let mut tables = MemoryReservation::new(memory, TABLES);
        tables.grow_as_far_as(self.job.plan.tables());
        tables
    }

    /// Gives the part's tiles their JSON, and writes their index and rows of tables.
    fn finish(&self, attempt: Attempt) -> Result<()> {
        let (job, directory, part) = (self.job, self.directory, self.part);
        let KnownLabels { done: labels, ids } = self.labels()?;
        let round = self.rounds.number(Round::Mesh);
        let done: Done<MeshedPart> = directory.done_by(round, part)?;
        done.check_marks()?;
        let work = &attempt.dir;
        let mut checkpointer = self.checkpointer(&attempt)?;
        make_directories(work)?;
        let memory = job.plan.pool();
        let _tables = self.table_memory(&memory);
        let components = self.components(&done, ids.places, work)?;
        let caps = read_caps(&done.file(CAPS)?.0)?;
        let files = Scratch::of_sweep(&done.dir, TILES);
        let tiles = MeshOutput::open(&files, &done.marks, job.made, caps)?;
        let mut tiles = tiles.ok_or_else(|| directory.gone(part))?;
        let measured = job.options.measured(&job.grid.header().placement)?;
        let mut set = TilesetWriter::new(work)?;
        let input = FinalizeInput {
            job,
            memory: &memory,
            // the tiles lie where they were meshed; whoever finishes them writes the same
            writer: &job.tile_writer(&done.dir),
            set: &mut set,
            placement: &measured,
            tiles: &mut tiles,
            components: &components,
            checkpointer: &mut checkpointer,
        };
        let tables = finalize(input, |components, stop| {
            write_tables(work, components, &measured, stop)
        })?;
        let sums = ScannedSums {
            caps,
            nan: labels.result.nan,
        };
        let mut voxels_below = 0;
        for place in 0..components.own_cells() {
            voxels_below += components.cells.get(place)?.voxels.voxels;
        }
        let result = FinishedPart {
            totals: sums.totals(set.written(), &components, job.options.cap)?,
            voxels_below,
            index_and_tables: set.index_bytes() + tables,
        };
        let made = Made {
            marks: Marks::default(),
            files: finished_files(work, &mut set, &self::tables(job.options))?,
            result,
        };
        self.done(attempt, checkpointer, made)
    }
}

/// The files that finishing a part leaves, but for tiles and shards.
fn finished_files(work: &Path, set: &mut TilesetWriter, tables: &[&str]) -> Result<Vec<FileSum>> {
    let mut layers = SpillFile::create(&work.join(LAYERS))?;
    let records: Vec<LayerRecord> = set.layer_records()?;
    layers.push(&records)?;
    layers.mark()?;
    let names = [LAYERS].iter().chain(tables);
    names.map(|name| FileSum::of(work, name)).collect()
}

fn write_caps(path: &Path, caps: &MeshSums) -> Result<()> {
    let mut out = Encoder::create(path)?;
    out.array(&[*caps])?;
    out.finish()
}

fn read_caps(path: &Path) -> Result<MeshSums> {
    let bytes = std::fs::read(path).map_err(|e| Error::io(path, "read", e))?;
    let caps = Decoder::new(bytes).and_then(|mut input| input.array::<MeshSums>()?.pop());
    caps.ok_or_else(|| Error::format(path, "other bytes", "sums over caps"))
}
