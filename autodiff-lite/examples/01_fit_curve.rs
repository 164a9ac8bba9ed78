//! A network with one hidden layer learns a curve; an SVG shows how it came there.
//!
//! `cargo run --release -p unsphere-autodiff-lite --example 01_fit_curve [OUTPUT.svg]`
#![allow(clippy::print_stdout, reason = "an example talks to its reader")]

use std::error::Error;
use std::fmt::Write as _;
use std::path::PathBuf;

use autodiff_lite::optim::{Adam, Schedule};
use autodiff_lite::{Param, Tape, Var, impl_module};
use ndarray::{Array1, Array2};
use rand::{RngExt, SeedableRng};
use rand_chacha::ChaCha8Rng;

/// `y(x) = Σ_k output_k tanh(slope_k x + offset_k)`.
struct Network {
    slope: Param,
    offset: Param,
    output: Param,
}
impl_module!(Network: f32 { slope, offset, output });

impl Network {
    /// Steps of random steepness, spread over `[0, 1]`.
    fn new(width: usize, seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let slope = Array1::from_shape_fn(width, |_| rng.random_range(-30.0..30.0_f32));
        let offset = slope.mapv(|slope| -slope * rng.random_range(0.0..1.0_f32));
        let output = Array1::from_shape_fn(width, |_| rng.random_range(-0.1..0.1_f32));
        Self { slope: Param::new(slope), offset: Param::new(offset), output: Param::new(output) }
    }

    /// `[N, 1] -> [N]`; the hidden layer `[N, width]` comes from broadcasting.
    fn forward<'t>(&self, x: Var<'t>) -> Var<'t> {
        let tape = x.tape();
        let hidden = (x * tape.param(&self.slope) + tape.param(&self.offset)).tanh();
        (hidden * tape.param(&self.output)).sum_axis(1)
    }
}

fn curve(x: f32) -> f32 {
    (9.0 * x * x).sin() * (1.2 - x) + 0.3 * (25.0 * x).cos() * x
}

fn main() -> Result<(), Box<dyn Error>> {
    let path = std::env::args_os()
        .nth(1)
        .map_or_else(|| std::env::temp_dir().join("fit_curve.svg"), PathBuf::from);
    let count = 400;
    let x = Array2::from_shape_fn((count, 1), |(i, _)| i as f32 / (count - 1) as f32).into_shared();
    let truth = Array1::from_iter(x.iter().map(|&x| curve(x))).into_shared();

    let mut network = Network::new(48, 1);
    let mut adam = Adam::new(0.01);
    let steps = 3000;
    let schedule = Schedule::cosine(100, steps);
    let mut tape = Tape::train(0);
    let mut lines = Vec::new();
    for step in 0..=steps {
        let y = network.forward(tape.constant(x.clone()));
        let loss = (y - tape.constant(truth.clone())).square().mean();
        if [0, 20, 100, 500, steps].contains(&step) {
            println!("step {step:4}   mean squared error {:.2e}", loss.item());
            lines.push((step, y.value().iter().copied().collect()));
        }
        let gradients = loss.backward();
        tape.reset();
        adam.set_factor(schedule.factor(step));
        adam.step(&mut network, &gradients);
    }
    std::fs::write(&path, draw(&truth.to_vec(), &lines))?;
    println!("drawn in {}", path.display());
    Ok(())
}

/// The truth as a broad grey line, the network at several steps in colours.
fn draw(truth: &[f32], lines: &[(u64, Vec<f32>)]) -> String {
    const COLORS: [&str; 5] = ["#f4c20d", "#e67e22", "#d64541", "#8e44ad", "#1f3a93"];
    let points = |y: &[f32]| {
        let mut text = String::new();
        for (i, y) in y.iter().enumerate() {
            let (x, y) = (20.0 + 760.0 * i as f32 / ((truth.len() - 1) as f32), 200.0 - 130.0 * y);
            let _ = write!(text, "{x:.1},{y:.1} ");
        }
        text
    };
    let mut svg = String::from(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 800 440\" font-family=\"sans-serif\">\n\
         <rect width=\"800\" height=\"440\" fill=\"white\"/>\n",
    );
    let line = |svg: &mut String, color: &str, width: f32, y: &[f32]| {
        let _ = writeln!(
            svg,
            "<polyline fill=\"none\" stroke=\"{color}\" stroke-width=\"{width}\" points=\"{}\"/>",
            points(y)
        );
    };
    line(&mut svg, "#cccccc", 9.0, truth);
    for (k, (step, y)) in lines.iter().enumerate() {
        let color = COLORS[k % COLORS.len()];
        line(&mut svg, color, 2.0, y);
        let _ = writeln!(
            svg,
            "<text x=\"{}\" y=\"425\" fill=\"{color}\" font-size=\"16\">step {step}</text>",
            30 + 150 * k
        );
    }
    svg.push_str("</svg>\n");
    svg
}
