//! The report of a reconstruction: one HTML page that carries everything it shows.
//!
//! The page holds the mesh in a small WebGL viewer, above the image for chosen views,
//! charts, figures and the command that made it. It loads nothing, so it can be mailed or archived.

mod chart;
mod scene;
mod sheet;

pub use chart::{Chart, Series};
pub use mesh_core::counted;
pub use scene::Scene;
pub use sheet::sheet;

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use mesh_core::{ByteImage, encode_png};

const STYLE: &str = include_str!("page.css");
const VIEWER: &str = include_str!("viewer.js");

/// What a report shows, top to bottom.
#[derive(Clone, Debug, Default)]
pub struct Report {
    /// The heading.
    pub title: String,
    /// One or two sentences under the heading.
    pub summary: String,
    /// The command that made all this, as it was typed.
    pub command: String,
    /// What the viewer shows, in the user's coordinates.
    pub scene: Scene,
    /// The numbers that matter most.
    pub figures: Vec<Figure>,
    /// Things that the reader should know before trusting the figures.
    pub warnings: Vec<String>,
    /// The mesh above the image, view by view.
    pub views: Vec<ViewPair>,
    /// Curves over the course of the run.
    pub charts: Vec<Chart>,
    /// Everything else.
    pub tables: Vec<Table>,
    /// An animated GIF, shown where WebGL is missing.
    pub turntable: Option<Vec<u8>>,
}

/// A number worth a card of its own.
#[derive(Clone, Debug, PartialEq)]
pub struct Figure {
    /// The value as it is to be read, with its unit.
    pub value: String,
    /// What it measures.
    pub label: String,
}

/// One view: what the model looks like from there and what the photograph shows.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewPair {
    /// The caption, for example the view's name and its scores.
    pub caption: String,
    /// The render.
    pub model: ByteImage,
    /// The photograph, of the same size.
    pub truth: ByteImage,
}

/// A table of two columns.
#[derive(Clone, Debug, PartialEq)]
pub struct Table {
    /// The heading.
    pub title: String,
    /// Names and values.
    pub rows: Vec<(String, String)>,
}

impl Figure {
    /// A value under what it measures.
    pub fn new(label: impl Into<String>, value: impl Into<String>) -> Self {
        Self { value: value.into(), label: label.into() }
    }
}

impl Table {
    /// Names and values under a heading.
    pub fn new<N: Into<String>>(
        title: impl Into<String>,
        rows: impl IntoIterator<Item = (N, String)>,
    ) -> Self {
        let rows = rows.into_iter().map(|(name, value)| (name.into(), value)).collect();
        Self { title: title.into(), rows }
    }
}

impl Report {
    /// The page.
    ///
    /// Its size is that of the scene (about 60 bytes a vertex in all) and the PNGs; images should be
    /// at most a few hundred pixels wide. All texts are escaped.
    pub fn to_html(&self) -> String {
        let (title, summary) = (escape(&self.title), escape(&self.summary));
        let mut page = String::with_capacity(1 << 20);
        let _ =
            write!(page, "{}<h1>{title}</h1><p class=\"lead\">{summary}</p>", head(&self.title));
        for warning in &self.warnings {
            let _ = write!(page, "<p class=\"warn\">{}</p>", escape(warning));
        }
        page.push_str("<div class=\"top\"><div>");
        self.write_viewer(&mut page);
        page.push_str("</div><div>");
        self.write_figures(&mut page);
        let _ = write!(page, "<pre>{}</pre>", escape(&self.command));
        page.push_str("</div></div>");
        self.write_views(&mut page);
        self.write_charts(&mut page);
        for table in &self.tables {
            write_table(table, &mut page);
        }
        let _ = write!(
            page,
            "</main>\n<script type=\"application/json\" id=\"scene\">{}</script>\n<script>\n{VIEWER}</script></body></html>\n",
            self.scene.to_json()
        );
        page
    }

