//! The tables as one HTML page with their images.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use train::report::{self, escape};

use super::digest::Digest;
use super::table::Table;

/// The file `report.html`.
pub(super) fn page(digest: &Digest<'_>) -> String {
    let (study, scale) = (digest.study, digest.order.scale);
    let title = format!("{}, reproduced", study.name());
    let mut body =
        format!("<h1>{}</h1><p class=\"lead\">{}</p>", escape(&title), escape(study.about()));
    if digest.left > 0 {
        let _ = write!(
            body,
            "<p class=\"warn\">Not finished: {} jobs are left. The same command goes on.</p>",
            digest.left
        );
    }
    write_claims(digest, &mut body);
    for table in &digest.tables.0 {
        let _ = write!(body, "<h2>{}</h2>", escape(&table.name));
        let caption = study.caption(&table.name, scale);
        if !caption.is_empty() {
            let _ = write!(body, "<p class=\"note\">{}</p>", escape(&caption));
        }
        write_table(table, &mut body);
        write_pictures(digest, &table.name, &mut body);
    }
    if digest.order.seeds.len() > 1 {
        body.push_str(
            "<p class=\"note\">Means over the seeds; in brackets the spread, largest less smallest. \
             Images are of the first seed.</p>",
        );
    }
    let facts = digest.facts().into_iter();
    let (command, rest): (Vec<_>, Vec<_>) = facts.partition(|(name, _)| *name == "command");
    report::write_table(&report::Table::new("How it was made", rest), &mut body);
    for (_, command) in command {
        let _ = write!(body, "<pre>{}</pre>", escape(&command));
    }
    report::page(&title, &body)
}

fn write_claims(digest: &Digest<'_>, body: &mut String) {
    if digest.claims.is_empty() {
        return;
    }
    body.push_str("<table class=\"grid claims\">");
    for claim in digest.claims {
        let (class, verdict) =
            if claim.holds { ("holds", "holds") } else { ("fails", "does not hold") };
        let _ = write!(
            body,
            "<tr class=\"{class}\"><th>{verdict}</th><td>{}</td><td>{}</td></tr>",
            escape(&claim.text),
            escape(&claim.found)
        );
    }
    body.push_str("</table>");
}

fn write_table(table: &Table, body: &mut String) {
    body.push_str("<div class=\"wide\"><table class=\"grid\"><tr><th></th>");
    for column in &table.columns {
        let _ = write!(body, "<th>{}</th>", escape(&column.heading()));
    }
    body.push_str("<th>time</th></tr>");
    for row in &table.rows {
        let _ = write!(body, "<tr><th>{}</th>", escape(&row.label));
        for column in 0..table.columns.len() {
            let (mean, spread) = table.cell(row, column);
            let mean = if table.is_best(row, column) { format!("<b>{mean}</b>") } else { mean };
            let _ = write!(body, "<td>{mean}<small>{spread}</small></td>");
        }
        let _ = write!(body, "<td>{}</td></tr>", row.time());
    }
    body.push_str("</table></div>");
}

/// The images of each row, of the first seed that has it.
fn write_pictures(digest: &Digest<'_>, table: &str, body: &mut String) {
    let first = digest.order.seeds.first();
    let kept = digest.kept.iter().filter(|kept| Some(&kept.seed) == first);
    for row in kept.flat_map(|kept| &kept.rows).filter(|row| row.table == table) {
        for picture in &row.pictures {
            let Some(png) = digest.store.picture(picture) else { continue };
            let caption = match picture.caption.as_str() {
                text if text.ends_with('.') => text.to_owned(),
                text if text == row.label => format!("{text}: the model above the truth"),
                text => format!("{}, {text}: the model above the truth", row.label),
            };
            let _ = write!(
                body,
                "<figure class=\"sheet\"><img alt=\"{caption}\" src=\"data:image/png;base64,{png}\">\
                 <figcaption>{caption}</figcaption></figure>",
                png = BASE64.encode(png),
                caption = escape(&caption)
            );
        }
    }
}
