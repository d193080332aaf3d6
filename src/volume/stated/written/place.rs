//! Attributes that may state where a grid lies, by no convention that says so for certain: they are told, not applied.

use crate::volume::stated::warning::Warning;
use crate::volume::stated::written::{Held, Written, plain};

/// Names of rotations and of matrices that place a grid, in plain spelling.
const TURNS: [&str; 14] = [
    "direction",
    "directions",
    "directionmatrix",
    "directioncosines",
    "imageorientationpatient",
    "orientation",
    "orientationmatrix",
    "rotation",
    "rotationmatrix",
    "affine",
    "affinematrix",
    "voxeltoworld",
    "indextoworld",
    "transformmatrix",
];

/// Names of the place of the first voxel.
const STARTS: [&str; 5] = [
    "origin",
    "imageorigin",
    "volumeorigin",
    "gridorigin",
    "imagepositionpatient",
];

/// True for the name of a rotation or of a matrix that places a grid.
#[cfg_attr(not(feature = "hdf5"), allow(dead_code))]
pub(crate) fn is_turn(name: &str) -> bool {
    TURNS.contains(&plain(name).as_str())
}

impl Written {
    /// Warns of attributes that may place the grid elsewhere or turn it; `of` says where they are if not at the array.
    pub(crate) fn placed(&self, of: &str, warnings: &mut Vec<Warning>) {
        for (name, held) in &self.0 {
            let own = plain(name);
            let what = match held {
                Held::Numbers(all) if is_turn(name) && turns(all) => "as it is stored",
                Held::Numbers(all) if STARTS.contains(&own.as_str()) && starts(all) => {
                    "with its first voxel at 0"
                }
                // lists of lists in JSON
                Held::Other if is_turn(name) => "as it is stored",
                _ => continue,
            };
            warnings.push(Warning::from(format!(
                "the attribute {name} ({held}){of} is not applied: if it places or turns the volume, that is taken {what}"
            )));
        }
    }
}

/// True for the numbers of a matrix, or of some of its rows, that is not the identity.
fn turns(numbers: &[f64]) -> bool {
    let columns = match numbers.len() {
        6 | 9 => 3,
        12 | 16 => 4,
        _ => return false,
    };
    let same = |(i, v): (usize, &f64)| *v == f64::from(u8::from(i / columns == i % columns));
    !numbers.iter().enumerate().all(same)
}

fn starts(numbers: &[f64]) -> bool {
    numbers.len() == 3 && numbers.iter().any(|v| *v != 0.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;

    #[test]
    fn what_turns_or_moves_is_told() {
        for (json, told) in [
            (json!({"direction": [-1, 0, 0, 0, 1, 0, 0, 0, 1]}), 1),
            (json!({"direction": [1, 0, 0, 0, 1, 0, 0, 0, 1]}), 0),
            (json!({"Affine": [[0.5, 0, 0, 1], [0, 0.5, 0, 2]]}), 1),
            (json!({"ImageOrientationPatient": [1, 0, 0, 0, 1, 0]}), 0),
            (json!({"ImageOrientationPatient": [1, 0, 0, 0, 0, -1]}), 1),
            (json!({"origin": [1, 2, 3], "rotation": 90}), 1),
            (json!({"origin": [0, 0, 0], "orientation": "RAS"}), 0),
        ] {
            let mut written = Written::default();
            written.add_json("", &json);
            let mut warnings = Vec::new();
            written.placed("", &mut warnings);
            assert_eq!(warnings.len(), told, "{json}");
        }
    }
}
