//! What kind of values a volume holds: those of a mask, labels, or grey values.
//!
//! A share of the rows that a pass over the volume reads is looked at, the same ones whatever the pieces: few of a
//! large volume, all of a small one.

use crate::error::Result;
use crate::sys::locks::lock;
use crate::volume::{Dtype, Header, Volume, Voxel, hand_on, with_voxel_type};
use std::collections::BTreeSet;
use std::ops::Range;
use std::path::Path;
use std::sync::Mutex;

/// The most rows that are looked at, and the most samples, unless a few rows have more.
const ROWS: u64 = 8192;
const SAMPLES: u64 = 8 << 20;
const LEAST_ROWS: u64 = 64;
/// More values than labels have.
const MOST: usize = 1024;
/// So few values are few.
const FEW: usize = 16;
/// Samples of the same value in a row that are few.
const SHORT: usize = 2;

/// What the values of a volume look like.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Kind {
    /// Two values, the lower one first; NaN counts as one and is the lower one.
    Mask([f64; 2]),
    /// Few values in large regions without anything between them: the values, by rising size.
    Labels(Vec<f64>),
}

impl Kind {
    /// What a user should know of it.
    pub fn warning(&self) -> String {
        match self {
            Kind::Mask([low, high]) => {
                let half_way = match low.is_nan() {
                    true => String::new(),
                    false => format!(" ({})", low / 2.0 + high / 2.0),
                };
                format!(
                    "the samples are of two values, {low} and {high}, as those of a mask: the surface has steps, and \
                     areas come out about 8 % too large with a threshold half-way{half_way}. With one at {high}, pores \
                     come out larger (balls with a radius of 10 voxels by 12 % in volume and by 19 % in area) and \
                     bodies smaller. Convert the grey values that the mask was made from, if there are any"
                )
            }
            Kind::Labels(values) => {
                let shown: Vec<String> = values.iter().take(4).map(f64::to_string).collect();
                let more = if values.len() > shown.len() {
                    ", ..."
                } else {
                    ""
                };
                format!(
                    "the samples are of {} values ({}{more}) and look like labels: a threshold makes one surface \
                     around all that reach it, and labels that touch become one object; make a volume of each label \
                     to have them apart",
                    values.len(),
                    shown.join(", ")
                )
            }
        }
    }
}

/// Looks at rows as they are read.
#[derive(Debug)]
pub(crate) struct Watch {
    dtype: Dtype,
    /// Rows of a slice.
    rows_of_slice: u64,
    /// Rows to look at, y + rows of a slice times z, rising.
    rows: Vec<u64>,
    seen: Mutex<Seen>,
}

/// What was seen.
#[derive(Debug, Default)]
struct Seen {
    /// Values are no labels, however few.
    scaled: bool,
    /// Per row.
    done: Vec<bool>,
    /// Bits of values in the order of the values; one more than [`MOST`] of them are too many.
    values: BTreeSet<i64>,
    /// Runs of samples of the same value.
    runs: u64,
    /// Those that are no longer than [`SHORT`].
    short: u64,
    /// Bits of samples whose values were added.
    recent: Recent,
    /// Where runs of a row begin.
    begins: Vec<u8>,
}

/// Bits of some samples that were seen, each in its place: nearly all samples have these, and a set takes much longer
/// to ask.
#[derive(Debug)]
struct Recent([u64; Recent::PLACES]);

impl Default for Recent {
    fn default() -> Self {
        // what has another place: 0 belongs to the first one, 1 does not
        let mut places = [0; Recent::PLACES];
        places[0] = 1;
        Recent(places)
    }
}

impl Recent {
    const PLACES: usize = 1 << 10;

    /// True if these bits are there; takes them if not.
    #[inline(always)]
    fn has(&mut self, bits: u64) -> bool {
        // the product's upper bits depend on all of these
        let place = bits.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 54;
        std::mem::replace(&mut self.0[place as usize], bits) == bits
    }
}

