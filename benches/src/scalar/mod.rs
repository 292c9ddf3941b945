//! Two of the solver's kernels once more, from their formulas: one group, one edge at a time in glam's vectors of three. What eight side by side are measured against.

mod calibrated_edges;
mod shape_matching;
#[cfg(test)]
mod testing;

pub use calibrated_edges::ScalarEdges;
pub use shape_matching::ScalarGroups;
