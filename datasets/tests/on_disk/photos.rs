//! Annotated photographs: made with SciPy, painted by each dataset's own formula (`make.py`).

use std::path::{Path, PathBuf};

use datasets::{Dataset, MaskSource, Pix3d, ReadOptions, Subset, View, Views};
use mesh_core::Camera;

fn folder(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures/photos").join(name)
}

fn expected() -> serde_json::Value {
    serde_json::from_str(&std::fs::read_to_string(folder("expected.json")).unwrap()).unwrap()
}

fn points<const N: usize>(value: &serde_json::Value) -> Vec<[f64; N]> {
    let number = |v: &serde_json::Value| v.as_f64().unwrap();
    let rows = value.as_array().unwrap().iter();
    rows.map(|row| std::array::from_fn(|k| number(&row[k]))).collect()
}

/// The model's vertices land where the maker of the fixture put them.
fn assert_projects(camera: &Camera, dataset: &str, name: &str) {
    let expected = expected();
    let pixels = points::<2>(&expected[dataset][name]);
    let vertices = points::<3>(&expected["vertices"]);
    assert_eq!(vertices.len(), pixels.len());
    assert_ne!(camera.width, camera.height);
    for (vertex, pixel) in vertices.into_iter().zip(pixels) {
        let p = camera.project(vertex);
        let off = (p.column - pixel[0]).hypot(p.row - pixel[1]);
        assert!(off < 1e-6, "{dataset} {name}: {vertex:?} at {p:?}, expected {pixel:?}");
        assert!(p.depth > 0.0, "{dataset} {name}: {vertex:?} is behind the camera");
    }
}

/// The mask covers the projected vertices' box and no more: neither mirrored nor shifted.
fn assert_masked(view: &View, vertices: &[[f64; 3]]) {
    let [top, left, height, width] = view.mask_bounds().unwrap();
    let pixels: Vec<_> = vertices.iter().map(|&v| view.camera.project(v)).collect();
    let ends = |values: Vec<f64>| {
        values.iter().fold([f64::MAX, f64::MIN], |[low, high], &v| [low.min(v), high.max(v)])
    };
    let columns = ends(pixels.iter().map(|p| p.column).collect());
    let rows = ends(pixels.iter().map(|p| p.row).collect());
    let masked = [left, left + width, top, top + height].map(|v| v as f64);
    for (mask, points) in masked.into_iter().zip([columns, rows].concat()) {
        assert!((mask - points).abs() < 1.0, "{}: {masked:?}, {columns:?} {rows:?}", view.name);
    }
}

fn vertices() -> Vec<[f64; 3]> {
    points(&expected()["vertices"])
}

fn read(dataset: &dyn Dataset, object: usize) -> Views {
    dataset.views(object, None, &ReadOptions::default(), &|_, _| {}).unwrap()
}

mod pix3d {
    use super::*;

    #[test]
    fn models_land_in_their_masks() {
        let pix3d = Pix3d::open(&folder("pix3d")).unwrap();
        let [entry] = pix3d.entries() else { panic!("{:?}", pix3d.entries()) };
        assert_eq!((entry.category.as_str(), entry.name.as_str()), ("chair", "LOPSIDED/model"));
        assert_eq!((entry.views, entry.subset), (2, None));
        let views = read(&pix3d, 0);
        for view in &views.views {
            assert_projects(&view.camera, "pix3d", &view.name);
            assert_masked(view, &vertices());
        }
        let one = pix3d.views(0, Some(&[1]), &ReadOptions::default(), &|_, _| {}).unwrap();
        assert_eq!(one.views, views.views[1..]);
    }

