//! Generated datasets, from configuration to files and back.
//!
//! Tolerances: cameras 1e-9; masks, depth and surfaces as they were drawn, to the bit; colours of
//! meshes half a step of a byte.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use datasets::r2n2::R2n2;
use datasets::{Dataset, Layout, ReadOptions, View, read_views};
use mesh_core::{Camera, TriMesh, primitives, read_mesh};
use synth::generate::{
    CameraSet, GenerateConfig, GenerateError, Generated, Model, Normalize, OutputLayout, generate,
    generate_shard, read_rough_poses,
};
use synth::progress::{Ended, Event, Watch};
use synth::shapes::Family;
use synth::{Monocular, NormalSpace, R2n2Cameras, RenderOptions, render_views};

/// The cameras of an object of [`small`].
fn r2n2_cameras(info: &synth::generate::ObjectInfo) -> Vec<Camera> {
    let seed = info.view_seed;
    R2n2Cameras { count: 3, width: 48, height: 36, seed, ..R2n2Cameras::default() }.cameras()
}

/// Two clocks and two tables, small, in images that are not square.
fn small(layout: OutputLayout) -> GenerateConfig {
    GenerateConfig {
        families: vec![Family::AlarmClock, Family::Table],
        objects: 2,
        layout,
        views: 3,
        width: 48,
        height: 36,
        points: 200,
        voxels: 12,
        depth: true,
        normals: Some(NormalSpace::Camera),
        monocular: Some(Monocular::default()),
        seed: 11,
        ..GenerateConfig::default()
    }
}

fn run(config: &GenerateConfig, folder: &Path) -> Generated {
    generate(config, &[], folder, &mut Watch::default()).unwrap()
}

/// Every file below a folder with its bytes.
fn files(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut found = BTreeMap::new();
    let mut pending = vec![folder.to_owned()];
    while let Some(next) = pending.pop() {
        for entry in fs::read_dir(next).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                pending.push(path);
            } else {
                let name = path.strip_prefix(folder).unwrap().to_str().unwrap().to_owned();
                found.insert(name, fs::read(&path).unwrap());
            }
        }
    }
    found
}

fn assert_same_camera(a: &Camera, b: &Camera) {
    assert_eq!((a.width, a.height), (b.width, b.height));
    assert!((a.rotation - b.rotation).abs().max() < 1e-9);
    assert!((a.translation - b.translation).abs().max() < 1e-9);
    let rows = |c: &Camera| c.projection();
    for (a, b) in rows(a).iter().flatten().zip(rows(b).iter().flatten()) {
        assert!((a - b).abs() < 1e-9, "{a} {b}");
    }
}

/// What was read is what the mesh looks like from the cameras that were read.
fn assert_views_show(mesh: &TriMesh, views: &[View]) {
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera.clone()).collect();
    let options = RenderOptions { depth: true, supersample: 3, ..RenderOptions::default() };
    let drawn = render_views(mesh, &cameras, &options, &|_, _| {}).unwrap();
    for (read, drawn) in views.iter().zip(&drawn) {
        let seen = drawn.mask_pixels();
        assert!(seen > 50, "{seen} pixels");
        // A camera that is off in its last bits can decide a pixel otherwise, once in a while.
        let differ = read.mask.data.iter().zip(&drawn.mask.data).filter(|(a, b)| a != b).count();
        assert!(differ <= 1, "{differ} pixels of the mask differ");
        let (read, drawn) = (read.depth.as_ref().unwrap(), drawn.depth.as_ref().unwrap());
        let wrong = read.data.iter().zip(&drawn.data).filter(|(a, b)| {
            a.is_finite() == b.is_finite() && a.is_finite() && (*a - *b).abs() > 1e-5
        });
        assert!(wrong.count() <= 1);
    }
}

/// The mesh as the family draws it, from the seed that the manifest has.
fn drawn_mesh(family: Family, info: &synth::generate::ObjectInfo) -> TriMesh {
    assert_eq!(info.category, family.name());
    family.draw(info.seed).mesh()
}

