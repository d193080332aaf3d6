//! Makes plans.

use crate::checkpoint::Identity;
use crate::convert::conversion::Conversion;
use crate::convert::layers::Layers;
use crate::convert::parts::directory::{Asked, Directory, FORMAT, Plan};
use crate::convert::parts::rounds::Rounds;
use crate::convert::resume::refuse_kept;
use crate::convert::{ConvertOptions, LabelRows, identity, predict, with_conversion};
use crate::error::{Error, Result};
use crate::manifest::MANIFEST;
use crate::progress::Quiet;
use crate::tileset::{Output, interrupted, refuse_bucket};
use crate::volume::{Stamp, Volume};
use serde::Serialize;
use std::path::Path;

/// What a plan will cost.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct PartsPlan {
    /// How many parts there are.
    pub parts: u32,
    /// How many rounds they do.
    pub rounds: u32,
    /// The peak of resident memory that work on a part is predicted to have.
    pub memory_bytes: u64,
}

/// Rows at both ends of the input whose samples tell it from others: as many as these bytes have.
const LOOKED_AT: u64 = 1 << 20;

/// Everything that the parts depend on. Nodes may find the input elsewhere, and tell times of other precision, so that
/// instead of its place some of its samples count.
pub fn identity_of(job: &Conversion) -> Result<Identity> {
    let mut input: Stamp = job.options.input.clone();
    input.values = stamped(&input, "input");
    input
        .values
        .push(("samples of the input".into(), looked_at(job.volume)?));
    if let Some(labels) = &job.options.labels
        && let LabelRows::OnDemand(labels) = &labels.rows
    {
        let values = stamped(&labels.stamp, "labels").into_iter();
        input.values.extend(values);
        let looked_at = looked_at(&*labels.volume)?;
        input
            .values
            .push(("samples of the labels".into(), looked_at));
    }
    Ok(identity::of(&input, &job.asked()))
}

/// What a stamp says that is the same wherever the file is found, of the input or of what else is `named`.
fn stamped(stamp: &Stamp, named: &str) -> Vec<(String, String)> {
    let values = stamp.values.iter().filter(|(name, _)| name != "input");
    let values = values.map(|(name, value)| {
        let whole = match name.as_str() {
            "last change of the input" => value
                .split_once('.')
                .map(|(s, _)| format!("{s} s after 1970")),
            "files of the input" => value.split_once(',').map(|(files, _)| files.to_owned()),
            _ => None,
        };
        let name = name.replace("the input", &format!("the {named}"));
        (name, whole.unwrap_or_else(|| value.clone()))
    });
    values.collect()
}

/// A checksum of the first and the last samples of a volume.
fn looked_at(volume: &dyn Volume) -> Result<String> {
    let header = volume.header();
    let [nx, ny, nz] = header.dims.0;
    let row = u64::from(nx) * header.dtype.bytes() as u64;
    let rows = (LOOKED_AT / row).clamp(1, ny.into()) as u32;
    let mut samples = vec![0; (row * u64::from(rows)) as usize];
    let mut hasher = crc32fast::Hasher::new();
    for (y, z) in [(0..rows, 0), (ny - rows..ny, nz - 1)] {
        volume.read_box(0..nx, y, z..z + 1, &mut samples)?;
        hasher.update(&samples);
    }
    Ok(format!("CRC-32 {:08x} at its ends", hasher.finalize()))
}

/// Cuts layers to parts that differ by one layer at most.
fn cut(layers: u32, parts: u32) -> Vec<[u32; 2]> {
    let end = |part: u32| (u64::from(layers) * u64::from(part) / u64::from(parts)) as u32;
    (0..parts).map(|part| [end(part), end(part + 1)]).collect()
}

/// Refuses a plan that [`plan_parts`] would refuse before it reads any sample, whatever the threshold and the region;
/// `in_region` tells whether there will be one.
///
/// # Errors
/// As of [`plan_parts`].
pub fn check_plan(
    volume: &dyn Volume,
    options: &ConvertOptions,
    in_region: bool,
    out: &Path,
) -> Result<()> {
    check(volume, options)?;
    refuse_tile_set(out)?;
    predict(volume, options, in_region).map(|_| ())
}

