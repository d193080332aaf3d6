//! Slow references.

use alvis::grid::Ambiguous;

/// Number of connected objects and cells.
pub fn components(dims: [usize; 3], above: &[bool], rule: Ambiguous) -> (u64, u64) {
    let ids = ids(dims, above, rule);
    let most = |phase: bool| {
        let ids = ids.iter().zip(above).filter(|(_, a)| **a == phase);
        ids.map(|(id, _)| *id).max().unwrap_or(0)
    };
    (most(true), most(false))
}

/// The id of each voxel's object or cell, by plain flood fill with the rule's neighbourhoods: 1, 2, ... by the
/// smallest voxel, objects and cells each for themselves.
pub fn ids(dims: [usize; 3], above: &[bool], rule: Ambiguous) -> Vec<u64> {
    let [nx, ny, nz] = dims;
    let mut ids = vec![0; above.len()];
    let mut counts = [0, 0];
    for start in 0..above.len() {
        if ids[start] > 0 {
            continue;
        }
        let wide = above[start] == (rule == Ambiguous::Join);
        let count = &mut counts[usize::from(above[start])];
        *count += 1;
        let id = *count;
        let mut stack = vec![start];
        ids[start] = id;
        while let Some(v) = stack.pop() {
            let at = [v % nx, v / nx % ny, v / nx / ny];
            for d in 0..27usize {
                let step = [d % 3, d / 3 % 3, d / 9];
                let moved = step.iter().filter(|&&s| s != 1).count();
                let outside = (0..3).any(|a| at[a] + step[a] == 0 || at[a] + step[a] > dims[a]);
                if moved == 0 || moved > if wide { 2 } else { 1 } || outside {
                    continue;
                }
                let [x, y, z]: [usize; 3] = std::array::from_fn(|a| at[a] + step[a] - 1);
                let n = x + nx * (y + ny * z);
                if above[n] == above[v] && ids[n] == 0 {
                    ids[n] = id;
                    stack.push(n);
                }
            }
        }
    }
    debug_assert_eq!(above.len(), nx * ny * nz);
    ids
}
