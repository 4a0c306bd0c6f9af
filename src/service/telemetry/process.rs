//! What the system reports about this process, if it has `/proc`.
//!
//! Elsewhere these rows are left out.

/// Bytes of memory that are resident; `None` if the system does not report it.
pub(super) fn resident_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmRSS:"))?;
    let kibibytes: u64 = line.trim().strip_suffix("kB")?.trim().parse().ok()?;
    Some(kibibytes * 1024)
}

/// Files, sockets and pipes that are open; `None` if the system does not report it.
pub(super) fn open_files() -> Option<usize> {
    // Listing the folder opens one itself.
    std::fs::read_dir("/proc/self/fd").ok().map(|files| files.count().saturating_sub(1))
}

/// The most that may be open; `None` if the system does not report it, or sets no limit.
pub(in crate::service) fn max_open_files() -> Option<u64> {
    let limits = std::fs::read_to_string("/proc/self/limits").ok()?;
    let line = limits.lines().find_map(|line| line.strip_prefix("Max open files"))?;
    line.split_whitespace().next()?.parse().ok()
}
