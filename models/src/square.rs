//! Views cut to a square around the object, their cameras with them.

use datasets::View;
use mesh_core::{ByteImage, Camera, DepthMap};

/// The square around the part of a box (left, top, right, bottom) that is in the image, wider than the box's longer side by a
/// factor `margin`; beyond the image it is white and without the object.
pub(crate) fn square(view: View, [left, top, right, bottom]: [f64; 4], margin: f64) -> View {
    let [width, height] = [view.color.width as f64, view.color.height as f64];
    let [left, right] = [left, right].map(|x| x.clamp(0.0, width));
    let [top, bottom] = [top, bottom].map(|y| y.clamp(0.0, height));
    let side = (margin * (right - left).max(bottom - top)).round().max(1.0);
    let corner = |low: f64, high: f64| (0.5 * (low + high - side)).round() as i64;
    let [x, y] = [corner(left, right), corner(top, bottom)];
    let side = side as usize;
    let depth = view.depth.as_ref().map(|depth| DepthMap {
        height: side,
        width: side,
        data: pixels(&depth.data, [depth.height, depth.width], 1, [x, y], side, f32::INFINITY),
    });
    let squared = |image: &ByteImage, outside: u8| ByteImage {
        height: side,
        width: side,
        channels: image.channels,
        data: pixels(
            &image.data,
            [image.height, image.width],
            image.channels,
            [x, y],
            side,
            outside,
        ),
    };
    View {
        crop: None,
        color: squared(&view.color, 255),
        mask: squared(&view.mask, 0),
        camera: moved(&view.camera, [x, y], side),
        depth,
        name: view.name,
    }
}

/// The camera of a part of its image, which may reach beyond it.
fn moved(camera: &Camera, [x, y]: [i64; 2], side: usize) -> Camera {
    let (x, y) = (x as f64, y as f64);
    let [sx, sy, cx, cy] = camera.lens.numbers();
    let lens = camera.lens.with([sx, sy, cx - x, cy - y]);
    Camera { lens, width: side, height: side, ..camera.clone() }
}

fn pixels<T: Copy>(
    data: &[T],
    [height, width]: [usize; 2],
    channels: usize,
    [x, y]: [i64; 2],
    side: usize,
    outside: T,
) -> Vec<T> {
    let mut out = vec![outside; side * side * channels];
    for i in 0..side {
        let Some(row) = usize::try_from(y + i as i64).ok().filter(|&row| row < height) else {
            continue;
        };
        for j in 0..side {
            let column = usize::try_from(x + j as i64).ok().filter(|&column| column < width);
            if let Some(column) = column {
                let (from, to) = ((row * width + column) * channels, (i * side + j) * channels);
                out[to..to + channels].copy_from_slice(&data[from..from + channels]);
            }
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use mesh_core::Lens;
    use mesh_core::nalgebra::{Matrix3, Vector3};

    /// A pixel keeps its colour and its ray, wherever the box lies.
    #[test]
    fn pixels_and_rays_move_together() {
        let (width, height) = (20, 12);
        let data: Vec<u8> = (0..width * height).map(|p| p as u8).collect();
        let color = data.iter().flat_map(|&p| [p; 3]).collect();
        let camera = Camera {
            rotation: Matrix3::identity(),
            translation: Vector3::new(0.1, -0.2, -3.0),
            lens: Lens::Perspective { fx: 25.0, fy: 25.0, cx: 9.5, cy: 6.25 },
            width,
            height,
        };
        let view = View {
            crop: None,
            name: "a".into(),
            color: ByteImage { height, width, channels: 3, data: color },
            mask: ByteImage { height, width, channels: 1, data: vec![255; data.len()] },
            camera: camera.clone(),
            depth: None,
        };
        // Inside of the image, and beyond its lower right corner.
        for bounds in [[3.0, 2.0, 8.0, 6.0], [14.0, 5.0, 20.0, 12.0]] {
            let found = square(view.clone(), bounds, 1.1);
            assert_eq!(
                (found.color.width, found.camera.height),
                (found.color.height, found.mask.width)
            );
            let mut seen = 0;
            for (i, j) in (0..12).flat_map(|i| (0..20).map(move |j| (i, j))) {
                let point = camera.unproject(j as f64 + 0.5, i as f64 + 0.5, 2.5);
                let at = found.camera.project(point);
                let (row, column) = (at.row.floor(), at.column.floor());
                let side = found.color.width as f64;
                if (0.0..side).contains(&row) && (0.0..side).contains(&column) {
                    let p = row as usize * found.color.width + column as usize;
                    assert_eq!(found.color.data[3 * p], data[i * 20 + j]);
                    assert_eq!(found.mask.data[p], 255);
                    seen += 1;
                }
            }
            let inside: usize = found.mask.data.iter().map(|&m| usize::from(m) / 255).sum();
            assert_eq!(seen, inside);
            let object = (bounds[2] - bounds[0]) * (bounds[3] - bounds[1]);
            assert!(seen as f64 >= object, "{seen} of {object}");
        }
    }
}
