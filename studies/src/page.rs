//! The tables as one HTML page with their intervals, curves and images.

use std::fmt::Write as _;

use base64::Engine as _;
use base64::engine::general_purpose::STANDARD as BASE64;
use train::report::{self, escape};

use crate::charts::charts;
use crate::markdown::{CELLS, RULE};
use crate::pages::Pages;
use crate::results::RowRecord;
use crate::row::ImageKind;
use crate::store::KeptImage;
use crate::strip::strip;
use crate::table::Table;
use crate::verdict::Verdict;

/// The file `report.html`.
pub(crate) fn page(pages: &Pages<'_>) -> String {
    let (study, results) = (pages.study, pages.results);
    let title = format!("{}, reproduced", study.name());
    let mut body =
        format!("<h1>{}</h1><p class=\"lead\">{}</p>", escape(&title), escape(study.about()));
    if results.left > 0 {
        let _ = write!(
            body,
            "<p class=\"warn\">Not finished: {} jobs are left. The same command goes on, or the other shares are to be merged.</p>",
            results.left
        );
    }
    write_claims(pages, &mut body);
    for table in &pages.tables.0 {
        let _ = write!(body, "<h2>{}</h2>", escape(&table.name));
        let caption = study.caption(&table.name, results.scale);
        if !caption.is_empty() {
            let _ = write!(body, "<p class=\"note\">{}</p>", escape(&caption));
        }
        write_table(table, &mut body);
        write_images(pages, &table.name, &mut body);
    }
    let _ = write!(
        body,
        "<p class=\"note\">{CELLS} Below it a dot a seed, on a line from the least to the largest value of the column. Images and \
         curves are of the first seed.</p>"
    );
    write_charts(pages, &mut body);
    let facts = pages.facts().into_iter();
    let (command, rest): (Vec<_>, Vec<_>) = facts.partition(|(name, _)| *name == "command");
    report::write_table(&report::Table::new("How it was made", rest), &mut body);
    for (_, command) in command {
        let _ = write!(body, "<pre>{}</pre>", escape(&command));
    }
    report::page(&title, &body)
}

fn write_claims(pages: &Pages<'_>, body: &mut String) {
    let claims = pages.claims.iter().map(|claim| {
        let class = match claim.verdict {
            Verdict::Holds => "holds",
            Verdict::Undecided => "open",
            Verdict::Reversed => "fails",
        };
        let margins = claim.margins.iter().map(|why| format!(" Margin: {why}."));
        let text = claim.text.clone() + "." + &margins.collect::<String>();
        (class, claim.verdict.to_string(), text, claim.found())
    });
    let checks = pages.checks.iter().map(|check| {
        let (class, verdict) = if check.passed { ("holds", "passed") } else { ("fails", "failed") };
        (class, verdict.to_owned(), check.text.clone(), check.found.clone())
    });
    let mut rows = String::new();
    for (class, verdict, text, found) in claims.chain(checks) {
        let (text, found) = (escape(&text), escape(&found));
        let _ = write!(
            rows,
            "<tr class=\"{class}\"><th>{verdict}</th><td>{text}</td><td>{found}</td></tr>"
        );
    }
    if !rows.is_empty() {
        let _ = write!(body, "<table class=\"grid claims\">{rows}</table>");
    }
    if !pages.claims.is_empty() {
        let _ = write!(body, "<p class=\"note\">{RULE}</p>");
    }
}

fn write_table(table: &Table, body: &mut String) {
    body.push_str("<div class=\"wide\"><table class=\"grid\"><tr><th></th>");
    for column in &table.columns {
        let _ = write!(body, "<th>{}</th>", escape(&column.heading()));
    }
    body.push_str("<th>time</th></tr>");
    for row in &table.rows {
        let _ = write!(body, "<tr><th>{}</th>", escape(&table.label(row)));
        for column in 0..table.columns.len() {
            let cell = table.cell(row, column);
            let mean = if table.is_best(row, column) {
                format!("<b>{}</b>", cell.mean)
            } else {
                cell.mean
            };
            let _ = write!(
                body,
                "<td>{mean}<small>{}{}</small>{}</td>",
                cell.interval,
                cell.each,
                strip(table, row, column)
            );
        }
        let _ = write!(body, "<td>{}</td></tr>", row.time());
    }
    body.push_str("</table></div>");
}

/// The images of each row, of the first seed that has it; the true objects above the predicted ones of all rows.
fn write_images(pages: &Pages<'_>, table: &str, body: &mut String) {
    let first = pages.results.rows.iter().map(|row| row.seed).min();
    let rows: Vec<&RowRecord> = pages
        .results
        .rows
        .iter()
        .filter(|row| row.table == table && Some(row.seed) == first)
        .collect();
    let of = |kind: ImageKind| {
        let all = rows.iter().flat_map(|row| row.pictures.iter().map(move |p| (*row, p)));
        all.filter(move |(_, image)| image.kind == kind)
    };
    if let Some((_, truth)) = of(ImageKind::Truth).next() {
        let caption =
            format!("Objects of the test, drawn by the seed, from three sides: {}.", truth.caption);
        write_image(pages, truth, &caption, body);
    }
    for (row, image) in of(ImageKind::Predicted) {
        write_image(pages, image, &format!("{}: the same objects", row.label), body);
    }
    for (row, image) in of(ImageKind::Sheet) {
        let caption = match image.caption.as_str() {
            text if text.ends_with('.') => text.to_owned(),
            text if text == row.label => format!("{text}: the model above the truth"),
            "" => format!("{}: the model above the truth", row.label),
            text => format!("{}, {text}: the model above the truth", row.label),
        };
        write_image(pages, image, &caption, body);
    }
}

/// Nothing where the file is not there: results are committed without their images.
fn write_image(pages: &Pages<'_>, image: &KeptImage, caption: &str, body: &mut String) {
    let Ok(png) = std::fs::read(pages.root.join(&image.file)) else { return };
    let _ = write!(
        body,
        "<figure class=\"sheet\"><img alt=\"{caption}\" src=\"data:image/png;base64,{png}\">\
         <figcaption>{caption}</figcaption></figure>",
        png = BASE64.encode(png),
        caption = escape(caption)
    );
}

fn write_charts(pages: &Pages<'_>, body: &mut String) {
    let charts = charts(pages.results);
    if charts.is_empty() {
        return;
    }
    body.push_str("<h2>The course of the trainings</h2><div class=\"charts\">");
    for chart in charts {
        body.push_str(&chart.to_svg());
    }
    body.push_str("</div>");
}