impl Watch {
    /// For volumes like this one; `scaled` says that stored numbers stand for measured values, which are no labels.
    pub fn new(header: &Header, scaled: bool) -> Self {
        let [nx, ny, nz] = header.dims.0.map(u64::from);
        let all = ny * nz;
        let count = (SAMPLES / nx).clamp(LEAST_ROWS, ROWS).min(all);
        // by steps of the golden ratio, which keep no time with slices
        let place = |i: u64| match count == all {
            true => i,
            false => ((i as f64 * 0.618_033_988_749_894_9).fract() * all as f64) as u64,
        };
        let mut rows: Vec<u64> = (0..count).map(place).collect();
        rows.sort_unstable();
        rows.dedup();
        let seen = Seen {
            scaled,
            done: vec![false; rows.len()],
            ..Seen::default()
        };
        Watch {
            dtype: header.dtype,
            rows_of_slice: ny,
            rows,
            seen: Mutex::new(seen),
        }
    }

    /// Takes what was read of rows `y` of slices `z`.
    fn look(&self, y: &Range<u32>, z: Range<u32>, bytes: &[u8]) {
        let row_bytes = bytes.len() / (y.len() * z.len()).max(1);
        if row_bytes == 0 {
            return;
        }
        for (slice, z) in z.enumerate() {
            let row = |y: u32| u64::from(y) + self.rows_of_slice * u64::from(z);
            let first = self.rows.partition_point(|&r| r < row(y.start));
            let own = self.rows[first..].iter().take_while(|r| **r < row(y.end));
            for (i, &r) in own.enumerate() {
                let at = slice * y.len() + (r - row(y.start)) as usize;
                let row = &bytes[at * row_bytes..][..row_bytes];
                let mut seen = lock(&self.seen);
                if !std::mem::replace(&mut seen.done[first + i], true) {
                    with_voxel_type!(self.dtype, T => seen.add::<T>(row));
                }
            }
        }
    }

    /// What the values look like, if they are no grey values.
    pub fn kind(&self) -> Option<Kind> {
        lock(&self.seen).kind()
    }
}

/// The bits of a value as a whole number that is ordered as values are; NaN comes first.
fn ordered(value: f64) -> i64 {
    if value.is_nan() {
        return i64::MIN;
    }
    // adding 0 makes -0 the same as 0
    let bits = (value + 0.0).to_bits() as i64;
    bits ^ ((bits >> 63) as u64 >> 1) as i64
}

/// The value of such a number.
fn value(ordered: i64) -> f64 {
    match ordered {
        i64::MIN => f64::NAN,
        bits => f64::from_bits((bits ^ ((bits >> 63) as u64 >> 1) as i64) as u64),
    }
}

impl Seen {
    /// Adds a row of samples.
    fn add<T: Voxel>(&mut self, row: &[u8]) {
        match size_of::<T>() {
            1 => self.add_samples::<T, 1>(row.as_chunks().0),
            2 => self.add_samples::<T, 2>(row.as_chunks().0),
            4 => self.add_samples::<T, 4>(row.as_chunks().0),
            _ => self.add_samples::<T, 8>(row.as_chunks().0),
        }
    }

    fn add_samples<T: Voxel, const N: usize>(&mut self, samples: &[[u8; N]]) {
        if self.values.len() > MOST {
            return; // these are grey values, whatever comes
        }
        self.count_runs(samples);
        for sample in samples {
            let mut bits = [0; 8];
            bits[..N].copy_from_slice(sample);
            if !self.recent.has(u64::from_le_bytes(bits)) && self.values.len() <= MOST {
                let sample: T = bytemuck::pod_read_unaligned(sample);
                self.values.insert(ordered(sample.to_f64()));
            }
        }
    }

    /// Counts runs of samples of the same bits, and those of them that are short. Where they begin is found for many
    /// samples at once, since no branch on it could be foretold.
    fn count_runs<const N: usize>(&mut self, samples: &[[u8; N]]) {
        let [_, others @ ..] = samples else { return };
        let count = samples.len();
        self.begins.clear();
        // the first one begins a run, and behind the last run another one would begin
        self.begins.resize(count + SHORT, 1);
        let begins = self.begins[1..count].iter_mut();
        for ((begins, before), sample) in begins.zip(samples).zip(others) {
            *begins = u8::from(before != sample);
        }
        const { assert!(SHORT == 2) };
        let [one, two, three] = [0, 1, 2].map(|i| &self.begins[i..i + count]);
        let (mut runs, mut short) = (0u32, 0u32);
        for i in 0..count {
            runs += u32::from(one[i]);
            short += u32::from(one[i] & (two[i] | three[i]));
        }
        self.runs += u64::from(runs);
        self.short += u64::from(short);
    }

