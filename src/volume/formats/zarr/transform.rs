//! Coordinate transformations of OME-Zarr, as one matrix and one shift.
//!
//! <https://ngff.openmicroscopy.org/0.6/>: scale, translation, identity, mapAxis, affine, rotation, sequence,
//! byDimension, and the forward part of bijection. What cannot be a matrix is refused by name.

use crate::error::{Error, Result};
use crate::grid::length;
use crate::volume::formats::zarr::small;
use serde_json::Value;
use std::path::Path;

/// More axes than an array may have.
const MAX_AXES: usize = 8;
/// Transformations in transformations beyond this are not looked into.
const MAX_DEPTH: u32 = 8;

/// Coordinates to coordinates: output i is the sum of `matrix[i][j]` times input j, and `shift[i]`.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Affine {
    pub(crate) matrix: Vec<Vec<f64>>,
    pub(crate) shift: Vec<f64>,
}

impl Affine {
    /// What changes none of `n` coordinates.
    pub(crate) fn identity(n: usize) -> Affine {
        Affine::scale(&vec![1.0; n])
    }

    fn scale(factors: &[f64]) -> Affine {
        let n = factors.len();
        let row = |i: usize| {
            (0..n)
                .map(|j| if i == j { factors[i] } else { 0.0 })
                .collect()
        };
        Affine {
            matrix: (0..n).map(row).collect(),
            shift: vec![0.0; n],
        }
    }

    /// This one, and then another.
    pub(crate) fn then(&self, next: &Affine) -> Affine {
        let inputs = self.matrix.first().map_or(0, Vec::len);
        let row = |to: &Vec<f64>| -> Vec<f64> {
            let sum = |j: usize| {
                to.iter()
                    .zip(&self.matrix)
                    .map(|(a, from)| times(*a, from[j]))
                    .fold(0.0, length::sum)
            };
            (0..inputs).map(sum).collect()
        };
        let shift = next.matrix.iter().zip(&next.shift).map(|(to, own)| {
            let moved = to.iter().zip(&self.shift).map(|(a, b)| times(*a, *b));
            length::sum(*own, moved.fold(0.0, length::sum))
        });
        Affine {
            matrix: next.matrix.iter().map(row).collect(),
            shift: shift.collect(),
        }
    }
}

/// A product in which nothing of something endless is nothing.
fn times(a: f64, b: f64) -> f64 {
    if a == 0.0 || b == 0.0 {
        0.0
    } else {
        length::product(a, b)
    }
}

/// Reads transformations of the group in a folder.
pub(crate) struct Reader<'a> {
    pub(crate) group: &'a Path,
}

