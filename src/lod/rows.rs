//! The rows of a node's file: each surface as a strip of its own, by their numbers, and behind them their fins.

use super::build::{Built, Coarse, Recipe};
use super::fins::{FinShape, in_a_row};
use super::gap::{Moved, Segment};
use super::mesh::Surface;
use crate::strip::{Stripifier, append_strip, connect};
use crate::tile::Extras;
use crate::tile::node::NodePart;

/// A node that is being taken apart into its surfaces.
pub struct Rows<'a> {
    /// As [`Built::error`].
    pub error: f32,
    /// Those of its children.
    pub surfaces: &'a [Surface],
    pub coarse: &'a Coarse,
    pub recipe: &'a Recipe,
}

impl Rows<'_> {
    /// The node, whose border has moved so far.
    pub fn finish(&self, moved: Moved, stripifier: &mut Stripifier) -> Built {
        let fin_width = self.recipe.fin_width + moved.gap;
        let mut order: Vec<usize> = (0..self.surfaces.len()).collect();
        order.sort_by_key(|&i| self.surfaces[i].key);
        let mut built = Built {
            parts: Vec::new(),
            fin_rows: 0,
            triangles: self.coarse.triangles.len() as u64,
            fin_triangles: 0,
            strips: 0,
            border_edges: moved.segments.iter().filter(|s| s.from != s.to).count() as u64,
            error: self.error,
            gap: moved.gap,
            fin_width,
        };
        let mut of_surface: Vec<Vec<[u32; 3]>> = vec![Vec::new(); self.surfaces.len()];
        for t in &self.coarse.triangles {
            of_surface[self.surface_of(t[0])].push(*t);
        }
        let mut numbers = vec![u32::MAX; self.coarse.clusters.all.len()];
        for &i in &order {
            if !of_surface[i].is_empty() {
                let triangles = std::mem::take(&mut of_surface[i]);
                let (part, strips) = self.part(i, triangles, &mut numbers, stripifier);
                built.parts.push(part);
                built.strips += strips;
            }
        }
        if fin_width > 0 {
            self.add_fins(&moved, &order, &mut built);
        }
        built
    }

    fn surface_of(&self, cluster: u32) -> usize {
        self.coarse.clusters.all[cluster as usize].surface as usize
    }

    fn normal(&self, cluster: u32) -> [f32; 3] {
        let sum = self.coarse.clusters.all[cluster as usize]
            .normal
            .map(|v| v as f64);
        let length = (sum[0] * sum[0] + sum[1] * sum[1] + sum[2] * sum[2]).sqrt();
        match length > 0.0 {
            true => sum.map(|v| (v / length) as f32),
            // those of a thin sheet may cancel
            false => [0.0, 0.0, 1.0],
        }
    }

    fn extras(&self, surface: usize, triangles: usize) -> Extras {
        Extras {
            triangles: triangles as u64,
            ..self.surfaces[surface].extras.clone()
        }
    }

    /// The part of a surface, and how many strips it has; `numbers` has no number but the largest, before and after.
    fn part(
        &self,
        surface: usize,
        mut triangles: Vec<[u32; 3]>,
        numbers: &mut [u32],
        stripifier: &mut Stripifier,
    ) -> (NodePart, u64) {
        let mut vertices: Vec<u32> = Vec::new();
        for corner in triangles.as_flattened_mut() {
            let number = &mut numbers[*corner as usize];
            if *number == u32::MAX {
                *number = vertices.len() as u32;
                vertices.push(*corner);
            }
            *corner = *number;
        }
        let points = &self.coarse.placed.points;
        let mut strip = Vec::with_capacity(triangles.len() * 3 / 2);
        let strips = stripifier.stripify(&mut connect(&triangles), &mut strip);
        vertices
            .iter()
            .for_each(|&c| numbers[c as usize] = u32::MAX);
        let vertices = by_first_use(&mut strip, &vertices);
        let part = NodePart {
            extras: self.extras(surface, triangles.len()),
            points: vertices.iter().map(|&c| points[c as usize]).collect(),
            normals: vertices.iter().map(|&c| self.normal(c)).collect(),
            strip,
        };
        (part, strips as u64)
    }

    /// Adds the fins of each surface, behind the surfaces.
    fn add_fins(&self, moved: &Moved, order: &[usize], built: &mut Built) {
        let Recipe { planes, rules, .. } = self.recipe;
        // 16 bits reach so far beyond the planes at least
        let room = 2_000 * rules.step;
        let shape = FinShape {
            half_width: built.fin_width,
            step: rules.step,
            limits: [planes.low.map(|v| v - room), planes.high.map(|v| v + room)],
        };
        let mut of_surface: Vec<Vec<Segment>> = vec![Vec::new(); self.surfaces.len()];
        for segment in &moved.segments {
            of_surface[self.surface_of(segment.from)].push(*segment);
        }
        for &i in order {
            if of_surface[i].is_empty() {
                continue;
            }
            let row = in_a_row(&of_surface[i]);
            let mut part = NodePart {
                extras: self.extras(i, 2 * row.len()),
                points: Vec::with_capacity(4 * row.len()),
                normals: Vec::with_capacity(4 * row.len()),
                strip: Vec::with_capacity(6 * row.len()),
            };
            for segment in &row {
                let first = part.points.len() as u32;
                let corners = shape.corners(segment, &self.coarse.placed.points);
                part.points.extend(corners);
                // one for all four packs best
                part.normals.extend([self.normal(segment.from); 4]);
                append_strip(&mut part.strip, &[0, 1, 2, 3], first);
            }
            let fins = row.len() as u64;
            built.fin_triangles += 2 * fins;
            built.strips += fins;
            built.fin_rows += 1;
            built.parts.push(part);
        }
    }
}

/// Numbers vertices anew in the order in which a strip comes upon them, which packs best; returns them in this order.
fn by_first_use(strip: &mut [u32], vertices: &[u32]) -> Vec<u32> {
    let mut numbers = vec![u32::MAX; vertices.len()];
    let mut order = Vec::with_capacity(vertices.len());
    for v in strip {
        let number = &mut numbers[*v as usize];
        if *number == u32::MAX {
            *number = order.len() as u32;
            order.push(vertices[*v as usize]);
        }
        *v = *number;
    }
    order
}
