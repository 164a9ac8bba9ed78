//! The cameras around the hull, drawn from above and from the side.

use std::fmt::Write as _;

use mesh_core::vector::{norm, sub};
use mesh_core::{Camera, VoxelGrid};

use super::hull::Sphere;

/// Side of one drawing of the cameras.
const PANEL: f64 = 420.0;
/// Cameras that are drawn; of more, evenly chosen ones.
const MOST_CAMERAS: usize = 120;

/// Which two axes of the world a drawing shows: right and up.
struct Panel {
    title: &'static str,
    axes: [usize; 2],
    /// -1 where the axis points the other way on paper.
    signs: [f64; 2],
    names: [&'static str; 2],
}

const PANELS: [Panel; 2] = [
    Panel { title: "from above", axes: [0, 2], signs: [1.0, -1.0], names: ["x", "-z"] },
    Panel { title: "from +z", axes: [0, 1], signs: [1.0, 1.0], names: ["x", "y"] },
];

/// The cameras around the hull, from above and from the side: one `<svg>` element.
///
/// Each is the pyramid of what it sees, the first one in orange; the hull is grey.
pub(crate) fn cameras_svg(
    cameras: &[&Camera],
    sphere: Option<Sphere>,
    hull: Option<&VoxelGrid>,
) -> String {
    let step = cameras.len().div_ceil(MOST_CAMERAS).max(1);
    let cameras: Vec<&Camera> = cameras.iter().step_by(step).copied().collect();
    let middle = sphere.map_or_else(|| mean_center(&cameras), |sphere| sphere.center);
    let reach = cameras
        .iter()
        .map(|camera| norm(sub(camera.center().into(), middle)))
        .chain(sphere.map(|sphere| sphere.radius))
        .filter(|d| d.is_finite())
        .fold(0.0, f64::max)
        .max(1e-9);
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {} {}\" role=\"img\" \
         aria-label=\"Cameras around the object\" font-family=\"sans-serif\" font-size=\"12\">",
        2.0 * PANEL + 20.0,
        PANEL + 20.0
    );
    for (k, panel) in PANELS.iter().enumerate() {
        let left = k as f64 * (PANEL + 20.0);
        let place = |p: [f64; 3]| -> [f64; 2] {
            let scale = 0.44 * PANEL / reach;
            let along =
                |axis: usize| panel.signs[axis] * (p[panel.axes[axis]] - middle[panel.axes[axis]]);
            [left + PANEL / 2.0 + scale * along(0), 20.0 + PANEL / 2.0 - scale * along(1)]
        };
        let _ = write!(
            svg,
            "<rect x=\"{left}\" y=\"20\" width=\"{PANEL}\" height=\"{PANEL}\" fill=\"none\" \
             stroke=\"#888\" stroke-width=\"0.5\"/>\
             <text x=\"{left}\" y=\"13\" fill=\"#888\">{}: {} to the right, {} up</text>",
            panel.title, panel.names[0], panel.names[1]
        );
        if let Some(hull) = hull {
            draw_hull(hull, panel, &place, &mut svg);
        }
        for (k, camera) in cameras.iter().enumerate().rev() {
            let color = if k == 0 { "#d55e00" } else { "#0072b2" };
            draw_camera(camera, 0.12 * reach, color, &place, &mut svg);
        }
    }
    svg.push_str("</svg>");
    svg
}

fn mean_center(cameras: &[&Camera]) -> [f64; 3] {
    let n = cameras.len().max(1) as f64;
    std::array::from_fn(|k| cameras.iter().map(|c| c.center()[k]).sum::<f64>() / n)
}

/// The shadow of the hull on the panel, one rectangle for each run of cells.
fn draw_hull(
    hull: &VoxelGrid,
    panel: &Panel,
    place: &dyn Fn([f64; 3]) -> [f64; 2],
    svg: &mut String,
) {
    let [a, b] = panel.axes;
    let [across, up] = [hull.dims[a], hull.dims[b]];
    let mut shadow = vec![false; across * up];
    for (k, _) in hull.bits.iter().enumerate().filter(|(_, bit)| **bit) {
        let cell =
            [k % hull.dims[0], k / hull.dims[0] % hull.dims[1], k / hull.dims[0] / hull.dims[1]];
        shadow[cell[b] * across + cell[a]] = true;
    }
    let corner = |i: usize, j: usize| {
        let mut p = [0.0; 3];
        p[a] = f64::from(hull.origin[a] + hull.cell[a] * j as f32);
        p[b] = f64::from(hull.origin[b] + hull.cell[b] * i as f32);
        place(p)
    };
    let mut path = String::new();
    for i in 0..up {
        let mut j = 0;
        while j < across {
            let run = shadow[i * across + j..(i + 1) * across].iter().take_while(|s| **s).count();
            if run > 0 {
                let ([x0, y0], [x1, y1]) = (corner(i, j), corner(i + 1, j + run));
                let _ = write!(path, "M{x0:.1} {y0:.1}H{x1:.1}V{y1:.1}H{x0:.1}Z");
            }
            j += run.max(1);
        }
    }
    let _ = write!(svg, "<path d=\"{path}\" fill=\"#999\" fill-opacity=\"0.55\"/>");
}

fn draw_camera(
    camera: &Camera,
    depth: f64,
    color: &str,
    place: &dyn Fn([f64; 3]) -> [f64; 2],
    svg: &mut String,
) {
    let (w, h) = (camera.width as f64, camera.height as f64);
    let [x, y] = place(camera.center().into());
    let corners = [[0.0, 0.0], [w, 0.0], [w, h], [0.0, h]]
        .map(|[column, row]| place(camera.unproject(column, row, depth)));
    if ![x, y].iter().chain(corners.iter().flatten()).all(|v| v.is_finite()) {
        return;
    }
    let mut path = String::new();
    for (k, [cx, cy]) in corners.iter().enumerate() {
        let [nx, ny] = corners[(k + 1) % 4];
        let _ = write!(path, "M{x:.1} {y:.1}L{cx:.1} {cy:.1}L{nx:.1} {ny:.1}");
    }
    let _ = write!(
        svg,
        "<path d=\"{path}\" fill=\"none\" stroke=\"{color}\" stroke-width=\"0.8\" \
         stroke-opacity=\"0.8\"/><circle cx=\"{x:.1}\" cy=\"{y:.1}\" r=\"1.8\" fill=\"{color}\"/>"
    );
}
