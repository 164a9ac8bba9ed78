//! Every image, animation and page that a command writes, looked at: size, frames, what is behind the object, and the
//! colour of the object itself.
#![allow(clippy::case_sensitive_file_extension_comparisons, reason = "names that we wrote")]

use std::path::{Path, PathBuf};
use std::sync::OnceLock;

use crate::common::pixels::{
    Look, carried, color_of, corner, frames_in, mean, part, picture, pictures_on, scene,
};
use crate::common::{self, TINY, files_in, unsphere_with};
use mesh_core::{ByteImage, TriMesh, primitives, read_mesh, write_mesh};

/// The object of most of these tests, and its colour.
const ORANGE: [f64; 3] = [204.0, 102.0, 51.0];
/// Behind what turns.
const BACKDROP: [u8; 3] = [237, 240, 245];
/// What palettes and the rims of an object do to its mean colour, bytes.
const NEAR: f64 = 14.0;

/// An ellipsoid, orange all over, or without colours.
fn ball(colored: bool) -> TriMesh {
    let mut mesh = primitives::icosphere(3);
    mesh.positions.iter_mut().for_each(|p| *p = [p[0], 1.3 * p[1], 0.8 * p[2]]);
    mesh.colors = colored.then(|| vec![[0.8, 0.4, 0.2]; mesh.positions.len()]);
    mesh
}

/// A folder with both balls, views of the orange one in kaolin's layout, and a fit to them, made once for all tests.
fn place() -> &'static Path {
    static PLACE: OnceLock<tempfile::TempDir> = OnceLock::new();
    let place = PLACE.get_or_init(|| {
        let place = tempfile::tempdir().unwrap();
        write_mesh(place.path().join("orange.ply"), &ball(true)).unwrap();
        write_mesh(place.path().join("bare.ply"), &ball(false)).unwrap();
        let made = "data generate --from orange.ply --cameras sphere --light flat --views 12 --size 48 -o made";
        run_in(place.path(), made);
        // So rough that there are views which disagree, for the page to show.
        let [a, b, c, d] = TINY;
        let rough = "--set filter-normals=false";
        run_in(place.path(), &format!("fit made/orange/0000 -o fit {a} {b} {c} {d} {rough}"));
        place
    });
    place.path()
}

fn run_in(folder: &Path, line: &str) {
    unsphere_with(folder, &[&line.split_whitespace().collect::<Vec<_>>()[..], &["-q"]].concat())
        .ok();
}

fn run(line: &str) {
    run_in(place(), line);
}

fn text(path: &str) -> String {
    std::fs::read_to_string(place().join(path)).unwrap()
}

fn size(image: &ByteImage) -> [usize; 2] {
    [image.height, image.width]
}

/// The frames of a turntable show an object of this colour on the backdrop.
fn turns(path: &Path, color: [f64; 3]) {
    let frames = frames_in(path);
    assert_eq!(frames.len(), 36);
    for frame in frames {
        assert_eq!((size(&frame), corner(&frame)), ([256, 256], BACKDROP));
        Look::at(&frame, BACKDROP).has(color, NEAR);
    }
}

#[test]
fn renderings_have_the_color_of_the_mesh() {
    run("render orange.ply -o turn.gif --frames 4 --size 40 --background 2040c0");
    let frames = frames_in(&place().join("turn.gif"));
    assert_eq!(frames.len(), 4);
    for frame in &frames {
        assert_eq!(size(frame), [40, 40]);
        Look::at(frame, [0x20, 0x40, 0xc0]).has(ORANGE, NEAR);
    }
    run("render orange.ply -o one.png --size 40 --depth");
    let one = picture(&place().join("one.png"));
    assert_eq!((size(&one), corner(&one)), ([40, 40], BACKDROP));
    Look::at(&one, BACKDROP).has(ORANGE, NEAR);
    let depth = mesh_core::read_depth(place().join("one.exr")).unwrap();
    let seen = depth.data.iter().filter(|z| z.is_finite() && **z > 0.0).count();
    assert!((0.1..0.9).contains(&(seen as f64 / 1600.0)), "{seen}");
    run("render fit/mesh.glb -o all --cameras made/orange/0000 --depth");
    assert_eq!(files_in(&place().join("all")).len(), 24);
    for i in 0..12 {
        Look::at(&picture(&place().join(format!("all/{i}.png"))), [0; 3]).has(ORANGE, NEAR);
    }
}