    #[test]
    fn what_is_left_of_the_model_is_left_in_the_picture() {
        // Upright, unturned, in front of the camera: the object is seen from its front, its left
        // (+x) is left in the image, up is up, and what lies inward (+z) is farther.
        let mut annotation = Pix3d::open(&folder("pix3d")).unwrap().annotations(0)[0].clone();
        annotation.rotation = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];
        annotation.translation = [0.0, 0.0, 3.0];
        let camera = annotation.camera();
        camera.validate().unwrap();
        let p = camera.project([0.5, 0.25, 1.0]);
        assert_eq!(p.depth, 4.0);
        let f = 35.0 / 32.0 * 96.0;
        assert!((p.column - (48.0 - f * 0.5 / 4.0)).abs() < 1e-9);
        assert!((p.row - (32.0 - f * 0.25 / 4.0)).abs() < 1e-9);
    }

    #[test]
    fn both_files_of_annotations_say_the_same() {
        let shipped = Pix3d::open(&folder("pix3d")).unwrap();
        let coco = Pix3d::open(&folder("pix3d/pix3d_s1_train.json")).unwrap();
        assert_eq!(coco.entries()[0].subset, Some(Subset::Train));
        for (a, b) in shipped.annotations(0).iter().zip(coco.annotations(0)) {
            assert_eq!((&a.image, &a.mask, &a.model), (&b.image, &b.mask, &b.model));
            assert_eq!((a.bounds, a.size, a.camera()), (b.bounds, b.size, b.camera()));
        }
        assert_eq!(read(&shipped, 0).views, read(&coco, 0).views);
        let [first, second] = shipped.annotations(0) else { panic!() };
        assert!(first.slightly_occluded && !first.occluded && second.occluded);
        assert!(!first.truncated && coco.warnings().is_empty());
        let warning = &shipped.warnings()[0];
        assert!(warning.contains("img/table/1749.jpg") && warning.contains("size"), "{warning}");
    }

    #[test]
    fn voxels_lie_as_the_model_does() {
        let truth = Pix3d::open(&folder("pix3d")).unwrap().truth(0).unwrap();
        let (mesh, voxels) = (truth.mesh.unwrap(), truth.voxels.unwrap());
        // The farthest cell's middle at distance 1/2 from the middle of the box, as Mesh R-CNN
        // has it; the model scaled alike is then the same solid.
        let (low, high) = mesh.bounds().unwrap();
        let middle: [f32; 3] = std::array::from_fn(|k| f32::midpoint(low[k], high[k]));
        let cell = f64::from(voxels.cell[0]);
        let scale = (cell / 0.05) as f32;
        let mesh = mesh.translated(middle.map(|m| -m)).scaled([scale; 3]);
        let solid = mesh_core::voxelize_solid(&mesh, voxels.dims, {
            let high =
                std::array::from_fn(|k| voxels.origin[k] + voxels.cell[k] * voxels.dims[k] as f32);
            (voxels.origin, high)
        });
        assert!(voxels.iou(&solid) > 0.9, "{}", voxels.iou(&solid));
    }

    #[test]
    fn what_is_missing_is_named_or_left_out() {
        let copy = copied("pix3d");
        std::fs::remove_file(copy.path().join("img/chair/0002.png")).unwrap();
        let pix3d = Pix3d::open(copy.path()).unwrap();
        let error = pix3d.views(0, None, &ReadOptions::default(), &|_, _| {}).unwrap_err();
        assert!(error.to_string().contains("img/chair/0002.png"), "{error}");
        let lenient = ReadOptions { allow_missing: true, ..ReadOptions::default() };
        let views = pix3d.views(0, None, &lenient, &|_, _| {}).unwrap();
        assert_eq!(views.len(), 1);
        assert!(views.warnings[0].contains("0002.png"), "{:?}", views.warnings);
    }

    #[test]
    fn a_wrong_field_is_named_with_its_place() {
        let fault = |from: &str, to: &str| {
            let copy = copied("pix3d");
            let file = copy.path().join("pix3d.json");
            let text = std::fs::read_to_string(&file).unwrap();
            assert!(text.contains(from));
            std::fs::write(&file, text.replace(from, to)).unwrap();
            let error = match Pix3d::open(copy.path()) {
                Err(error) => error,
                Ok(opened) => {
                    opened.views(0, None, &ReadOptions::default(), &|_, _| {}).unwrap_err()
                }
            };
            error.to_string()
        };
        assert!(fault("\"trans_mat\"", "\"translation\"").contains("`[0].trans_mat`"));
        assert!(
            fault("\"focal_length\": 50.0", "\"focal_length\": -5").contains("[1].focal_length")
        );
        assert!(fault("\"truncated\": false", "\"truncated\": \"no\"").contains("[0].truncated"));
        let error = fault("   96,", "   75,");
        assert!(error.contains("size") && error.contains("75x64"), "{error}");
    }
}

