//! The finished surfaces, and the laws that hold between all of them.
//!
//! Surfaces finish in no order and may be more than memory should hold, so they are sorted on disk
//! three times: by surface, by cell and by object.

use super::bodies::Body;
use super::code::Code;
use super::inside::{self, Inside};
use super::parts::{PartLedger, PartSums};
use super::piece::Sums;
use super::report::Issues;
use super::spill::{Merge, Spill};
use super::sweep::{Component, Ids};
use super::tile::Context;
use crate::error::Result;

/// Records that each of the three sorts keeps in memory: 1.1 MiB.
const IN_MEMORY: usize = 1 << 11;

/// Words of a record before those of [`Inside`], and in all.
const OWN_WORDS: usize = 14;
const RECORD_WORDS: usize = OWN_WORDS + inside::WORDS;

type Record = [u64; RECORD_WORDS];

/// Collects finished surfaces.
pub(super) struct Ledger {
    by_surface: Spill<RECORD_WORDS>,
    by_cell: Spill<RECORD_WORDS>,
    by_object: Spill<RECORD_WORDS>,
    pub surfaces: u64,
    /// What triangles say of cells, where these are parts of components.
    parts: Option<PartLedger>,
    /// True if records are of parts.
    of_parts: bool,
}

impl Ledger {
    /// `parts` is true if cells are parts of components.
    pub fn new(parts: bool) -> Self {
        Ledger {
            by_surface: Spill::new(IN_MEMORY),
            by_cell: Spill::new(IN_MEMORY),
            by_object: Spill::new(IN_MEMORY),
            surfaces: 0,
            parts: parts.then(PartLedger::default),
            of_parts: parts,
        }
    }

    /// Adds a finished component.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub fn add(&mut self, c: &Component) -> Result<()> {
        self.surfaces += 1;
        // where cells are parts of components, its sums are those of its parts
        match self.parts {
            None => self.push(c),
            Some(_) => Ok(()),
        }
    }

    /// Adds a part of a surface in a tile, which has a number.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub fn add_part(&mut self, part: &PartSums, tile: u64) -> Result<()> {
        let Some(mut parts) = self.parts.take() else {
            return Ok(());
        };
        parts.add(part, tile, |sums| self.push(sums))?;
        self.parts = Some(parts);
        Ok(())
    }

    /// Takes what is known of parts, of which all sums are added.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub fn take_parts(&mut self) -> Result<Option<PartLedger>> {
        let Some(mut parts) = self.parts.take() else {
            return Ok(None);
        };
        parts.drain(|sums| self.push(sums))?;
        Ok(Some(parts))
    }

    fn push(&mut self, c: &Component) -> Result<()> {
        let Ids {
            surface,
            cell,
            object,
        } = c.ids;
        self.by_surface.push(pack([surface, cell, object], c))?;
        self.by_cell.push(pack([cell, object, surface], c))?;
        self.by_object.push(pack([object, cell, surface], c))
    }

    /// The components by surface, by cell and by object.
    ///
    /// # Errors
    /// If a temporary file cannot be read back.
    pub fn into_sorted(self) -> Result<[Rows; 3]> {
        let mut all = [
            Rows::new(self.by_surface.into_sorted()?, |[s, c, o]| [s, c, o])?,
            Rows::new(self.by_cell.into_sorted()?, |[c, o, s]| [s, c, o])?,
            Rows::new(self.by_object.into_sorted()?, |[o, c, s]| [s, c, o])?,
        ];
        all.iter_mut()
            .for_each(|rows| rows.of_parts = self.of_parts);
        Ok(all)
    }
}

/// Sorts the sums of cells by component, once the component of each is known.
pub(super) struct ByComponent(Spill<RECORD_WORDS>);

impl ByComponent {
    pub fn new() -> Self {
        ByComponent(Spill::new(IN_MEMORY))
    }

    /// Adds a cell.
    ///
    /// # Errors
    /// If a temporary file cannot be written.
    pub fn push(&mut self, component: u64, cell: &Group) -> Result<()> {
        self.0.push(pack([component, cell.id, 0], &cell.total))
    }

    /// The cells by component.
    ///
    /// # Errors
    /// If a temporary file cannot be read back.
    pub fn into_sorted(self) -> Result<Rows> {
        let mut rows = Rows::new(self.0.into_sorted()?, |[component, cell, _]| {
            [0, component, cell]
        })?;
        rows.of_parts = true;
        Ok(rows)
    }
}

