//! Slow references.

use alvis::grid::Ambiguous;

/// Number of connected objects and cells by plain flood fill, with the rule's neighbourhoods.
pub fn components(dims: [usize; 3], above: &[bool], rule: Ambiguous) -> (u64, u64) {
    let [nx, ny, nz] = dims;
    let mut seen = vec![false; above.len()];
    let mut counts = [0, 0];
    for start in 0..above.len() {
        if seen[start] {
            continue;
        }
        let wide = above[start] == (rule == Ambiguous::Join);
        counts[usize::from(above[start])] += 1;
        let mut stack = vec![start];
        seen[start] = true;
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
                if above[n] == above[v] && !seen[n] {
                    seen[n] = true;
                    stack.push(n);
                }
            }
        }
    }
    debug_assert_eq!(above.len(), nx * ny * nz);
    (counts[1], counts[0])
}
