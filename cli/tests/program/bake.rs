//! `unsphere bake`: textures for meshes that exist, by their pixels, and what it says.

use std::path::Path;
use std::sync::OnceLock;

use crate::common::pixels::{Look, frames_in, picture, pictures_on};
use crate::common::{Run, TINY, files_in, unsphere_with};
use mesh_core::{Image, Texture, TriMesh, primitives, read_mesh, write_mesh};

/// Behind what turns.
const BACKDROP: [u8; 3] = [237, 240, 245];
/// What rims do to the mean colour of an object, bytes.
const NEAR: f64 = 26.0;
/// The six sides of the box: red, green, blue, and what lies between.
const COLORS: [[f32; 3]; 6] = [
    [0.9, 0.2, 0.2],
    [0.2, 0.9, 0.2],
    [0.2, 0.2, 0.9],
    [0.8, 0.8, 0.2],
    [0.8, 0.2, 0.8],
    [0.2, 0.8, 0.8],
];

/// A box of diagonal 1, to which what is drawn is brought.
fn shape() -> TriMesh {
    primitives::cuboid([0.35, 0.9, 0.3].map(|side| side / 1.0225f32.sqrt()))
}

/// A box with a square of an image of 96 x 64 texels for each side, four texels inside of a cell of 32, and its true image.
fn painted_box() -> TriMesh {
    let (mut uvs, mut image) = (Vec::new(), Image::new(64, 96, 3));
    for (side, color) in COLORS.iter().enumerate() {
        let [left, top] = [32 * (side % 3), 32 * (side / 3)];
        for [x, y] in [[4, 4], [4, 28], [28, 28], [28, 4]] {
            uvs.push([(left + x) as f32 / 96.0, 1.0 - (top + y) as f32 / 64.0]);
        }
        for texel in 0..32 * 32 {
            let at = (top + texel / 32) * 96 + left + texel % 32;
            image.data[3 * at..3 * at + 3].copy_from_slice(color);
        }
    }
    let faces =
        (0..6u32).flat_map(|k| [[4 * k, 4 * k + 1, 4 * k + 2], [4 * k, 4 * k + 2, 4 * k + 3]]);
    let texture = Some(Texture { uvs, faces: faces.collect(), image });
    TriMesh { texture, ..shape() }
}

/// A folder with the box (`box.glb`), its layout without an image (`bare.obj`), and twelve views of it.
fn place() -> &'static Path {
    static PLACE: OnceLock<tempfile::TempDir> = OnceLock::new();
    let place = PLACE.get_or_init(|| {
        let place = tempfile::tempdir().unwrap();
        let path = |name: &str| place.path().join(name);
        write_mesh(path("box.glb"), &painted_box()).unwrap();
        write_mesh(path("bare.obj"), &painted_box()).unwrap();
        for file in ["bare.mtl", "bare.png"] {
            std::fs::remove_file(path(file)).unwrap();
        }
        let made = "data generate --from box.glb --cameras sphere --light flat --views 16 --size 160 -o made -q";
        unsphere_with(place.path(), &made.split(' ').collect::<Vec<_>>()).ok();
        std::fs::rename(path("made/box/0000"), path("views")).unwrap();
        place
    });
    place.path()
}

fn run(line: &str) -> Run {
    unsphere_with(place(), &line.split_whitespace().collect::<Vec<_>>())
}

/// The colour of a texture at a place of a side of the box, 0 to 1.
fn at(mesh: &TriMesh, side: usize, barycentric: [f32; 3]) -> [f32; 3] {
    let texture = mesh.texture.as_ref().unwrap();
    texture.color_at(&mesh_core::SurfacePoint { face: 2 * side as u32, barycentric })
}

/// Every side of the box has its colour in the middle and near its corners, where no pixel shows another side too.
fn has_its_colors(mesh: &TriMesh) {
    for (side, truth) in COLORS.iter().enumerate() {
        for weights in [[0.3, 0.3, 0.4], [0.7, 0.15, 0.15], [0.15, 0.7, 0.15], [0.15, 0.15, 0.7]] {
            let found = at(mesh, side, weights);
            let near = found.iter().zip(truth).all(|(a, b)| (a - b).abs() < 0.04);
            assert!(near, "side {side}, {weights:?}: {found:?}, expected {truth:?}");
        }
    }
}

