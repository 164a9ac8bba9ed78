//! Differentiable operations, one family per file: methods on [`Var`](crate::Var) and
//! [`Tape`](crate::Tape).

mod attention;
mod conv;
mod conv3d;
mod dropout;
mod elementwise;
mod gather;
mod graph;
mod graph_sum;
mod layout;
mod linear;
mod matmul;
mod norm;
mod pairwise;
mod pooling;
mod project;
mod reduce;
mod resample;
mod softmax;
mod sparse;

pub use conv3d::Conv3dGeometry;
pub use graph::GraphWeights;
pub use linear::LinearThen;
pub use norm::BatchStatistics;

#[cfg(test)]
mod tests;