#[test]
fn a_mesh_without_colors_shows_its_shape() {
    run("render bare.ply -o bare.gif --frames 3 --size 40");
    let frames = frames_in(&place().join("bare.gif"));
    assert_eq!(frames.len(), 3);
    for frame in &frames {
        Look::at(frame, BACKDROP).is_shaded();
    }
    run("render bare.ply -o bare.png --size 40");
    Look::at(&picture(&place().join("bare.png")), BACKDROP).is_shaded();
    run("render bare.ply -o flat.png --size 40 --light flat");
    assert!(Look::at(&picture(&place().join("flat.png")), BACKDROP).spread < 1.0);
    // A coloured one is lit where that is asked for.
    run("render orange.ply -o lit.png --size 40 --light studio");
    assert!(Look::at(&picture(&place().join("lit.png")), BACKDROP).spread > 5.0);
}

#[test]
fn a_fit_is_delivered_in_the_colors_of_its_views() {
    let mesh = read_mesh(place().join("fit/mesh.ply")).unwrap();
    let color = color_of(&mesh);
    assert!(color.iter().zip(ORANGE).all(|(a, b)| (a - b).abs() < NEAR), "{color:?}");
    turns(&place().join("fit/turntable.gif"), ORANGE);
    let page = text("fit/report.html");
    let turntable = std::fs::read(place().join("fit/turntable.gif")).unwrap();
    assert_eq!(carried(&page, "image/gif"), [turntable]);
    // The six worst views, the disagreement above the photograph; then the two of twelve that are held out, each the model
    // above the truth.
    let pictures = pictures_on(&page);
    assert_eq!(pictures.len(), 16);
    let (worst, pictures) = pictures.split_at(12);
    for pair in worst.chunks(2) {
        assert_eq!(size(&pair[0]), size(&pair[1]));
        assert!(pair[0].data.iter().any(|v| *v != pair[0].data[0]), "nothing is drawn");
        Look::at(&pair[1], [0; 3]).has(ORANGE, NEAR);
    }
    for pair in pictures.chunks(2) {
        assert_eq!(size(&pair[0]), size(&pair[1]));
        for picture in pair {
            Look::at(picture, [0; 3]).has(ORANGE, NEAR);
        }
    }
    let (vertices, colors) = scene(&page);
    assert_eq!(vertices, mesh.positions.len());
    assert!(colors.unwrap().iter().zip(ORANGE).all(|(a, b)| (a - b).abs() < NEAR));
    // Two charts, neither of them empty.
    assert_eq!(page.matches("<polyline").count(), page.matches("<rect x=").count());
    assert!(page.matches("<svg class=\"chart\"").count() == 2 && page.contains("<polyline"));
    assert!(!page.contains("nothing to draw"));
}

#[test]
fn textures_have_the_colors_of_the_views() {
    let [a, b, c, d] = TINY;
    run(&format!("fit made/orange/0000 -o textured --set color=texture {a} {b} {c} {d}"));
    let folder = place().join("textured");
    let in_obj =
        files_in(&folder).into_iter().find(|file| file.extension().is_some_and(|e| e == "png"));
    let orange = |image: &ByteImage, what: &str| {
        let found = mean(image.data.chunks_exact(3).filter(|p| p.iter().any(|v| *v > 24)));
        assert!(
            found.iter().zip(ORANGE).all(|(a, b)| (a - b).abs() < 2.0 * NEAR),
            "{what}: {found:?}"
        );
    };
    orange(&picture(&in_obj.unwrap()), "mesh.obj");
    let in_glb = read_mesh(folder.join("mesh.glb")).unwrap().texture.unwrap();
    orange(&in_glb.image.to_bytes(), "mesh.glb");
    turns(&folder.join("turntable.gif"), ORANGE);
    let page = text("textured/report.html");
    orange(pictures_on(&page).last().unwrap(), "the viewer");
}

#[test]
fn the_demo_is_not_dark() {
    let place = tempfile::tempdir().unwrap();
    let views = common::clock_views(place.path());
    let mesh = read_mesh(place.path().join("made/mesh.ply")).unwrap();
    let color = color_of(&mesh);
    assert!(color.iter().sum::<f64>() > 150.0, "{color:?}");
    // Of a clock not all sides are alike: the mean over all frames is.
    let frames = frames_in(&place.path().join("made/turntable.gif"));
    let looks: Vec<Look> = frames.iter().map(|frame| Look::at(frame, BACKDROP)).collect();
    let shown: [f64; 3] =
        std::array::from_fn(|k| looks.iter().map(|look| look.mean[k]).sum::<f64>() / 36.0);
    let near = shown.iter().zip(color).all(|(a, b)| (a - b).abs() < 50.0);
    assert!(frames.len() == 36 && near, "{shown:?}, expected {color:?}");
    for i in 0..10 {
        let view = picture(&views.join(format!("{i}_rgb.png")));
        assert_eq!(size(&view), [48, 48]);
        assert!(Look::at(&view, [0; 3]).mean.iter().sum::<f64>() > 150.0);
    }
}

