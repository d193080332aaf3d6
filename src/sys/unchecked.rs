//! Elements without bounds checks, for the innermost loops.
//!
//! The walk over cubes looks up some fifty elements for each: to compare every index with a length would be a
//! fifth of its instructions. With debug assertions, as all tests are built,
//! every index is compared.

use crate::sys::simd::{prefetch, prefetch_to_write};

/// Elements that are read.
#[derive(Debug, Clone, Copy)]
pub struct Unchecked<'a, T>(&'a [T]);

impl<'a, T: Copy> Unchecked<'a, T> {
    /// # Safety
    /// All that is asked for lies in the slice.
    #[inline(always)]
    pub unsafe fn new(slice: &'a [T]) -> Self {
        Unchecked(slice)
    }

    /// Element `i`.
    #[inline(always)]
    pub fn at(self, i: usize) -> T {
        debug_assert!(i < self.0.len(), "{i} of {}", self.0.len());
        // SAFETY: as promised to `new`
        unsafe { *self.0.get_unchecked(i) }
    }

    /// Asks for the cache line of element `i`, which need not be there.
    #[inline(always)]
    pub fn prefetch(self, i: usize) {
        prefetch(self.0, i);
    }
}

/// Elements that are read and written.
#[derive(Debug)]
pub struct UncheckedMut<'a, T>(&'a mut [T]);

impl<'a, T: Copy> UncheckedMut<'a, T> {
    /// # Safety
    /// All that is asked for or written lies in the slice.
    #[inline(always)]
    pub unsafe fn new(slice: &'a mut [T]) -> Self {
        UncheckedMut(slice)
    }

    /// The same elements, under the same promise.
    #[inline(always)]
    pub fn again(&mut self) -> UncheckedMut<'_, T> {
        UncheckedMut(self.0)
    }

    /// Element `i`.
    #[inline(always)]
    pub fn at(&self, i: usize) -> T {
        debug_assert!(i < self.0.len(), "{i} of {}", self.0.len());
        // SAFETY: as promised to `new`
        unsafe { *self.0.get_unchecked(i) }
    }

    /// Element `i`, to be changed.
    #[inline(always)]
    pub fn at_mut(&mut self, i: usize) -> &mut T {
        debug_assert!(i < self.0.len(), "{i} of {}", self.0.len());
        // SAFETY: as promised to `new`
        unsafe { self.0.get_unchecked_mut(i) }
    }

    /// Asks for the cache line of element `i`, which need not be there, to write to it.
    #[inline(always)]
    pub fn prefetch(&self, i: usize) {
        prefetch_to_write(self.0, i);
    }

    /// Writes `N` elements from `i` on.
    #[inline(always)]
    pub fn put<const N: usize>(&mut self, i: usize, values: [T; N]) {
        debug_assert!(i + N <= self.0.len(), "{i} + {N} of {}", self.0.len());
        // SAFETY: as promised to `new`
        unsafe { self.0.as_mut_ptr().add(i).cast::<[T; N]>().write(values) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn elements_are_those_of_the_slice() {
        let mut numbers: Vec<u32> = (0..100).collect();
        // SAFETY: below 100
        let mut unchecked = unsafe { UncheckedMut::new(&mut numbers) };
        unchecked.put(96, [1, 2, 3, 4]);
        *unchecked.at_mut(0) = unchecked.at(99) + 1;
        // SAFETY: below 100
        let read = unsafe { Unchecked::new(&numbers) };
        assert_eq!([0, 1, 95, 96, 99].map(|i| read.at(i)), [5, 1, 95, 1, 4]);
    }

    #[test]
    #[cfg(debug_assertions)]
    #[should_panic = "99 + 2 of 100"]
    fn tests_compare_indices() {
        let mut numbers = [0; 100];
        // SAFETY: not kept, which is what is to be seen
        unsafe { UncheckedMut::new(&mut numbers) }.put(99, [1, 2]);
    }
}