#[test]
fn a_layout_without_an_image_gets_the_colors_of_the_views() {
    let out = run("bake bare.obj views -o own --texture-size 256 --json").ok().json();
    let metrics = &out["metrics"];
    assert_eq!((&metrics["uv"]["kept"], &metrics["texture_size"]), (&true.into(), &256.into()));
    assert!(metrics["mask_iou"].as_f64().unwrap() > 0.95, "{metrics}");
    assert!(metrics["baked"]["psnr"].as_f64().unwrap() > 25.0, "{metrics}");
    assert!(metrics["unseen"].as_f64().unwrap() < 0.01 && metrics["held_out"].is_null());
    let folder = place().join("own");
    let files = files_in(&folder);
    for name in ["mesh.glb", "mesh.mtl", "mesh.obj", "mesh.ply", "mesh.png", "metrics.json"] {
        assert!(files.contains(&folder.join(name)), "{name} among {files:?}");
    }
    assert_eq!(files.len(), 8, "{files:?}");
    let said: serde_json::Value =
        serde_json::from_str(&std::fs::read_to_string(folder.join("metrics.json")).unwrap())
            .unwrap();
    assert_eq!(&said, metrics);

    let truth = painted_box().texture.unwrap();
    let [glb, obj] = ["mesh.glb", "mesh.obj"].map(|name| read_mesh(folder.join(name)).unwrap());
    for mesh in [&glb, &obj] {
        has_its_colors(mesh);
        let texture = mesh.texture.as_ref().unwrap();
        for (own, true_) in texture.faces.iter().flatten().zip(truth.faces.iter().flatten()) {
            let (own, true_) = (texture.uvs[*own as usize], truth.uvs[*true_ as usize]);
            assert!((0..2).all(|k| (own[k] - true_[k]).abs() < 1e-6), "{own:?} {true_:?}");
        }
    }
    // The image itself: the middle of each side's square, and levels up nothing that is not of a side.
    let image = picture(&folder.join("mesh.png"));
    assert_eq!([image.width, image.height, image.channels], [256, 256, 3]);
    for (side, color) in COLORS.iter().enumerate() {
        let (row, column) = (64 + 128 * (side / 3), 42 + 85 * (side % 3));
        let pixel = image.pixel(row, column);
        let near = pixel.iter().zip(color).all(|(a, b)| (f32::from(*a) / 255.0 - b).abs() < 0.04);
        assert!(near, "side {side}: {pixel:?}, expected {color:?}");
    }
    let level = image.resized(16, 16);
    assert!(level.data.chunks_exact(3).all(|p| p.iter().map(|&v| u32::from(v)).sum::<u32>() > 250));
    let frames = frames_in(&folder.join("turntable.gif"));
    let looks: Vec<Look> = frames.iter().map(|frame| Look::at(frame, BACKDROP)).collect();
    for k in 0..3 {
        // All four sides come by, and the top: each channel is bright on some of them and dark on others.
        let values = || looks.iter().map(|look| look.mean[k]);
        let (least, most) = (values().fold(255.0, f64::min), values().fold(0.0, f64::max));
        assert!(looks.len() == 36 && most - least > 60.0, "channel {k}: {least} to {most}");
    }
    let page = std::fs::read_to_string(folder.join("report.html")).unwrap();
    let pictures = pictures_on(&page);
    assert!(pictures.len() >= 16, "{}", pictures.len());
    for pair in pictures.chunks_exact(2).take(8) {
        let [model, truth] = [&pair[0], &pair[1]].map(|image| Look::at(image, [0; 3]));
        truth.has(truth.mean, NEAR);
        model.has(truth.mean, NEAR);
    }
    // Vertices, for who reads PLY.
    let colors = read_mesh(folder.join("mesh.ply")).unwrap().colors.unwrap();
    assert!(colors.iter().all(|color| color.iter().sum::<f32>() > 0.8), "{colors:?}");
}

fn count_of(metrics: &serde_json::Value, name: &str) -> usize {
    metrics[name]["views"].as_array().unwrap().len()
}

#[test]
fn layouts_are_kept_or_made_and_that_is_said() {
    let mut twice = painted_box();
    let texture = twice.texture.as_mut().unwrap();
    texture.faces = texture.faces.iter().map(|face| face.map(|t| t % 4)).collect();
    write_mesh(place().join("twice.glb"), &twice).unwrap();
    let out = run("bake twice.glb views -o made-new").ok();
    assert!(out.stdout().contains("new: the mesh's own overlap"), "{}", out.stdout());
    has_its_colors(&read_mesh(place().join("made-new/mesh.glb")).unwrap());
    let out = run("bake twice.glb views -o kept --uv keep").ok();
    assert!(out.stderr().contains("overlap"), "{}", out.stderr());
    let out = run("bake bare.obj views -o asked --uv new --hold-out 4 --json").ok().json();
    let metrics = &out["metrics"];
    assert_eq!(metrics["uv"]["reason"], "new ones were asked for");
    assert_eq!([count_of(metrics, "baked"), count_of(metrics, "held_out")], [12, 4]);
    assert!(metrics["held_out"]["psnr"].as_f64().unwrap() > 22.0, "{metrics}");
    // Other views score alone; a mesh without a layout.
    write_mesh(place().join("shape.stl"), &shape()).unwrap();
    let twelve: Vec<String> = (0..12).map(|view| view.to_string()).collect();
    std::fs::write(place().join("twelve.txt"), twelve.join("\n")).unwrap();
    let line = "bake shape.stl views -o scored --only twelve.txt --score views --json";
    let out = run(line).ok().json();
    let metrics = &out["metrics"];
    assert_eq!(metrics["uv"]["reason"], "the mesh has none");
    assert_eq!([count_of(metrics, "baked"), count_of(metrics, "held_out")], [12, 4]);
    has_its_colors(&read_mesh(place().join("scored/mesh.glb")).unwrap());
}

