//! A slice of a volume as a picture: grey values, the threshold's contour, cells, objects or surfaces in colour, and
//! around them a caption, a scale bar and legends.
//!
//! Voxels have their true proportion. In a slice across z, x runs to the right and y down; across y, x runs to the right
//! and z down; across x, y runs to the right and z down.

mod cells;
mod draw;
mod labels;
mod options;
mod page;
mod region;
mod slice;
mod zoom;

pub use labels::LabelVolume;
pub use options::{Panel, PreviewOptions, PreviewReport};
pub use slice::{Axis, Slice};

use crate::error::{Error, Result};
use crate::grid::{Ambiguous, Placement};
use crate::manifest::Manifest;
use crate::picture::{Picture, printed_unit};
use crate::table::{Chosen, Table, warn_of_outside};
use crate::volume::{Cropped, Volume};
use crate::words::{counted, number, percent, things};
use cells::{Colours, Meaning};
use draw::Canvas;
use page::{Bar, GAP, Key, Page, side_by_side};
use region::SliceRegion;
use std::path::Path;
use zoom::{Zoom, ZoomInput};

/// The most conditions of painted tiles that a picture lists.
const KEYS: usize = 8;

/// Draws a slice of a volume and writes it as PNG. Memory: some 16 bytes per voxel of the slice, twice as many with a
/// region of interest, some 50 for each that the outline of a surface passes if these are drawn, 3 per pixel, and a tile.
///
/// With a tile set, the slice is one of the grid that the tiles cover, so the volume has to have been through the
/// same filters, and below regions of the slice
/// take the cell, or above ones the object, of the surface at their rim. A region without a rim in the slice, or whose
/// surface is not in the tile set, stays grey. Tiles do not tell where labels cut through a hollow: the labels do, if they
/// are given. Cells that the volume's faces cut are hatched if they are coloured by a measure.
///
/// # Errors
/// [`Error::Usage`] if the slice is outside the volume, the picture would pass 2^28 pixels, or the
/// tile set is that of another volume; [`Error::InputChanged`]; [`Error::Io`]; [`Error::Format`].
pub fn preview(
    volume: &dyn Volume,
    path: &Path,
    options: &PreviewOptions,
) -> Result<PreviewReport> {
    let (picture, report) = render(volume, options)?;
    picture
        .save(path)
        .map_err(|e| Error::io(path, "write the picture", e))?;
    Ok(report)
}

/// What [`preview`] draws, and what it tells of it.
///
/// # Errors
/// As of [`preview`].
pub(crate) fn render(
    volume: &dyn Volume,
    options: &PreviewOptions,
) -> Result<(Picture, PreviewReport)> {
    let manifest = options.tiles.as_deref().map(Manifest::open).transpose()?;
    let grid = grid_of(volume, manifest.as_ref())?;
    let grid = &*grid;
    let dims = grid.header().dims.0;
    let placement = match &manifest {
        Some(m) => m.placement,
        None => grid.header().placement,
    };
    let axis = options.axis;
    let at = options.at.unwrap_or(dims[axis as usize] / 2);
    let thresholds = thresholds(options, manifest.as_ref());
    let (zoom, true_proportion) = Zoom::new(ZoomInput {
        voxels: axis.plane().map(|a| dims[a]),
        spacing: axis.plane().map(|a| placement.spacing[a]),
        asked: options.scale,
        panels: thresholds.len().max(1) as u32,
    })?;
    let slice = Slice::read(grid, axis, at)?;
    let window = options.window.or_else(|| slice.window());
    let region = SliceRegion::of(&slice, options.region.as_ref(), manifest.as_ref())?;
    let classified = region.as_ref().map_or(&slice, |region| &region.filled);
    let colours = match (&options.tiles, &manifest) {
        (Some(dir), Some(m)) => Some(cells::colours(dir, m, classified, options)?),
        _ => None,
    };
    let shown = Shown {
        slice: &slice,
        region: region.as_ref(),
        zoom,
        placement,
        dims,
        window,
        thresholds: &thresholds,
        names: &options.names,
        fills: &options.fills,
        colours: colours.as_ref(),
        chosen: &options.chosen,
        of_tiles: manifest.as_ref().map_or(f64::NAN, |m| m.threshold),
        phases_only: options.phases_only,
    };
    let rule = manifest
        .as_ref()
        .map_or(Ambiguous::Separate, |m| m.ambiguous);
    let (picture, corners) = shown.draw(rule, options.plain);
    // before the picture takes the place of another one
    let mut warnings: Vec<String> = options.input.check()?.into_iter().collect();
    warnings.extend(shown.doubts(true_proportion));
    if let (Some(dir), Some(m)) = (&options.tiles, &manifest) {
        warnings.extend(warn_of_outside(dir, m, &options.chosen, false)?);
    }
    let report = PreviewReport {
        size: picture.size(),
        warnings,
        ..shown.report(&corners)
    };
    Ok((picture, report))
}

