//! From an array and what is stated of it to a volume.

use crate::error::{Error, Result};
use crate::grid::{Dims, Placement, Provenance};
use crate::volume::Dtype;
use crate::volume::descriptor::{Samples, VolumeDescriptor};
use crate::volume::formats::zarr::axes::{self, Axis, Chosen};
use crate::volume::formats::zarr::chunk::ZarrChunks;
use crate::volume::formats::zarr::count;
use crate::volume::formats::zarr::files::Files;
use crate::volume::formats::zarr::meta::Array;
use crate::volume::formats::zarr::ome::{OmeAxis, Stated};
use crate::volume::formats::zarr::place::{self, Coordinates, Line, Placed};
use crate::volume::formats::zarr::{coordinates, foreign};
use crate::volume::io::paged::MAX_CHUNK;
use crate::volume::options::OpenOptions;
use crate::volume::stated::cf;
use crate::volume::stated::size::{Step, voxel_size};
use crate::volume::stated::warning::Warning;
use crate::volume::stated::written::{self, Grid};
use std::path::{Path, PathBuf};

/// An array that was found.
pub(crate) struct Source {
    pub(crate) folder: PathBuf,
    pub(crate) array: Array,
    /// Where it lies, if it is a level of a pyramid.
    pub(crate) stated: Option<Stated>,
    pub(crate) notes: Vec<String>,
    pub(crate) warnings: Vec<Warning>,
}

impl Source {
    /// The volume in the array; `path` is what was opened.
    ///
    /// # Errors
    /// See [`crate::volume::formats::zarr::parse`].
    pub(crate) fn descriptor(
        mut self,
        path: &Path,
        options: &OpenOptions,
    ) -> Result<VolumeDescriptor> {
        let stored = self.dtype()?;
        let usual = |stated: &Stated| stated.usual && matches!(stated.affine, Ok(None));
        if self.array.shape.len() != 5 && self.stated.as_ref().is_some_and(usual) {
            self.stated = None;
        }
        let labels = match &self.stated {
            Some(stated) => place::labels(stated, self.array.shape.len()),
            None => Vec::new(),
        };
        let all = self.axes(&labels)?;
        let Chosen {
            axes,
            at,
            named,
            notes,
        } = axes::choose(path, &all, options)?;
        self.notes.extend(notes);
        let dims = Dims::new(axes.map(|a| self.array.shape[a]))
            .map_err(|e| e.of_header(path, "an array"))?;
        let (placement, provenance) = self.place(&labels, axes, named, options)?;
        let attribute = |name: &str| Ok(coordinates::attribute(&self.array, name));
        self.notes.extend(coordinates::fill_note(&self.array));
        let packed = cf::values(&self.folder, stored, attribute)?;
        if self.stated.is_none() && self.array.names.iter().all(String::is_empty) {
            foreign::no_other_order(&self.folder, &self.array)?;
        }
        let warnings = &mut self.warnings;
        let values = foreign::scale(&self.folder, &self.array, packed.values, warnings)?;
        let bytes = self.chunk_bytes(path)?;
        let (endian, fill) = (self.array.coding.endian, self.array.fill.unwrap_or(0.0));
        let mut files = Files::new(self.folder, self.array, bytes);
        let counted = count::count(&mut files, axes, &at, &mut self.notes)?;
        if let Some(count) = counted {
            let (notes, warnings) = (&mut self.notes, &mut self.warnings);
            written::missing(count.into(), &fill.to_string(), notes, warnings);
        }
        let chunks = ZarrChunks::new(files, dims, axes, &at, packed.dtype);
        Ok(VolumeDescriptor {
            endian: Some(endian),
            placement,
            provenance,
            values,
            notes: self.notes,
            warnings: self.warnings,
            ..VolumeDescriptor::new(
                "zarr",
                dims,
                packed.dtype,
                Samples::Chunks(Box::new(chunks)),
            )
        })
    }

    /// The type of samples as they are handed out if nothing scales them.
    fn dtype(&self) -> Result<Dtype> {
        self.array.kind.dtype().ok_or_else(|| {
            let what = format!("a Zarr array of type {}", self.array.kind);
            let hint = "convert it to a type of at most 32 bits or to f64";
            Error::unsupported(&self.folder, what, hint)
        })
    }

