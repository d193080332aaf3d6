//! Images of ITK and VTK in HDF5, which state the place of their grid beside the array, x first.
//!
//! ITK: `/ITKImage/0` with the datasets `Dimension`, `Spacing`, `Origin` and `Directions`, of which row i is the
//! direction of axis i, in millimetres as in DICOM. VTK
//! (<https://docs.vtk.org/en/latest/vtk_file_formats/vtkhdf_file_format/vtkhdf_specifications.html>): attributes of
//! `/VTKHDF`, of which `Direction` is a matrix by rows whose columns are the axes, and no unit.

use crate::grid::{Origin, Placement, Provenance, Unit};
use crate::volume::formats::hdf5::attributes::{Attributes, numbers_of};
use crate::volume::formats::hdf5::axes::Names;
use crate::volume::formats::hdf5::place::Place;

/// The group of VTK's images.
const VTK: &str = "/VTKHDF";

/// Whose image an array is.
enum Writer {
    /// The group that its parts are in.
    Itk(String),
    Vtk {
        image: Attributes,
        /// The array is of the cells between the points.
        cells: bool,
    },
}

/// What is stated of x, y and z.
struct Stated {
    spacing: Option<[f64; 3]>,
    origin: Option<[f64; 3]>,
    directions: Option<[[f64; 3]; 3]>,
    /// Where the first voxel is, in voxels from the origin.
    first: [f64; 3],
    unit: Unit,
}

impl Writer {
    fn of(place: &Place) -> Option<Writer> {
        let (folder, own) = place.name.rsplit_once('/')?;
        if own == "VoxelData" && folder.starts_with("/ITKImage/") {
            return Some(Writer::Itk(folder.to_owned()));
        }
        let cells = match folder.strip_prefix(VTK)? {
            "/PointData" => false,
            "/CellData" => true,
            _ => return None,
        };
        let image = Attributes(place.file.group(VTK).ok()?.attributes().ok()?);
        (image.text("Type")? == "ImageData").then_some(Writer::Vtk { image, cells })
    }
}

/// The names of the axes of such an array, which are no attributes.
pub(crate) fn names(place: &Place) -> Option<Names> {
    let axes = place.dataset.ndim();
    let times = match Writer::of(place)? {
        Writer::Itk(group) => numbers(place, &group, "Dimension").ok()??.len() == 4,
        Writer::Vtk { .. } => place.file.group(&format!("{VTK}/Steps")).is_ok(),
    };
    let mut names: Vec<&str> = if times { vec!["t"] } else { Vec::new() };
    names.extend(["z", "y", "x"]);
    if axes == names.len() + 1 {
        names.push("c");
    }
    let names = names.into_iter().map(String::from).collect();
    Names::new(names, axes, "its writer")
}

/// The place of such an image of that many voxels; `None` for other arrays.
///
/// # Errors
/// What is missing or wrong, for people.
pub(crate) fn placement(
    place: &Place,
    size: [u64; 3],
) -> Result<Option<(Placement, Provenance)>, String> {
    let stated = match Writer::of(place) {
        None => return Ok(None),
        Some(Writer::Itk(group)) => of_itk(place, &group)?,
        Some(Writer::Vtk { image, cells }) => of_vtk(&image, cells, size)?,
    };
    let from = |there: bool| if there { Origin::File } else { Origin::Default };
    let provenance = Provenance {
        spacing: [from(stated.spacing.is_some()); 3],
        unit: Origin::Default,
        origin: from(stated.origin.is_some()),
        ..Provenance::default()
    };
    let mut grid = Placement::default();
    if let Some(spacing) = stated.spacing {
        grid.spacing = spacing;
        grid.unit = stated.unit;
    }
    grid.origin = stated.origin.unwrap_or(grid.origin);
    if let Some(directions) = stated.directions {
        grid.directions = unit_vectors(directions)?;
    }
    grid.origin = grid.world(stated.first);
    for (spacing, direction) in grid.spacing.iter_mut().zip(&mut grid.directions) {
        if *spacing < 0.0 {
            *spacing = -*spacing;
            *direction = direction.map(|v| 0.0 - v);
        }
    }
    Ok(Some((grid, provenance)))
}

