//! `unsphere convert`.

use std::path::PathBuf;

use clap::Args;

use super::output;
use super::values::factor;

#[derive(Args, Debug)]
#[command(
    after_help = "Written are .glb, .obj, .ply and .stl; read are these and .off. STL has no colours; printers take
its numbers for millimetres and +Z for up, so what is +Y elsewhere becomes +Z there; --up y keeps it.

Examples:
  unsphere convert clock/mesh.glb -o clock.stl --height 80mm   for a printer
  unsphere convert scan.ply -o small.glb --faces 5000          fewer triangles, closed as before
  unsphere convert mesh.obj -o mesh.ply --scale 0.01           centimetres to metres"
)]
pub(crate) struct ConvertMesh {
    /// The mesh: .obj, .ply, .glb, .off or .stl.
    pub(crate) mesh: PathBuf,
    /// The file to write: .glb, .obj, .ply or .stl.
    #[arg(long, short, value_name = "FILE", value_parser = output::mesh())]
    pub(crate) output: PathBuf,
    /// Replace what is there.
    #[arg(long)]
    pub(crate) force: bool,
    /// At most so many triangles; the mesh must be closed, and stays so.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..))]
    pub(crate) faces: Option<u32>,
    /// Multiply all coordinates.
    #[arg(long, value_name = "FACTOR", conflicts_with = "height", value_parser = factor)]
    pub(crate) scale: Option<f64>,
    /// How high it becomes along +Y: 80mm, 8cm, 0.08m or 3in. GLB's unit is the metre, the others' are millimetres then.
    #[arg(long, value_name = "LENGTH", value_parser = millimetres)]
    pub(crate) height: Option<f64>,
    /// Which axis is up in the file [default: z in .stl, else y].
    #[arg(long, value_name = "AXIS", value_parser = ["y", "z"])]
    pub(crate) up: Option<String>,
}

/// A length with its unit, in millimetres.
fn millimetres(text: &str) -> Result<f64, String> {
    let units = [("mm", 1.0), ("cm", 10.0), ("in", 25.4), ("m", 1000.0)];
    let found = units
        .into_iter()
        .find_map(|(unit, size)| Some(text.strip_suffix(unit)?.trim().parse::<f64>().ok()? * size));
    let found = found.filter(|length| *length > 0.0 && length.is_finite());
    found.ok_or_else(|| "expected a length with its unit: 80mm, 8cm, 0.08m or 3in".to_owned())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lengths_have_units() {
        for text in ["80mm", "8cm", "0.08m", "80 mm"] {
            assert_eq!(millimetres(text), Ok(80.0), "{text}");
        }
        assert_eq!(millimetres("2in"), Ok(50.8));
        for text in ["80", "mm", "-1mm", "1e999m", "NaNmm", "3 feet"] {
            assert!(millimetres(text).is_err(), "{text}");
        }
        assert_eq!((factor("0.01"), factor("0").is_err()), (Ok(0.01), true));
    }
}
