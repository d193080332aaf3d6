//! Voxels of other lengths along x than along y.

use super::*;

/// What is round in the body is an ellipse in voxels that are longer along an axis, and the other way round.
#[test]
fn voxels_that_are_longer_along_an_axis_are_told() {
    let text = "voxels are 1 long along x and 2 along y";
    for (squeezed, is_found) in [(1.0, true), (2.0, false)] {
        for (spacing, is_told) in [([1.0, 2.0, 1.0], true), ([2.0, 2.0, 1.0], false)] {
            let plain = scan([100, 100, 8], |[x, y, _]| {
                round(x, 50.0 + squeezed * (y - 50.0), [50.0, 50.0, 40.0])
            });
            let header = plain.header();
            let placement = Placement {
                spacing,
                ..Placement::default()
            };
            let mut samples = vec![0u16; 100 * 100 * 8];
            let out = bytemuck::cast_slice_mut(&mut samples);
            plain.read_box(0..100, 0..100, 0..8, out).unwrap();
            let volume = MemoryVolume::new(header.dims, placement, samples).unwrap();
            let words = match find(&volume) {
                Ok(found) => {
                    assert!(is_found, "{found:?}");
                    found.warnings.join("\n")
                }
                Err(why) => {
                    assert!(!is_found, "{why}");
                    why.to_string()
                }
            };
            assert_eq!(words.contains(text), is_told, "{words}");
        }
    }
}
