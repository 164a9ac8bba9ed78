//! Photographs through lenses that bend rays, made ray by ray, read as a pinhole would have seen them.

use std::path::Path;

use datasets::{MaskSource, OnInconsistent, ReadOptions, View, Views, read_views};
use mesh_core::{ByteImage, Camera, DepthMap, Distortion, Lens, encode_depth, write_png};
use serde_json::json;

const SIZE: [usize; 2] = [160, 120];
const PINHOLE: [f64; 4] = [120.0, 118.0, 81.5, 58.5];

/// What a ray from the origin along (x, y, 1) meets: the planar depth of a ball, if it does.
fn ball([x, y]: [f64; 2]) -> Option<f64> {
    let (center, radius) = ([0.35, -0.1, 3.0], 0.8);
    let (a, b) = (x * x + y * y + 1.0, x * center[0] + y * center[1] + center[2]);
    let c = center.iter().map(|v| v * v).sum::<f64>() - radius * radius;
    let root = b * b - a * c;
    (root > 0.0).then(|| (b - root.sqrt()) / a)
}

/// A colour that changes slowly with the direction of a ray.
fn color([x, y]: [f64; 2]) -> [f64; 3] {
    [
        128.0 + 90.0 * (3.0 * x).sin(),
        128.0 + 90.0 * (3.0 * y).cos(),
        128.0 + 60.0 * (2.0 * x + y).sin(),
    ]
}

/// The image through a lens, its mask and depth: `ray` takes pixels to the plane at depth 1.
fn photograph(
    size: [usize; 2],
    ray: impl Fn([f64; 2]) -> Option<[f64; 2]>,
) -> (ByteImage, DepthMap) {
    let [width, height] = size;
    let mut image = ByteImage::new(height, width, 4);
    let mut depth = DepthMap { height, width, data: vec![f32::INFINITY; height * width] };
    for k in 0..height * width {
        let Some(ray) = ray([(k % width) as f64 + 0.5, (k / width) as f64 + 0.5]) else { continue };
        let seen = color(ray).map(|c| c.round() as u8);
        let hit = ball(ray);
        image.data[4 * k..][..3].copy_from_slice(&seen);
        image.data[4 * k + 3] = if hit.is_some() { 255 } else { 0 };
        depth.data[k] = hit.map_or(f32::INFINITY, |z| z as f32);
    }
    (image, depth)
}

fn through(lens: &Distortion, [fx, fy, cx, cy]: [f64; 4]) -> (ByteImage, DepthMap) {
    let undistort = lens.undistorter();
    photograph(SIZE, |[x, y]| undistort([(x - cx) / fx, (y - cy) / fy]))
}

/// The image and mask split, as readers that composite want them.
fn write(folder: &Path, image: &ByteImage) {
    std::fs::create_dir_all(folder.join("images")).unwrap();
    std::fs::create_dir_all(folder.join("masks")).unwrap();
    write_png(folder.join("images/0.png"), &image.to_rgb()).unwrap();
    write_png(folder.join("masks/0.png"), &image.channel(3)).unwrap();
}

fn read(folder: &Path, depth: bool) -> Views {
    let options =
        ReadOptions { on_inconsistent: OnInconsistent::Accept, depth, ..ReadOptions::default() };
    read_views(folder, &options, &|_, _| {}).unwrap()
}

/// The view against one that the pinhole sees itself.
fn compare(view: &View, depth: bool) {
    let camera: &Camera = &view.camera;
    let Lens::Perspective { fx, fy, cx, cy } = camera.lens else { unreachable!() };
    let size = [camera.width, camera.height];
    assert_eq!([view.mask.width, view.mask.height], size);
    let (truth, far) = photograph(size, |[x, y]| Some([(x - cx) / fx, (y - cy) / fy]));
    let (mut object, mut wrong, mut worst) = (0, 0, 0);
    for k in 0..size[0] * size[1] {
        let is_object = truth.data[4 * k + 3] == 255;
        object += usize::from(is_object);
        wrong += usize::from(is_object != (view.mask.data[k] == 255));
        if is_object && view.mask.data[k] == 255 {
            for c in 0..3 {
                worst = worst.max(truth.data[4 * k + c].abs_diff(view.color.data[3 * k + c]));
            }
            if depth {
                let found = view.depth.as_ref().unwrap().data[k];
                assert!(
                    !found.is_finite() || (found - far.data[k]).abs() < 0.2,
                    "{found} {}",
                    far.data[k]
                );
            }
        }
    }
    // The outline of a disc of this size has about 200 pixels.
    assert!(object > 2000 && wrong < 60, "{wrong} pixels of {object}");
    assert!(worst <= 4, "a colour is off by {worst}");
}