fn assert_same_mesh(read: &TriMesh, drawn: &TriMesh) {
    assert_eq!(read.faces, drawn.faces);
    assert_eq!(read.positions, drawn.positions);
    let (read, drawn) = (read.colors.as_ref().unwrap(), drawn.colors.as_ref().unwrap());
    for (a, b) in read.iter().flatten().zip(drawn.iter().flatten()) {
        assert!((a - b).abs() <= 0.5 / 255.0 + 1e-6);
    }
}

#[test]
fn threads_change_no_byte() {
    let place = tempfile::tempdir().unwrap();
    let make = |threads: usize, layout: OutputLayout| {
        let folder = place.path().join(format!("{threads} {layout:?}"));
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
        pool.install(|| run(&small(layout), &folder));
        files(&folder)
    };
    for layout in LAYOUTS {
        let one = make(1, layout);
        assert!(one.len() > 4 * 3 * 5, "{} files", one.len());
        for threads in [2, 3] {
            let other = make(threads, layout);
            assert!(one.keys().eq(other.keys()));
            for (name, bytes) in &one {
                assert!(other[name] == *bytes, "{name} differs with {threads} threads");
            }
        }
    }
}

const LAYOUTS: [OutputLayout; 3] =
    [OutputLayout::Kaolin, OutputLayout::R2n2, OutputLayout::Transforms];

#[test]
fn a_run_that_was_stopped_is_taken_up() {
    let place = tempfile::tempdir().unwrap();
    let config = GenerateConfig { depth: false, monocular: None, ..small(OutputLayout::Kaolin) };
    let whole = place.path().join("whole");
    let all = run(&config, &whole);
    assert_eq!((all.made, all.skipped, all.total, all.ended), (4, 0, 4, Ended::Completed));

    let folder = place.path().join("stopped");
    let pool = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    let mut heard = Vec::new();
    let mut watch = Watch::new(|event: &Event| heard.push(event.clone()))
        .until_event(|event| matches!(event, Event::Progress { done: 4, total: 12, .. }));
    let begun = pool.install(|| generate(&config, &[], &folder, &mut watch)).unwrap();
    drop(watch);
    assert_eq!((begun.ended, begun.made, begun.objects.len()), (Ended::Cancelled, 2, 2));
    // The object that was being drawn is finished: so many views are done of the twelve.
    let job = "generate";
    assert!(
        matches!(heard[0], Event::Started { total: 12, done: 0, job: found, .. } if found == job)
    );
    let [.., last, end] = &heard[..] else { panic!("{heard:?}") };
    assert!(matches!(last, Event::Progress { done: 6, total: 12, .. }), "{last:?}");
    assert!(matches!(end, Event::Finished { ended: Ended::Cancelled, done: 6, .. }), "{end:?}");
    assert!(!folder.join("objects.json").exists());

    // What another run was killed over, and an object that lost its manifest.
    fs::create_dir_all(folder.join(".unfinished/table-0000")).unwrap();
    fs::remove_file(folder.join("alarm_clock/0001/object.json")).unwrap();
    let end = run(&config, &folder);
    assert_eq!((end.made, end.skipped, end.ended), (3, 1, Ended::Completed));
    assert!(files(&whole) == files(&folder));
    assert_eq!(run(&config, &folder).skipped, 4);
}