/// Refuses a place in a bucket: attempts and tiles are moved and changed where they lie.
///
/// # Errors
/// [`Error::Unsupported`].
pub fn refuse_parts_in_bucket(out: &Path) -> Result<()> {
    refuse_bucket(out).map_err(|refused| {
        refused.with_hint(
            "plan into a directory that all machines share; when `alvis merge` has ended with status 0, copy that to the \
             bucket, index.json last",
        )
    })
}

fn refuse_tile_set(out: &Path) -> Result<()> {
    refuse_parts_in_bucket(out)?;
    if !out.join(MANIFEST).exists() {
        return Ok(());
    }
    let found = format!("{}, which holds a tile set", out.display());
    let expected = "another directory: parts are not made where a tile set is";
    Err(Error::usage("OUT", found, expected))
}

/// Refuses what is not converted in parts.
fn check(volume: &dyn Volume, options: &ConvertOptions) -> Result<()> {
    if !volume.random_access() {
        let found = format!("{}, which is packed as one stream", options.source_name);
        let expected = "an input of which each part can be read by itself";
        return Err(Error::usage("INPUT", found, expected)
            .with_hint("unpack it first, as by `gunzip -k` or `zstd -d`"));
    }
    Ok(())
}

/// Plans the conversion of a volume into the directory `out` in so many parts. If the same plan is there already, it stays,
/// with all that its parts have done; `options.force` drops another one.
///
/// # Errors
/// [`Error::Usage`] if there are not as many layers, or for what is not converted in parts; [`Error::OtherPlan`] if another
/// plan is there; those of [`predicted_memory`](crate::convert::predicted_memory) and
/// [`check_unused`](crate::convert::check_unused), also with `options.force` if a tile set is there.
pub fn plan_parts(
    volume: &dyn Volume,
    options: &ConvertOptions,
    out: &Path,
    parts: u32,
    asked: Asked,
) -> Result<PartsPlan> {
    check(volume, options)?;
    refuse_tile_set(out)?;
    with_conversion(volume, options, &Quiet, Layers::all, |job| {
        check(job.grid, options)?;
        let layers = job.layers();
        if parts == 0 || parts > layers {
            let expected = format!(
                "1 to {layers}: the volume has so many layers of macrocubes of {} voxels along z, of which a part has at least one",
                options.macrocube[2]
            );
            return Err(Error::usage("--parts", parts.to_string(), expected));
        }
        let rounds = Rounds::of(options);
        let plan = Plan {
            format: FORMAT,
            identity: identity_of(job)?.into_list(),
            parts: cut(layers, parts),
            rounds,
            asked,
        };
        write_plan(options, out, &plan)?;
        Ok(PartsPlan {
            parts,
            rounds: rounds.count(),
            memory_bytes: job.plan.memory,
        })
    })
}

/// Writes a plan, unless the same one is there.
fn write_plan(options: &ConvertOptions, out: &Path, plan: &Plan) -> Result<()> {
    refuse_tile_set(out)?;
    match Directory::open(out) {
        Ok(Some(before)) if !options.force => {
            before.check(&Identity::new(plan.identity.clone()))?;
            let [was, is] = [&before.plan.parts, &plan.parts].map(Vec::len);
            if was != is {
                return Err(Error::OtherPlan {
                    path: out.to_path_buf(),
                    differences: format!("--parts was {was} and is {is}"),
                });
            }
            return Ok(());
        }
        Err(e) if !options.force => return Err(e),
        _ => {}
    }
    if !options.force {
        refuse_kept(out, interrupted(out))?;
    }
    let mut output = Output::open(out, options.force, false)?;
    output.clear()?;
    let is_ours = Directory::create(output.work(), plan)?;
    output.keep(true);
    match is_ours {
        true => Ok(()),
        // somebody else was first, where the file system has no locks
        false => Err(Error::OutputBusy {
            path: out.to_path_buf(),
        }),
    }
}
