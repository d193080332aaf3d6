//! Equal elements of a slice.

use std::collections::BTreeMap;

/// The first of those that are equal to each: `firsts(&['a', 'b', 'a'])` is 0, 1, 0.
pub fn firsts<K: Ord>(keys: &[K]) -> Vec<usize> {
    let mut order: Vec<usize> = (0..keys.len()).collect();
    order.sort_by(|&a, &b| keys[a].cmp(&keys[b]));
    let mut firsts = vec![0; keys.len()];
    for equal in order.chunk_by(|&a, &b| keys[a] == keys[b]) {
        // sorting keeps the order of equal ones
        equal.iter().for_each(|&i| firsts[i] = equal[0]);
    }
    firsts
}

/// Equal ones together, each group in order, and groups in that of their first ones: `groups(&['a', 'b', 'a'])` is
/// 0 and 2, 1.
pub fn groups<K: Ord>(keys: &[K]) -> Vec<Vec<usize>> {
    let mut groups: BTreeMap<usize, Vec<usize>> = BTreeMap::new();
    for (i, first) in firsts(keys).into_iter().enumerate() {
        groups.entry(first).or_default().push(i);
    }
    groups.into_values().collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn each_finds_the_first_that_is_equal(keys in prop::collection::vec(0..9u8, 0..40)) {
            for (key, first) in keys.iter().zip(firsts(&keys)) {
                prop_assert_eq!(keys.iter().position(|k| k == key), Some(first));
            }
        }

        #[test]
        fn groups_are_all_that_are_equal(keys in prop::collection::vec(0..9u8, 0..40)) {
            let groups = groups(&keys);
            prop_assert!(groups.is_sorted_by_key(|group| group[0]));
            for group in &groups {
                let equal = (0..keys.len()).filter(|&i| keys[i] == keys[group[0]]);
                prop_assert_eq!(group, &equal.collect::<Vec<_>>());
            }
            prop_assert_eq!(groups.concat().len(), keys.len());
        }
    }
}
