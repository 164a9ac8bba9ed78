//! Lens distortion against OpenCV's `projectPoints` and `fisheye::projectPoints` (`fixtures/distortion/make.py`), for models
//! that OpenCV does not have against COLMAP's own (`make_colmap.py`), and against itself.

#![allow(clippy::unwrap_used, reason = "tests")]

use mesh_core::Distortion;
use proptest::prelude::*;
use serde_json::Value;

fn numbers(value: &Value) -> Vec<f64> {
    value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
}

#[test]
fn projections_are_opencvs_and_colmaps() {
    let read = |text: &str| -> Vec<Value> {
        let all: Value = serde_json::from_str(text).unwrap();
        all["lenses"].as_array().unwrap().clone()
    };
    let mut lenses = read(include_str!("fixtures/distortion/opencv.json"));
    lenses.extend(read(include_str!("fixtures/distortion/colmap.json")));
    assert_eq!(lenses.len(), 8 + 3);
    for lens in &lenses {
        let model = lens["model"].as_str().unwrap();
        let ([fx, fy, cx, cy], distortion) =
            Distortion::from_colmap(model, &numbers(&lens["params"])).unwrap();
        let distortion = distortion.unwrap();
        let pairs =
            lens["points"].as_array().unwrap().iter().zip(lens["pixels"].as_array().unwrap());
        let mut worst = [0.0_f64; 2];
        for (point, pixel) in pairs {
            let (point, pixel) = (numbers(point), numbers(pixel));
            let plane = [point[0] / point[2], point[1] / point[2]];
            let seen = distortion.distort(plane);
            let error = (fx * seen[0] + cx - pixel[0]).hypot(fy * seen[1] + cy - pixel[1]);
            worst[0] = worst[0].max(error);
            let back = distortion.undistort([(pixel[0] - cx) / fx, (pixel[1] - cy) / fy]).unwrap();
            worst[1] = worst[1].max((back[0] - plane[0]).hypot(back[1] - plane[1]));
        }
        assert!(worst[0] < 1e-6, "{model}: {} pixels off", worst[0]);
        assert!(worst[1] < 1e-8, "{model}: {} on the way back", worst[1]);
    }
}

proptest! {
    #[test]
    fn undistort_takes_back_what_distort_did(
        k in prop::array::uniform4(-0.3..0.3_f64),
        p in prop::array::uniform2(-0.003..0.003_f64),
        kind in 0..4_u8,
        [share, turn] in prop::array::uniform2(0.0..1.0_f64),
    ) {
        let lens = match kind {
            0 => Distortion::KannalaBrandt { k: k.map(|k| 0.1 * k) },
            1 => Distortion::ThinPrismFisheye { k: k.map(|k| 0.1 * k), tangential: p, prism: [p[1], -p[0]] },
            2 => Distortion::FieldOfView { omega: 5.0 * k[0] },
            _ => Distortion::BrownConrady { numerator: [k[0], k[1], 0.0, 0.0], denominator: [k[2], k[3], 0.0], tangential: p },
        };
        // Within four fifths of the angle that the lens shows: where it turns back, decentering decides.
        let r = (0.8 * share * lens.reach().atan()).tan();
        let turn = turn * std::f64::consts::TAU;
        let point = [r * turn.cos(), r * turn.sin()];
        let back = lens.undistort(lens.distort(point));
        let back = back.ok_or_else(|| TestCaseError::fail(format!("{lens:?} at {point:?}")))?;
        prop_assert!((back[0] - point[0]).hypot(back[1] - point[1]) < 1e-7 * (1.0 + r), "{lens:?} {point:?} {back:?}");
    }
}

#[test]
fn a_lens_reaches_as_far_as_it_does_not_turn_back() {
    // r (1 - r^2 / 3) grows up to r = 1.
    let barrel = Distortion::brown_conrady([-1.0 / 3.0, 0.0, 0.0], [0.0; 2]);
    assert!((barrel.reach() - 1.0).abs() < 2e-3, "{}", barrel.reach());
    assert_eq!(barrel.undistort([0.9, 0.0]), None, "nothing is shown beyond 2/3");
    let pinhole = Distortion::brown_conrady([0.0; 3], [0.0; 2]);
    assert!(pinhole.is_none() && (pinhole.reach().atan().to_degrees() - 85.0).abs() < 1e-9);
    assert_eq!(
        Distortion::from_colmap("OPENCV", &[5.0, 5.0, 1.0, 1.0, 0.0, 0.0, 0.0, 0.0]).unwrap().1,
        None
    );
}

#[test]
fn a_field_of_view_goes_over_into_a_pinhole() {
    // The series below 1e-4 goes on where the formula ends, and 0 is no distortion.
    let at = |omega: f64| Distortion::FieldOfView { omega }.distort([0.7, -0.4]);
    for k in 0..2 {
        assert!((at(0.999e-4)[k] - at(1.001e-4)[k]).abs() < 1e-11);
        assert!((at(-0.8)[k] - at(0.8)[k]).abs() < 1e-15);
    }
    assert_eq!(at(0.0), [0.7, -0.4]);
    assert_eq!(Distortion::from_colmap("FOV", &[5.0, 5.0, 1.0, 1.0, 0.0]).unwrap().1, None);
}

#[test]
fn what_is_no_lens_is_said() {
    let fails = |model: &str, params: &[f64]| {
        Distortion::from_colmap(model, params).unwrap_err().to_string()
    };
    assert!(fails("EUCM", &[1.0; 6]).contains("FULL_OPENCV"));
    assert!(fails("FOV", &[1.0; 4]).contains("FOV has 5"));
    assert!(fails("OPENCV", &[1.0; 7]).contains("OPENCV has 8"));
    assert!(fails("RADIAL", &[1.0, 1.0, 1.0, f64::NAN, 0.0]).contains("NaN"));
    // Coefficients that no lens has: no panic, no hang.
    for k in [1e300, -1e300, f64::MIN_POSITIVE] {
        let lens = Distortion::brown_conrady([k; 3], [k; 2]);
        let _ = (lens.reach(), lens.undistort([0.3, 0.2]), lens.distort([1e200, -1e200]));
    }
}