/// Directions of length 1 that span space.
fn unit_vectors(directions: [[f64; 3]; 3]) -> Result<[[f64; 3]; 3], String> {
    let axes = directions.map(glam::DVec3::from);
    let volume = axes[0].cross(axes[1]).dot(axes[2]);
    let even = axes.iter().all(|axis| (axis.length() - 1.0).abs() < 1e-4);
    // false for NaN too
    if even && volume.abs() > 1e-6 {
        return Ok(directions);
    }
    Err(format!(
        "directions that are not three of length 1 which do not lie in one plane ({directions:?})"
    ))
}

/// The numbers of a dataset in a group, if it is there.
fn numbers(place: &Place, group: &str, name: &str) -> Result<Option<Vec<f64>>, String> {
    let Ok(dataset) = place.file.dataset(&format!("{group}/{name}")) else {
        return Ok(None);
    };
    match numbers_of(&dataset) {
        Some(numbers) => Ok(Some(numbers)),
        None => Err(format!("{name} that is no list of numbers")),
    }
}

/// The first three of as many numbers as there are axes.
fn three(name: &str, numbers: Option<Vec<f64>>, axes: usize) -> Result<Option<[f64; 3]>, String> {
    match numbers.as_deref() {
        None => Ok(None),
        Some(all @ &[x, y, z, ..]) if all.len() == axes => Ok(Some([x, y, z])),
        Some(all) => Err(format!("{name} of {} numbers, not {axes}", all.len())),
    }
}

fn of_itk(place: &Place, group: &str) -> Result<Stated, String> {
    let of = |name: &str| numbers(place, group, name);
    let axes = of("Dimension")?.map_or(3, |all| all.len());
    let directions = match of("Directions")? {
        None => None,
        Some(all) if all.len() == axes * axes && axes >= 3 => {
            let row = |a: usize| [0, 1, 2].map(|i| all[a * axes + i]);
            // an axis of times apart from space has 0 of x, y and z, and they of it
            let mixed =
                |a: usize, b: usize| a != b && (a >= 3 || b >= 3) && all[a * axes + b] != 0.0;
            if (0..axes).any(|a| (0..axes).any(|b| mixed(a, b))) {
                return Err("directions that mix space with other axes".into());
            }
            Some([row(0), row(1), row(2)])
        }
        Some(all) => {
            return Err(format!(
                "Directions of {} numbers, of {axes} axes",
                all.len()
            ));
        }
    };
    Ok(Stated {
        spacing: three("Spacing", of("Spacing")?, axes)?,
        origin: three("Origin", of("Origin")?, axes)?,
        directions,
        first: [0.0; 3],
        unit: Unit::Millimetre,
    })
}

fn of_vtk(image: &Attributes, cells: bool, size: [u64; 3]) -> Result<Stated, String> {
    let first = match image.numbers("WholeExtent").as_deref() {
        None => return Err("no attribute WholeExtent".into()),
        Some(&[x0, x1, y0, y1, z0, z1]) => {
            let points = if cells { 0.0 } else { 1.0 };
            let ends = [(x0, x1), (y0, y1), (z0, z1)];
            let fits = ends
                .iter()
                .zip(size)
                .all(|((a, b), n)| b - a + points == n as f64);
            if !fits {
                return Err(format!(
                    "a WholeExtent of {x0} {x1} {y0} {y1} {z0} {z1}, which is not that of {size:?} voxels"
                ));
            }
            [x0, y0, z0]
        }
        Some(all) => return Err(format!("a WholeExtent of {} numbers", all.len())),
    };
    let directions = match image.numbers("Direction").as_deref() {
        None => None,
        Some(rows) if rows.len() == 9 => {
            Some([0, 1, 2].map(|axis| [rows[axis], rows[3 + axis], rows[6 + axis]]))
        }
        Some(rows) => return Err(format!("a Direction of {} numbers", rows.len())),
    };
    let half = if cells { 0.5 } else { 0.0 };
    Ok(Stated {
        spacing: three("Spacing", image.numbers("Spacing"), 3)?,
        origin: three("Origin", image.numbers("Origin"), 3)?,
        directions,
        first: first.map(|n| n + half),
        unit: Unit::Voxel,
    })
}
