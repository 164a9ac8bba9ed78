//! Parts that the masks do not ask for.

use super::{config::FitConfig, shape::Shape, target::Target};

/// A part with more of the surface than this is none.
const LARGEST: f64 = 0.01;
/// What the mean mask IoU may lose with them: half a pixel of an object of 5,000.
const LOSS: f64 = 1e-4;

/// The shape less its specks: small parts, the smallest first, without which the masks are met as well. They are what a few wrong
/// pixels of one mask left, or a thin part of which the rest was lost.
pub(super) fn without_specks(shape: Shape, targets: &[Target], config: &FitConfig) -> Shape {
    let component = shape.topology.components();
    let areas = areas(&shape, &component);
    let whole: f64 = areas.iter().sum();
    let mut small: Vec<u32> =
        (0..areas.len() as u32).filter(|&c| areas[c as usize] < LARGEST * whole).collect();
    small.sort_by(|&a, &b| areas[a as usize].total_cmp(&areas[b as usize]));
    if small.is_empty() {
        return shape;
    }
    let least = shape.mask_iou(targets) - LOSS;
    let mut best = None;
    let mut kept = vec![true; areas.len()];
    for speck in small {
        kept[speck as usize] = false;
        let without = shape.part(|v| kept[component[v] as usize], config);
        if without.mask_iou(targets) < least {
            kept[speck as usize] = true;
        } else {
            best = Some(without);
        }
    }
    best.unwrap_or(shape)
}

/// The area of each component.
fn areas(shape: &Shape, component: &[u32]) -> Vec<f64> {
    let mut areas = vec![0.0; shape.topology.component_count()];
    let of_vertices = mesh_core::vertex_areas(&shape.positions, &shape.faces);
    for (&component, area) in component.iter().zip(of_vertices) {
        areas[component as usize] += f64::from(area);
    }
    areas
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use mesh_core::{TriMesh, primitives::icosphere};
    use synth::{Orbit, RenderOptions, render_views};

    use super::*;

    fn balls(places: &[(f32, f32)]) -> TriMesh {
        let ball = |&(x, r): &(f32, f32)| icosphere(3).scaled([r; 3]).translated([x, 0.0, 0.0]);
        let mut all = TriMesh::default();
        for place in places {
            all.append(&ball(place)).unwrap();
        }
        all.colored([0.5; 3])
    }

    #[test]
    fn what_a_mask_shows_stays_and_what_none_shows_goes() {
        let (large, small, speck) = ((0.0, 0.6), (0.8, 0.05), (-0.8, 0.004));
        let orbit = Orbit { count: 6, width: 96, height: 96, ..Orbit::default() };
        let object = balls(&[large, small]);
        let look = RenderOptions::default();
        let views = render_views(&object, &orbit.cameras(), &look, &|_, _| {}).unwrap();
        let config = FitConfig::default();
        let target = |view| config.target(view);
        let mut targets: Vec<Target> = views.iter().filter_map(target).collect();
        for target in &mut targets {
            target.place([0.0; 3], 1.0);
        }
        let given = balls(&[speck, large, small, (0.85, 0.003)]);
        let shape = Shape::of(given.positions, given.faces, &config);
        let found = without_specks(shape, &targets, &config);
        assert_eq!(found.positions, balls(&[large, small]).positions);
        assert_eq!(found.faces, balls(&[large, small]).faces);
    }
}
