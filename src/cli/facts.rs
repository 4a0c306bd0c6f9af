//! Facts about the build, for `covis --version`. The build script (`build.rs`) provides them.
//!
//! The machine that the program runs on is not asked.

/// Version, commit, target, profile, features and compiler, a line each.
pub(super) const LONG_VERSION: &str = concat!(
    env!("CARGO_PKG_VERSION"),
    "\ncommit:   ",
    env!("COVIS_BUILD_COMMIT"),
    "\ntarget:   ",
    env!("COVIS_BUILD_TARGET"),
    "\nprofile:  ",
    env!("COVIS_BUILD_PROFILE"),
    "\nfeatures: ",
    env!("COVIS_BUILD_FEATURES"),
    "\ncompiler: ",
    env!("COVIS_BUILD_COMPILER"),
);
