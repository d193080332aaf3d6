//! The verifier's report.

use super::code::Code;
use serde::Serialize;

/// How bad a finding is.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Severity {
    /// The tile set is not what it claims to be.
    Error,
    /// The surface is sound, but something about it could not be checked.
    Warning,
}

/// A finding.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Issue {
    /// Kind of the finding.
    pub code: Code,
    /// How bad it is.
    pub severity: Severity,
    /// The file, relative to the tile set, and within JSON a pointer:
    /// `index/z0003.json#/tiles/7/box`.
    pub path: String,
    /// The message: found, and expected.
    pub message: String,
    /// The place in voxel coordinates, if it has one.
    pub voxel: Option<[f64; 3]>,
}

impl Issue {
    /// An error without a place.
    pub(super) fn new(code: Code, path: impl Into<String>, message: impl Into<String>) -> Self {
        Issue {
            code,
            severity: Severity::Error,
            path: path.into(),
            message: message.into(),
            voxel: None,
        }
    }

    /// Adds a place, given in lattice units.
    pub(super) fn at(mut self, lattice: [i32; 3]) -> Self {
        self.voxel = Some(lattice.map(|v| f64::from(v) / 256.0));
        self
    }
}

/// A list of findings that keeps the first `max` and counts the rest.
#[derive(Debug)]
pub(super) struct Issues {
    pub list: Vec<Issue>,
    pub omitted: u64,
    max: usize,
    errors: bool,
    broken: bool,
}

impl Issues {
    pub fn new(max: usize) -> Self {
        Issues {
            list: Vec::new(),
            omitted: 0,
            max,
            errors: false,
            broken: false,
        }
    }

    /// How many findings are kept.
    pub fn most(&self) -> usize {
        self.max
    }

    pub fn push(&mut self, issue: Issue) {
        self.errors |= issue.severity == Severity::Error;
        self.broken |= issue.code.breaks_surface();
        if self.list.len() < self.max {
            self.list.push(issue);
        } else {
            self.omitted += 1;
        }
    }

    pub fn add(&mut self, code: Code, path: impl Into<String>, message: impl Into<String>) {
        self.push(Issue::new(code, path, message));
    }

    /// Appends the findings of a part, in order.
    pub fn append(&mut self, part: Issues) {
        self.omitted += part.omitted;
        self.errors |= part.errors;
        self.broken |= part.broken;
        for issue in part.list {
            self.push(issue);
        }
    }

    /// True if there is an error.
    pub fn any_error(&self) -> bool {
        self.errors
    }

    /// True if the surface could not be rebuilt.
    pub fn broken(&self) -> bool {
        self.broken
    }
}

/// The result of [`super::verify`]. Counts are those of the files, not those that the manifest states.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// True if there is no issue of severity `error`.
    pub ok: bool,
    /// True if the tiles were also compared with the volume.
    pub against: bool,
    /// True if cells were compared with the labels that they were made by; absent if they were not.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub labels: bool,
    /// True if the set says that it is a part of another one: then what holds for all components together, and the
    /// measures of objects that have lost surfaces, are not proven. Absent in JSON if it does not.
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    pub part: bool,
    /// What is not proved: of the index what only the volume can prove, where it was not compared with that, and which
    /// voxels cells have that are parts of components. Absent in JSON if nothing.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub unproved: Vec<String>,
    /// Tiles read.
    pub tiles: u64,
    /// Triangles, degenerates of strips not counted; caps are counted.
    pub triangles: u64,
    /// Triangles of caps.
    pub cap_triangles: u64,
    /// Lattice vertices, each counted once.
    pub vertices: u64,
    /// Vertices as written.
    pub tile_vertices: u64,
    /// Edges on the volume's faces where the surface is open; 0 with caps.
    pub border_edges: u64,
    /// Connected components of triangles, caps not counted; where cells are parts of components, pairs of a cell and an
    /// object that have a surface.
    pub surfaces: u64,
    /// Objects that have a surface.
    pub objects: u64,
    /// Cells that have a surface; where they are parts of components, all that have a row in their table.
    pub cells: u64,
    /// Components that have a surface, where cells are parts of them. Absent in JSON where they are the cells.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub components: Option<u64>,
    /// Vertices - edges + triangles of the whole surface.
    pub euler_characteristic: i64,
    /// 6 times the signed volume that the triangles span with the origin, in lattice units
    /// (voxel/256)^3: an exact integer, as a decimal string in JSON.
    #[serde(serialize_with = "decimal")]
    pub volume6: i128,
    /// Bytes of all tiles.
    pub bytes: u64,
    /// The findings, in the order of the files.
    pub issues: Vec<Issue>,
    /// Findings left out because there were more than asked for.
    pub issues_omitted: u64,
    /// Wall time.
    pub seconds: f64,
    /// Largest resident set of the process so far, in bytes; 0 where the system does not tell.
    pub peak_rss_bytes: u64,
}

fn decimal<S: serde::Serializer>(value: &i128, s: S) -> Result<S::Ok, S::Error> {
    s.collect_str(value)
}

/// The process's largest resident set in bytes, from `/proc/self/status`; 0 if that is missing.
pub(super) fn peak_rss_bytes() -> u64 {
    std::fs::read_to_string("/proc/self/status")
        .ok()
        .and_then(|s| {
            let line = s.lines().find_map(|l| l.strip_prefix("VmHWM:"))?;
            line.trim().strip_suffix(" kB")?.trim().parse::<u64>().ok()
        })
        .map_or(0, |kib| kib * 1024)
}