    /// The axes of the array, by the pyramid's names or by its own; these must not contradict each other.
    fn axes(&self, labels: &[usize]) -> Result<Vec<Axis>> {
        let array = &self.array;
        let own = |i: usize| array.names.get(i).cloned().unwrap_or_default();
        let mut axes = Vec::new();
        for (i, &size) in array.shape.iter().enumerate() {
            let axis = match &self.stated {
                Some(stated) => stated.axes.get(labels[i]).cloned().unwrap_or_default(),
                None => OmeAxis {
                    name: own(i),
                    ..OmeAxis::default()
                },
            };
            axes.push(Axis {
                name: axis.name,
                kind: axis.kind,
                size,
            });
        }
        let Some(stated) = &self.stated else {
            return Ok(axes);
        };
        if stated.axes.len() != axes.len() {
            let found = format!("an array of shape {:?}", array.shape);
            let expected = format!("{} axes, as its pyramid has", stated.axes.len());
            return Err(Error::format(&self.folder, found, expected));
        }
        let names: Vec<&str> = axes.iter().map(|axis| axis.name.as_str()).collect();
        let elsewhere = |(i, axis): (usize, &Axis)| {
            names
                .iter()
                .position(|n| **n == own(i))
                .is_some_and(|j| j != i)
                && own(i) != axis.name
        };
        if axes.iter().enumerate().any(elsewhere) {
            let found = format!("an array of the axes {}", array.names.join(", "));
            let expected = format!("{}, as its pyramid has", names.join(", "));
            return Err(Error::format(&self.folder, found, expected)
                .with_hint("correct the names of its axes in one of the two"));
        }
        Ok(axes)
    }

    /// Where the volume lies. What a pyramid states and cannot be taken is no error if `--spacing` overrides it.
    fn place(
        &mut self,
        labels: &[usize],
        axes: [usize; 3],
        named: bool,
        options: &OpenOptions,
    ) -> Result<(Placement, Provenance)> {
        let placed: Result<Placed> = match &self.stated {
            Some(Stated {
                axes: coordinates,
                affine: Ok(Some(affine)),
                ..
            }) => {
                let to = Coordinates {
                    affine,
                    axes: coordinates,
                    labels,
                };
                place::turned(&self.folder, &to, axes)
            }
            Some(Stated { affine: Err(_), .. }) => match self.stated.take() {
                Some(Stated { affine: Err(e), .. }) => Err(e),
                _ => Ok(Placed::default()),
            },
            _ => {
                foreign::placed(&self.folder, &self.array, &mut self.warnings);
                let (lines, odd) = coordinates::lines(&self.folder, &self.array, axes);
                match lines.iter().all(Option::is_none) && odd.is_empty() {
                    true => Ok(self.by_attributes(axes, named)),
                    false => {
                        self.warnings.extend(odd);
                        let step = |line: &Line| Step::new(line.step.abs(), line.unit.clone());
                        let steps = lines.clone().map(|line| line.as_ref().map(step));
                        let own = foreign::size(&self.folder, &self.array, self.grid(axes, named));
                        self.warnings.extend(own.contradicts(&steps));
                        Ok(place::along(lines))
                    }
                }
            }
        };
        let (placement, provenance, warning) = match placed {
            Ok(placed) => placed,
            Err(e) if options.spacing.is_some() => {
                self.notes
                    .push(format!("not applied, as --spacing is given: {e}"));
                Placed::default()
            }
            Err(e) => {
                return Err(e.with_hint(
                    "give --spacing and --unit to take the axes of the array as they are",
                ));
            }
        };
        self.warnings.extend(warning);
        Ok((placement, provenance))
    }

    fn grid(&self, axes: [usize; 3], named: bool) -> Grid {
        Grid {
            volume: axes,
            axes: self.array.shape.len(),
            named,
        }
    }

    /// Where the volume lies by attributes that state the size of a voxel.
    fn by_attributes(&mut self, axes: [usize; 3], named: bool) -> Placed {
        let found = foreign::size(&self.folder, &self.array, self.grid(axes, named));
        self.notes.extend(found.notes);
        self.warnings.extend(found.warnings);
        let size = voxel_size(found.steps.unwrap_or_default());
        let mut placed = Placed::default();
        size.apply(&mut placed.0, &mut placed.1);
        placed.2 = size.warning;
        placed
    }

    /// Bytes of a chunk as stored.
    fn chunk_bytes(&self, path: &Path) -> Result<usize> {
        let array = &self.array;
        let sample = array.kind.size as u64;
        let chunk = array
            .chunk
            .iter()
            .try_fold(sample, |n, &c| n.checked_mul(c));
        match chunk {
            Some(bytes) if bytes <= MAX_CHUNK => Ok(bytes as usize),
            _ => {
                let what = format!("a Zarr array with chunks of {:?}", array.chunk);
                Err(Error::unsupported(
                    path,
                    what,
                    "write it anew with smaller chunks",
                ))
            }
        }
    }
}