#[test]
fn folders_of_others_are_left_alone() {
    let place = tempfile::tempdir().unwrap();
    let config = GenerateConfig { objects: 1, views: 1, ..small(OutputLayout::Kaolin) };
    let folder = place.path().join("set");
    run(&config, &folder);
    let before = files(&folder);
    let other = GenerateConfig { seed: 12, ..config.clone() };
    let error = generate(&other, &[], &folder, &mut Watch::default()).unwrap_err();
    assert!(matches!(error, GenerateError::Different { .. }), "{error}");
    let text = error.to_string();
    assert!(text.contains("seed = 11") && text.contains("seed = 12"), "{text}");
    let model = model(place.path());
    let error = generate(&config, std::slice::from_ref(&model), &folder, &mut Watch::default())
        .unwrap_err();
    assert!(matches!(error, GenerateError::Different { .. }), "{error}");
    assert!(before == files(&folder));

    let mine = place.path().join("mine");
    fs::create_dir(&mine).unwrap();
    fs::write(mine.join("letter.txt"), "dear").unwrap();
    let error = generate(&config, &[], &mine, &mut Watch::default()).unwrap_err();
    assert!(matches!(error, GenerateError::Foreign { .. }), "{error}");
    assert_eq!(files(&mine).len(), 1);
    let wrong = GenerateConfig { views: 0, ..config };
    let error = generate(&wrong, &[], &mine, &mut Watch::default()).unwrap_err();
    assert!(error.to_string().contains("`views` is 0"), "{error}");
}

#[test]
fn kaolin_views_come_back() {
    let place = tempfile::tempdir().unwrap();
    let config = small(OutputLayout::Kaolin);
    let made = run(&config, place.path());
    for info in &made.objects {
        let folder = place.path().join(&info.category).join(&info.name);
        let options = ReadOptions { depth: true, ..ReadOptions::default() };
        let read = read_views(&folder, &options, &|_, _| {}).unwrap();
        assert_eq!((read.layout, read.len()), (Layout::KaolinFolder, 3));
        for (view, camera) in read.views.iter().zip(r2n2_cameras(info)) {
            assert_same_camera(&view.camera, &camera);
        }
        let mesh = drawn_mesh(info.category.parse().unwrap(), info);
        assert_same_mesh(&read_mesh(folder.join("mesh.ply")).unwrap(), &mesh);
        assert_views_show(&mesh, &read.views);
        for end in ["0_monocular.exr", "2_normals.png"] {
            assert!(folder.join(end).is_file(), "{end}");
        }
    }
}

#[test]
fn shapenets_layout_comes_back() {
    let place = tempfile::tempdir().unwrap();
    let made = run(&small(OutputLayout::R2n2), place.path());
    let read = R2n2::open(place.path()).unwrap();
    assert_eq!(read.entries().len(), 4);
    let options = ReadOptions { depth: true, ..ReadOptions::default() };
    let mut subsets = 0;
    for info in &made.objects {
        let same = |e: &datasets::Entry| (&e.category, &e.name) == (&info.synset, &info.name);
        let object = read.entries().iter().position(same).unwrap();
        subsets += usize::from(read.entries()[object].subset.is_some());
        let views = read.views(object, None, &options, &|_, _| {}).unwrap();
        for (view, camera) in views.views.iter().zip(r2n2_cameras(info)) {
            assert_same_camera(&view.camera, &camera);
        }
        let mesh = drawn_mesh(info.category.parse().unwrap(), info);
        assert_views_show(&mesh, &views.views);
        let truth = read.truth(object).unwrap();
        assert_same_mesh(truth.mesh.as_ref().unwrap(), &mesh);
        let points = truth.points.unwrap();
        assert_eq!((points.positions.len(), points.normals.len()), (200, 200));
        let surface = mesh_core::ClosestPoint::new(&mesh);
        for p in &points.positions {
            assert!(surface.find(*p).unwrap().distance < 1e-5);
        }
        let voxels = mesh_core::voxelize_solid(&mesh, [12; 3], ([-0.5; 3], [0.5; 3]));
        assert!(voxels.count() > 10);
        assert_eq!(truth.voxels.unwrap().bits, voxels.bits);
        // What faces the viewer has a normal that does, too.
        let normals = read.normals(object, 0).unwrap().unwrap();
        let facing = normals.data.chunks_exact(3).zip(&views.views[0].mask.data);
        let facing = facing.filter(|(n, m)| **m == 255 && n[2] > 120).count();
        assert!(facing as f64 > 0.95 * views.views[0].mask_pixels() as f64);
    }
    assert_eq!(subsets, 4);
}