/// A copy of a fixture, to be spoilt.
fn copied(name: &str) -> tempfile::TempDir {
    fn copy(from: &Path, to: &Path) {
        std::fs::create_dir_all(to).unwrap();
        for entry in std::fs::read_dir(from).unwrap() {
            let (from, to) = {
                let entry = entry.unwrap();
                (entry.path(), to.join(entry.file_name()))
            };
            if from.is_dir() {
                copy(&from, &to);
            } else {
                std::fs::copy(&from, &to).unwrap();
            }
        }
    }
    let out = tempfile::tempdir().unwrap();
    copy(&folder(name), out.path());
    out
}

#[test]
fn masks_can_be_left_alone() {
    let whole = ReadOptions { mask: MaskSource::Whole, ..ReadOptions::default() };
    let pix3d = Pix3d::open(&folder("pix3d")).unwrap();
    let views = pix3d.views(0, Some(&[0]), &whole, &|_, _| {}).unwrap();
    assert_eq!(views.views[0].mask_pixels(), 96 * 64);
}

mod pascal3d {
    use super::*;
    use datasets::{Pascal3d, Viewpoint};
    use mesh_core::nalgebra::Vector3;

    fn open() -> Pascal3d {
        Pascal3d::open(&folder("pascal3d")).unwrap()
    }

    #[test]
    fn models_land_where_the_authors_formula_puts_them() {
        let pascal = open();
        let names: Vec<_> = pascal.entries().iter().map(|e| e.name.as_str()).collect();
        assert_eq!(names, ["n02690373_16", "2008_000021"]);
        assert!(pascal.warnings()[0].contains("1 object is left out"), "{:?}", pascal.warnings());
        assert!(pascal.warnings()[0].contains("aeroplane_imagenet/n02690373_16.mat"));
        let whole = ReadOptions { mask: MaskSource::Whole, ..ReadOptions::default() };
        for (object, entry) in pascal.entries().iter().enumerate() {
            assert_eq!((entry.category.as_str(), entry.views), ("aeroplane", 1));
            let views = pascal.views(object, None, &whole, &|_, _| {}).unwrap();
            views.views[0].camera.validate().unwrap();
            assert_projects(&views.views[0].camera, "pascal3d", &entry.name);
        }
    }

    #[test]
    fn lists_of_the_release_are_the_subsets() {
        let copy = copied("pascal3d");
        let subsets = || -> Vec<_> {
            let dataset = Pascal3d::open(copy.path()).unwrap();
            dataset.entries().iter().map(|entry| entry.subset).collect()
        };
        assert_eq!(subsets(), [None, None]);
        let write = |name: &str, text: &str| {
            let path = copy.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        };
        write("Image_sets/aeroplane_imagenet_train.txt", "n02690373_16\nn02690373_17\n");
        write(
            "PASCAL/VOCdevkit/VOC2012/ImageSets/Main/aeroplane_val.txt",
            "2008_000003  1\n2008_000021 -1\n",
        );
        assert_eq!(subsets(), [Some(Subset::Train), Some(Subset::Test)]);
    }