/// The thresholds whose contours are drawn: that of tiles if none is asked for, unless outlines take its place.
fn thresholds(options: &PreviewOptions, manifest: Option<&Manifest>) -> Vec<f64> {
    let outlined = |m| cells::table(m, options) == Table::Surfaces;
    match manifest {
        Some(m) if options.thresholds.is_empty() && !outlined(m) => vec![m.threshold],
        _ => options.thresholds.clone(),
    }
}

/// The part of a volume that tiles cover; all of it without tiles.
fn grid_of<'a>(
    volume: &'a dyn Volume,
    manifest: Option<&Manifest>,
) -> Result<Box<dyn Volume + 'a>> {
    let Some(manifest) = manifest else {
        return Ok(Box::new(volume));
    };
    let source = &manifest.source;
    let found = volume.header().dims;
    let whole = manifest.filtered_dims()?;
    if found != whole {
        let expected = format!("the volume of {whole} that the tiles were made from");
        return Err(Error::usage(
            "--tiles",
            format!("a volume of {found}"),
            expected,
        ));
    }
    Cropped::part(Box::new(volume), source.crop.as_ref())
}

/// Everything that a picture shows.
struct Shown<'a> {
    slice: &'a Slice,
    region: Option<&'a SliceRegion>,
    zoom: Zoom,
    /// Of the grid, of which these are the voxels.
    placement: Placement,
    dims: [u32; 3],
    window: Option<[f64; 2]>,
    thresholds: &'a [f64],
    /// See [`PreviewOptions::names`].
    names: &'a [String],
    /// See [`PreviewOptions::fills`].
    fills: &'a [f64],
    colours: Option<&'a Colours>,
    chosen: &'a Chosen,
    /// Threshold of the tile set, if there is one.
    of_tiles: f64,
    /// Samples tell phases alone.
    phases_only: bool,
}