#[test]
fn nerfstudio_and_instant_ngp() {
    let cases = [
        (
            json!({ "k1": -0.22, "k2": 0.06, "p1": 0.002, "p2": -0.003 }),
            Distortion::brown_conrady([-0.22, 0.06, 0.0], [0.002, -0.003]),
        ),
        (
            json!({ "camera_model": "OPENCV", "k1": 0.3, "k4": 0.1 }),
            Distortion::BrownConrady {
                numerator: [0.3, 0.0, 0.0, 0.1],
                denominator: [0.0; 3],
                tangential: [0.0; 2],
            },
        ),
        (
            json!({ "camera_model": "OPENCV_FISHEYE", "k1": 0.03, "k2": -0.01 }),
            Distortion::KannalaBrandt { k: [0.03, -0.01, 0.0, 0.0] },
        ),
        (json!({ "is_fisheye": true }), Distortion::KannalaBrandt { k: [0.0; 4] }),
    ];
    for (mut poses, lens) in cases {
        let folder = tempfile::tempdir().unwrap();
        let (image, depth) = through(&lens, PINHOLE);
        write(folder.path(), &image);
        std::fs::write(folder.path().join("0.exr"), encode_depth(&depth)).unwrap();
        let [fx, fy, cx, cy] = PINHOLE;
        for (key, value) in [("fl_x", fx), ("fl_y", fy), ("cx", cx), ("cy", cy)] {
            poses[key] = json!(value);
        }
        poses["frames"] = json!([{
            "file_path": "images/0.png",
            "mask_path": "masks/0.png",
            "depth_file_path": "0.exr",
            "transform_matrix": [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]],
        }]);
        std::fs::write(folder.path().join("transforms.json"), poses.to_string()).unwrap();
        let views = read(folder.path(), true);
        assert!(views.warnings[0].contains("(1 view)"), "{:?}", views.warnings);
        compare(&views.views[0], true);
    }
}

#[test]
fn every_model_of_colmap() {
    let [fx, fy, cx, cy] = PINHOLE;
    let models = [
        ("SIMPLE_RADIAL", vec![120.0, cx, cy, -0.15]),
        ("RADIAL", vec![120.0, cx, cy, -0.2, 0.05]),
        ("OPENCV", vec![fx, fy, cx, cy, -0.2, 0.05, 0.003, -0.002]),
        ("FULL_OPENCV", vec![fx, fy, cx, cy, 0.3, 0.1, 0.001, 0.001, 0.02, 0.5, 0.1, 0.01]),
        ("SIMPLE_RADIAL_FISHEYE", vec![120.0, cx, cy, 0.02]),
        ("OPENCV_FISHEYE", vec![fx, fy, cx, cy, 0.02, -0.01, 0.0, 0.0]),
        ("FOV", vec![fx, fy, cx, cy, 0.8]),
        (
            "THIN_PRISM_FISHEYE",
            vec![fx, fy, cx, cy, 0.02, -0.01, 0.003, -0.002, 0.0, 0.0, 0.002, 0.001],
        ),
    ];
    for (model, params) in models {
        let (pinhole, lens) = Distortion::from_colmap(model, &params).unwrap();
        let lens = lens.unwrap();
        let (image, _) = through(&lens, pinhole);
        let folder = tempfile::tempdir().unwrap();
        write(folder.path(), &image);
        let params: Vec<String> = params.iter().map(f64::to_string).collect();
        let [width, height] = SIZE;
        let write =
            |name: &str, text: String| std::fs::write(folder.path().join(name), text).unwrap();
        write("cameras.txt", format!("1 {model} {width} {height} {}\n", params.join(" ")));
        write("images.txt", "1 1 0 0 0 0 0 0 1 0.png\n\n".to_owned());
        write("points3D.txt", String::new());
        let views = read(folder.path(), false);
        assert!(views.warnings[0].contains(model), "{:?}", views.warnings);
        compare(&views.views[0], false);
    }
}

