//! The tables as Markdown, to be committed.

use std::fmt::Write as _;

use super::digest::Digest;
use super::table::Table;

/// The file `table.md`.
pub(super) fn markdown(digest: &Digest<'_>) -> String {
    let (study, scale) = (digest.study, digest.order.scale);
    let mut text = format!("# {}: {}\n", study.name(), study.about());
    for table in &digest.tables.0 {
        let _ = write!(text, "\n## {}\n\n", table.name);
        let caption = study.caption(&table.name, scale);
        if !caption.is_empty() {
            let _ = write!(text, "{caption}\n\n");
        }
        write_table(table, &mut text);
    }
    if digest.order.seeds.len() > 1 {
        text.push_str("\nMeans over the seeds; in brackets the spread, largest less smallest.\n");
    }
    text.push_str("\n## Claims\n\n");
    if digest.left > 0 {
        let _ = writeln!(text, "Judged when all jobs are done; {} are left.", digest.left);
    }
    for claim in digest.claims {
        let verdict = if claim.holds { "holds" } else { "**does not hold**" };
        let _ = writeln!(text, "- {verdict}: {} ({})", claim.text, claim.found);
    }
    text.push_str("\n## How it was made\n\n");
    for (name, fact) in digest.facts() {
        let fact = if name == "command" { format!("`{fact}`") } else { fact };
        let _ = writeln!(text, "- {name}: {fact}");
    }
    text
}

fn write_table(table: &Table, text: &mut String) {
    let escaped = |text: &str| text.replace('|', "\\|");
    text.push_str("| |");
    for column in &table.columns {
        let _ = write!(text, " {} |", escaped(&column.heading()));
    }
    text.push_str(" time |\n|---|");
    text.push_str(&"---:|".repeat(table.columns.len() + 1));
    text.push('\n');
    for row in &table.rows {
        let _ = write!(text, "| {} |", escaped(&row.label));
        for column in 0..table.columns.len() {
            let (mean, spread) = table.cell(row, column);
            let mean = if table.is_best(row, column) { format!("**{mean}**") } else { mean };
            let _ = write!(text, " {mean}{spread} |");
        }
        let _ = writeln!(text, " {} |", row.time());
    }
}
