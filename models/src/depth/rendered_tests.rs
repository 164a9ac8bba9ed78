//! What the rendered-depth loss compares.

#![allow(clippy::unwrap_used, reason = "tests")]

use std::sync::Arc;

use autodiff_lite::Tape;
use diff_raster::Scratch;
use train::System;

use super::rendered::{Wanted, depth_difference, draw};
use super::tests::{moved, refine, sphere, step, voxels};
use super::*;

/// The truth costs nothing in any comparison; the truth as far again from the camera, seen just so, only where depth has
/// a unit; and where nothing is compared there is neither a loss nor a gradient.
#[test]
fn rendered_depth_is_compared_as_it_says() {
    use DepthKind::{Estimated, True};
    use DepthLossKind::{Aligned, Auto, Log, Plain, Trimmed};

    let with = |depth: DepthKind, depth_loss, times: f32, nothing: Option<f64>, alone: bool| {
        // Nothing is compared, but coverage may count.
        let coverage = nothing.unwrap_or(if alone { 1.0 } else { 0.0 });
        let coverage_alone = alone;
        let config = RefineConfig { depth, depth_loss, coverage, coverage_alone, ..refine() };
        let scenes = Scenes::synthetic(&config, 0).unwrap();
        let (object, mut scene) = scenes.trial(train::Subset::Test, 1, 0).unwrap();
        let surface = scenes.mesh(object).unwrap();
        let truth = scene.depth_targets.frame.mesh_placed(surface.mesh.as_ref().unwrap());
        if nothing.is_some() {
            let depth_targets =
                DepthTargets { compared: vec![false; 1024], ..(*scene.depth_targets).clone() };
            scene.depth_targets = Arc::new(depth_targets);
        }
        let packed = Packed::new(vec![Arc::new(Shape::of(&truth))]);
        let tape = Tape::train(0);
        let rows: Vec<f32> = truth.positions.as_flattened().iter().map(|x| times * x).collect();
        let rows = ndarray::Array3::from_shape_vec((1, packed.vertices(), 3), rows).unwrap();
        let positions = tape.leaf(rows);
        let lens = ndarray::Array3::from_shape_vec((1, 3, 4), scene.image.lens.to_vec()).unwrap();
        let wanted = Wanted { silhouette: coverage > 0.0, colors: None };
        let lens = tape.constant(lens);
        let drawn = draw(&Scratch::default(), &packed, positions, lens, 32, wanted);
        let loss = depth_difference(&drawn, &[&scene], &config);
        let value = loss.item();
        let gradients = loss.backward();
        let derivative =
            gradients.wrt(positions).map_or(0.0, |g| g.iter().map(|x| x.abs()).sum::<f32>());
        (value, derivative)
    };
    let of = |depth, kind, times, nothing| with(depth, kind, times, nothing, false);
    for kind in [Aligned, Trimmed, Log, Plain] {
        let (value, _) = of(True, kind, 1.0, None);
        assert!(value.abs() < 1e-3, "{kind:?} of the truth: {value}");
        let (value, derivative) = of(True, kind, 2.0, None);
        let has_unit = matches!(kind, Log | Plain);
        assert_eq!(value > 0.1, has_unit, "{kind:?} twice as far: {value}");
        assert!(derivative > 0.0 && derivative.is_finite());
        assert_eq!(of(True, kind, 2.0, Some(0.0)), (0.0, 0.0), "{kind:?} of nothing");
        // The truth covers its own silhouette but for pixels that its outline halves.
        let (value, _) = of(True, kind, 1.0, Some(0.5));
        assert!((0.0..0.02).contains(&value), "{kind:?} of nothing: {value}");
    }
    // An estimate is blurred at the outline: the truth fits it, not exactly, but by less than its own spread,
    // which counts a tenth.
    let (value, _) = of(Estimated, Auto, 1.0, None);
    assert!(value.is_finite() && value < 0.1, "{value}");
    assert_eq!(of(Estimated, Auto, 1.0, Some(0.0)), (0.0, 0.0));
    // Of coverage alone, how deep the truth lies is nothing: twice as far and as large it covers the same.
    let [near, far] = [1.0, 2.0].map(|times| with(True, Plain, times, None, true).0);
    assert!(near < 0.05 && (near - far).abs() < 1e-4, "{near}, {far}");
    let without = RefineConfig { coverage_alone: true, coverage: 0.0, ..refine() };
    let problems = MeshRcnn::check(&VoxelConfig { refine: without, ..voxels() }).join("; ");
    assert!(problems.contains("`coverage-alone`"), "{problems}");
}

/// The stages of a system are the first ones of a system with more.
#[test]
fn depth_of_all_stages_is_their_mean() {
    let depth_at = |stages, depth_of_all_stages| {
        let refine = RefineConfig { stages, depth_of_all_stages, ..refine() };
        let config = SphereConfig { refine, ..sphere() };
        let mut system = DepthPixel2Mesh::new(&config, 3);
        moved(&mut system);
        let (terms, gradients) = step(&system, &config.refine, 0);
        let depth = terms.iter().find(|(name, _)| *name == "depth").unwrap().1;
        assert!(gradients.iter().all(|(_, norm)| norm.is_finite()));
        depth
    };
    let each = [1, 2, 3].map(|stages| depth_at(stages, false));
    let mean = each.iter().sum::<f32>() / 3.0;
    let found = depth_at(3, true);
    assert!((found - mean).abs() < 1e-5 * mean, "{found}, of {each:?}");
    assert!((each[2] - mean).abs() > 1e-3 * mean, "{each:?}");
    assert_eq!(depth_at(1, true), each[0]);
}
