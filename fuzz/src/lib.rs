//! What the programs here share: an allocator that ends them where an input holds too much, and the
//! choice of the target.
//!
//! The allocator counts what is live, on all threads. What grows while one input runs must stay below
//! 64 MiB, whatever the input says; past it the process aborts, which libFuzzer reports with the
//! input. The largest growth is told at the end. Memory of C code (zstd's) is not counted here;
//! `-rss_limit_mb` bounds it.
#![allow(unsafe_code, reason = "an allocator is unsafe, and so is asking to be called at the end")]

use std::alloc::{GlobalAlloc, Layout, System};
use std::sync::atomic::{AtomicBool, AtomicIsize, Ordering};

// The counters that the compiler adds need libFuzzer in every program.
pub use libfuzzer_sys::fuzz_target;

/// What one input may hold at any time, bytes.
pub const MOST_BYTES: isize = 64 << 20;

/// Bytes that are live; those that were when the input began; the most that any input added.
static LIVE: AtomicIsize = AtomicIsize::new(0);
static BEFORE: AtomicIsize = AtomicIsize::new(0);
static PEAK: AtomicIsize = AtomicIsize::new(0);
static RUNNING: AtomicBool = AtomicBool::new(false);

/// The system's allocator, counted.
#[derive(Debug)]
pub struct Counted;

#[global_allocator]
static ALLOCATOR: Counted = Counted;

fn grow(bytes: isize) {
    let live = LIVE.fetch_add(bytes, Ordering::Relaxed) + bytes;
    let grown = live - BEFORE.load(Ordering::Relaxed);
    if bytes <= 0 || !RUNNING.load(Ordering::Relaxed) {
        return;
    }
    if grown > PEAK.load(Ordering::Relaxed) {
        PEAK.fetch_max(grown, Ordering::Relaxed);
    }
    if grown > MOST_BYTES && RUNNING.swap(false, Ordering::Relaxed) {
        say(format_args!("an input holds {grown} bytes, {MOST_BYTES} are allowed"));
        say(format_args!("{}", std::backtrace::Backtrace::force_capture()));
        std::process::abort();
    }
}

// SAFETY: every call is handed on to the system's allocator as it came.
unsafe impl GlobalAlloc for Counted {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        grow(layout.size().cast_signed());
        // SAFETY: the caller's promise.
        unsafe { System.alloc(layout) }
    }

    unsafe fn alloc_zeroed(&self, layout: Layout) -> *mut u8 {
        grow(layout.size().cast_signed());
        // SAFETY: the caller's promise.
        unsafe { System.alloc_zeroed(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        grow(-layout.size().cast_signed());
        // SAFETY: the caller's promise.
        unsafe { System.dealloc(pointer, layout) }
    }

    unsafe fn realloc(&self, pointer: *mut u8, layout: Layout, size: usize) -> *mut u8 {
        grow(size.cast_signed() - layout.size().cast_signed());
        // SAFETY: the caller's promise.
        unsafe { System.realloc(pointer, layout, size) }
    }
}

#[allow(clippy::print_stderr, reason = "a program that libFuzzer runs")]
fn say(text: std::fmt::Arguments<'_>) {
    eprintln!("{text}");
}

/// Runs one input of a target and watches what it holds.
pub fn run(target: &str, input: &[u8]) {
    BEFORE.store(LIVE.load(Ordering::Relaxed), Ordering::Relaxed);
    RUNNING.store(true, Ordering::Relaxed);
    covis::fuzzing::run(target, input);
    RUNNING.store(false, Ordering::Relaxed);
}

/// The targets' names. The programs ask for them here: a constant with the targets' functions would have
/// all of them compiled once more in each program.
#[must_use]
pub fn targets() -> Vec<&'static str> {
    covis::fuzzing::TARGETS.iter().map(|target| target.name).collect()
}

/// Hands out inputs of at most `length` bytes that make a target hold much.
pub fn largest(target: &str, corpus: &[Vec<u8>], length: usize, take: &mut dyn FnMut(&[u8])) {
    covis::fuzzing::largest(target, corpus, length, take);
}

/// The most that any input added so far, bytes.
#[must_use]
pub fn peak() -> isize {
    PEAK.load(Ordering::Relaxed)
}

/// Begins anew with the peak.
pub fn forget_peak() {
    PEAK.store(0, Ordering::Relaxed);
}

/// Tells the peak when the process ends.
pub fn tell_at_exit() {
    extern "C" fn tell() {
        say(format_args!("peak: {} bytes", peak()));
    }
    unsafe extern "C" {
        fn atexit(function: extern "C" fn()) -> std::ffi::c_int;
    }
    // SAFETY: C's own function, with a function that lives as long as the process.
    let _full = unsafe { atexit(tell) };
}

/// The target that the variable `COVIS_FUZZ_TARGET` names; ends the process where there is none.
#[must_use]
pub fn named_target() -> String {
    let name = std::env::var("COVIS_FUZZ_TARGET").unwrap_or_default();
    let names = targets();
    if !names.contains(&name.as_str()) {
        let names = names.join(", ");
        say(format_args!("error: COVIS_FUZZ_TARGET is \"{name}\"; the targets are {names}"));
        std::process::exit(2);
    }
    name
}
