//! What only all views together show: whether there is an object, and whether cameras see it.

use std::path::Path;

use mesh_core::Ray;

use crate::convention::Convention;
use crate::error::{ReadViewsError, ViewsProblem};
use crate::view::View;

/// Refuses views in which nothing is to be seen, and says what looks wrong in some. `convention` is what the poses are taken for, for
/// messages, as `poses` is the field that holds them; `brightest` is the largest value in files of masks.
pub(crate) fn check(
    path: &Path,
    views: &[View],
    (poses, convention): (&str, Option<Convention>),
    brightest: Option<u16>,
    warnings: &mut Vec<String>,
) -> Result<(), ReadViewsError> {
    let share = |view: &View| {
        let [height, width] = view.whole_size();
        view.mask_pixels() as f64 / (height * width) as f64
    };
    let shares: Vec<f64> = views.iter().map(share).collect();
    let empty = names(views, |i| shares[i] == 0.0);
    if empty.len() == views.len() {
        let mut remedy = "choose another mask source, or invert the masks".to_owned();
        // Above that the alpha or the options have taken the object away.
        if let Some(value) = brightest.filter(|&value| value < 128) {
            remedy = format!(
                "{remedy}; the largest value in their files is {value}, and object is from 128 on, or 1 beside 0 alone"
            );
        }
        let problem = ViewsProblem::EmptyMasks { views: views.len(), remedy };
        return Err(ReadViewsError::new(path, problem));
    }
    if !empty.is_empty() {
        warnings.push(format!("the masks of views {} are empty", empty.join(", ")));
    }
    if shares.iter().all(|&share| share > 0.6) {
        warnings.push(
            "the masks cover most of every image: if they mark the background, invert them"
                .to_owned(),
        );
    }
    let strays = strays(views);
    if 2 * strays.len() > views.len() - empty.len() {
        let problem = ViewsProblem::SeesNothing {
            field: poses.to_owned(),
            wrong: strays.len(),
            views: views.len(),
            first: views[strays[0]].name.clone(),
            convention,
        };
        return Err(ReadViewsError::new(path, problem));
    }
    if !strays.is_empty() {
        let names: Vec<_> = strays.iter().map(|&i| views[i].name.as_str()).collect();
        warnings.push(format!(
            "the cameras of views {} do not see the point where the other masks meet",
            names.join(", ")
        ));
    }
    Ok(())
}

fn names(views: &[View], wanted: impl Fn(usize) -> bool) -> Vec<&str> {
    (0..views.len()).filter(|&i| wanted(i)).map(|i| views[i].name.as_str()).collect()
}

/// Views whose camera does not see the point nearest to all rays through the masks' centres.
///
/// Empty where the rays do not fix a point: a single view, or parallel ones.
fn strays(views: &[View]) -> Vec<usize> {
    let rays: Vec<(usize, Ray)> = views
        .iter()
        .enumerate()
        .filter_map(|(i, view)| {
            let [top, left, height, width] = view.mask_bounds()?;
            let (column, row) =
                (left as f64 + width as f64 / 2.0, top as f64 + height as f64 / 2.0);
            Some((i, view.camera.ray(column, row)))
        })
        .collect();
    let Some(point) = Ray::nearest_point(rays.iter().map(|&(_, ray)| ray)) else {
        return Vec::new();
    };
    rays.iter()
        .filter(|&&(i, ..)| {
            let p = views[i].camera.project(point);
            let [h, w] = views[i].whole_size().map(|n| n as f64);
            let near = |x: f64, size: f64| (-size..=2.0 * size).contains(&x);
            let behind = views[i].camera.is_perspective() && p.depth <= 0.0;
            behind || !(near(p.column, w) && near(p.row, h))
        })
        .map(|&(i, ..)| i)
        .collect()
}
