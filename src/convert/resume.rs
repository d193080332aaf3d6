//! What a conversion finds in its output directory: nothing, a part of itself, or all of it.

use crate::checkpoint::{Checkpointer, Identity, LayersDone, boot, kept};
use crate::convert::conversion::{Conversion, Made};
use crate::convert::identity;
use crate::convert::warnings::warnings;
use crate::error::{Error, Result};
use crate::manifest::{Layer, Manifest, PARTIAL, PartsBy};
use crate::progress::Progress;
use crate::tileset::{Output, interrupted, remove_if, tidy};
use std::fs::File;
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;

/// Goes on with what an interrupted conversion left, if that is asked for and there is any, or makes
/// the work directory empty.
///
/// # Errors
/// [`Error::OutputInterrupted`] if there is any and neither `resume` nor `force` is set; those of
/// [`Checkpointer::resume`]; [`Error::Io`].
pub fn begin(
    output: &mut Output,
    out: &Path,
    job: &Conversion,
    identity: &Identity,
) -> Result<Checkpointer> {
    let (options, progress, layers) = (job.options, job.progress, job.layers());
    let dust = options.min_voxels > 1;
    let work = output.work().to_path_buf();
    // whatever happens now, what is there is not to be lost
    output.keep(true);
    let before = kept(&work);
    if !options.resume && !options.force {
        refuse_kept(out, before)?;
    }
    if options.resume {
        if let Some(checkpointer) = Checkpointer::resume(&work, out, identity, dust, layers)? {
            let (kept, finished) = (checkpointer.kept(), checkpointer.finished());
            let of = before.map_or(0, |b| b.of);
            let index = match finished {
                0 => String::new(),
                n => format!(", and {n} in the index"),
            };
            progress.warn(&format!("resuming: {kept} of {of} layers were done{index}"));
            return Ok(checkpointer);
        }
    } else if let Some(LayersDone { done, of }) = before {
        progress.warn(&format!(
            "dropping {done} of {of} layers of an interrupted conversion"
        ));
    }
    output.clear()?;
    output.keep(false);
    Checkpointer::new(&work, identity, dust, layers)
}

/// Refuses to drop layers that an interrupted conversion has done.
pub fn refuse_kept(out: &Path, kept: Option<LayersDone>) -> Result<()> {
    match kept {
        None => Ok(()),
        Some(LayersDone { done, of }) => Err(Error::OutputInterrupted {
            path: out.to_path_buf(),
            done,
            of,
        }),
    }
}

/// What was made, if it was being moved into place.
pub fn commit_begun(output: &Output, identity: &Identity) -> Option<Made> {
    let made: Made = serde_json::from_slice(&output.moving()?).ok()?;
    let same = Checkpointer::differences(output.work(), identity)?.is_empty();
    let counts = made.boot.as_ref().is_none_or(|then| *then == boot());
    (same && counts).then_some(made)
}

/// Takes the bytes that its input has, and no others.
struct Same(BufReader<File>);

impl Write for Same {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let mut own = vec![0; bytes.len()];
        self.0.read_exact(&mut own)?;
        match own == bytes {
            true => Ok(own.len()),
            false => Err(std::io::Error::other("it differs")),
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

/// True if this conversion was interrupted in `out`, and there is something to go on from.
pub fn is_begun(out: &Path, identity: &Identity) -> bool {
    let same = |d: Vec<String>| d.is_empty();
    let work = out.join(PARTIAL);
    kept(&work).is_some() && Checkpointer::differences(&work, identity).is_some_and(same)
}

/// Removes what was begun beside the whole tile set of this conversion in `out`, unless it is another conversion.
///
/// # Errors
/// As of [`tidy`].
pub fn tidy_beside(out: &Path, identity: &Identity, progress: &dyn Progress) -> Result<()> {
    tidy(out)?;
    if is_begun(out, identity) {
        remove_if(out, || is_begun(out, identity))?;
        progress.warn("what was begun beside it, to make the same tile set once more, was removed");
    } else if interrupted(out).is_some() {
        progress.warn(&format!(
            "what another conversion has begun beside it is left: that one goes on when it is typed again with --force and \
             --resume; this one with --force and without --resume drops it, and so does removing {}",
            out.join(PARTIAL).display()
        ));
    }
    Ok(())
}

/// Refuses a whole tile set in `out` that was made of something else, or otherwise; `begun` says that this conversion
/// was begun in place of it.
///
/// # Errors
/// [`Error::OtherTileSet`].
pub fn refuse_other(job: &Conversion, out: &Path, begun: bool) -> Result<()> {
    let Ok(found) = Manifest::open(out) else {
        return Ok(());
    };
    let differences = identity::of_set(&job.asked()).differences(&identity::of_set(&found));
    match differences.is_empty() {
        true => Ok(()),
        false => Err(Error::OtherTileSet {
            path: out.to_path_buf(),
            differences: differences.join("; "),
            begun,
        }),
    }
}

/// What is asked for of cells, with what is known of them at the end as it was found.
fn same_cells(asked: Option<PartsBy>, found: Option<&PartsBy>) -> Option<PartsBy> {
    let mut asked = asked?;
    match (&mut asked, found) {
        (
            PartsBy::Labels { unlabelled, .. },
            Some(PartsBy::Labels {
                unlabelled: found, ..
            }),
        ) => unlabelled.clone_from(found),
        (PartsBy::Split { curve, .. }, Some(PartsBy::Split { curve: found, .. })) => {
            curve.clone_from(found);
        }
        _ => {}
    }
    Some(asked)
}

/// What was made, if `out` holds the tile set that is asked for, and the input did not change since.
pub fn complete(job: &Conversion, out: &Path) -> Option<Made> {
    let options = job.options;
    let index = out.join("index.json");
    let file = BufReader::new(File::open(&index).ok()?);
    let found: Manifest = serde_json::from_reader(file).ok()?;
    let min_voxels = found.dust.map_or(1, |d| d.min_voxels);
    let same = Manifest {
        dust: found.dust,
        // as much of it as is known before
        cells: same_cells(job.stated_cells(0, &[]), found.cells.as_ref()),
        // levels are made of a set that is whole
        lod: found.lod.clone(),
        ..job.manifest(found.totals)
    };
    let mut as_it_is = Same(BufReader::new(File::open(&index).ok()?));
    let layers =
        &mut |each: &mut dyn FnMut(&Layer) -> Result<()>| found.layers.iter().try_for_each(each);
    same.seal(out, layers, &mut as_it_is).ok()?;
    if !as_it_is.0.fill_buf().ok()?.is_empty() || min_voxels != options.min_voxels.max(1) {
        return None;
    }
    let made = std::fs::metadata(&index).and_then(|m| m.modified()).ok()?;
    if options
        .input
        .last_change
        .is_some_and(|change| change > made)
    {
        job.progress
            .warn("the input has changed since the tile set in the directory was made");
        return None;
    }
    let mut size = found.totals.bytes + std::fs::metadata(&index).ok()?.len();
    size += found.layers.iter().map(|l| l.bytes).sum::<u64>();
    let tables = &found.tables;
    let always = [&tables.cells, &tables.objects, &tables.surfaces];
    let more = [&tables.components, &tables.necks, &tables.walls];
    for table in always.into_iter().chain(more.into_iter().flatten()) {
        size += std::fs::metadata(out.join(table)).ok()?.len();
    }
    Some(Made {
        totals: found.totals,
        bytes: size,
        warnings: warnings(
            &found.totals,
            job.plan.tiling.dims,
            options.threshold,
            found.dust,
        ),
        boot: None,
    })
}
