//! Small scenes with answers that follow from geometry alone.

use std::sync::Arc;

use autodiff_lite::Tape;
use diff_raster::{Faces, Settings, antialiased_silhouette, interpolate, rasterize};
use ndarray::{Array3, arr2};

/// A rectangle of two triangles; NDC corners, depth 1.
fn rectangle([x0, y0, x1, y1]: [f64; 4]) -> (Array3<f64>, Arc<Faces>) {
    let corners = [[x0, y0], [x1, y0], [x1, y1], [x0, y1]];
    let positions =
        Array3::from_shape_fn((1, 4, 3), |(_, v, k)| *corners[v].get(k).unwrap_or(&1.0));
    (positions, Arc::new(Faces::new(4, &[[0, 1, 2], [0, 2, 3]]).unwrap()))
}

/// From pixels (column, row, y down) to NDC.
fn ndc([c0, r0, c1, r1]: [f64; 4], height: usize, width: usize) -> [f64; 4] {
    let (h, w) = (height as f64, width as f64);
    [2.0 * c0 / w - 1.0, 1.0 - 2.0 * r1 / h, 2.0 * c1 / w - 1.0, 1.0 - 2.0 * r0 / h]
}

#[test]
fn the_antialiased_coverage_of_a_box_is_its_area_in_each_pixel() {
    let (height, width) = (9, 14);
    // All four corners lie in pixels whose centres are covered: there the product is exact.
    for [c0, r0, c1, r1] in [[2.3, 1.2, 9.9, 6.7], [3.0, 2.0, 5.0, 6.0], [1.45, 1.05, 12.6, 7.95]] {
        let (positions, faces) = rectangle(ndc([c0, r0, c1, r1], height, width));
        let fragments = rasterize(positions.view(), &faces, &Settings::new(height, width));
        let tape = Tape::<f64>::eval();
        let coverage = antialiased_silhouette(tape.constant(positions), &fragments).value();
        let overlap = |low: f64, high: f64, cell: usize| {
            (high.min(cell as f64 + 1.0) - low.max(cell as f64)).max(0.0)
        };
        for i in 0..height {
            for j in 0..width {
                let area = overlap(c0, c1, j) * overlap(r0, r1, i);
                assert!((coverage[[0, i, j]] - area).abs() < 1e-12, "pixel {i} {j}");
            }
        }
    }
}

#[test]
fn the_antialiased_coverage_of_a_row_is_the_length_of_its_chord() {
    // A parallelogram with steep sides, over the whole height.
    let (height, width) = (16, 24);
    for shift in 0..50 {
        let at = f64::from(shift) * 0.0137;
        let x = |column: f64| 2.0 * (column + at) / width as f64 - 1.0;
        let corners = [[x(4.2), -1.3], [x(13.1), -1.3], [x(16.4), 1.3], [x(7.5), 1.3]];
        let positions =
            Array3::from_shape_fn((1, 4, 3), |(_, v, k)| *corners[v].get(k).unwrap_or(&2.0));
        let faces = Arc::new(Faces::new(4, &[[0, 1, 2], [0, 2, 3]]).unwrap());
        let fragments = rasterize(positions.view(), &faces, &Settings::new(height, width));
        let tape = Tape::<f64>::eval();
        let coverage = antialiased_silhouette(tape.constant(positions), &fragments).value();
        for row in coverage.rows() {
            assert!((row.sum() - 8.9).abs() < 1e-9, "{}", row.sum());
        }
    }
}

#[test]
fn perspective_interpolation_finds_points_in_space() {
    // A slanted plane with its own coordinates as attributes: the ray through each pixel must
    // give them back.
    let (height, width) = (20, 30);
    let corners = [[-1.0, -1.0, 1.5], [2.0, -0.8, 3.0], [-0.5, 2.5, 6.0]];
    let positions = Array3::from_shape_fn((1, 3, 3), |(_, v, k)| match k {
        2 => corners[v][2],
        _ => corners[v][k] / corners[v][2],
    });
    let faces = Arc::new(Faces::new(3, &[[0, 1, 2]]).unwrap());
    let fragments = rasterize(positions.view(), &faces, &Settings::new(height, width));
    let tape = Tape::<f64>::eval();
    let attributes = tape.constant(arr2(&corners));
    let points = interpolate(tape.constant(positions), attributes, &fragments).value();
    let mut seen = 0;
    for i in 0..height {
        for j in 0..width {
            let at = i * width + j;
            let [x, y, z] = [0, 1, 2].map(|k| points[[0, i, j, k]]);
            if fragments.depth[at].is_finite() {
                seen += 1;
                let ndc_x = (2 * j + 1) as f64 / width as f64 - 1.0;
                let ndc_y = 1.0 - (2 * i + 1) as f64 / height as f64;
                assert!((x / z - ndc_x).abs() < 1e-12 && (y / z - ndc_y).abs() < 1e-12);
                assert!((z - fragments.depth[at]).abs() < 1e-12);
            } else {
                assert_eq!([x, y, z], [0.0; 3]);
            }
        }
    }
    assert!(seen > 50);
}
