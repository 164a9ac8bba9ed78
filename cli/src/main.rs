//! The unsphere command.
fn main() {}
