//! `unsphere convert`: a mesh file in, another one out.

use std::path::Path;

use mesh_core::{TriMesh, UpAxis, counted, simplify, write_mesh};
use recon::fit::solidify;
use serde::Serialize;

use crate::args::{ConvertMesh, refuse_existing};
use crate::console::Console;
use crate::failure::Failure;
use crate::mesh_file::read_mesh;

/// What is printed with `--json`.
#[derive(Debug, Serialize)]
struct Converted<'a> {
    #[serde(serialize_with = "train::path_text::serialize")]
    output: &'a Path,
    vertices: usize,
    faces: usize,
    /// Along x, y and z of the file, in its numbers.
    size: [f64; 3],
    /// The axis that is up in the file.
    up: &'static str,
    /// What its numbers are, where that is known.
    #[serde(skip_serializing_if = "Option::is_none")]
    unit: Option<&'static str>,
}

pub(crate) fn run(console: Console, arguments: &ConvertMesh) -> Result<(), Failure> {
    let ConvertMesh { mesh: input, output, faces, .. } = arguments;
    refuse_existing(&[output], arguments.force)?;
    let mut mesh = read_mesh(console, input)?;
    if mesh.faces.is_empty() {
        return Err(Failure::Input(format!("{}: no faces, expected a surface", input.display())));
    }
    if arguments.solid {
        let refused = |error| Failure::Input(format!("{}: --solid: {error}", input.display()));
        mesh = solidify(&mesh).map_err(refused)?;
        let found = mesh.examined();
        if !found.is_solid() {
            console.warn(format_args!("{}: --solid: still {found}", input.display()));
        }
    }
    if is(output, "stl") && (mesh.colors.take().is_some() | mesh.texture.take().is_some()) {
        console.warn(format_args!("STL has no colours: {} is without", output.display()));
    }
    let fewer = faces.map(|faces| faces as usize).filter(|&faces| mesh.faces.len() > faces);
    if fewer.is_none() {
        refuse_existing(&mesh_core::io::files_of(output, &mesh), arguments.force)?;
    }
    if let Some(faces) = fewer {
        mesh = simplified(console, mesh, faces, input)?;
    }
    let from = arguments.input_up.unwrap_or_else(|| usual(input));
    let up = arguments.up.unwrap_or_else(|| usual(output));
    let (mesh, unit) = sized(mesh.upright(from), arguments)?;
    let mesh = mesh.laid(up);
    write_mesh(output, &mesh).map_err(Failure::other)?;
    let (vertices, faces, size) = (mesh.positions.len(), mesh.faces.len(), size_of(&mesh));
    console.result(&Converted { output, vertices, faces, size, up: up.name(), unit }, |found| {
        let [x, y, z] = found.size;
        let unit = found.unit.map_or_else(String::new, |unit| format!(" {unit}"));
        format!(
            "{}: {vertices} vertices, {faces} faces, {x:.4} x {y:.4} x {z:.4}{unit}, {up} is up\n",
            found.output.display()
        )
    })
}

fn is(path: &Path, ending: &str) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case(ending))
}

/// The mesh with at most so many faces, fewer than it has, and with colours in place of a texture.
fn simplified(
    console: Console,
    mut mesh: TriMesh,
    most: usize,
    input: &Path,
) -> Result<TriMesh, Failure> {
    let input = input.display();
    let texture = mesh.texture.take();
    let fails = |error| Failure::Input(format!("{input}: --faces: {error}"));
    let fewer = simplify(&mesh, most).map_err(fails)?;
    let mut small = fewer.mesh;
    if let Some(texture) = texture {
        console.warn(format_args!(
            "{input}: the texture fits no new triangles: its colours are those of the vertices now"
        ));
        small.colors.get_or_insert_with(|| {
            fewer.sources.iter().map(|point| texture.color_at(point)).collect()
        });
    }
    if small.faces.len() > most {
        console.warn(format_args!(
            "{input}: {} faces are left, since with fewer it would open, fold or have slivers",
            small.faces.len()
        ));
    }
    // The two sides of a sheet come through each other where triangles get longer than it is thick.
    if small.untangle().is_none() {
        let pairs = counted(small.self_intersections().len(), "pair");
        console.warn(format_args!(
            "{input}: {pairs} of the {} faces run through each other: more faces have more room",
            small.faces.len()
        ));
    }
    Ok(small)
}

/// Which axis is up for the programs that take such files.
fn usual(path: &Path) -> UpAxis {
    if is(path, "stl") || is(path, "3mf") { UpAxis::Z } else { UpAxis::Y }
}

/// The mesh, which stands upright, in the size that is asked for, and what its unit is then.
fn sized(
    mesh: TriMesh,
    arguments: &ConvertMesh,
) -> Result<(TriMesh, Option<&'static str>), Failure> {
    let (option, factor, unit) = if let Some(height) = arguments.height {
        // A unit of its own has only GLB.
        let (unit, size) =
            if is(&arguments.output, "glb") { ("metres", 0.001) } else { ("millimetres", 1.0) };
        let now = size_of(&mesh)[1];
        if now <= 0.0 {
            let input = arguments.mesh.display();
            return Err(Failure::Input(format!("{input}: it has no height: it is flat")));
        }
        ("--height", height * size / now, Some(unit))
    } else if let Some(factor) = arguments.scale {
        ("--scale", factor, None)
    } else {
        return Ok((mesh, None));
    };
    let largest = |mesh: &TriMesh| size_of(mesh).into_iter().fold(0.0, f64::max) as f32;
    let is_point = largest(&mesh) == 0.0;
    let mesh = mesh.scaled([factor as f32; 3]);
    let finite = mesh.positions.as_flattened().iter().all(|x| x.is_finite());
    if finite && (factor as f32).is_normal() && (is_point || largest(&mesh).is_normal()) {
        return Ok((mesh, unit));
    }
    let text =
        format!("{option}: {factor:e} times as large it has coordinates beyond single precision");
    Err(Failure::Usage(text))
}

fn size_of(mesh: &TriMesh) -> [f64; 3] {
    let (low, high) = mesh.bounds().unwrap_or_default();
    std::array::from_fn(|k| f64::from(high[k]) - f64::from(low[k]))
}