    #[test]
    fn vocs_picture_of_objects_is_the_mask() {
        let pascal = open();
        assert_masked(&read(&pascal, 1).views[0], &vertices());
        let error =
            pascal.views(0, None, &ReadOptions::default(), &|_, _| {}).unwrap_err().to_string();
        assert!(error.contains("n02690373_16.JPEG") && error.contains("`whole`"), "{error}");
    }

    #[test]
    fn the_camera_stands_where_the_angles_say_and_rolls_by_theta() {
        // Not by the formula: from where it stands, what it looks at, and which way is up.
        let (azimuth, elevation, theta, distance) = (130.0f64, 25.0f64, 35.0f64, 4.0);
        let principal = [30.5, 20.5];
        let viewpoint = Viewpoint {
            azimuth,
            elevation,
            theta,
            distance,
            focal: 1.0,
            viewport: 90.0,
            principal,
        };
        let (width, height) = (64, 48);
        let camera = viewpoint.camera(width, height);
        camera.validate().unwrap();
        // The front is at -y; the azimuth turns from there towards +x.
        let (a, e) = (azimuth.to_radians(), elevation.to_radians());
        let eye = Vector3::new(a.sin() * e.cos(), -a.cos() * e.cos(), e.sin()) * distance;
        assert!((camera.center() - eye).norm() < 1e-12);
        assert!((camera.forward() + eye / distance).norm() < 1e-12);
        let upright = Camera::look_at(eye.into(), [0.0; 3], [0.0, 0.0, 1.0], 1.0, width, height);
        let (sin, cos) = theta.to_radians().sin_cos();
        for point in [[0.3, -0.2, 0.5], [-0.7, 0.1, 0.2], [0.0, 0.4, -0.6]] {
            let p = upright.rotation * Vector3::from(point) + upright.translation;
            let flat = [90.0 * p.x / -p.z, 90.0 * p.y / -p.z];
            // Counter-clockwise in an image whose y goes up.
            let turned = [cos * flat[0] - sin * flat[1], sin * flat[0] + cos * flat[1]];
            let found = camera.project(point);
            assert!((found.column - (30.0 + turned[0])).abs() < 1e-9, "{found:?}");
            assert!((found.row - (20.0 - turned[1])).abs() < 1e-9, "{found:?}");
        }
    }

    #[test]
    fn boxes_flags_and_anchors_are_read() {
        let pascal = open();
        let (first, second) = (pascal.annotation(0), pascal.annotation(1));
        assert_eq!((first.model, second.model), (0, 1));
        assert!(first.occluded && !first.truncated && !first.difficult);
        assert_eq!(first.size, Some([96, 64]));
        // The nose was put at (px + 3, py - 2), as MATLAB counts.
        assert_eq!(first.anchors["nose"], [50.5 + 3.0 - 0.5, 30.0 - 2.0 - 0.5]);
        assert!(!first.anchors.contains_key("left_wing"));
        let view = &read(&pascal, 1).views[0];
        let [top, left, height, width] = view.mask_bounds().unwrap();
        let bounds = [left, top, left + width, top + height].map(|v| v as f64);
        assert_eq!(second.bounds, bounds);
    }

    #[test]
    fn models_are_read_from_both_forms() {
        let of_off = open().truth(1).unwrap().mesh.unwrap();
        let copy = copied("pascal3d");
        std::fs::remove_dir_all(copy.path().join("CAD/aeroplane")).unwrap();
        let of_mat = Pascal3d::open(copy.path()).unwrap().truth(1).unwrap().mesh.unwrap();
        assert_eq!(of_off, of_mat);
        let expected: Vec<[f32; 3]> =
            vertices().iter().map(|v| v.map(|c| (c * 0.5) as f32)).collect();
        assert_eq!(of_mat.positions, expected);
        assert!(of_mat.volume() > 0.0);
        std::fs::remove_dir_all(copy.path().join("CAD")).unwrap();
        assert_eq!(Pascal3d::open(copy.path()).unwrap().truth(1).unwrap().mesh, None);
    }
}