/// Off the middle, not square, from everywhere.
#[test]
fn transforms_come_back() {
    let place = tempfile::tempdir().unwrap();
    let config = GenerateConfig {
        cameras: CameraSet::Sphere,
        principal: [0.1, -0.15],
        ..small(OutputLayout::Transforms)
    };
    let made = run(&config, place.path());
    for info in &made.objects {
        let folder = place.path().join(&info.category).join(&info.name);
        let options = ReadOptions { depth: true, ..ReadOptions::default() };
        let read = read_views(&folder, &options, &|_, _| {}).unwrap();
        let mesh = drawn_mesh(info.category.parse().unwrap(), info);
        assert_same_mesh(&read_mesh(folder.join("mesh.ply")).unwrap(), &mesh);
        assert_views_show(&mesh, &read.views);
        // The middle of the object is where the principal point was put.
        for view in &read.views {
            let middle = view.camera.project([0.0; 3]);
            assert!((middle.column - 48.0 * 0.6).abs() < 1e-6);
            assert!((middle.row - 36.0 * 0.35).abs() < 1e-6);
        }
        assert!(folder.join("monocular/0002.exr").is_file());
        assert!(folder.join("normals/0000.png").is_file());
    }
}

#[test]
fn collections_keep_both_poses() {
    let place = tempfile::tempdir().unwrap();
    let config = GenerateConfig {
        cameras: CameraSet::Collection,
        views: 1,
        ..small(OutputLayout::Transforms)
    };
    let made = run(&config, place.path());
    for info in &made.objects {
        let folder = place.path().join(&info.category).join(&info.name);
        let read = read_views(&folder, &ReadOptions::default(), &|_, _| {}).unwrap();
        let poses = read_rough_poses(&folder).unwrap();
        assert_eq!((read.len(), poses.len()), (1, 1));
        assert_same_camera(&read.views[0].camera, &poses[0].camera);
        assert!((poses[0].rough.rotation - poses[0].camera.rotation).abs().max() > 1e-3);
    }
}

#[test]
fn depth_that_was_drawn_for_the_guess_alone_is_not_written() {
    let place = tempfile::tempdir().unwrap();
    let config = GenerateConfig { depth: false, objects: 1, ..small(OutputLayout::Kaolin) };
    run(&config, place.path());
    let names = files(place.path());
    assert!(names.keys().any(|name| name.ends_with("_monocular.exr")));
    assert!(!names.keys().any(|name| name.ends_with("_depth.exr")));
}

/// A cube with a texture, at no particular place and of no particular size.
fn model(folder: &Path) -> Model {
    let mut mesh = primitives::cuboid([2.0, 3.0, 6.0]).translated([10.0, 0.0, -4.0]);
    let mut image = mesh_core::Image::new(4, 4, 3);
    image.data.iter_mut().enumerate().for_each(|(k, v)| *v = (k % 7) as f32 / 6.0);
    mesh.texture = Some(mesh_core::Texture {
        uvs: mesh.positions.iter().map(|p| [(p[0] - 9.0) / 2.0, (p[1] + 1.5) / 3.0]).collect(),
        faces: mesh.faces.clone(),
        image,
    });
    let path = folder.join("block.obj");
    mesh_core::write_mesh(&path, &mesh).unwrap();
    Model::read(&path, Normalize::UnitDiagonal).unwrap()
}

#[test]
fn a_mesh_of_the_users_own_keeps_its_texture() {
    let place = tempfile::tempdir().unwrap();
    let model = model(place.path());
    let folder = place.path().join("set");
    let config = GenerateConfig { cameras: CameraSet::Sphere, ..small(OutputLayout::Kaolin) };
    let mut watch = Watch::new(|event: &Event| {
        assert!(!matches!(event, Event::Progress { total, .. } if *total != 3), "{event:?}");
    });
    let made = generate(&config, std::slice::from_ref(&model), &folder, &mut watch);
    assert_eq!(made.unwrap().objects[0].category, "block");
    let object = folder.join("block/0000");
    let mesh = read_mesh(object.join("mesh.glb")).unwrap();
    let image = &mesh.texture.as_ref().unwrap().image;
    assert_eq!((image.height, image.width), (4, 4));
    let (low, high) = mesh.bounds().unwrap();
    // The diagonal was 7.
    assert!((high[2] - 3.0 / 7.0).abs() < 1e-6 && (low[0] + 1.0 / 7.0).abs() < 1e-6);
    let options = ReadOptions { depth: true, ..ReadOptions::default() };
    let read = read_views(&object, &options, &|_, _| {}).unwrap();
    assert_views_show(&mesh, &read.views);
    let colors: std::collections::BTreeSet<&[u8]> =
        read.views.iter().flat_map(|view| view.color.data.chunks_exact(3)).collect();
    assert!(colors.len() > 50, "{} colours", colors.len());
}

