//! An inspection as a page that carries all it shows, with its images beside it.

use std::fmt::Write as _;

use mesh_core::bounds::longest_side;
use mesh_core::encode_png;
use train::output::{OutputError, OutputFolder};
use train::report::{Chart, Series, Table, counted, escape, page, png_uri, write_table};

use super::{Count, Inspection, ObjectInspection};

/// Writes `report.html`, `inspection.json`, and for each object `NAME_views.png` and
/// `NAME_cameras.svg`.
///
/// # Errors
/// If a file cannot be written.
pub fn write_report(
    inspection: &Inspection,
    command: &str,
    folder: &OutputFolder,
) -> Result<(), OutputError> {
    for (k, object) in inspection.looked_at.iter().enumerate() {
        let plain = |c: char| if c.is_ascii_alphanumeric() || c == '-' { c } else { '_' };
        let name: String = object.name.chars().map(plain).collect();
        let stem = if inspection.looked_at.len() > 1 { format!("{k:02}_{name}") } else { name };
        folder.write(&format!("{stem}_views.png"), &encode_png(&object.sheet))?;
        folder.write(&format!("{stem}_cameras.svg"), object.cameras.as_bytes())?;
    }
    let json = serde_json::to_vec_pretty(inspection).expect("plain numbers and texts");
    folder.write("inspection.json", &json)?;
    folder.write("report.html", html(inspection, command).as_bytes())
}

fn html(inspection: &Inspection, command: &str) -> String {
    let mut body = format!(
        "<h1>{}</h1><p class=\"lead\">{}</p><pre>{}</pre>",
        escape(&inspection.path.display().to_string()),
        escape(&inspection.summary()),
        escape(command)
    );
    for warning in &inspection.warnings {
        let _ = write!(body, "<p class=\"warn\">{}</p>", escape(warning));
    }
    let row = |c: &Count| {
        (c.name.clone(), format!("{}, {}", counted(c.objects, "object"), counted(c.views, "view")))
    };
    if inspection.categories.len() > 1 {
        write_table(&Table::new("Categories", inspection.categories.iter().map(row)), &mut body);
    }
    if !inspection.subsets.is_empty() {
        write_table(&Table::new("Subsets", inspection.subsets.iter().map(row)), &mut body);
    }
    for object in &inspection.looked_at {
        write_object(object, &mut body);
    }
    page(&format!("Data: {}", inspection.path.display()), &body)
}

fn write_object(object: &ObjectInspection, body: &mut String) {
    let _ = write!(body, "<h2>{}</h2>", escape(&object.title()));
    if object.problems.is_empty() {
        let _ = write!(body, "<p>Nothing looks wrong.</p>");
    }
    let problems = object.problems.iter().map(|p| &p.message).chain(&object.warnings);
    for text in problems {
        let _ = write!(body, "<p class=\"warn\">{}</p>", escape(text));
    }
    let _ = write!(
        body,
        "{}<p class=\"note\">Cameras around the visual hull; the first view is orange.</p>\
         <img style=\"max-width:100%\" alt=\"All views, masks outlined\" src=\"{}\">\
         <p class=\"note\">The views in their order, row by row; masks are outlined in green.</p>",
        object.cameras,
        png_uri(&object.sheet)
    );
    body.push_str("<div class=\"charts\">");
    let agreement = &object.agreement;
    let ious = agreement.hull_iou_by_view.iter().enumerate();
    let by_view = ious.filter_map(|(k, iou)| Some((k as f64, (*iou)?))).collect();
    let focal = agreement.focal.iter().map(|&pair| pair.into()).collect();
    for (title, x_label, series) in [
        ("Hull and mask, view by view", "view", Series::new("IoU", by_view)),
        (
            "Agreement if the focal length were another",
            "times the given one",
            Series::new("agreement", focal),
        ),
    ] {
        if series.points.len() > 1 {
            body.push_str(&Chart::new(title, x_label, vec![series]).to_svg());
        }
    }
    body.push_str("</div>");
    write_table(&Table::new("Figures", object.rows()), body);
}

