//! `unsphere`: images of an object in, a triangle mesh out.

use std::process::ExitCode;

use unsphere::Program;

fn main() -> ExitCode {
    Program::new().main()
}
