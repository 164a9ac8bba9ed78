//! `unsphere convert`: a mesh file in, another one out.

use std::path::Path;

use mesh_core::{TriMesh, simplify, write_mesh};
use serde::Serialize;

use crate::args::ConvertMesh;
use crate::console::Console;
use crate::failure::Failure;
use crate::mesh_file::read_mesh;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Converted<'a> {
    output: &'a Path,
    vertices: usize,
    faces: usize,
    /// Along x, y and z of the file, in its numbers.
    size: [f64; 3],
    /// What its numbers are, where that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<&'static str>,
}

pub(crate) fn run(console: Console, arguments: &ConvertMesh) -> Result<(), Failure> {
    let ConvertMesh { mesh: input, output, force, faces, scale, height, up } = arguments;
    if output.exists() && !force {
        let text = format!("{} exists already; choose another name or --force", output.display());
        return Err(Failure::Other(text));
    }
    let mut mesh = read_mesh(console, input)?;
    if mesh.faces.is_empty() {
        return Err(Failure::Input(format!("{}: no faces, expected a surface", input.display())));
    }
    let is = |ending: &str| output.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending));
    if let Some(faces) = *faces {
        mesh = fewer(console, mesh, faces as usize, input)?;
    }
    let mut unit = None;
    if let Some(height) = *height {
        // A unit of its own has only GLB.
        let (name, size) = if is("glb") { ("metres", 0.001) } else { ("millimetres", 1.0) };
        let now = size_of(&mesh)[1];
        if now <= 0.0 {
            return Err(Failure::Input(format!("{}: it is flat along y", input.display())));
        }
        mesh = mesh.scaled([(height * size / now) as f32; 3]);
        unit = Some(name);
    } else if let Some(factor) = *scale {
        mesh = mesh.scaled([factor as f32; 3]);
    }
    let usual = if is("stl") { "z" } else { "y" };
    let upright = up.as_deref().unwrap_or(usual);
    if upright == "z" {
        mesh = mesh.map_positions(|[x, y, z]| [x, -z, y]);
    }
    if is("stl") && (mesh.colors.is_some() || mesh.texture.is_some()) {
        console.warn(format_args!("STL has no colours: {} is without", output.display()));
    }
    write_mesh(output, &mesh).map_err(Failure::other)?;
    let (vertices, faces, size) = (mesh.positions.len(), mesh.faces.len(), size_of(&mesh));
    console.result(&Converted { output, vertices, faces, size, unit }, |found| {
        let [x, y, z] = found.size;
        let unit = found.unit.map_or_else(String::new, |unit| format!(" {unit}"));
        format!(
            "{}: {vertices} vertices, {faces} faces, {x:.4} x {y:.4} x {z:.4}{unit}, +{} is up\n",
            found.output.display(),
            upright.to_uppercase()
        )
    })
}

/// The mesh with at most so many faces.
fn fewer(console: Console, mesh: TriMesh, most: usize, input: &Path) -> Result<TriMesh, Failure> {
    if mesh.faces.len() <= most {
        return Ok(mesh);
    }
    let fails = |error| Failure::Input(format!("{}: --faces: {error}", input.display()));
    let small = simplify(&mesh, most).map_err(fails)?.mesh;
    if small.faces.len() > most {
        console.warn(format_args!(
            "{}: {} faces are left, since with fewer it would not stay closed",
            input.display(),
            small.faces.len()
        ));
    }
    Ok(small)
}

fn size_of(mesh: &TriMesh) -> [f64; 3] {
    let (low, high) = mesh.bounds().unwrap_or_default();
    std::array::from_fn(|k| f64::from(high[k]) - f64::from(low[k]))
}