#[test]
fn datasets_show_their_objects() {
    for i in 0..12 {
        let view = picture(&place().join(format!("made/orange/0000/{i}_rgb.png")));
        Look::at(&view, [0; 3]).has(ORANGE, NEAR);
    }
    // Of flat light the sheet makes an exception: it is to show shapes.
    let sheet = picture(&place().join("made/contact_sheet.png"));
    assert_eq!((size(&sheet), corner(&sheet)), ([168, 168], [235; 3]));
    let look = Look::at(&sheet, [235; 3]);
    look.is_shaded_in(ORANGE);
    let generated = "data generate --from orange.ply --light flat --views 2 --size 40x32 --normals camera --depth true,monocular";
    run(&format!("{generated} --layout r2n2 -o r2n2"));
    run(&format!("{generated} --layout transforms --background 102030 -o transforms"));
    let named = |folder: &str, wanted: fn(&str) -> bool| -> Vec<PathBuf> {
        let wanted = |file: &PathBuf| wanted(file.file_name().unwrap().to_str().unwrap());
        files_in(&place().join(folder)).into_iter().filter(wanted).collect()
    };
    let renderings = named("r2n2", |name| matches!(name, "00.png" | "01.png"));
    assert_eq!(renderings.len(), 2);
    for file in renderings {
        let view = picture(&file);
        assert_eq!((size(&view), view.channels), ([32, 40], 4));
        Look::at(&view.over([0; 3]), [0; 3]).has(ORANGE, NEAR);
        assert_eq!(view.data[3], 0, "the background is transparent");
    }
    let normals = named("r2n2", |name| name.ends_with("_normal.png"));
    assert_eq!(normals.len(), 2);
    for file in normals {
        // Of what is seen, normals point to the viewer: blue.
        let view = picture(&file).to_rgb();
        let look = Look::at(&view, corner(&view));
        assert!(look.mean[2] > 190.0 && (90.0..165.0).contains(&look.mean[0]), "{look:?}");
    }
    let pictures = named("transforms", |name| {
        name.ends_with(".png")
            && !["mask", "normal", "depth", "sheet"].iter().any(|w| name.contains(w))
    });
    assert!(!pictures.is_empty());
    for file in pictures.iter().filter(|file| {
        !file.components().any(|c| ["masks", "normals"].iter().any(|name| c.as_os_str() == *name))
    }) {
        let view = picture(file);
        assert_eq!(corner(&view), [0x10, 0x20, 0x30], "{}", file.display());
        Look::at(&view.to_rgb(), [0x10, 0x20, 0x30]).has(ORANGE, NEAR);
    }
}

#[test]
fn converted_pictures_are_the_same() {
    let first = picture(&place().join("made/orange/0000/0_rgb.png"));
    for layout in ["photos", "colmap", "transforms", "kaolin"] {
        run(&format!("data convert made/orange/0000 as-{layout} --layout {layout}"));
        let files = files_in(&place().join(format!("as-{layout}")));
        let pictures = files.iter().filter(|file| file.extension().is_some_and(|e| e == "png"));
        let same = pictures.filter(|file| picture(file).to_rgb() == first).count();
        assert_eq!(same, 1, "{layout}: {files:?}");
    }
}

#[test]
fn inspections_show_views_masks_and_cameras() {
    run("data inspect made/orange/0000 -o look");
    let name = |end: &str| {
        let files = files_in(&place().join("look"));
        files.into_iter().find(|file| file.to_str().unwrap().ends_with(end)).unwrap()
    };
    let sheet = picture(&name("_views.png"));
    // Twelve views of at most 144 pixels in four columns.
    assert_eq!((size(&sheet), corner(&sheet)), ([3 * 144, 4 * 144], [40; 3]));
    let green = |p: &&[u8]| **p == [40, 220, 90];
    let outlines = sheet.data.chunks_exact(3).filter(green).count();
    assert!(outlines > 12 * 40, "{outlines}");
    let inside = sheet.data.chunks_exact(3).filter(|p| p[0] > 120 && !green(p));
    let found = mean(inside);
    assert!(found.iter().zip(ORANGE).all(|(a, b)| (a - b).abs() < NEAR), "{found:?}");
    let page = text("look/report.html");
    assert_eq!(pictures_on(&page), [sheet]);
    let svg = std::fs::read_to_string(name("_cameras.svg")).unwrap();
    assert!(page.contains(&svg) && !svg.contains("NaN") && !svg.contains("inf"));
    // Each camera from two sides, around the hull.
    assert_eq!((svg.matches("<circle").count(), svg.matches("fill=\"#999\"").count()), (24, 2));
}

