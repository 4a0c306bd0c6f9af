//! Where the real data lie, on machines that have them.

pub(crate) use covis_solvers::testing::data;
