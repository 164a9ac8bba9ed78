//! What stopped being a number.

use std::fmt;

/// A value or gradient that became NaN or infinite, and where it did.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct NotFinite {
    /// Steps taken before.
    pub step: u64,
    /// Epochs finished before.
    pub epoch: u64,
    /// The loss term; empty if it shows in none by itself.
    pub term: String,
    /// What it was found in.
    pub tensor: Tensor,
    /// The sample, or all of a batch if none alone shows it.
    pub sample: String,
}

/// What is not finite.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Tensor {
    /// A parameter, before the step.
    Parameter(String),
    /// The value of the term.
    Value,
    /// The gradient of this parameter.
    Gradient(String),
    /// Only the sum over the step.
    Sum,
}

impl fmt::Display for NotFinite {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "step {} (epoch {}): ", self.step, self.epoch)?;
        match &self.tensor {
            Tensor::Parameter(path) => write!(f, "parameter `{path}`")?,
            Tensor::Value => write!(f, "the value of loss `{}`", self.term)?,
            Tensor::Gradient(path) => {
                write!(f, "the gradient of loss `{}` to `{path}`", self.term)?;
            }
            Tensor::Sum => write!(f, "the sum of all gradients")?,
        }
        write!(f, " is not finite in {}", self.sample)?;
        f.write_str("; the last checkpoint is whole: begin another run `--from` it, with a smaller `learning-rate`, with `clip-norm`, or without that sample")
    }
}

impl std::error::Error for NotFinite {}
