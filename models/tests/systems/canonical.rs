//! The weights that come along, on an object in worlds of other units, origins and verticals.

use std::path::Path;

use datasets::{Dataset as _, ReadOptions, View, Views};
use mesh_core::nalgebra::{SimilarityMatrix3, Vector3};
use models::img2mesh::Img2Mesh;
use models::predict::{Choice, PredictInput, Predictor as _};
use recon::evaluate::score_views;
use synth::shapes::Family;
use synth::{Orbit, Procedural};
use train::Checkpoint;

/// Views that the prediction is made from; as many others judge it.
const GIVEN: usize = 5;

fn shipped() -> Img2Mesh {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../weights/img2mesh.safetensors");
    Checkpoint::read(&path).unwrap().load().unwrap().0
}

/// Objects that the weights were not trained on.
fn objects(family: Family, count: usize) -> Vec<Vec<View>> {
    let orbit = Orbit { count: 2 * GIVEN, width: 128, height: 128, seed: 5, ..Procedural::orbit() };
    let set = Procedural::new(&[family], [0, 0, count], orbit);
    let views = |k| set.views(k, None, &ReadOptions::default(), &|_, _| ()).unwrap().views;
    (0..count).map(views).collect()
}

fn chair() -> Vec<View> {
    objects(Family::Chair, 1).swap_remove(0)
}

/// The IoU at cameras that were not given, and what was said.
fn predicted(system: &Img2Mesh, views: Vec<View>) -> (f64, Vec<String>) {
    let input = PredictInput::part(Views::in_memory(views), Choice::First(GIVEN)).unwrap();
    let prediction = system.apply(&input).unwrap();
    let others: Vec<&View> = input.others.iter().collect();
    let scores = score_views(&prediction.mesh, &others, &|_, _| ()).unwrap();
    (scores.mask_iou, prediction.warnings)
}

fn moved(views: &[View], by: &SimilarityMatrix3<f64>) -> Vec<View> {
    views.iter().map(|view| View { camera: view.camera.transformed(by), ..view.clone() }).collect()
}

/// An image of another size and shape, in which the object is small and beside the middle.
fn wide(view: &View) -> View {
    let (left, top, width, height) = (90, 20, 320, 180);
    let put = |picture: &mesh_core::ByteImage| {
        let c = picture.channels;
        let mut out =
            mesh_core::ByteImage { height, width, channels: c, data: vec![0; height * width * c] };
        for (i, row) in picture.data.chunks_exact(picture.width * c).enumerate() {
            let at = ((i + top) * width + left) * c;
            out.data[at..at + row.len()].copy_from_slice(row);
        }
        out
    };
    let [fx, fy, cx, cy] = view.camera.lens.numbers();
    let lens = view.camera.lens.with([fx, fy, cx + left as f64, cy + top as f64]);
    let camera = mesh_core::Camera { lens, width, height, ..view.camera.clone() };
    View { color: put(&view.color), mask: put(&view.mask), camera, ..view.clone() }
}

/// One image says nothing of depth, and its camera is believed.
#[test]
fn a_single_view_of_the_learned_world_stays_there() {
    let (system, views) = (shipped(), chair());
    for view in views {
        let name = view.name.clone();
        let input = PredictInput::part(Views::in_memory(vec![view]), Choice::All).unwrap();
        let warnings = system.apply(&input).unwrap().warnings;
        assert!(warnings.is_empty(), "{name}: {warnings:?}");
    }
}

#[test]
fn an_object_is_known_in_any_world() {
    let (system, views) = (shipped(), chair());
    let (known, warnings) = predicted(&system, views.clone());
    assert!(known > 0.7, "{known}");
    assert!(warnings.is_empty(), "{warnings:?}");
    let quarter = Vector3::x() * std::f64::consts::FRAC_PI_2;
    let worlds = [
        ("larger", SimilarityMatrix3::new(Vector3::zeros(), Vector3::zeros(), 100.0)),
        ("elsewhere", SimilarityMatrix3::new(Vector3::new(4.0, -3.0, 2.0), Vector3::zeros(), 1.0)),
        ("z up", SimilarityMatrix3::new(Vector3::new(0.1, 0.2, 0.9), quarter, 2.0)),
        ("turned", SimilarityMatrix3::new(Vector3::zeros(), Vector3::y() * 2.1, 30.0)),
    ];
    for (name, world) in worlds {
        let (iou, warnings) = predicted(&system, moved(&views, &world));
        assert!(iou > known - 0.1, "{name}: {iou} beside {known}");
        assert_eq!(warnings.len(), 1, "{name}");
    }
    let wide: Vec<View> = moved(&views, &worlds[0].1).iter().map(wide).collect();
    let (iou, _) = predicted(&system, wide);
    assert!(iou > known - 0.1, "wide: {iou} beside {known}");
}

/// Seen from the wrong side a car still covers two thirds of its masks: that is not enough to be believed.
#[test]
fn a_world_that_is_turned_by_a_quarter_is_found_out() {
    let system = shipped();
    let quarter = Vector3::y() * std::f64::consts::FRAC_PI_2;
    let turned = SimilarityMatrix3::new(Vector3::zeros(), quarter, 1.0);
    for views in objects(Family::Car, 3) {
        let (known, _) = predicted(&system, views.clone());
        let (iou, _) = predicted(&system, moved(&views, &turned));
        assert!(known > 0.85 && iou > known - 0.05, "{iou} beside {known}");
    }
}
