//! `unsphere convert`.

use std::path::PathBuf;

use clap::Args;
use mesh_core::UpAxis;

use super::output;
use super::values::factor;

#[derive(Args, Debug)]
#[command(
    after_help = "Written are .3mf, .glb, .obj, .ply and .stl; read are .glb, .obj, .off, .ply and .stl. STL has no
colours. Printers take the numbers of .3mf and .stl for millimetres and +Z for up. In all other
formats +Y is up. Between the two a mesh is turned, so that what stands keeps standing; a file that
is otherwise needs --input-up.

A textured mesh becomes two more files beside an .obj: the .mtl and the .png of its name.

Examples:
  unsphere convert clock/mesh.glb -o clock.stl --height 80mm  for a printer
  unsphere convert clock/mesh.glb -o clock.3mf --height 80mm  in colours
  unsphere convert part.stl -o part.glb --scale 0.001         metres, upright
  unsphere convert scan.ply -o small.glb --faces 5000         fewer triangles
  unsphere convert parts.obj -o part.stl --solid              parts as one
  unsphere convert cad.obj -o cad.glb --input-up z            +Z was up"
)]
pub(crate) struct ConvertMesh {
    /// The mesh: .obj, .ply, .glb, .off or .stl.
    pub(crate) mesh: PathBuf,
    /// The file to write: .3mf, .glb, .obj, .ply or .stl.
    #[arg(long, short, value_name = "FILE", value_parser = output::mesh())]
    pub(crate) output: PathBuf,
    /// Replace what is there.
    #[arg(long)]
    pub(crate) force: bool,
    /// Make one solid of a closed mesh whose parts or faces run through each other: the surface of all that it encloses.
    ///
    /// It is made anew on a lattice of 128 points along the longest side: edges are rounded, gaps narrower than three steps of it and
    /// hollows within are filled. A texture becomes colours of the vertices.
    #[arg(long)]
    pub(crate) solid: bool,
    /// At most so many triangles. The mesh must be closed, all its faces turned to the same side, no vertex without
    /// faces or where parts only touch; so it stays. A texture becomes colours of the vertices.
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u32).range(4..))]
    pub(crate) faces: Option<u32>,
    /// Multiply all coordinates.
    #[arg(long, value_name = "FACTOR", conflicts_with = "height", value_parser = factor)]
    pub(crate) scale: Option<f64>,
    /// How high it becomes along what is up: 80mm, 8cm, 0.08m or 3in. GLB's unit is the metre, the others' are
    /// millimetres then.
    #[arg(long, value_name = "LENGTH", allow_hyphen_values = true, value_parser = millimetres)]
    pub(crate) height: Option<f64>,
    /// Which axis is up in the file to write [default: z in .3mf and .stl, else y].
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    pub(crate) up: Option<UpAxis>,
    /// Which axis is up in the mesh that is read [default: z in .stl, else y].
    #[arg(long, value_name = "AXIS", allow_hyphen_values = true)]
    pub(crate) input_up: Option<UpAxis>,
}

/// A length with its unit, in millimetres.
fn millimetres(text: &str) -> Result<f64, String> {
    let units = [("mm", 1.0), ("cm", 10.0), ("in", 25.4), ("m", 1000.0)];
    let found = units
        .into_iter()
        .find_map(|(unit, size)| Some(text.strip_suffix(unit)?.trim().parse::<f64>().ok()? * size));
    // In metres it must be a coordinate too.
    let found = found.filter(|&x| x > 0.0 && (0.001 * x as f32).is_normal());
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
        for text in ["80", "mm", "-1mm", "1e999m", "NaNmm", "3 feet", "1e-60mm", "1e39mm"] {
            assert!(millimetres(text).is_err(), "{text}");
        }
        assert_eq!(
            [factor("0.01"), factor("1e-37"), factor("1e38")],
            [Ok(0.01), Ok(1e-37), Ok(1e38)]
        );
        for text in ["0", "-1", "nan", "inf", "1e-60", "1e-40", "1e39", "two"] {
            assert!(factor(text).is_err(), "{text}");
        }
    }
}