#[test]
fn threads_change_no_byte_of_a_texture() {
    let by = |threads: &str| {
        run(&format!("bake bare.obj views -o by{threads} --threads {threads} -q")).ok();
        ["mesh.glb", "mesh.png", "mesh.ply", "metrics.json"]
            .map(|name| std::fs::read(place().join(format!("by{threads}")).join(name)).unwrap())
    };
    let one = by("1");
    assert!(one == by("2") && one == by("3"));
}

#[test]
fn a_mesh_that_is_elsewhere_is_found_out() {
    let path = |name: &str| place().join(name);
    write_mesh(path("lying.obj"), &painted_box().laid(mesh_core::UpAxis::Z)).unwrap();
    let said = run("bake lying.obj views -o lying").ok().stderr();
    assert!(said.contains("hardly lies") && said.contains("--mesh-up"), "{said}");
    let metrics = std::fs::read_to_string(path("lying/metrics.json")).unwrap();
    assert!(metrics.contains("hardly lies"), "{metrics}");
    let out = run("bake lying.obj views -o stands --mesh-up z --up y").ok();
    assert!(!out.stderr().contains("hardly"), "{}", out.stderr());
    has_its_colors(&read_mesh(path("stands/mesh.obj")).unwrap());
    write_mesh(path("large.obj"), &painted_box().scaled([1000.0; 3])).unwrap();
    let said = run("bake large.obj views -o large").ok().stderr();
    assert!(said.contains("times as large") && said.contains("--scale 0.001"), "{said}");
}

#[test]
fn what_cannot_be_baked_is_refused_and_nothing_is_left() {
    let path = |name: &str| place().join(name);
    let refused = |line: &str, code: i32, words: &[&str]| {
        run(&format!("{line} -o refused")).fails(code, words);
        assert!(!path("refused").exists(), "{line}");
    };
    std::fs::write(path("points.obj"), "v 0 0 0\nv 1 0 0\n").unwrap();
    std::fs::write(path("noise.glb"), "no mesh at all").unwrap();
    std::fs::write(path("dot.obj"), "v 1 1 1\nv 1 1 1\nv 1 1 1\nf 1 2 3\n").unwrap();
    write_mesh(path("shape.ply"), &primitives::icosphere(3)).unwrap();
    refused("bake points.obj views", 3, &["points.obj", "no faces"]);
    refused("bake noise.glb views", 3, &["noise.glb", "glTF"]);
    refused("bake dot.obj views", 3, &["dot.obj", "no extent"]);
    refused("bake nothing.ply views", 3, &["nothing.ply"]);
    refused("bake bare.obj nowhere", 3, &["nowhere"]);
    refused("bake shape.ply views --uv keep", 3, &["shape.ply", "--uv new"]);
    refused(
        "bake shape.ply views --texture-size 64",
        2,
        &["--texture-size", "64 x 64", "1280 faces"],
    );
    refused("bake bare.obj views --texture-size 9000", 2, &["9000", "8192"]);
    refused("bake bare.obj views --uv best", 2, &["auto", "keep", "new"]);
    refused("bake bare.obj views --hold-out 4 --score views", 2, &["--score"]);
    run("bake bare.obj views -o file.glb").fails(2, &["folder"]);
    // A folder of a user stays as it is.
    std::fs::create_dir_all(path("mine")).unwrap();
    std::fs::write(path("mine/notes.txt"), "mine").unwrap();
    run("bake bare.obj views -o mine").fails(1, &["mine", "--force"]);
    assert_eq!(files_in(&path("mine")).len(), 1);
}

/// What a fit leaves is textured again by its own views, from the file that stands upright too.
#[test]
fn a_mesh_of_a_fit_is_baked_again() {
    let [a, b, c, d] = TINY;
    run(&format!("fit views -o fitted --set color=texture {a} {b} {c} {d} -q")).ok();
    let out = run("bake fitted/mesh.glb views -o again --json").ok().json();
    let metrics = &out["metrics"];
    assert_eq!(metrics["uv"]["kept"], true, "{metrics}");
    assert!(metrics["mask_iou"].as_f64().unwrap() > 0.6, "{metrics}");
}