impl Shown<'_> {
    /// The picture, and the upper left pixels of the slices in it, at least one.
    fn draw(&self, rule: Ambiguous, plain: bool) -> (Picture, Vec<[u32; 2]>) {
        let slice = self.zoom.size();
        let panels = self.thresholds.len().max(1);
        let (mut picture, corners) = if plain {
            let across = panels as u32 * (slice[0] + GAP) - GAP;
            let picture = Picture::new([across, slice[1]], [255; 3]);
            (picture, side_by_side([0; 2], slice[0], panels))
        } else {
            let page = self.page();
            let layout = page.layout(slice);
            (page.draw(&layout), layout.corners)
        };
        for (i, &corner) in corners.iter().enumerate() {
            let fill = self.fills.get(i).filter(|_| self.of_tiles.is_nan());
            let filled = self.region.zip(fill).map(|(r, fill)| r.filled_with(*fill));
            let mut canvas = Canvas {
                picture: &mut picture,
                corner,
                slice: self.slice,
                zoom: self.zoom,
            };
            canvas.voxels(self.window, self.colours);
            if let Some(region) = self.region {
                canvas.pale(&region.inside);
                canvas.slice = filled.as_ref().unwrap_or(&region.filled);
            }
            if let Some(&t) = self.thresholds.get(i) {
                canvas.contour(t, rule, self.colours.is_some());
            }
            if let Some(colours) = self.of(Table::Surfaces) {
                canvas.outlines(self.of_tiles, rule, colours);
            }
            if let Some(region) = self.region {
                canvas.slice = &region.inside;
                canvas.outline();
            }
        }
        (picture, corners)
    }

    /// What the picture shows, but its size and what is to be warned of.
    fn report(&self, corners: &[[u32; 2]]) -> PreviewReport {
        PreviewReport {
            axis: self.slice.axis,
            at: self.slice.at,
            size: [0; 2],
            slice_corner: corners[0],
            slice_size: self.zoom.size(),
            window: self.window,
            threshold: self.thresholds.first().copied().or(self.outlined()),
            panels: self.panels(corners),
            cells: self.of(Table::Cells).map(Colours::coloured),
            cells_without_value: self.of(Table::Cells).map(Colours::without_value),
            objects: self.of(Table::Objects).map(Colours::coloured),
            objects_without_value: self.of(Table::Objects).map(Colours::without_value),
            surfaces: self.of(Table::Surfaces).map(Colours::coloured),
            surfaces_without_value: self.of(Table::Surfaces).map(Colours::without_value),
            range: self.colours.and_then(Colours::range),
            warnings: Vec::new(),
        }
    }

    /// The threshold of outlines in colour, if they are drawn.
    fn outlined(&self) -> Option<f64> {
        self.of(Table::Surfaces).map(|_| self.of_tiles)
    }

    /// The colours if they are of this table.
    fn of(&self, table: Table) -> Option<&Colours> {
        self.colours.filter(|c| c.table == table)
    }

    /// What is told of several slices side by side.
    fn panels(&self, corners: &[[u32; 2]]) -> Vec<Panel> {
        if self.thresholds.len() < 2 {
            return Vec::new();
        }
        let panel = |(&threshold, &corner): (&f64, &[u32; 2])| Panel {
            threshold,
            share_above: self.share_above(threshold),
            corner,
        };
        self.thresholds.iter().zip(corners).map(panel).collect()
    }

    /// The share of the slice above a threshold, or of what of the slice is in the region.
    fn share_above(&self, t: f64) -> f64 {
        let inside = self.region.map(|region| &region.inside);
        self.slice.share_above(t, inside)
    }

    /// A threshold in a few digits.
    fn short(t: f64) -> String {
        let exact = t.to_string();
        if exact.len() > 9 { number(t, 4) } else { exact }
    }

    /// Caption and legends.
    fn page(&self) -> Page {
        let mut page = Page {
            caption: self.caption(),
            titles: self.titles(),
            pixel: Some((
                self.spacing()[0] / self.zoom.factor[0],
                self.placement.unit.name(),
            )),
            ..Page::default()
        };
        if let Some(ends) = self.window.filter(|_| !self.phases_only) {
            page.bars.push(Bar {
                title: "samples".into(),
                ends,
                colour: Box::new(|share| [(255.0 * share).round() as u8; 3]),
            });
        }
        let Some(colours) = self.colours else {
            return page;
        };
        for meaning in &colours.meanings {
            match meaning {
                Meaning::Ids => {}
                Meaning::Values { title, ends, map } => {
                    let (ends, map) = (*ends, *map);
                    page.bars.push(Bar {
                        title: title.clone(),
                        ends,
                        colour: Box::new(move |share| map.at(share)),
                    });
                }
                Meaning::Painted(rules) => {
                    let key = |(text, colour): &(String, [u8; 3])| Key {
                        colour: Some(*colour),
                        text: text.clone(),
                    };
                    page.keys.extend(rules.iter().take(KEYS).map(key));
                }
            }
        }
        if colours.without_value() > 0 {
            page.keys.push(Key {
                colour: None,
                text: "cut by the volume's faces, or without a value".into(),
            });
        }
        page
    }

    fn spacing(&self) -> [f64; 2] {
        self.slice.axis.plane().map(|a| self.placement.spacing[a])
    }

    /// What found a threshold, and a space; nothing if it was given.
    fn name(&self, i: usize) -> String {
        let name = self.names.get(i).filter(|name| !name.is_empty());
        name.map_or(String::new(), |name| format!("{name} "))
    }

    /// What stands above each of several slices.
    fn titles(&self) -> Vec<String> {
        if self.thresholds.len() < 2 {
            return Vec::new();
        }
        let title = |(i, &t): (usize, &f64)| {
            let share = percent(self.share_above(t));
            format!(
                "{}{}: {share} above in the slice",
                self.name(i),
                Self::short(t)
            )
        };
        self.thresholds.iter().enumerate().map(title).collect()
    }

    /// What slice it is, of what, and what is drawn on it.
    fn caption(&self) -> Vec<String> {
        let axis = self.slice.axis as usize;
        let names = ["x", "y", "z"];
        let [right, down] = self.slice.axis.plane();
        let mut texts = vec![
            format!("slice {} of 0 to {}", self.slice.at, self.dims[axis] - 1),
            format!("across {}{}", names[axis], self.position()),
            format!("{} to the right, {} down", names[right], names[down]),
            self.size(),
        ];
        if let [t] = *self.thresholds {
            texts.push(format!(
                "contour: threshold {}{}",
                self.name(0),
                Self::short(t)
            ));
        }
        if let Some(t) = self.outlined() {
            texts.push(format!("outlines: threshold {}", Self::short(t)));
        }
        let by_id = |c: &&Colours| matches!(c.meanings[..], [Meaning::Ids]);
        if let Some(colours) = self.colours.filter(by_id) {
            let all = things(colours.coloured(), colours.table.singular());
            texts.push(format!("{all}, in colours that tell them apart"));
        }
        if let Some(chosen) = self.which() {
            texts.push(format!("in colour: {chosen}"));
        }
        texts
    }

    /// `the 3 largest objects with volume > 2`; nothing if all are in colour.
    fn which(&self) -> Option<String> {
        let Chosen {
            condition, largest, ..
        } = self.chosen;
        if self.chosen.is_all() {
            return None;
        }
        let name = self.chosen.table.name();
        let first = match largest {
            Some(1) => format!("the largest {}", self.chosen.table.singular()),
            Some(n) => format!("the {n} largest {name}"),
            None => name.to_owned(),
        };
        let condition = condition.as_ref().map(|c| format!(" with {c}"));
        Some(first + &condition.unwrap_or_default())
    }

    /// ` at 0.8 mm`, along the axis of the grid; nothing if that is the number of the slice.
    fn position(&self) -> String {
        let Placement {
            spacing,
            unit,
            origin,
            directions,
        } = self.placement;
        let axis = self.slice.axis as usize;
        let along = f64::from(self.slice.at) * spacing[axis];
        let unit = printed_unit(unit.name());
        if unit == "voxel" && spacing[axis] == 1.0 && origin[axis] == 0.0 {
            String::new()
        } else if directions == Placement::default().directions {
            format!(" at {} {unit}", number(origin[axis] + along, 4))
        } else {
            // the axes of the world are others
            format!(", {} {unit} from slice 0", number(along, 4))
        }
    }

    /// `40 × 36 voxels of 0.05 × 0.05 mm`.
    fn size(&self) -> String {
        let [width, height] = self.slice.size;
        let [right, down] = self.spacing().map(|step| number(step, 4));
        match self.placement.unit.name() {
            "voxel" => format!("{width} × {height} voxels"),
            unit => format!(
                "{width} × {height} voxels of {right} × {down} {}",
                printed_unit(unit)
            ),
        }
    }

    /// What the picture shows otherwise than expected.
    fn doubts(&self, true_proportion: bool) -> Vec<String> {
        let mut doubts = Vec::new();
        if !true_proportion {
            let [right, down] = self.spacing().map(|step| number(step, 4));
            doubts.push(format!(
                "voxels of {right} by {down} are drawn as squares: in their true proportion the picture would be too \
                 large"
            ));
        }
        for &t in self.thresholds {
            let all = match self.share_above(t) {
                0.0 => "above",
                1.0 => "at or below",
                _ => continue,
            };
            doubts.push(format!(
                "threshold {} is {all} all samples of the slice: there is no contour in it",
                Self::short(t)
            ));
        }
        if let Some(colours) = self.colours
            && colours.coloured() == 0
        {
            let name = colours.table.singular();
            let Chosen {
                condition, largest, ..
            } = self.chosen;
            let text = match (colours.without_value(), condition, largest) {
                (0, Some(condition), None) => format!("no {name} of the slice has {condition}"),
                (0, _, Some(_)) => format!("no {name} of the slice is one of those chosen"),
                (0, None, None) => format!("the slice has no {name} of the tile set"),
                (n, _, _) => format!(
                    "no {name} of the slice has a colour, {} hatched: the volume's faces cut them, or they have no value",
                    counted(n, "is", "are")
                ),
            };
            doubts.push(text);
        }
        doubts
    }
}
