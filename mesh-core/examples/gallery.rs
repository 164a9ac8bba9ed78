//! Draws all primitives into one SVG image, and writes each as an OBJ file beside it.
//!
//! ```text
//! cargo run -p unsphere-mesh-core --example gallery -- gallery.svg
//! ```

use std::fmt::Write as _;
use std::path::PathBuf;

use mesh_core::{Camera, TriMesh, face_normals, primitives, write_mesh};

/// Pixels per image.
const SIZE: usize = 220;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = PathBuf::from(std::env::args().nth(1).unwrap_or_else(|| "gallery.svg".into()));
    let vase = [[0.35, 0.0], [0.6, 0.25], [0.62, 0.5], [0.25, 0.95], [0.25, 1.1], [0.4, 1.25]];
    let star: Vec<[f32; 2]> = (0..10)
        .map(|i| {
            let (sin, cos) = (i as f32 * std::f32::consts::PI / 5.0).sin_cos();
            let radius = if i % 2 == 0 { 1.0 } else { 0.45 };
            [radius * sin, radius * cos]
        })
        .collect();
    let shapes = [
        ("icosphere", primitives::icosphere(2)),
        ("uv_sphere", primitives::uv_sphere(12, 20)),
        ("pixel2mesh_ellipsoid", primitives::pixel2mesh_ellipsoid(0)),
        ("cuboid", primitives::cuboid([1.0, 0.7, 1.3])),
        ("torus", primitives::torus(0.7, 0.3, 28, 14)),
        ("cylinder", primitives::cylinder(0.6, 1.3, 24)),
        ("cone", primitives::cone(0.7, 1.3, 24)),
        ("capsule", primitives::capsule(0.45, 0.7, 6, 20)),
        ("lathe", primitives::lathe(&vase, 28)),
        ("extrude", primitives::extrude(&star, 0.4)?),
    ];

    let columns = 5;
    let (width, height) = (columns * SIZE, shapes.len().div_ceil(columns) * (SIZE + 20));
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}\" height=\"{height}\" \
         font-family=\"sans-serif\" font-size=\"13\" text-anchor=\"middle\">\n\
         <rect width=\"100%\" height=\"100%\" fill=\"white\"/>\n"
    );
    for (i, (name, mesh)) in shapes.iter().enumerate() {
        let (x, y) = ((i % columns) * SIZE, (i / columns) * (SIZE + 20));
        writeln!(svg, "<g transform=\"translate({x} {y})\">")?;
        draw(&mut svg, &mesh.clone().normalized(1.45))?;
        let label = format!("{name}: {} faces", mesh.faces.len());
        writeln!(svg, "<text x=\"{}\" y=\"{}\">{label}</text></g>", SIZE / 2, SIZE + 10)?;
        write_mesh(path.with_file_name(format!("{name}.obj")), mesh)?;
    }
    svg.push_str("</svg>\n");
    std::fs::write(&path, svg)?;
    Ok(())
}

/// Fills the faces that look this way, furthest first, each by the light that falls on it.
fn draw(svg: &mut String, mesh: &TriMesh) -> std::fmt::Result {
    let eye = [2.2, 1.7, 3.0];
    let camera = Camera::look_at(eye, [0.0; 3], [0.0, 1.0, 0.0], 0.5, SIZE, SIZE);
    let normals = face_normals(&mesh.positions, &mesh.faces);
    let mut visible: Vec<(f64, String)> = Vec::new();
    for (face, normal) in mesh.faces.iter().zip(normals) {
        let corners = face.map(|v| mesh.positions[v as usize].map(f64::from));
        let toward: f64 = (0..3).map(|k| f64::from(normal[k]) * (eye[k] - corners[0][k])).sum();
        if toward <= 0.0 {
            continue;
        }
        let light: f64 = (0..3).map(|k| f64::from(normal[k]) * [0.3, 0.85, 0.43][k]).sum();
        let gray = 0.45 + 0.5 * light.max(0.0);
        let [r, g, b] = [230.0, 170.0, 110.0].map(|c| (c * gray) as u8);
        let seen = corners.map(|p| camera.project(p));
        let points: Vec<String> =
            seen.iter().map(|p| format!("{:.2},{:.2}", p.column, p.row)).collect();
        let depth = seen.iter().map(|p| p.depth).sum::<f64>();
        let points = points.join(" ");
        visible.push((
            depth,
            format!(
                "<polygon points=\"{points}\" fill=\"rgb({r},{g},{b})\" \
                 stroke=\"#3a2a1a\" stroke-width=\"0.5\" stroke-linejoin=\"round\"/>"
            ),
        ));
    }
    visible.sort_by(|a, b| b.0.total_cmp(&a.0));
    visible.iter().try_for_each(|(_, polygon)| writeln!(svg, "{polygon}"))
}