mod mcmr {
    use super::*;
    use datasets::{Mcmr, Pascal3d};

    #[test]
    fn models_land_in_their_masks() {
        for path in ["mcmr", "mcmr/aeroplane"] {
            let mcmr = Mcmr::open(&folder(path)).unwrap();
            let entries: Vec<_> =
                mcmr.entries().iter().map(|e| (e.name.as_str(), e.subset)).collect();
            assert_eq!(entries, [("00000", Some(Subset::Train)), ("00001", Some(Subset::Test))]);
            for (object, entry) in mcmr.entries().iter().enumerate() {
                let view = read(&mcmr, object).views.remove(0);
                assert_projects(&view.camera, "mcmr", &entry.name);
                assert_masked(&view, &vertices());
            }
        }
    }

    #[test]
    fn without_roll_it_is_the_camera_of_pascal3d() {
        let (mcmr, pascal) =
            (Mcmr::open(&folder("mcmr")).unwrap(), Pascal3d::open(&folder("pascal3d")).unwrap());
        for object in 0..2 {
            let mut viewpoint = pascal.annotation(object).viewpoint;
            viewpoint.theta = 0.0;
            let (a, b) = (viewpoint.camera(96, 64), mcmr.annotation(object).camera().unwrap());
            for vertex in vertices() {
                let (p, q) = (a.project(vertex), b.project(vertex));
                assert!((p.column - q.column).hypot(p.row - q.row) < 1e-6);
                assert!((p.depth - q.depth).abs() < 1e-9);
            }
        }
    }

    #[test]
    fn boxes_keypoints_and_masks_are_read() {
        let mcmr = Mcmr::open(&folder("mcmr")).unwrap();
        let (first, second) = (mcmr.annotation(0), mcmr.annotation(1));
        assert!(first.mask.contains("masks_pointrend") && second.mask.contains("masks_VOC"));
        assert_eq!((first.model, second.model), (0, 1));
        assert!(!first.truncated && second.truncated);
        assert_eq!(first.size, [96, 64]);
        assert_eq!(first.keypoints, [Some([11.5, 19.5]), None, None]);
    }

    #[test]
    fn what_a_network_painted_is_no_truth_to_test_on() {
        let copy = copied("mcmr");
        let class = copy.path().join("aeroplane");
        std::fs::rename(class.join("masks_VOC"), class.join("masks")).unwrap();
        let mcmr = Mcmr::open(copy.path()).unwrap();
        assert_eq!(mcmr.entries().len(), 1);
        assert!(mcmr.warnings()[0].contains("1 object is"), "{:?}", mcmr.warnings());
    }

    #[test]
    fn a_wrong_field_is_named() {
        let fault = |from: &str, to: &str| {
            let copy = copied("mcmr");
            let file = copy.path().join("aeroplane/annotations/00001.yaml");
            let text = std::fs::read_to_string(&file).unwrap();
            assert!(text.contains(from));
            std::fs::write(&file, text.replace(from, to)).unwrap();
            Mcmr::open(copy.path()).unwrap_err().to_string()
        };
        let error = fault("cad_idx: 1", "cad_idx: x");
        assert!(error.contains("00001.yaml") && error.contains("`cad_idx`"), "{error}");
        assert!(fault("extrinsic", "extrinsics").contains("`extrinsic`"));
        assert!(fault("[0.0, 0.0, 1.0]", "[0.0, 1.0]").contains("intrinsic[2]"));
        assert!(fault("bbox: [", "bbox: &b [").contains("anchors"));
    }
}

mod cub {
    use super::*;
    use datasets::{Cub, CubAnnotation};