/// In millimetres, cameras that stand at 1.1 to 1.7 would be inside of it.
#[test]
fn models_that_3d_r2n2s_cameras_are_not_around_are_refused() {
    let place = tempfile::tempdir().unwrap();
    let path = place.path().join("chair.ply");
    let config = GenerateConfig { cameras: CameraSet::R2n2, ..small(OutputLayout::Kaolin) };
    for scale in [1000.0, 0.001] {
        mesh_core::write_mesh(&path, &primitives::cuboid([scale; 3])).unwrap();
        let read = |normalize| Model::read(&path, normalize).unwrap();
        let make = |model: &Model, config: &GenerateConfig, name: &str| {
            let folder = place.path().join(format!("{name}{scale}"));
            generate(config, std::slice::from_ref(model), &folder, &mut Watch::default())
        };
        let error = make(&read(Normalize::None), &config, "none").unwrap_err().to_string();
        assert!(error.contains("chair/0000") && error.contains("--normalize"), "{error}");
        for fits in [Normalize::UnitDiagonal, Normalize::UnitBox, Normalize::UnitSphere] {
            assert!(make(&read(fits), &config, &format!("{fits:?}")).is_ok());
        }
        let sphere = GenerateConfig { cameras: CameraSet::Sphere, ..config.clone() };
        assert!(make(&read(Normalize::None), &sphere, "sphere").is_ok());
    }
}

/// Several processes at one folder, one of which is stopped and run again, make the bytes of one.
#[test]
fn shares_make_the_whole() {
    for layout in [OutputLayout::Kaolin, OutputLayout::R2n2] {
        let place = tempfile::tempdir().unwrap();
        let [whole, shared] = ["whole", "shared"].map(|name| place.path().join(name));
        let config = GenerateConfig { objects: 3, ..small(layout) };
        run(&config, &whole);
        let share = |index: u64, watch: &mut Watch<'_>| {
            let shard = train::Shard::new(index, 4).unwrap();
            generate_shard(&config, &[], shard, &shared, watch).unwrap()
        };
        // Cancelled from the start: nothing of it is done.
        let mut cancelled = Watch::default();
        cancelled.cancel().cancel();
        let stopped = share(3, &mut cancelled);
        assert_eq!((stopped.made, stopped.ended), (0, Ended::Cancelled));
        let ends: Vec<Generated> = std::thread::scope(|scope| {
            let share = &share;
            let threads =
                [1, 2, 4].map(|index| scope.spawn(move || share(index, &mut Watch::default())));
            threads.into_iter().map(|thread| thread.join().unwrap()).collect()
        });
        assert_eq!(ends.iter().map(|end| end.made).sum::<usize>(), 5);
        assert!(ends.iter().all(|end| end.ended == Ended::Completed && !end.complete));
        assert!(!shared.join("splits.json").exists());
        let last = share(3, &mut Watch::default());
        assert_eq!((last.made, last.total, last.complete), (1, 1, true));
        assert!(files(&shared) == files(&whole));
        // What is there is not made again, by whomever.
        let again = share(1, &mut Watch::default());
        assert_eq!((again.made, again.skipped, again.complete), (0, 2, true));
        assert_eq!(run(&config, &shared).skipped, 6);
        assert!(files(&shared) == files(&whole));
    }
}