/// Sheets of samples and pages of trainings, of every system: the model above the truth.
#[test]
fn samples_of_trainings_show_the_model_above_the_truth() {
    let briefly = "--preset tiny --set epochs=1 --set max-steps=1 --set samples-every=1";
    for system in
        ["img2mesh", "pixel2mesh", "ode-pixel2mesh", "mcmr", "depth-pixel2mesh", "mesh-rcnn"]
    {
        let data = if system == "img2mesh" { "made/orange/0000" } else { "" };
        run(&format!("train {system} {data} -o run-{system} {briefly}"));
        let folder = place().join(format!("run-{system}"));
        let sheet = picture(&folder.join("samples/epoch-00001.png"));
        let half = [sheet.height / 2, sheet.width];
        let (model, truth) = (part(&sheet, [0, 0], half), part(&sheet, [half[0], 0], half));
        let page = text(&format!("run-{system}/report.html"));
        let on_page = pictures_on(&page);
        assert!(on_page.len() >= 2, "{system}");
        for (row, pictures) in [(&model, 0), (&truth, 1)] {
            let background = corner(row);
            let look = Look::at(row, background);
            // White behind a lit mesh, black behind colours: something that is neither is to be seen on both.
            assert!((0.02..0.98).contains(&look.share), "{system}, row {pictures}: {look:?}");
            let first = &on_page[pictures];
            let look = Look::at(first, corner(first));
            assert!((0.02..0.98).contains(&look.share), "{system}, page: {look:?}");
        }
        if system == "img2mesh" {
            Look::at(&truth, [0; 3]).has(ORANGE, NEAR);
        }
        if ["pixel2mesh", "ode-pixel2mesh"].contains(&system) {
            assert_eq!(corner(&model), [255; 3]);
            Look::at(&model, [255; 3]).is_shaded();
        }
        let png = std::fs::read(folder.join("samples/epoch-00001.png")).unwrap();
        let events = files_in(&folder.join("tensorboard")).remove(0);
        let events = std::fs::read(events).unwrap();
        assert!(
            events.windows(png.len()).any(|part| part == png),
            "{system}: TensorBoard's picture"
        );
        assert!(scene(&page).0 > 3, "{system}");
    }
}

#[test]
fn predictions_turn_and_deform() {
    let briefly =
        "--preset tiny --set max-steps=1 --set validation-every=none --set samples-every=none";
    run(&format!("train ode-pixel2mesh -o bare-run {briefly}"));
    run("predict ode-pixel2mesh made/orange/0000 -c bare-run -o bare-out --first 1");
    // A shape without colours, so light is on all of it: what turns, what deforms, and the views of the report.
    let frames = frames_in(&place().join("bare-out/turntable.gif"));
    assert_eq!(frames.len(), 36);
    for frame in &frames {
        Look::at(frame, BACKDROP).is_shaded();
    }
    let frames = frames_in(&place().join("bare-out/deformation.gif"));
    assert_eq!(frames.len(), 25 + 8);
    for frame in &frames {
        Look::at(frame, BACKDROP).is_shaded();
    }
    let page = text("bare-out/report.html");
    let (vertices, colors) = scene(&page);
    assert!(vertices > 100 && colors.is_none());
    let pictures = pictures_on(&page);
    assert_eq!(pictures.len(), 24);
    for pair in pictures.chunks(2) {
        Look::at(&pair[0], [0; 3]).is_shaded();
        Look::at(&pair[1], [0; 3]).has(ORANGE, NEAR);
    }
    run(&format!("train img2mesh made/orange/0000 -o run {briefly} --set level=1"));
    run("predict img2mesh made/orange/0000 -c run -o out --first 3");
    let mesh = read_mesh(place().join("out/mesh.ply")).unwrap();
    let color = color_of(&mesh);
    for frame in frames_in(&place().join("out/turntable.gif")) {
        let look = Look::at(&frame, BACKDROP);
        assert!((0.03..0.97).contains(&look.share), "{look:?}");
        // Only some of its vertices are seen from one side.
        assert!(
            look.mean.iter().zip(color).all(|(a, b)| (a - b).abs() < 60.0),
            "{look:?} {color:?}"
        );
    }
}