fn pack(key: [u64; 3], c: &Component) -> Record {
    let s = &c.sums;
    let volume = s.volume6 as u128;
    // the record has room for either count of tiles only, and each sort needs only its own
    let flags = u64::from(c.cut) << 3 | u64::from(c.mixed) << 2 | u64::from(c.names);
    let tiles = c.tiles << 4 | flags;
    let words = [
        key[0],
        key[1],
        key[2],
        s.triangles,
        s.vertices,
        s.edges,
        s.border,
        s.area.to_bits(),
        (volume >> 64) as u64,
        volume as u64,
        tiles,
        c.cell_tiles << 32 | c.object_tiles & 0xFFFF_FFFF,
        c.measures,
        u64::from(c.colour),
    ];
    let mut record = [0; RECORD_WORDS];
    record[..OWN_WORDS].copy_from_slice(&words);
    record[OWN_WORDS..].copy_from_slice(&s.inside.pack());
    record
}

fn unpack(r: &Record, order: fn([u64; 3]) -> [u64; 3]) -> Component {
    let [surface, cell, object] = order([r[0], r[1], r[2]]);
    Component {
        ids: Ids {
            surface,
            cell,
            object,
        },
        sums: Sums {
            triangles: r[3],
            vertices: r[4],
            edges: r[5],
            border: r[6],
            area: f64::from_bits(r[7]),
            volume6: (u128::from(r[8]) << 64 | u128::from(r[9])) as i128,
            inside: Inside::unpack(&r[OWN_WORDS..]),
        },
        tiles: r[10] >> 4,
        cut: r[10] & 8 != 0,
        mixed: r[10] & 4 != 0,
        names: (r[10] & 3) as u8,
        measures: r[12],
        colour: r[13] as u32,
        cell_tiles: r[11] >> 32,
        object_tiles: r[11] & 0xFFFF_FFFF,
    }
}

/// Components in order of their first id.
pub(super) struct Rows {
    merge: Merge<RECORD_WORDS>,
    order: fn([u64; 3]) -> [u64; 3],
    next: Option<Record>,
    /// Edges are not counted.
    of_parts: bool,
}

impl Rows {
    fn new(mut merge: Merge<RECORD_WORDS>, order: fn([u64; 3]) -> [u64; 3]) -> Result<Self> {
        let next = merge.next()?;
        Ok(Rows {
            merge,
            order,
            next,
            of_parts: false,
        })
    }

    /// The next id.
    pub fn peek(&self) -> Option<u64> {
        self.next.map(|record| record[0])
    }

    /// Sums up the components of the next id.
    ///
    /// # Errors
    /// If a temporary file cannot be read back.
    pub fn next_group(&mut self) -> Result<Option<Group>> {
        let Some(first) = self.next else {
            return Ok(None);
        };
        let mut group = Group {
            id: first[0],
            total: unpack(&first, self.order),
            parts: 1,
            several_objects: false,
            several_ids: false,
            twins: None,
        };
        let first_ids = group.total.ids;
        let mut last = group.total.ids;
        self.next = self.merge.next()?;
        while let Some(record) = self.next.filter(|r| r[0] == first[0]) {
            let component = unpack(&record, self.order);
            let ids = component.ids;
            group.total.absorb(&component);
            group.parts += 1;
            group.several_objects |= ids.object != last.object;
            group.several_ids |= ids != first_ids;
            if (ids.cell, ids.object) == (last.cell, last.object) && ids.surface != last.surface {
                group.twins.get_or_insert([last, ids]);
            }
            last = ids;
            self.next = self.merge.next()?;
        }
        if self.of_parts {
            group.count_edges();
        }
        Ok(Some(group))
    }
}

/// The components of one id.
pub(super) struct Group {
    pub id: u64,
    /// Their sums; the ids are those of the first.
    pub total: Component,
    /// How many there are.
    pub parts: u64,
    several_objects: bool,
    /// True if they have not all the same ids.
    pub several_ids: bool,
    /// Two surfaces between one cell and one object.
    twins: Option<[Ids; 2]>,
}

impl Group {
    /// Fills in the edges, of parts of which only the triangles were counted: each edge is of two of them, or on the border.
    fn count_edges(&mut self) {
        let sums = &mut self.total.sums;
        sums.edges = (3 * sums.triangles).saturating_sub(sums.border) / 2;
    }

    /// The body that the surfaces bound; `None` if they bound none.
    pub fn body(&self, kind: Kind, cx: &Context) -> Option<Body> {
        let (cell, dims) = (kind.is_below(), cx.tiling.dims.0);
        if kind == Kind::Surface {
            return None;
        }
        let body = Body::of(&self.total.sums, cell, dims, cx.rotated.as_ref())?;
        Some(Body {
            touches: body.touches || self.total.cut,
            ..body
        })
    }

    /// The one cell or object of a single-phase volume, which has no surface.
    pub fn single_phase() -> Self {
        Group {
            id: 1,
            total: Component::default(),
            parts: 0,
            several_objects: false,
            several_ids: false,
            twins: None,
        }
    }
}

/// The kinds of things that have tables, for messages: `surface`, `cell`, `object`, and where cells are parts of
/// components `component`, `neck`; and `wall` where these were asked for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Kind {
    Surface,
    Cell,
    Object,
    Component,
    Neck,
    Wall,
}

