//! Converts a mesh between OBJ, PLY and GLB:
//! `cargo run -p unsphere-mesh-core --example convert -- in.obj out.glb`.
//!
//! Without arguments it makes a coloured sphere and writes it in all three formats.

#![allow(clippy::print_stdout, reason = "it is a program")]

use std::error::Error;
use std::path::{Path, PathBuf};

use mesh_core::{TriMesh, primitives, read_mesh, write_mesh};

fn main() -> Result<(), Box<dyn Error>> {
    let paths: Vec<PathBuf> = std::env::args_os().skip(1).map(PathBuf::from).collect();
    match paths.as_slice() {
        [from, to] => convert(from, to),
        [] => {
            let mut mesh = primitives::icosphere(4);
            // Where a vertex is says what colour it has.
            mesh.colors = Some(mesh.positions.iter().map(|p| p.map(|v| 0.5 + 0.5 * v)).collect());
            for name in ["sphere.obj", "sphere.ply", "sphere.glb"] {
                let path = std::env::temp_dir().join(name);
                write_mesh(&path, &mesh)?;
                println!("wrote {} ({})", path.display(), describe(&mesh));
            }
            Ok(())
        }
        _ => Err("give a mesh to read and a mesh to write, or nothing".into()),
    }
}

fn convert(from: &Path, to: &Path) -> Result<(), Box<dyn Error>> {
    let mesh = read_mesh(from)?;
    println!("read  {} ({})", from.display(), describe(&mesh));
    write_mesh(to, &mesh)?;
    println!("wrote {}", to.display());
    Ok(())
}

fn describe(mesh: &TriMesh) -> String {
    let surface = match (&mesh.texture, &mesh.colors) {
        (Some(texture), _) => {
            format!("texture {} x {}", texture.image.width, texture.image.height)
        }
        (None, Some(_)) => "vertex colours".to_owned(),
        (None, None) => "no colours".to_owned(),
    };
    format!("{} vertices, {} triangles, {surface}", mesh.positions.len(), mesh.faces.len())
}