/// Where images and pages are made, and the test that looks at them. A file that begins to make them fails the test
/// below until somebody looks at those, too.
const MAKERS: [(&str, &str); 26] = [
    (
        "cli/src/command/capture.rs",
        "its photographs are those that it is given: from_photographs_to_a_mesh",
    ),
    ("cli/src/command/data/depth.rs", "its own unit test: a network is needed to run it"),
    ("cli/src/command/data/mask.rs", "masks_are_found_beside_the_views_and_fit_takes_them"),
    ("cli/src/command/render.rs", "renderings_have_the_colour_of_the_mesh"),
    ("datasets/src/assemble.rs", "converted_pictures_are_the_same"),
    ("datasets/src/layouts/colmap/write.rs", "converted_pictures_are_the_same"),
    ("datasets/src/layouts/kaolin.rs", "datasets_show_their_objects"),
    ("datasets/src/layouts/r2n2/write.rs", "datasets_show_their_objects"),
    ("mesh-core/src/io/glb/write.rs", "textures_have_the_colours_of_the_views"),
    ("mesh-core/src/io/obj/write.rs", "textures_have_the_colours_of_the_views"),
    ("mesh-core/src/io/threemf.rs", "its own test: it unzips and reads what was written"),
    (
        "recon/src/delivery/baked.rs",
        "bake.rs: a_layout_without_an_image_gets_the_colors_of_the_views",
    ),
    ("recon/src/delivery/mod.rs", "a_fit_is_delivered_in_the_colours_of_its_views"),
    ("recon/src/turntable.rs", "a_fit_is_delivered_in_the_colours_of_its_views"),
    ("synth/src/generate/shapenet.rs", "datasets_show_their_objects"),
    ("synth/src/generate/store.rs", "datasets_show_their_objects"),
    ("recon/src/inspect/mod.rs", "inspections_show_views_masks_and_cameras"),
    ("recon/src/inspect/page.rs", "inspections_show_views_masks_and_cameras"),
    ("studies/src/mcmr/mod.rs", "its own unit test: a study takes minutes"),
    ("models/src/predict/deliver.rs", "predictions_turn_and_deform"),
    ("train/src/report/mod.rs", "a_fit_is_delivered_in_the_colours_of_its_views"),
    ("recon/src/scene.rs", "textures_have_the_colours_of_the_views"),
    ("studies/src/page.rs", "the tests of studies: a study takes minutes"),
    ("studies/src/store.rs", "the tests of studies: a study takes minutes"),
    ("studies/src/output.rs", "the tests of studies: a study takes minutes"),
    ("train/src/record.rs", "samples_of_trainings_show_the_model_above_the_truth"),
];

/// Calls that make an image, an animation or a page.
const MAKING: [&str; 15] = [
    "encode_png(",
    "write_png(",
    "encode_gif(",
    "png_uri(",
    "encode_exr(",
    "write_depth(",
    "encode_depth(",
    "encode_pfm(",
    "cameras_svg(",
    ".to_svg()",
    ".to_html()",
    " page(",
    ":page(",
    "turntable(",
    "animation(",
];

#[test]
fn every_maker_of_pictures_is_looked_at() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut found = Vec::new();
    let packages = [
        "mesh-core/src/io",
        "datasets/src",
        "synth/src",
        "train/src",
        "recon/src",
        "models/src",
        "studies/src",
        "cli/src",
    ];
    for package in packages {
        for file in files_in(&root.join(package)) {
            let text = std::fs::read_to_string(&file).unwrap_or_default();
            // Tests stand at the end of their file; a definition is no call.
            let code = text.split("#[cfg(test)]").next().unwrap();
            let calls = |line: &str| {
                let line = line.trim_start();
                !line.starts_with("//")
                    && !line.contains("fn ")
                    && !line.contains('`')
                    && !line.starts_with("use ")
                    && MAKING.iter().any(|call| line.contains(call))
            };
            if code.lines().any(calls)
                && !file.ends_with("tests.rs")
                && !file.ends_with("pix3d_tests.rs")
            {
                let name = file.strip_prefix(&root).unwrap().to_str().unwrap();
                found.push(name.replace('\\', "/"));
            }
        }
    }
    found.sort();
    let mut known: Vec<&str> = MAKERS.iter().map(|(file, _)| *file).collect();
    known.sort_unstable();
    assert_eq!(found, known);
}