impl Kind {
    /// Those of every set.
    pub const ALL: [Kind; 3] = [Kind::Surface, Kind::Cell, Kind::Object];

    pub fn name(self) -> &'static str {
        ["surface", "cell", "object", "component", "neck", "wall"][self as usize]
    }

    pub fn plural(self) -> &'static str {
        [
            "surfaces",
            "cells",
            "objects",
            "components",
            "necks",
            "walls",
        ][self as usize]
    }

    /// True for what voxels below make up.
    pub fn is_below(self) -> bool {
        matches!(self, Kind::Cell | Kind::Component)
    }
}

/// Where the number of surfaces is stated.
const SURFACES: &str = "index.json#/totals/surfaces";

/// Checks the ids as they come, rising, of one kind.
pub(super) struct Laws {
    pub kind: Kind,
    last: u64,
    pub count: u64,
    gap: Option<(u64, u64)>,
    /// Where the last one comes first.
    first: Option<u64>,
    /// Two that are not in the order of where they come first.
    disorder: Option<(u64, u64)>,
}

impl Laws {
    pub fn new(kind: Kind) -> Self {
        Laws {
            kind,
            last: 0,
            count: 0,
            gap: None,
            first: None,
            disorder: None,
        }
    }

    /// Takes the next id, and the body of it if that is one of which all surfaces are known.
    pub fn add(&mut self, group: &Group, body: Option<&Body>, issues: &mut Issues) {
        let id = group.id;
        if self.gap.is_none() && id != self.last + 1 {
            self.gap = Some((self.last, id));
        }
        let first = match self.kind {
            Kind::Surface => Some(group.total.sums.inside.first.vertex),
            _ => body.map(|b| b.first),
        };
        if self.disorder.is_none() && first.zip(self.first).is_some_and(|(own, last)| own <= last) {
            self.disorder = Some((self.last, id));
        }
        self.first = first.or(self.first);
        self.last = id;
        self.count += 1;
        if self.kind == Kind::Surface && group.parts > 1 {
            let message = format!(
                "surface {id} is in {} parts that are not connected",
                group.parts
            );
            issues.add(Code::SurfaceSplit, SURFACES, message);
        }
        if self.kind == Kind::Cell {
            self.check_pairs(group, issues);
            check_names(group, issues);
        }
    }

    /// Takes the next id of which nothing is known.
    pub fn pass(&mut self, id: u64) {
        self.last = id;
        self.count += 1;
    }

    /// Takes the next id of those whose order says nothing of places, and which may have gaps if they are not `dense`.
    pub fn count(&mut self, group: &Group, dense: bool, issues: &mut Issues) {
        if dense && self.gap.is_none() && group.id != self.last + 1 {
            self.gap = Some((self.last, group.id));
        }
        self.last = group.id;
        self.count += 1;
        if self.kind == Kind::Cell {
            self.check_pairs(group, issues);
            check_names(group, issues);
        }
    }

    /// A cell or a component has one surface with each object at most.
    fn check_pairs(&self, group: &Group, issues: &mut Issues) {
        if let Some([a, b]) = group.twins {
            let message = format!(
                "surfaces {} and {} both lie between {} {} and object {}",
                a.surface,
                b.surface,
                self.kind.name(),
                group.id,
                a.object
            );
            issues.add(Code::PairRepeated, SURFACES, message);
        }
    }

    /// Reports ids that are not in order; nothing else may be wrong.
    pub fn check_order(&self, issues: &mut Issues) {
        if let Some((last, next)) = self.disorder {
            let (name, plural) = (self.kind.name(), self.kind.plural());
            let first = match self.kind {
                Kind::Surface => "vertex",
                _ => "voxel",
            };
            let message = format!(
                "the first {first} of {name} {next} comes before that of {name} {last}, expected {plural} numbered \
                 by their first {first}: by z, then y, then x"
            );
            issues.add(
                Code::IdOrder,
                format!("index.json#/totals/{plural}"),
                message,
            );
        }
    }

    /// Reports a gap; nothing else may be wrong, or a gap says nothing.
    pub fn finish(&self, issues: &mut Issues) {
        if let Some((last, next)) = self.gap {
            let (name, plural) = (self.kind.name(), self.kind.plural());
            let message = format!("found {name} {next} after {last}, expected {plural} 1 to n");
            issues.add(Code::IdGap, format!("index.json#/totals/{plural}"), message);
        }
    }
}

/// A node is named after its object as well where the cell borders more than one.
fn check_names(group: &Group, issues: &mut Issues) {
    let cell = group.id;
    let (expected, form) = if group.several_objects {
        (
            2,
            format!("cell_{cell}_object_N, since it borders several objects"),
        )
    } else {
        (1, format!("cell_{cell}, since it borders one object"))
    };
    if group.total.names & !expected != 0 {
        let message = format!("nodes of cell {cell} are named otherwise than {form}");
        issues.add(Code::NodeName, "tiles", message);
    }
}
