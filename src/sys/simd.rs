//! Kernels compiled twice: for any processor, and for those with wide vectors and bit counting.
//!
//! The plain x86-64 has neither AVX2 nor a population count, on which the mesher's numbering rests.
//! [`dispatch!`](crate::sys::simd::dispatch) compiles a call for both, and takes the faster one where the
//! processor has it. Results are the same bits: no operation is reordered or contracted.
//! What is called must be compiled in the same unit as the call, or it stays as it is for any processor:
//! classification did so unnoticed until instructions were counted both ways.
//! `ALVIS_PORTABLE=1` in the environment forces the plain way, which is the only one on other
//! architectures.
//! What is fetched from many places is put across by compilers number by number, so there AVX2 is spelled out,
//! see `surface::sums` and `verify::facets`.

use std::sync::LazyLock;

/// Threads to a core, and in all, beyond which more of them only wait for each other.
const TO_A_CORE: usize = 4;
const AT_LEAST: usize = 16;

/// How many threads work if so many are asked for; with 0, one per core.
pub fn threads(asked: usize) -> usize {
    let cores = std::thread::available_parallelism().map_or(1, |n| n.get());
    match asked {
        0 => cores,
        n => n.min((TO_A_CORE * cores).max(AT_LEAST)),
    }
}

/// True if the fast way can be taken.
#[inline]
pub fn is_fast() -> bool {
    static FAST: LazyLock<bool> = LazyLock::new(|| {
        let portable = std::env::var_os("ALVIS_PORTABLE").is_some_and(|v| v == "1");
        !portable && detected()
    });
    *FAST
}

#[cfg(target_arch = "x86_64")]
fn detected() -> bool {
    is_x86_feature_detected!("avx2")
        && is_x86_feature_detected!("bmi1")
        && is_x86_feature_detected!("bmi2")
        && is_x86_feature_detected!("lzcnt")
        && is_x86_feature_detected!("popcnt")
}

#[cfg(not(target_arch = "x86_64"))]
fn detected() -> bool {
    false
}

/// Runs `work`, if it is inlined, as compiled for the fast way.
///
/// # Panics
/// If the processor has no fast way, see [`is_fast`].
#[inline]
pub fn run_fast<R>(work: impl FnOnce() -> R) -> R {
    assert!(is_fast(), "asked before");
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx2,bmi1,bmi2,lzcnt,popcnt")]
        fn compiled<R>(work: impl FnOnce() -> R) -> R {
            work()
        }
        // SAFETY: the processor has these features, as was asserted
        unsafe { compiled(work) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    work()
}

/// Evaluates a call whose callee is `#[inline(always)]`, compiled for the processor at hand.
macro_rules! dispatch {
    ($call:expr) => {
        if $crate::sys::simd::is_fast() {
            $crate::sys::simd::run_fast(|| $call)
        } else {
            $call
        }
    };
}
pub(crate) use dispatch;

/// Asks for the cache line of an element, which need not be in the slice; a hint that changes speed alone.
///
/// Processors foresee what is read or written in order, but not in the dozens of orders of a tile's pieces.
#[inline(always)]
pub fn prefetch<T>(slice: &[T], element: usize) {
    #[cfg(target_arch = "x86_64")]
    {
        use std::arch::x86_64::{_MM_HINT_T0, _mm_prefetch};
        let at = slice.as_ptr().wrapping_add(element);
        // SAFETY: a prefetch reads nothing into the program and faults at no address
        unsafe { _mm_prefetch::<_MM_HINT_T0>(at.cast()) }
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = (slice, element);
}

/// The same for a line that is to be written: other cores are to give it up, which takes longest for memory that a
/// device has just read, as it does that of tiles.
#[inline(always)]
pub fn prefetch_to_write<T>(slice: &[T], element: usize) {
    #[cfg(all(target_arch = "x86_64", not(miri)))]
    {
        let at = slice.as_ptr().wrapping_add(element);
        // spelled out, for the compiler makes it of its own hint only for processors that are said to have it; to
        // others it is no operation
        // SAFETY: a prefetch reads nothing into the program and faults at no address
        unsafe {
            std::arch::asm!("prefetchw [{}]", in(reg) at, options(nostack, preserves_flags, readonly));
        }
    }
    #[cfg(not(all(target_arch = "x86_64", not(miri))))]
    let _ = (slice, element);
}

#[cfg(test)]
mod tests {
    #[inline(always)]
    fn bits_and_sum(words: &[u64]) -> (u32, f32) {
        let bits = words.iter().map(|w| w.count_ones() + w.leading_zeros());
        (bits.sum(), words.iter().map(|&w| w as f32 * 0.1).sum())
    }

    #[test]
    fn both_ways_give_the_same_bits() {
        let words: Vec<u64> = (1..=100u64).map(|i| i.pow(7)).collect();
        let (bits, sum) = dispatch!(bits_and_sum(&words));
        let plain = bits_and_sum(&words);
        assert_eq!((bits, sum.to_bits()), (plain.0, plain.1.to_bits()));
    }
}

#[cfg(test)]
mod thread_tests {
    // no `use`: a bench that takes this file in has no tests
    #[test]
    fn more_threads_than_cores_can_use_are_not_started() {
        let cores = super::threads(0);
        assert!(cores >= 1 && super::threads(1) == 1 && super::threads(16) == 16);
        assert_eq!(super::threads(100_000), (4 * cores).max(16));
    }
}