/// At its corners a lens of such barrels shows what it has shown farther in: no ray leads there.
#[test]
fn corners_that_no_ray_leads_to_are_no_part_of_an_object() {
    let folder = tempfile::tempdir().unwrap();
    let [width, height] = SIZE;
    write(folder.path(), &ByteImage::new(height, width, 4));
    let put = |name: &str, text: &str| std::fs::write(folder.path().join(name), text).unwrap();
    put("cameras.txt", "1 SIMPLE_RADIAL 160 120 112 80 60 -0.25\n");
    put("images.txt", "1 1 0 0 0 0 0 0 1 0.png\n\n");
    put("points3D.txt", "");
    let options = |mask: MaskSource| ReadOptions {
        mask,
        on_inconsistent: OnInconsistent::Accept,
        ..ReadOptions::default()
    };
    let views = read_views(folder.path(), &options(MaskSource::Whole), &|_, _| {}).unwrap();
    let view = &views.views[0];
    // The middle is as it was, and what the lens does not show is no part of the image.
    let [h, w] = [view.mask.height, view.mask.width];
    assert!(view.mask.data[h / 2 * w + w / 2] == 255 && view.mask.data[0] == 0);
    assert!(w >= width && h >= height);
    // A model of colours then has too few views, not a lens that cannot be followed.
    let error =
        read_views(folder.path(), &options(MaskSource::ColorModel), &|_, _| {}).unwrap_err();
    assert!(error.to_string().contains('3'), "{error}");
    // An object in the corner cannot be followed, as before.
    let mut mask = ByteImage::new(height, width, 1);
    mask.data[..4].fill(255);
    write_png(folder.path().join("masks/0.png"), &mask).unwrap();
    let error = read_views(folder.path(), &options(MaskSource::Files), &|_, _| {}).unwrap_err();
    assert!(error.to_string().contains("off the axis"), "{error}");
    // However the frame grows, nothing is larger than it may be.
    for longest in [100, 160] {
        let options = ReadOptions { max_size: Some(longest), ..options(MaskSource::Whole) };
        let views = read_views(folder.path(), &options, &|_, _| {}).unwrap();
        assert_eq!(views.views[0].camera.width.max(views.views[0].camera.height), longest);
    }
}

#[test]
fn what_the_old_frame_cut_off_of_a_pinhole_is_kept() {
    // A fisheye that sees 150 degrees across: most of it is no pinhole's, the object is.
    let lens = Distortion::KannalaBrandt { k: [0.0; 4] };
    let scene = |x: f64, y: f64| [(x - 80.0) / 60.0, (y - 60.0) / 60.0];
    let mut view = View {
        crop: None,
        name: "wide".into(),
        color: ByteImage::new(120, 160, 3),
        mask: ByteImage::new(120, 160, 1),
        camera: Camera::from_opengl(
            [
                [1.0, 0.0, 0.0, 0.0],
                [0.0, 1.0, 0.0, 0.0],
                [0.0, 0.0, 1.0, 0.0],
                [0.0, 0.0, 0.0, 1.0],
            ],
            60.0,
            60.0,
            80.0,
            60.0,
            160,
            120,
        ),
        depth: None,
    };
    for k in 0..120 * 160 {
        let [x, y] = scene((k % 160) as f64 + 0.5, (k / 160) as f64 + 0.5);
        view.mask.data[k] = if (x - 1.0).hypot(y) < 0.25 { 255 } else { 0 };
    }
    let straight = view.clone().undistorted(&lens).unwrap();
    // Seen between 0.75 and 1.25 radians: up to a tangent of 3.0, at column 80 + 60 * 3.0.
    assert!(straight.camera.width > 255 && straight.camera.width < 290, "{:?}", straight.camera);
    let [_, left, _, width] = straight.mask_bounds().unwrap();
    let far = |t: f64| 60.0 * t.tan() + 80.0;
    assert!(
        (left as f64 - far(0.75)).abs() < 2.0 && ((left + width) as f64 - far(1.25)).abs() < 3.0
    );
    // Farther than 85 degrees off the axis there is no pinhole.
    for k in 0..120 * 160 {
        let [x, y] = scene((k % 160) as f64 + 0.5, (k / 160) as f64 + 0.5);
        view.mask.data[k] = if (1.2..1.6).contains(&x.hypot(y)) { 255 } else { 0 };
    }
    let error = view.undistorted(&lens).unwrap_err();
    assert!((error.degrees - 85.0).abs() < 1e-9, "{error}");
}
