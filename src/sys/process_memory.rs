//! How much memory the process has used, and what it gives back.

/// Largest resident set of this process so far, in bytes; 0 where the system does not tell.
pub fn peak_rss_bytes() -> u64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let kibibytes = status
        .lines()
        .find_map(|line| line.strip_prefix("VmHWM:"))
        .and_then(|rest| rest.trim().strip_suffix("kB"))
        .and_then(|number| number.trim().parse::<u64>().ok());
    kibibytes.map_or(0, |k| k << 10)
}

/// Buffers of so many bytes go back to the system when they are freed.
#[cfg(all(target_os = "linux", target_env = "gnu"))]
const LARGE: libc::c_int = 1 << 20;

/// From now on the allocator gives large buffers back to the system when they are freed.
///
/// By itself glibc raises that limit to what was freed last, up to 32 MiB, and each thread's arena keeps twice as
/// much: memory that the pool does not know of.
pub fn give_back_large_buffers() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: the call only sets numbers of the allocator, under its own lock.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, LARGE);
        libc::mallopt(libc::M_TRIM_THRESHOLD, 2 * LARGE);
    }
}

/// From now on the allocator keeps what is freed, for work that takes the same large buffers again and again: the
/// system would have to fill each with zeros anew. What is kept is no more than what was in use at once.
pub fn keep_large_buffers() {
    #[cfg(all(target_os = "linux", target_env = "gnu"))]
    // SAFETY: as above.
    unsafe {
        libc::mallopt(libc::M_MMAP_THRESHOLD, 32 * LARGE);
        libc::mallopt(libc::M_TRIM_THRESHOLD, 512 * LARGE);
    }
}