impl Inspection {
    /// One sentence: the layout, how much there is, and whether anything looks wrong.
    pub fn summary(&self) -> String {
        let problems: usize = self.looked_at.iter().map(|object| object.problems.len()).sum();
        let verdict = match problems {
            0 => "nothing looks wrong".to_owned(),
            1 => "1 thing looks wrong".to_owned(),
            n => format!("{n} things look wrong"),
        };
        format!(
            "{}: {}, {}; {} looked at, {verdict}",
            self.layout,
            counted(self.objects, "object"),
            counted(self.views, "view"),
            counted(self.looked_at.len(), "object"),
        )
    }
}

impl ObjectInspection {
    /// The object's name with its category.
    pub fn title(&self) -> String {
        match self.category.as_str() {
            "" => self.name.clone(),
            category => format!("{category}/{}", self.name),
        }
    }

    /// The figures as names and values, for people.
    pub fn rows(&self) -> Vec<(&'static str, String)> {
        let sizes = |[low, high]: [usize; 2]| {
            if low == high { low.to_string() } else { format!("{low} to {high}") }
        };
        let fine = |[low, high]: [f64; 2]| {
            let digits = 4 + more_digits(high.abs());
            format!("{low:.digits$} to {high:.digits$}")
        };
        let spread = |[low, high]: [f64; 2]| {
            let narrow = high - low <= 1e-3 * high.abs();
            let digits = 4 + more_digits(high.abs());
            if narrow { format!("{low:.digits$}") } else { fine([low, high]) }
        };
        let longest = self.hull_box.map_or(1.0, |[low, high]| f64::from(longest_side((low, high))));
        let digits = 3 + more_digits(longest);
        let corner = |[x, y, z]: [f32; 3]| format!("({x:.digits$}, {y:.digits$}, {z:.digits$})");
        let [low, high] = self.coverage.map(|share| 100.0 * share);
        let found = &self.agreement;
        let rows = [
            ("views", Some(self.views.to_string())),
            ("width, height", Some(format!("{}, {}", sizes(self.width), sizes(self.height)))),
            ("object", Some(format!("{low:.1} to {high:.1} % of an image"))),
            ("colours on it", Some(format!("{} to {}", self.colors[0], self.colors[1]))),
            ("horizontal angle of view", self.fov.map(|fov| format!("{} degrees", spread(fov)))),
            ("distance", self.distance.map(spread)),
            ("elevation (+Y up)", self.elevation.map(|[a, b]| format!("{a:.1} to {b:.1} degrees"))),
            ("depth on it", self.depth.map(|depth| fine(depth.map(f64::from)))),
            ("hull's box", self.hull_box.map(|[a, b]| format!("{} to {}", corner(a), corner(b)))),
            ("true shape", (!self.truth.is_empty()).then(|| self.truth.join(", "))),
            ("hull and masks, IoU", found.hull_iou.map(|iou| format!("{iou:.4}"))),
            (
                "true points in the masks",
                found.points_inside.map(|share| format!("{:.2} %", 100.0 * share)),
            ),
            ("their boxes and the masks', IoU", found.points_box_iou.map(|v| format!("{v:.4}"))),
        ];
        rows.into_iter().filter_map(|(name, value)| Some((name, value?))).collect()
    }
}

/// Digits behind the point that a length below a hundredth has beside those of others.
fn more_digits(length: f64) -> usize {
    if length > 0.0 { (-2.0 - length.log10().floor()).clamp(0.0, 40.0) as usize } else { 0 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_worlds_have_more_digits() {
        let rows = |unit: f64| {
            let object = ObjectInspection {
                distance: Some([2.5 * unit, 3.5 * unit]),
                hull_box: Some([[0.0; 3], [0.5 * unit as f32; 3]]),
                ..ObjectInspection::default()
            };
            let rows = object.rows();
            let value = |name| rows.iter().find(|row| row.0 == name).map(|row| row.1.clone());
            [value("distance"), value("hull's box")].map(Option::unwrap_or_default)
        };
        assert_eq!(
            rows(1.0),
            ["2.5000 to 3.5000", "(0.000, 0.000, 0.000) to (0.500, 0.500, 0.500)"]
        );
        let [distance, hull] = rows(1e-5);
        assert_eq!(distance, "0.0000250 to 0.0000350");
        assert!(hull.ends_with("(0.0000050, 0.0000050, 0.0000050)"), "{hull}");
    }
}