    #[test]
    fn models_land_in_their_masks() {
        for path in ["cub", "cub/cachedir/cub"] {
            let cub = Cub::open(&folder(path)).unwrap();
            let subsets: Vec<_> = cub.entries().iter().map(|e| e.subset.unwrap()).collect();
            assert_eq!(subsets, [Subset::Train, Subset::Train, Subset::Validation]);
            assert_eq!(cub.entries()[1].category, "002.Lopsided_Bird");
            for object in 0..3 {
                let view = read(&cub, object).views.remove(0);
                let image = &cub.annotation(object).image;
                let expected = expected();
                let pixels = points::<2>(&expected["cub"][image]);
                for (vertex, pixel) in vertices().into_iter().zip(pixels) {
                    let p = view.camera.project(vertex);
                    assert!((p.column - pixel[0]).hypot(p.row - pixel[1]) < 1e-6, "{image}");
                    assert!(p.depth > 0.0);
                }
                assert_masked(&view, &vertices());
                let [top, left, height, width] = view.mask_bounds().unwrap();
                let bounds = [left, top, left + width, top + height].map(|v| v as f64);
                assert_eq!(cub.annotation(object).bounds, bounds);
            }
        }
    }

    #[test]
    fn parts_are_where_they_are_seen() {
        // The fixture's parts are the model's first vertices.
        let cub = Cub::open(&folder("cub")).unwrap();
        for object in 0..3 {
            let (annotation, view) = (cub.annotation(object), &read(&cub, object).views[0]);
            for (k, part) in annotation.parts.iter().enumerate() {
                let Some(part) = part else {
                    assert!(k >= 12);
                    continue;
                };
                let p = view.camera.project(vertices()[k]);
                assert!((p.column - part[0]).hypot(p.row - part[1]) < 1e-6);
            }
        }
    }

    #[test]
    fn the_mean_shape_and_the_mirror_are_cmrs() {
        let cub = Cub::open(&folder("cub")).unwrap();
        let shape = cub.mean_shape().unwrap();
        assert_eq!(shape.parts.as_slice(), &vertices()[..15]);
        assert_eq!((shape.triangles.len(), shape.triangles[0]), (7, [0, 2, 3]));
        shape.mesh().validate().unwrap();
        // CMR's list counts from 1; doing it twice is doing nothing.
        let listed = [1, 2, 3, 4, 5, 6, 11, 12, 13, 10, 7, 8, 9, 14, 15];
        let mirror = CubAnnotation::MIRRORED;
        assert_eq!(mirror.map(|k| k + 1), listed);
        assert!((0..15).all(|k| mirror[mirror[k]] == k));
    }

    #[test]
    fn what_is_wrong_is_named_as_matlab_counts() {
        let copy = copied("cub");
        let sfm = copy.path().join("cachedir/cub/sfm");
        std::fs::copy(sfm.join("anno_val.mat"), sfm.join("anno_train.mat")).unwrap();
        let error = Cub::open(copy.path()).unwrap_err().to_string();
        assert!(error.contains("anno_train.mat") && error.contains("`sfm_anno`"), "{error}");
        assert!(error.contains("1 structs") && error.contains("as many as images"), "{error}");
        std::fs::remove_file(sfm.join("anno_train.mat")).unwrap();
        let error = Cub::open(copy.path()).unwrap_err().to_string();
        assert!(error.contains("anno_train.mat") && error.contains("missing"), "{error}");
    }
}

#[test]
fn a_single_object_is_read_wherever_it_is() {
    let views =
        datasets::read_views(&folder("pix3d"), &ReadOptions::default(), &|_, _| {}).unwrap();
    assert_eq!((views.layout, views.len()), (datasets::Layout::Pix3d, 2));
    for (name, count) in [("pascal3d", "2"), ("mcmr", "2"), ("cub", "3")] {
        let error = datasets::read_views(&folder(name), &ReadOptions::default(), &|_, _| {});
        let error = error.unwrap_err().to_string();
        assert!(error.contains(&format!("{count} objects")), "{error}");
    }
}
