//! Verdicts: a good fit is good, and each thing that is wrong has its word.

use datasets::{Truth, Views};
use mesh_core::{TriMesh, primitives};
use recon::fit::{Fitted, Quality, fit};
use recon::inspect::inspect_views;
use recon::progress::Watch;
use recon::verdict::{Assessment, Evidence, Grade, assess, judge};
use synth::{Orbit, Planted, RenderOptions, render_views};

fn views_of(mesh: &TriMesh) -> Views {
    let orbit = Orbit {
        count: 20,
        target: [0.0; 3],
        distance: [2.6, 3.0],
        width: 96,
        height: 96,
        ..Orbit::default()
    };
    let views =
        render_views(mesh, &orbit.cameras(), &RenderOptions::default(), &|_, _| {}).unwrap();
    Views::in_memory(views)
}

fn fitted(views: &Views) -> Fitted {
    fit(views, &Quality::Draft.config(), &mut Watch::default()).unwrap()
}

fn egg() -> TriMesh {
    primitives::icosphere(4).scaled([0.8, 0.6, 0.7]).colored([0.7, 0.3, 0.2])
}

/// A change of the evidence, the grade that it must bring, and a word of the reason.
type Flaw = (fn(&mut Evidence), Grade, &'static str);

#[test]
fn a_good_fit_is_good_until_something_speaks_against_it() {
    let views = views_of(&egg());
    let good = Evidence::of(&views, &fitted(&views)).unwrap();
    let verdict = judge(&good);
    assert_eq!((verdict.grade, verdict.reasons), (Grade::Good, Vec::new()), "{good:?}");
    assert_eq!((good.fitted_views, good.views.len()), (16, 20));
    let flaws: [Flaw; 11] = [
        (|e| e.mask_iou = 0.5, Grade::Failed, "mask IoU"),
        (|e| e.closed = false, Grade::Failed, "not closed"),
        (|e| e.mask_iou = 0.94, Grade::Doubtful, "mask IoU"),
        (|e| e.self_intersections = 3, Grade::Doubtful, "3 pairs"),
        (|e| e.fitted_views = 3, Grade::Doubtful, "few"),
        (|e| e.unseen = (0.4, "-y".into()), Grade::Doubtful, "-y"),
        (|e| e.motion = 9.0, Grade::Doubtful, "moved"),
        (|e| e.views[0].mask_iou = 0.7, Grade::Doubtful, "disagree"),
        (|e| e.views.iter_mut().for_each(|v| v.cut = true), Grade::Doubtful, "out of frame"),
        (|e| e.mask_edge = Some(-1.5), Grade::Doubtful, "larger"),
        (|e| e.coherence = None, Grade::Doubtful, "fix no body"),
    ];
    for (flaw, grade, word) in flaws {
        let mut evidence = good.clone();
        flaw(&mut evidence);
        let verdict = judge(&evidence);
        assert_eq!(verdict.grade, grade, "{word}: {verdict:?}");
        assert!(verdict.reasons[0].contains(word), "{word}: {verdict:?}");
    }
}

#[test]
fn inputs_that_agree_are_not_to_blame() {
    let views = views_of(&egg());
    let good = Evidence::of(&views, &fitted(&views)).unwrap();
    assert!(good.is_coherent());
    // A shape that is off is not yet an input that is.
    assert!(Evidence { mask_iou: 0.96, self_intersections: 3, ..good.clone() }.is_coherent());
    let flaws: [fn(&mut Evidence); 6] = [
        (|e| e.mask_iou = 0.8),
        (|e| e.views[0].mask_iou = 0.8),
        (|e| e.mask_edge = Some(1.5)),
        (|e| e.coherence = None),
        (|e| e.motion = 9.0),
        (|e| e.coherence.as_mut().unwrap().gap = 0.6),
    ];
    for (k, flaw) in flaws.into_iter().enumerate() {
        let mut evidence = good.clone();
        flaw(&mut evidence);
        assert!(!evidence.is_coherent(), "{k}");
    }
    let mistake = Planted::Poses(2.0);
    let views = Views::in_memory(mistake.plant(views.views.clone(), [0.0; 3], 4));
    assert!(!Evidence::of(&views, &fitted(&views)).unwrap().is_coherent());
}

#[test]
fn holes_are_seen_and_shown() {
    // A frame around a window.
    let mut frame = TriMesh::default();
    for (sides, at) in [
        ([1.4, 0.3, 0.3], [0.0, 0.5, 0.0]),
        ([1.4, 0.3, 0.3], [0.0, -0.5, 0.0]),
        ([0.3, 1.0, 0.3], [0.55, 0.0, 0.0]),
        ([0.3, 1.0, 0.3], [-0.55, 0.0, 0.0]),
    ] {
        frame.append(&primitives::cuboid(sides).translated(at)).unwrap();
    }
    let views = views_of(&frame.colored([0.2, 0.6, 0.3]));
    // A closed plate where the frame is: what a surface without a hole can be.
    let plate = primitives::cuboid([1.4, 1.3, 0.3]).colored([0.5; 3]);
    let mesh = mesh_core::subdivide(&plate);
    let filled =
        Fitted { health: mesh.health(), mesh, self_intersections: 0, ..fitted(&views_of(&egg())) };
    let Assessment { verdict, evidence, pictures, .. } = assess(&views, &filled).unwrap();
    assert_ne!(verdict.grade, Grade::Good);
    assert!(verdict.reasons.iter().any(|reason| reason.contains("holes")), "{verdict:?}");
    assert!(evidence.views.len() == 8 && evidence.views[0].mask_iou <= evidence.views[7].mask_iou);
    let worst = &pictures[0];
    assert!(worst.caption.contains(&evidence.views[0].name), "{}", worst.caption);
    assert_eq!(worst.difference.width, worst.photograph.width);
    let blue = |p: &&[u8]| p[2] > 150 && p[0] < 60;
    let count = worst.difference.data.chunks_exact(3).filter(blue).count() as f64;
    let area = views.views[evidence.views[0].index].mask_pixels() as f64;
    assert!((count / area - evidence.views[0].excess).abs() < 0.05, "{count} of {area}");
}

#[test]
fn what_a_verdict_says_an_inspection_need_not_say_again() {
    let good = views_of(&egg());
    assert_eq!(assess(&good, &fitted(&good)).unwrap().said, [""; 0]);
    let views = Planted::OneSided(50.0).plant(good.views, [0.0; 3], 4);
    let views = Views::in_memory(views);
    let found = assess(&views, &fitted(&views)).unwrap();
    let says = |reason: &String| reason.contains("no view shows the side");
    assert!(found.verdict.reasons.iter().any(says), "{:?}", found.verdict);
    let inspected = inspect_views(&views, &Truth::default()).problems;
    assert!(inspected.iter().any(|problem| problem.kind == "one_sided"), "{inspected:?}");
    assert!(found.said.contains(&"one_sided"), "{:?}", found.said);
}

#[test]
fn views_that_are_spoilt_are_not_good() {
    let good = views_of(&egg());
    for mistake in [
        Planted::Poses(2.0),
        Planted::Blobs { views: 1.0, area: 0.1 },
        Planted::Few(5),
        Planted::OneSided(50.0),
    ] {
        let views = Views::in_memory(mistake.plant(good.views.clone(), [0.0; 3], 4));
        let verdict = judge(&Evidence::of(&views, &fitted(&views)).unwrap());
        assert_ne!(verdict.grade, Grade::Good, "{mistake:?}");
    }
}