impl Reader<'_> {
    fn wrong(&self, found: impl Into<String>, expected: &str) -> Error {
        Error::format(self.group, found, expected)
    }

    /// A list of transformations, one after the other, of `n` coordinates.
    ///
    /// # Errors
    /// [`Error::Unsupported`] with the type of a transformation that is no matrix, [`Error::Format`] if one is
    /// damaged or of another number of coordinates.
    pub(crate) fn list(&self, json: &Value, n: usize) -> Result<Affine> {
        match n <= MAX_AXES {
            true => self.steps(json, n, 0),
            false => Err(self.wrong(format!("{n} axes"), "at most 8")),
        }
    }

    fn steps(&self, json: &Value, n: usize, depth: u32) -> Result<Affine> {
        let mut all = Affine::identity(n);
        for step in json.as_array().into_iter().flatten() {
            all = all.then(&self.step(step, all.matrix.len(), depth)?);
        }
        Ok(all)
    }

    fn step(&self, json: &Value, n: usize, depth: u32) -> Result<Affine> {
        let kind = json["type"].as_str().unwrap_or_default();
        let no = |what: String| Err(Error::unsupported(self.group, what, ""));
        if depth > MAX_DEPTH {
            return no(format!("a {kind} transformation in {depth} others"));
        }
        Ok(match kind {
            "identity" => Affine::identity(n),
            "scale" => Affine::scale(&self.numbers(json, kind, n)?),
            "translation" => Affine {
                shift: self.numbers(json, kind, n)?,
                ..Affine::identity(n)
            },
            "mapAxis" => {
                let from = self.places(&json["mapAxis"], n)?;
                let row = |&i: &usize| Affine::identity(n).matrix.swap_remove(i);
                Affine {
                    matrix: from.iter().map(row).collect(),
                    shift: vec![0.0; from.len()],
                }
            }
            "affine" => {
                let mut rows = self.rows(json, kind, n + 1)?;
                Affine {
                    shift: rows.iter_mut().filter_map(Vec::pop).collect(),
                    matrix: rows,
                }
            }
            "rotation" => Affine {
                matrix: self.rows(json, kind, n)?,
                shift: vec![0.0; n],
            },
            "sequence" => self.steps(&json["transformations"], n, depth + 1)?,
            "bijection" => self.step(&json["forward"], n, depth + 1)?,
            "byDimension" => self.by_dimension(&json["transformations"], n, depth + 1)?,
            "" => {
                return Err(self.wrong("a coordinate transformation without a type", "one with it"));
            }
            other => return no(format!("an OME-Zarr coordinate transformation `{other}`")),
        })
    }

    /// The numbers of a transformation: its own, or those of an array at its path.
    fn values(&self, json: &Value, kind: &str) -> Result<(Vec<usize>, Vec<f64>)> {
        if let Some(path) = json["path"].as_str().filter(|_| json[kind].is_null()) {
            return small::at(self.group, path);
        }
        let list = |json: &Value| -> Option<Vec<f64>> {
            json.as_array()?.iter().map(Value::as_f64).collect()
        };
        if let Some(plain) = list(&json[kind]) {
            return Ok((vec![plain.len()], plain));
        }
        let rows: Option<Vec<Vec<f64>>> = json[kind]
            .as_array()
            .and_then(|rows| rows.iter().map(list).collect());
        match rows {
            Some(rows)
                if rows
                    .first()
                    .is_some_and(|first| rows.iter().all(|r| r.len() == first.len())) =>
            {
                Ok((vec![rows.len(), rows[0].len()], rows.concat()))
            }
            _ => Err(self.wrong(
                format!("the {kind} {} of a coordinate transformation", json[kind]),
                "numbers",
            )),
        }
    }

    fn numbers(&self, json: &Value, kind: &str, n: usize) -> Result<Vec<f64>> {
        let (shape, values) = self.values(json, kind)?;
        if shape == [n] && values.iter().all(|v| v.is_finite()) {
            return Ok(values);
        }
        let found = format!("the {kind} {values:?} of a coordinate transformation");
        Err(self.wrong(found, &format!("{n} numbers, one for each axis")))
    }

    fn rows(&self, json: &Value, kind: &str, columns: usize) -> Result<Vec<Vec<f64>>> {
        let (shape, values) = self.values(json, kind)?;
        match shape[..] {
            [rows, found]
                if found == columns && rows <= MAX_AXES && values.iter().all(|v| v.is_finite()) =>
            {
                Ok(values.chunks_exact(columns).map(<[f64]>::to_vec).collect())
            }
            _ => {
                let found = format!("a matrix {shape:?} of a coordinate transformation `{kind}`");
                Err(self.wrong(found, &format!("rows of {columns} numbers")))
            }
        }
    }

    /// Numbers of axes, each below `n`.
    fn places(&self, json: &Value, n: usize) -> Result<Vec<usize>> {
        let list = json.as_array().filter(|list| list.len() <= MAX_AXES);
        let places = list.and_then(|list| {
            let place = |v: &Value| v.as_u64().map(|i| i as usize).filter(|&i| i < n);
            list.iter().map(place).collect()
        });
        places.ok_or_else(|| self.wrong(format!("the axes {json}"), "numbers of axes, from 0 on"))
    }

    fn by_dimension(&self, json: &Value, n: usize, depth: u32) -> Result<Affine> {
        let parts = json.as_array().map(Vec::as_slice).unwrap_or_default();
        let mut rows: Vec<Option<(Vec<f64>, f64)>> = vec![None; MAX_AXES];
        for part in parts {
            let from = self.places(&part["inputAxes"], n)?;
            let to = self.places(&part["outputAxes"], MAX_AXES)?;
            let inner = self.step(&part["transformation"], from.len(), depth)?;
            if inner.matrix.len() != to.len() {
                return Err(self.wrong(
                    format!("{} results for the axes {to:?}", inner.matrix.len()),
                    "as many",
                ));
            }
            for ((to, row), shift) in to.into_iter().zip(inner.matrix).zip(inner.shift) {
                let mut wide = vec![0.0; n];
                from.iter().zip(row).for_each(|(&j, v)| wide[j] += v);
                if rows[to].replace((wide, shift)).is_some() {
                    return Err(
                        self.wrong(format!("the axis {to} twice in `byDimension`"), "each once")
                    );
                }
            }
        }
        let count = rows.iter().position(Option::is_none).unwrap_or(MAX_AXES);
        if count == 0 || rows[count..].iter().any(Option::is_some) {
            return Err(self.wrong("axes that `byDimension` leaves out", "every axis once"));
        }
        let (matrix, shift) = rows.into_iter().flatten().unzip();
        Ok(Affine { matrix, shift })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    fn list(json: Value, n: usize) -> Result<Affine> {
        Reader {
            group: Path::new("a.zarr"),
        }
        .list(&json, n)
    }

    #[test]
    fn one_after_the_other() {
        let scaled = list(
            json!([{"type": "translation", "translation": [1, 2]}, {"type": "scale", "scale": [3, 4]}]),
            2,
        );
        let known = Affine {
            matrix: vec![vec![3.0, 0.0], vec![0.0, 4.0]],
            shift: vec![3.0, 8.0],
        };
        assert_eq!(scaled.unwrap(), known);
        // as people write these numbers
        let short = list(
            json!([{"type": "scale", "scale": [0.1, 0.7]}, {"type": "translation", "translation": [0.1, 0.2]},
                   {"type": "scale", "scale": [3, 1.1]}, {"type": "translation", "translation": [0.3, 0.01]}]),
            2,
        );
        let known = Affine {
            matrix: vec![vec![0.3, 0.0], vec![0.0, 0.77]],
            shift: vec![0.6, 0.23],
        };
        assert_eq!(short.unwrap(), known);
        let turned = list(
            json!([{"type": "sequence", "transformations": [
                {"type": "identity"},
                {"type": "mapAxis", "mapAxis": [1, 0]},
                {"type": "affine", "affine": [[2, 0, 5], [0, 1, 0]]},
                {"type": "rotation", "rotation": [[0, -1], [1, 0]]},
            ]}]),
            2,
        );
        let known = Affine {
            matrix: vec![vec![-1.0, 0.0], vec![0.0, 2.0]],
            shift: vec![0.0, 5.0],
        };
        assert_eq!(turned.unwrap(), known);
        let parts = list(
            json!([{"type": "byDimension", "transformations": [
                {"inputAxes": [3, 2], "outputAxes": [1, 2],
                 "transformation": {"type": "translation", "translation": [0.5, 1.5]}},
                {"inputAxes": [1], "outputAxes": [0], "transformation": {"type": "scale", "scale": [2]}},
            ]}]),
            4,
        );
        let known = Affine {
            matrix: vec![
                vec![0.0, 2.0, 0.0, 0.0],
                vec![0.0, 0.0, 0.0, 1.0],
                vec![0.0, 0.0, 1.0, 0.0],
            ],
            shift: vec![0.0, 0.5, 1.5],
        };
        assert_eq!(parts.unwrap(), known);
    }

    #[test]
    fn what_is_no_matrix_is_refused_by_name() {
        for name in [
            "displacements",
            "coordinates",
            "projectAxis",
            "inverseOf",
            "warp",
        ] {
            let error = list(json!([{"type": name, "path": "field"}]), 2).unwrap_err();
            assert!(matches!(error, Error::Unsupported { .. }), "{error}");
            assert!(error.to_string().contains(name), "{error}");
            let deep = json!([{"type": "sequence", "transformations": [{"type": name}]}]);
            assert!(list(deep, 2).unwrap_err().to_string().contains(name));
        }
    }

    #[test]
    fn damaged_ones_are_refused() {
        for json in [
            json!({"scale": [1, 1]}),
            json!({"type": "scale"}),
            json!({"type": "scale", "scale": [1]}),
            json!({"type": "scale", "scale": [1, "2"]}),
            json!({"type": "scale", "path": "../other"}),
            json!({"type": "mapAxis", "mapAxis": [0, 2]}),
            json!({"type": "affine", "affine": [[1, 0], [0, 1]]}),
            json!({"type": "rotation", "rotation": []}),
            json!({"type": "byDimension", "transformations": []}),
            json!({"type": "byDimension", "transformations": [
                {"inputAxes": [0], "outputAxes": [1], "transformation": {"type": "identity"}}]}),
        ] {
            let error = list(json!([json]), 2).unwrap_err();
            assert!(matches!(error, Error::Format { .. }), "{json}: {error}");
        }
    }
}
