//! The last thing that merging does: what the finished parts have made becomes one tile set.

use crate::convert::conversion::{Conversion, Made};
use crate::convert::label::LeftOut;
use crate::convert::parts::directory::{Directory, Done, FileSum, each_block};
use crate::convert::parts::rounds::{Round, Rounds};
use crate::convert::parts::small::left_out;
use crate::convert::parts::split::{MergedCells, MeshedPart};
use crate::convert::parts::work::{FinishedPart, LAYERS, LabelsOfPart, tables};
use crate::convert::totals::{dust_of, together};
use crate::convert::warnings::warnings;
use crate::error::{Error, Result};
use crate::manifest::{LayerRecord, Manifest, Totals, shard_path, sums_of};
use crate::tileset::{Output, PLAN, TilesetWriter, layer_directory, make_directories};
use serde::de::IgnoredAny;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::Path;

/// Joins what all parts have made.
pub struct Commit<'a> {
    /// The conversion of the whole volume.
    pub job: &'a Conversion<'a>,
    /// Where the parts work.
    pub directory: &'a Directory,
    /// The rounds.
    pub rounds: Rounds,
}

impl Commit<'_> {
    /// Makes the tile set and moves it into place.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Format`] if anything is damaged or does not fit together.
    pub fn run(&self) -> Result<Made> {
        let mut output = Output::open_planned(&self.directory.out)?;
        if !self.directory.work.join(PLAN).exists() {
            // another merge was first, and has removed what there was
            output.keep(false);
            let path = self.directory.out.clone();
            return Err(Error::OutputBusy { path });
        }
        if let Some(note) = output.moving() {
            let made = serde_json::from_slice(&note).map_err(|_| {
                let path = &self.directory.work;
                Error::format(path, "a damaged note of what was made", "that of a merge")
            })?;
            output.move_in()?;
            return Ok(made);
        }
        let made = self.make()?;
        self.job.check_inputs()?;
        let note = serde_json::to_vec(&made).expect("plain data serialises");
        output.begin_commit(&note)?;
        output.move_in()?;
        Ok(made)
    }

    fn make(&self) -> Result<Made> {
        let (job, directory) = (self.job, self.directory);
        let work = &directory.work;
        make_directories(work)?;
        let mut set = TilesetWriter::new(work)?;
        let (mut totals, mut voxels_below, mut bytes) = (Totals::default(), 0, 0);
        let finish = self.rounds.number(Round::Finish);
        let mut parts = Vec::new();
        for part in 0..directory.parts() {
            let done: Done<FinishedPart> = directory.done_by(finish, part)?;
            self.take_layers(part, &done, &mut set)?;
            let FinishedPart {
                totals: own,
                voxels_below: below,
                index_and_tables,
            } = &done.result;
            totals = together(totals, own);
            voxels_below += below;
            bytes += index_and_tables;
            parts.push(done);
        }
        self.check(&totals, voxels_below)?;
        for name in tables(job.options) {
            self.join_table(name, &parts)?;
        }
        let dust = dust_of(job.options, self.left_out()?);
        let (dims, threshold) = (job.plan.tiling.dims, job.options.threshold);
        let mut warnings = warnings(&totals, dims, threshold, dust);
        let cells = job.stated_cells(self.unlabelled()?, &self.curve()?);
        let of_parts = cells.as_ref();
        let in_region = job.options.region.is_some();
        let more = of_parts.and_then(|parts| parts.warning(totals.cells, in_region));
        warnings.extend(more);
        warnings
            .iter()
            .for_each(|warning| job.progress.warn(warning));
        let manifest = Manifest {
            dust,
            cells,
            ..job.manifest(totals)
        };
        bytes += totals.bytes + set.finish(manifest)?;
        Ok(Made {
            totals,
            bytes,
            warnings,
            boot: None,
        })
    }

    /// Moves the tiles and shards of a part to their places.
    fn take_layers(
        &self,
        part: u32,
        done: &Done<FinishedPart>,
        set: &mut TilesetWriter,
    ) -> Result<()> {
        let directory = self.directory;
        let mesh = self.rounds.number(Round::Mesh);
        let meshed: Done<IgnoredAny> = directory.done_by(mesh, part)?;
        done.spool(LAYERS)?.each(|layer: LayerRecord| {
            let name = layer_directory(layer.z);
            move_once(&meshed.dir.join(&name), &directory.work.join(&name))?;
            let name = shard_path(layer.z);
            let shard = directory.work.join(&name);
            move_once(&done.dir.join(&name), &shard)?;
            let file = File::open(&shard).map_err(|e| Error::io(&shard, "read", e))?;
            let (bytes, crc) = sums_of(&file).map_err(|e| Error::io(&shard, "read", e))?;
            let sum = |bytes, crc| FileSum {
                path: name.clone(),
                bytes,
                crc,
            };
            done.check_file(&shard, &sum(bytes, crc), &sum(layer.bytes, layer.crc))?;
            set.add_layer(layer, &Totals::default())
        })
    }

    /// Refuses sums that no volume has: something went wrong with a part then.
    fn check(&self, totals: &Totals, voxels_below: u64) -> Result<()> {
        let out = &self.directory.out;
        let all = self.job.plan.tiling.dims.voxels();
        let found = totals.voxels_above + voxels_below;
        if found != all {
            let found = format!("components of {found} voxels");
            return Err(Error::format(
                out,
                found,
                format!("{all}, as the volume has"),
            ));
        }
        let Totals {
            objects,
            cells,
            surfaces,
            ..
        } = totals;
        // surfaces of cells that are parts of components are counted by cells
        if !self.job.options.has_parts() && surfaces + 1 != objects + cells {
            let found = format!("{objects} objects, {cells} cells and {surfaces} surfaces");
            let expected = "one surface less than objects and cells";
            return Err(Error::format(out, found, expected));
        }
        Ok(())
    }

    /// How many cells there are at each ratio, where they are split.
    fn curve(&self) -> Result<Vec<[u64; 2]>> {
        if self.job.options.split.is_none() {
            return Ok(Vec::new());
        }
        let round = self.rounds.number(Round::Saddles);
        let merged: Done<MergedCells> = self.directory.merged(round, 0)?;
        Ok(merged.result.curve)
    }

    /// Voxels below that labels give to no cell.
    fn unlabelled(&self) -> Result<u64> {
        let (directory, mesh) = (self.directory, self.rounds.number(Round::Mesh));
        let mut sum = 0;
        for part in 0..directory.parts() {
            sum += directory
                .done_by::<MeshedPart>(mesh, part)?
                .result
                .unlabelled;
        }
        Ok(sum)
    }

    /// What was left out as small, by all parts and between them.
    fn left_out(&self) -> Result<LeftOut> {
        let (directory, rounds) = (self.directory, self.rounds);
        let mut merged = Vec::new();
        for sweep in rounds.searches() {
            let round = rounds.number(Round::Search(sweep));
            merged.push(directory.merged(round, 0)?.result);
        }
        let mut sum = left_out(&merged);
        for part in 0..directory.parts() {
            let own: Done<LabelsOfPart> = directory.done_by(rounds.number(Round::Label), part)?;
            for (sum, own) in sum.iter_mut().zip(own.result.left_out) {
                sum.0 += own.0;
                sum.1 += own.1;
            }
        }
        Ok(sum)
    }

    /// Joins the rows that the parts have of a table.
    fn join_table(&self, name: &str, parts: &[Done<FinishedPart>]) -> Result<()> {
        let path = self.directory.work.join(name);
        let new = path.with_extension(format!("new-{}", std::process::id()));
        let failed = |e| Error::io(&new, "write", e);
        let file = File::create(&new).map_err(|e| Error::io(&new, "create", e))?;
        let mut out = BufWriter::with_capacity(1 << 18, file);
        for part in parts {
            let from = part.dir.join(name);
            let mut crc = crc32fast::Hasher::new();
            let bytes = each_block(&from, |block| {
                crc.update(block);
                out.write_all(block).map_err(failed)
            })?;
            let found = FileSum {
                path: name.to_owned(),
                bytes,
                crc: crc.finalize(),
            };
            part.check_file(&from, &found, part.sum(name)?)?;
        }
        out.flush().map_err(failed)?;
        std::fs::rename(&new, &path).map_err(|e| Error::io(&path, "move into place", e))
    }
}

/// Moves a file or directory, unless that was done by a merge that was interrupted.
fn move_once(from: &Path, to: &Path) -> Result<()> {
    match std::fs::rename(from, to) {
        Err(_) if to.exists() => Ok(()),
        moved => moved.map_err(|e| Error::io(from, "move into place", e)),
    }
}
