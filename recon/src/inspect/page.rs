//! An inspection as a page that carries all it shows, with its images beside it.

use std::fmt::Write as _;

use mesh_core::encode_png;
use train::output::{OutputError, OutputFolder};
use train::report::{Chart, Series, Table, escape, page, png_uri, write_table};

use super::{Inspection, ObjectInspection};

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
    let counts = |counts: &[super::Count]| {
        counts
            .iter()
            .map(|c| (c.name.clone(), format!("{} objects, {} views", c.objects, c.views)))
            .collect::<Vec<_>>()
    };
    if inspection.categories.len() > 1 {
        let rows = counts(&inspection.categories);
        write_table(&Table { title: "Categories".to_owned(), rows }, &mut body);
    }
    if !inspection.subsets.is_empty() {
        let rows = counts(&inspection.subsets);
        write_table(&Table { title: "Subsets".to_owned(), rows }, &mut body);
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
    let by_view: Vec<(f64, f64)> = object
        .agreement
        .hull_iou_by_view
        .iter()
        .enumerate()
        .filter_map(|(k, iou)| Some((k as f64, (*iou)?)))
        .collect();
    for (title, x_label, name, points) in [
        ("Hull and mask, view by view", "view", "IoU", by_view),
        (
            "Agreement if the focal length were another",
            "times the given one",
            "agreement",
            object.agreement.focal.iter().map(|&[factor, score]| (factor, score)).collect(),
        ),
    ] {
        if points.len() > 1 {
            let series = vec![Series { name: name.to_owned(), points }];
            let (title, x_label) = (title.to_owned(), x_label.to_owned());
            body.push_str(&Chart { title, x_label, logarithmic: false, series }.to_svg());
        }
    }
    body.push_str("</div>");
    write_table(&Table { title: "Figures".to_owned(), rows: object.rows() }, body);
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
        let count = |n: usize, noun: &str| format!("{n} {noun}{}", if n == 1 { "" } else { "s" });
        format!(
            "{}: {}, {}; {} looked at, {verdict}",
            self.layout,
            count(self.objects, "object"),
            count(self.views, "view"),
            count(self.looked_at.len(), "object"),
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
    pub fn rows(&self) -> Vec<(String, String)> {
        let mut rows = Vec::new();
        let mut row = |name: &str, value: String| rows.push((name.to_owned(), value));
        let sizes = |[low, high]: [usize; 2]| {
            if low == high { low.to_string() } else { format!("{low} to {high}") }
        };
        row("views", self.views.to_string());
        row("width, height", format!("{}, {}", sizes(self.width), sizes(self.height)));
        let [low, high] = self.coverage.map(|share| 100.0 * share);
        row("object", format!("{low:.1} to {high:.1} % of an image"));
        row("colours on it", format!("{} to {}", self.colors[0], self.colors[1]));
        let spread = |[low, high]: [f64; 2]| {
            if high - low < 1e-3 * high.abs().max(1e-9) {
                format!("{low:.4}")
            } else {
                format!("{low:.4} to {high:.4}")
            }
        };
        if let Some(fov) = self.fov {
            row("horizontal angle of view", format!("{} degrees", spread(fov)));
        }
        if let Some(distance) = self.distance {
            row("distance", spread(distance));
        }
        if let Some([low, high]) = self.elevation {
            row("elevation", format!("{low:.1} to {high:.1} degrees"));
        }
        if let Some([low, high]) = self.depth {
            row("depth on it", format!("{low:.4} to {high:.4}"));
        }
        if let Some([low, high]) = self.hull_box {
            let corner = |p: [f32; 3]| format!("({:.3}, {:.3}, {:.3})", p[0], p[1], p[2]);
            row("hull's box", format!("{} to {}", corner(low), corner(high)));
        }
        if !self.truth.is_empty() {
            row("true shape", self.truth.join(", "));
        }
        if let Some(iou) = self.agreement.hull_iou {
            row("hull and masks, IoU", format!("{iou:.4}"));
        }
        if let Some(share) = self.agreement.points_inside {
            row("true points in the masks", format!("{:.2} %", 100.0 * share));
        }
        if let Some(iou) = self.agreement.points_box_iou {
            row("their boxes and the masks', IoU", format!("{iou:.4}"));
        }
        rows
    }
}