    fn write_viewer(&self, page: &mut String) {
        page.push_str(
            "<canvas id=\"viewer\" tabindex=\"0\" aria-label=\"The mesh; drag or use the arrow keys to turn it\"></canvas>",
        );
        if let Some(gif) = &self.turntable {
            let _ = write!(
                page,
                "<img id=\"still\" hidden alt=\"The mesh turning\" src=\"data:image/gif;base64,{}\">",
                BASE64.encode(gif)
            );
        }
        // What has no colours is a flat blob without light.
        let colored = self.scene.colors.is_some() || self.scene.texture.is_some();
        let colors = "<option value=\"0\">colours as they are</option>\
                      <option value=\"1\">colours, lit</option>";
        let _ = write!(
            page,
            "<div class=\"controls\"><label>show <select id=\"shading\" autocomplete=\"off\">{}\
             <option value=\"2\">shape</option><option value=\"3\">normals</option></select></label>\
             <label><input type=\"checkbox\" id=\"wires\"> edges</label>\
             <label><input type=\"checkbox\" id=\"spin\"> turn</label>\
             <span id=\"viewer-note\">Drag to turn, scroll to zoom.</span></div>",
            if colored { colors } else { "" }
        );
    }

    fn write_figures(&self, page: &mut String) {
        page.push_str("<div class=\"cards\">");
        for figure in &self.figures {
            let _ = write!(
                page,
                "<div class=\"card\"><b>{}</b><span>{}</span></div>",
                escape(&figure.value),
                escape(&figure.label)
            );
        }
        page.push_str("</div>");
    }

    fn write_views(&self, page: &mut String) {
        if self.views.is_empty() {
            return;
        }
        page.push_str("<h2>Mesh above image</h2><div class=\"views\">");
        for view in &self.views {
            let _ = write!(
                page,
                "<figure><img alt=\"mesh, {caption}\" src=\"{}\"><img alt=\"image, {caption}\" src=\"{}\">\
                 <figcaption>{caption}</figcaption></figure>",
                png_uri(&view.model),
                png_uri(&view.truth),
                caption = escape(&view.caption)
            );
        }
        page.push_str("</div>");
    }

    fn write_charts(&self, page: &mut String) {
        if self.charts.is_empty() {
            return;
        }
        page.push_str("<h2>The course of the run</h2><div class=\"charts\">");
        for chart in &self.charts {
            page.push_str(&chart.to_svg());
        }
        page.push_str("</div>");
    }
}

/// A whole page in the reports' style: only what is handed in, nothing from outside.
pub fn page(title: &str, body: &str) -> String {
    format!("{}{body}</main></body></html>\n", head(title))
}

/// A page as far as its first heading.
fn head(title: &str) -> String {
    format!(
        "<!doctype html>\n<html lang=\"en\"><head><meta charset=\"utf-8\">\
         <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\
         <link rel=\"icon\" href=\"data:,\"><title>{}</title>\n<style>\n{STYLE}</style></head>\n<body><main>",
        escape(title)
    )
}

/// Appends a table of two columns to a page.
pub fn write_table(table: &Table, page: &mut String) {
    let _ = write!(page, "<h2>{}</h2><table>", escape(&table.title));
    for (name, value) in &table.rows {
        let _ = write!(page, "<tr><th>{}</th><td>{}</td></tr>", escape(name), escape(value));
    }
    page.push_str("</table>");
}

/// An image as it stands in a page: a PNG in base64.
pub fn png_uri(image: &ByteImage) -> String {
    format!("data:image/png;base64,{}", BASE64.encode(encode_png(image)))
}

/// A text as it may stand in HTML, between tags or in a quoted attribute.
pub fn escape(text: &str) -> String {
    let mut out = String::with_capacity(text.len());
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c => out.push(c),
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_cannot_leave_their_place() {
        let report = Report {
            title: "</title><script>alert(1)</script>".into(),
            command: "unsphere fit \"<a b>\"".into(),
            scene: Scene { positions: "AAAA".into(), ..Scene::default() },
            ..Report::default()
        };
        let page = report.to_html();
        assert!(!page.contains("<script>alert"));
        assert!(page.contains("unsphere fit &quot;&lt;a b&gt;&quot;"));
    }

    #[test]
    fn what_has_no_colors_is_shown_by_its_shape() {
        let first = |scene: Scene| {
            let page = Report { scene, ..Report::default() }.to_html();
            let options = page.split("<select id=\"shading\"").nth(1).unwrap_or_default();
            options.split("<option value=\"").nth(1).unwrap_or_default().chars().next()
        };
        assert_eq!(first(Scene::default()), Some('2'));
        let colors = Some("AAAA".to_owned());
        assert_eq!(first(Scene { colors, ..Scene::default() }), Some('0'));
    }

    #[test]
    fn the_page_asks_for_nothing_from_outside() {
        let scene = Scene { positions: "AAAA".into(), ..Scene::default() };
        let report = Report { scene, ..Report::default() };
        let page = report.to_html();
        assert!(!page.contains("http://") && !page.contains("https://"));
    }
}
