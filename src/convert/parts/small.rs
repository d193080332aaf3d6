//! Which small components are left out of a volume that is searched in parts.

use crate::convert::label::{Arrival, Beyond, LeftOut, Seam};
use crate::convert::parts::directory::{Directory, Done, Made};
use crate::convert::parts::handed_out::HandedOut;
use crate::convert::parts::ids::unfit;
use crate::convert::parts::join::{Contributions, Joiner};
use crate::convert::parts::work::{LabelsOfPart, SEAM};
use crate::error::Result;
use crate::sys::memory_pool::MemoryPool;
use bytemuck::{Pod, Zeroable};
use serde::{Deserialize, Serialize};
use std::path::Path;
use std::sync::Arc;

/// What is known of a component that goes on in another part.
#[repr(C)]
#[derive(Debug, Clone, Copy, Pod, Zeroable)]
struct Known {
    voxels: u64,
    above: u64,
}

/// What is searched for.
#[derive(Debug, Clone, Copy)]
pub struct SmallSearch {
    /// Objects, else cells.
    pub above: bool,
    /// Of fewer voxels.
    pub min_voxels: u64,
}

/// What came of merging: how many of the components that lie in several parts are left out, and their voxels.
#[derive(Debug, Clone, Copy, Default, Serialize, Deserialize)]
pub struct MergedSmall {
    /// Components.
    pub components: u64,
    /// Their voxels.
    pub voxels: u64,
}

/// What the filters of objects and of cells leave out that lies in several parts.
pub fn left_out(merged: &[MergedSmall]) -> LeftOut {
    match merged {
        [objects, cells] => [objects, cells].map(|small| (small.components, small.voxels)),
        _ => LeftOut::default(),
    }
}

/// 1 for each component that is left out; nothing stands before.
type SmallOfPart = HandedOut<u8, u8>;

fn file_of(part: u32) -> String {
    format!("part-{part:04}.small")
}

/// Decides which components of one phase that lie in several parts have fewer voxels than are to be left.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if what the parts have left is damaged or does not fit.
pub fn merge_small(
    directory: &Directory,
    round: u32,
    dir: &Path,
    search: SmallSearch,
    memory: &Arc<MemoryPool>,
) -> Result<Made<MergedSmall>> {
    let SmallSearch { above, min_voxels } = search;
    let mut joiner = Joiner::new(dir, memory)?;
    for part in 0..directory.parts() {
        let done: Done<LabelsOfPart> = directory.done_by(round, part)?;
        let (path, _) = done.file(SEAM)?;
        let seam = Seam::read(&path)?;
        let leaving = seam.leaving.iter().map(|leaving| {
            Some(Known {
                voxels: leaving.voxels,
                above: leaving.above,
            })
        });
        let contributions = Contributions {
            ended: |arrival: &Arrival| {
                Some(Known {
                    voxels: arrival.voxels,
                    above: arrival.above,
                })
            },
            leaving: leaving.collect(),
        };
        let joined = joiner.add(&seam, contributions, |one: &mut Known, other| {
            // more than any number if it leaves the region of interest
            one.voxels = one.voxels.saturating_add(other.voxels);
            Ok(())
        })?;
        joined.map_err(|misfit| unfit(directory, part, misfit))?;
    }
    let (mut result, mut files) = (MergedSmall::default(), Vec::new());
    joiner.finish(
        |known| {
            let is_small = (known.above == 1) == above && known.voxels < min_voxels;
            if is_small {
                result.components += 1;
                result.voxels += known.voxels;
            }
            Ok(u8::from(is_small))
        },
        |part, arrivals, leaving| {
            let small = SmallOfPart {
                head: Vec::new(),
                arrivals,
                leaving,
            };
            files.push(small.write(dir, &file_of(part))?);
            Ok(())
        },
    )?;
    Ok(Made {
        marks: Default::default(),
        files,
        result,
    })
}

/// Which of the components of a part that lie in others, too, are to be left out: 1 for those.
///
/// # Errors
/// [`crate::Error::Io`]; [`crate::Error::Format`] if the file is damaged.
pub fn small_beyond(merged: &Done<MergedSmall>, seam: &Seam, part: u32) -> Result<Beyond<u8>> {
    let SmallOfPart {
        arrivals, leaving, ..
    } = SmallOfPart::read(merged, &file_of(part), seam)?;
    Ok(Beyond::of(seam, &arrivals, leaving))
}