    fn kind(&self) -> Option<Kind> {
        let values: Vec<f64> = self.values.iter().map(|v| value(*v)).collect();
        let short = self.short as f64 / self.runs.max(1) as f64;
        match values[..] {
            [] | [_] => None,
            [low, high] => Some(Kind::Mask([low, high])),
            _ if self.scaled => None,
            // grey values differ from voxel to voxel, or there is a voxel or two of values between at every edge
            _ if values.len() <= FEW && short < 0.5 => Some(Kind::Labels(values)),
            _ if values.len() <= MOST && short < 0.2 => Some(Kind::Labels(values)),
            _ => None,
        }
    }
}

/// A volume that is looked at while it is read.
pub(crate) struct Watched<'a> {
    volume: Box<dyn Volume + 'a>,
    watch: &'a Watch,
}

impl<'a> Watched<'a> {
    /// Looks with `watch`, which is for volumes of this size and type.
    pub fn new(volume: Box<dyn Volume + 'a>, watch: &'a Watch) -> Self {
        Watched { volume, watch }
    }
}

impl Volume for Watched<'_> {
    fn header(&self) -> &Header {
        self.volume.header()
    }

    fn fill_box(&self, x: Range<u32>, y: Range<u32>, z: Range<u32>, out: &mut [u8]) -> Result<()> {
        self.volume.read_box(x, y.clone(), z.clone(), out)?;
        self.watch.look(&y, z, out);
        Ok(())
    }

    hand_on!(volume);

    fn decoded_once(&self, dir: &Path) -> Result<Option<Box<dyn Volume + '_>>> {
        let once = self.volume.decoded_once(dir)?;
        Ok(once.map(|volume| {
            let watched: Box<dyn Volume + '_> = Box::new(Watched::new(volume, self.watch));
            watched
        }))
    }

    fn held_bytes(&self) -> u64 {
        self.volume.held_bytes()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::grid::{Dims, Placement};
    use crate::progress::Quiet;
    use crate::volume::MemoryVolume;
    use crate::volume::statistics;

    fn kind<T: Voxel>(dims: [u32; 3], value: impl Fn([u32; 3]) -> T) -> Option<Kind> {
        kind_of(dims, value, false)
    }

    fn kind_of<T: Voxel>(
        dims: [u32; 3],
        value: impl Fn([u32; 3]) -> T,
        scaled: bool,
    ) -> Option<Kind> {
        let [nx, ny, nz] = dims;
        let mut samples = Vec::new();
        for z in 0..nz {
            for y in 0..ny {
                samples.extend((0..nx).map(|x| value([x, y, z])));
            }
        }
        let volume = MemoryVolume::new(Dims(dims), Placement::default(), samples).unwrap();
        let watch = Watch::new(volume.header(), scaled);
        let watched = Watched::new(Box::new(&volume), &watch);
        statistics(&watched, None, &Quiet).unwrap();
        // to read it again changes nothing
        let once = watch.kind();
        statistics(&watched, None, &Quiet).unwrap();
        assert_eq!(format!("{:?}", watch.kind()), format!("{once:?}"));
        once
    }

    /// Against sample by sample, and every value asked for in the set.
    fn is_seen_as_one_by_one<T: Voxel>(rows: &[Vec<T>]) {
        let (mut seen, mut values) = (Seen::default(), BTreeSet::new());
        let (mut runs, mut short) = (0, 0);
        for row in rows {
            seen.add::<T>(bytemuck::cast_slice(row));
            for run in row.chunk_by(|a, b| bytemuck::bytes_of(a) == bytemuck::bytes_of(b)) {
                runs += 1;
                short += u64::from(run.len() <= SHORT);
                values.insert(ordered(run[0].to_f64()));
            }
        }
        let found = (seen.runs, seen.short, seen.values);
        assert_eq!(found, (runs, short, values));
    }

    #[test]
    fn what_is_seen_at_once_is_what_is_there() {
        let number = |i: u64| (i.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as u32;
        for values in [2, 3, 9, 250] {
            for length in [1, 2, 3, 64, 331] {
                let row = |r: u64| {
                    let sample = |i: u64| number(i / 2 + 1000 * r) % values;
                    (0..length).map(sample).collect::<Vec<_>>()
                };
                let rows: Vec<_> = (0..20).map(row).collect();
                fn cast<T>(rows: &[Vec<u32>], to: impl Fn(u32) -> T) -> Vec<Vec<T>> {
                    let row = |row: &Vec<u32>| row.iter().map(|&v| to(v)).collect();
                    rows.iter().map(row).collect()
                }
                is_seen_as_one_by_one(&cast(&rows, |v| v as u8));
                is_seen_as_one_by_one(&cast(&rows, |v| v as i16 - 100));
                is_seen_as_one_by_one(&cast(&rows, |v| v as f32 / 7.0 - 5.0));
                is_seen_as_one_by_one(&cast(&rows, |v| match v {
                    0 => f64::NAN,
                    1 => -0.0,
                    _ => f64::from(v) - 3.0,
                }));
            }
        }
    }

    fn in_ball([x, y, z]: [u32; 3]) -> f64 {
        let away = [x, y, z].map(|c| f64::from(c) - 20.0);
        10.0 - away.iter().map(|d| d * d).sum::<f64>().sqrt()
    }

    #[test]
    fn two_values_are_a_mask_in_every_type() {
        let inside = |p| in_ball(p) >= 0.0;
        let dims = [40; 3];
        let mask = |low: f64, high: f64| Some(Kind::Mask([low, high]));
        assert_eq!(kind(dims, |p| u8::from(inside(p))), mask(0.0, 1.0));
        let values = |p| if inside(p) { -1000i16 } else { 1000 };
        assert_eq!(kind(dims, values), mask(-1000.0, 1000.0));
        assert_eq!(
            kind(dims, |p| if inside(p) { 0.25f32 } else { 0.75 }),
            mask(0.25, 0.75)
        );
        assert_eq!(kind(dims, |p| if inside(p) { 0.0f64 } else { -0.0 }), None);
        let nan = kind(dims, |p| if inside(p) { 1.0f32 } else { f32::NAN });
        assert!(matches!(nan, Some(Kind::Mask([low, 1.0])) if low.is_nan()));
        assert_eq!(kind(dims, |_| 7u8), None);
        // a volume of which not all is looked at
        let large = kind([300, 300, 60], |[x, y, z]| u8::from(x + y + z > 300));
        assert_eq!(large, mask(0.0, 1.0));
    }

    #[test]
    fn few_values_in_regions_are_labels() {
        let labels =
            |p: [u32; 3]| u16::from(in_ball(p) > 0.0) * (1 + p[0] / 20 + 2 * (p[1] / 20)) as u16;
        assert_eq!(kind_of([40; 3], labels, true), None, "measured values");
        let Some(Kind::Labels(values)) = kind([40; 3], labels) else {
            panic!("no labels");
        };
        assert_eq!(values, [0.0, 1.0, 2.0, 3.0, 4.0]);
        let text = Kind::Labels(values).warning();
        assert!(text.contains("5 values (0, 1, 2, 3, ...)"), "{text}");
        // cells of 8 voxels with a number each
        let many = |[x, y, z]: [u32; 3]| (x / 8 + 5 * (y / 8) + 25 * (z / 8)) as i32;
        assert!(matches!(kind([40; 3], many), Some(Kind::Labels(v)) if v.len() == 125));
    }

    #[test]
    fn grey_values_are_none_of_these() {
        // a sharp edge, but for a voxel of values between
        let ball = |p| (128.0 + 40.0 * in_ball(p).clamp(-1.5, 1.5)) as u8;
        assert_eq!(kind([40; 3], ball), None);
        let noise = |[x, y, z]: [u32; 3]| {
            let seed = u64::from(x + 40 * (y + 40 * z));
            (seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) >> 40) as u8
        };
        assert_eq!(kind([40; 3], noise), None);
        assert_eq!(kind([40; 3], |p| noise(p) / 32), None);
        assert_eq!(kind([40; 3], |p| 100 + noise(p) / 16), None);
        assert_eq!(kind([40; 3], |[x, y, z]| (x * y + z) as f32), None);
    }
}
