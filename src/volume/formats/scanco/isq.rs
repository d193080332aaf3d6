//! ISQ (and RSQ): a header in blocks of 512 bytes, then samples of i16. Sizes of the whole are in micrometres.

use crate::error::{Error, Result};
use crate::grid::Dims;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::format::Format;
use crate::volume::formats::scanco::{attenuation, i32_at};
use crate::volume::io::data::{Data, Encoding, Start};
use crate::volume::stated::size::{Step, voxel_size};
use crate::volume::{Dtype, Endian};
use std::path::Path;

/// The format.
pub(crate) const FORMAT: Format = Format {
    name: "isq",
    title: "Scanco ISQ",
    extensions: &["isq", "rsq"],
    starts: |head| head.starts_with(MAGIC),
    parse: Some(|input, _| parse(input.path, input.head)),
    ..Format::BASE
};

const MAGIC: &[u8] = b"CTDATA-HEADER_V1";
const BLOCK: u64 = 512;
/// A scout view, which is flat.
const SCOUT: i32 = 9;

/// Parses a header.
///
/// # Errors
/// [`Error::Format`] for a header that is cut short or of impossible sizes, [`Error::Unsupported`] for scout views.
fn parse(path: &Path, head: &[u8]) -> Result<VolumeDescriptor> {
    if (head.len() as u64) < BLOCK {
        let found = format!("a header of {} bytes", head.len());
        return Err(Error::format(path, found, "512 bytes of an ISQ"));
    }
    let three = |at: usize| [0, 4, 8].map(|by| i32_at(head, at + by));
    let (voxels, lengths) = (three(44), three(56));
    if i32_at(head, 16) == SCOUT || lengths[2] == 0 && voxels[2] <= 1 {
        let hint = "it is a flat picture for planning a scan: give the ISQ";
        return Err(Error::unsupported(path, "a scout view of Scanco", hint));
    }
    let sizes = voxels.map(|n| u64::try_from(n).unwrap_or(0));
    let dims = Dims::new(sizes).map_err(|e| e.of_header(path, "a volume"))?;
    let blocks = i32_at(head, 508);
    let Ok(blocks) = u64::try_from(blocks) else {
        let found = format!("samples that begin at block {blocks}");
        return Err(Error::format(path, found, "a block behind the header"));
    };
    let step = |a: usize| {
        let size = f64::from(lengths[a]) / f64::from(dims.0[a]);
        (lengths[a] != 0).then(|| Step::new(size, "um"))
    };
    let samples = Samples::Files(Data {
        files: vec![path.to_path_buf()],
        start: Start::At {
            base: 0,
            lines: 0,
            bytes: (blocks + 1) * BLOCK,
            stated: true,
        },
        encoding: Encoding::Raw,
    });
    let mut found = VolumeDescriptor::new("isq", dims, Dtype::I16, samples);
    found.endian = Some(Endian::Little);
    found.values = attenuation(i32_at(head, 88).into());
    if found.values.is_none() {
        let note = "the header states no scale of attenuation: values are as they are stored";
        found.notes.push(note.into());
    }
    let size = voxel_size([step(0), step(1), step(2)]);
    size.apply(&mut found.placement, &mut found.provenance);
    found.warnings.extend(size.warning);
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::Unit;
    use crate::volume::{OpenOptions, Opened, open};

    /// A volume of 4 x 3 x 2 whose samples count up, in blocks behind `blocks` others.
    fn isq(kind: i32, lengths: [i32; 3], scaling: i32, blocks: i32) -> Vec<u8> {
        let mut out = MAGIC.to_vec();
        let words = [&[kind, 48, 0, 1, 2, 0, 0, 4, 3, 2][..], &lengths].concat();
        out.extend(words.iter().flat_map(|w| w.to_le_bytes()));
        out.resize(88, 0);
        out.extend(scaling.to_le_bytes());
        out.resize(508, 0);
        out.extend(blocks.to_le_bytes());
        out.resize(512 * (1 + blocks.max(0)) as usize, 0);
        out.extend((0..24i16).flat_map(|v| (v * 100 - 50).to_le_bytes()));
        out
    }

    fn opened(bytes: &[u8]) -> Result<Opened> {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("v.isq");
        std::fs::write(&path, bytes).unwrap();
        open(&path, &OpenOptions::default())
    }

    #[test]
    fn values_are_attenuation_where_a_scale_is_stated() {
        let scaled = opened(&isq(3, [400, 300, 1000], 4096, 1)).unwrap();
        let header = scaled.volume.header();
        assert_eq!((header.dims.0, header.dtype), ([4, 3, 2], Dtype::F32));
        let place = header.placement;
        assert_eq!(
            (place.spacing, place.unit),
            ([100.0, 100.0, 500.0], Unit::Micrometre)
        );
        let mut out = [0; 8];
        scaled.volume.read_box(0..2, 0..1, 0..1, &mut out).unwrap();
        let values: [f32; 2] = bytemuck::pod_read_unaligned(&out);
        assert_eq!(values, [-50.0 / 4096.0, 50.0 / 4096.0]);
        let plain = opened(&isq(3, [400, 300, 1000], 0, 3)).unwrap();
        assert_eq!(plain.volume.header().dtype, Dtype::I16);
        assert!(
            plain.notes[0].contains("as they are stored"),
            "{:?}",
            plain.notes
        );
    }

    #[test]
    fn what_is_no_volume_is_refused() {
        let whole = isq(3, [400, 300, 1000], 4096, 0);
        for (bytes, says) in [
            (isq(9, [400, 300, 0], 4096, 0), "scout view"),
            (isq(3, [400, 300, 1000], 4096, -2), "block -2"),
            (whole[..whole.len() - 1].to_vec(), "559 bytes"),
            (whole[..300].to_vec(), "a header of 300 bytes"),
        ] {
            let said = opened(&bytes).unwrap_err().to_string();
            assert!(said.contains(says), "{says}: {said}");
        }
        let unplaced = opened(&isq(3, [400, 300, -7], 4096, 0)).unwrap();
        assert!(
            unplaced.warnings[0].contains("--spacing"),
            "{:?}",
            unplaced.warnings
        );
    }
}
