//! The tables as Markdown, to be committed.

use std::fmt::Write as _;

use crate::pages::Pages;
use crate::table::Table;
use crate::verdict::{Judged, Verdict};

/// What the cells say, where something needs to be said.
pub(crate) const CELLS: &str = "A cell is the mean over the seeds; in square brackets the 95 % interval of the mean, where there are values by object; \
                                in round brackets the values of the seeds. The best mean of rows with as many seeds as any is bold, whatever chance has to do with it: what is \
                                more than chance stands under Claims.";
/// How claims are judged.
pub(crate) const RULE: &str = "Rows are paired object by object within each seed; a claim holds if the 95 % interval of the mean difference, or of \
                               the ratio of the mean errors, lies wholly on its side, is reversed if it lies wholly on the other, and is else \
                               undecided (bootstrap over seeds and objects, no narrower than Student's interval of the seeds).";

/// The file `table.md`.
pub(crate) fn markdown(pages: &Pages<'_>) -> String {
    let (study, results) = (pages.study, pages.results);
    let mut text = format!("# {}: {}\n", study.name(), study.about());
    for table in &pages.tables.0 {
        let _ = write!(text, "\n## {}\n\n", table.name);
        let caption = study.caption(&table.name, results.scale);
        if !caption.is_empty() {
            let _ = write!(text, "{caption}\n\n");
        }
        write_table(table, &mut text);
    }
    let _ = write!(text, "\n{CELLS}\n");
    if results.left > 0 {
        let _ = write!(text, "\nJudged when all jobs are done; {} are left.\n", results.left);
    }
    if !pages.claims.is_empty() {
        let _ = write!(text, "\n## Claims\n\n{RULE}\n\n");
    }
    for judged in &pages.claims {
        write_claim(judged, &mut text);
    }
    if !pages.checks.is_empty() {
        text.push_str("\n## Floors\n\n");
    }
    for check in &pages.checks {
        let passed = if check.passed { "passed" } else { "**failed**" };
        let _ = writeln!(text, "- {passed}: {} ({})", check.text, check.found);
    }
    text.push_str("\n## How it was made\n\n");
    for (name, fact) in pages.facts() {
        let fact = if name == "command" { format!("`{fact}`") } else { fact };
        let _ = writeln!(text, "- {name}: {fact}");
    }
    text
}

fn write_claim(judged: &Judged, text: &mut String) {
    let verdict = match judged.verdict {
        Verdict::Holds => "holds",
        Verdict::Reversed => "**reversed**",
        Verdict::Undecided => "**undecided**",
    };
    let _ = write!(text, "- {verdict}: {} ({})", judged.text, judged.found());
    if !judged.margins.is_empty() {
        let _ = write!(text, "; margin: {}", judged.margins.join("; "));
    }
    text.push('\n');
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
        let _ = write!(text, "| {} |", escaped(&table.label(row)));
        for column in 0..table.columns.len() {
            let cell = table.cell(row, column);
            let mean =
                if table.is_best(row, column) { format!("**{}**", cell.mean) } else { cell.mean };
            let _ = write!(text, " {mean}{}{} |", cell.interval, cell.each);
        }
        let _ = writeln!(text, " {} |", row.time());
    }
}
