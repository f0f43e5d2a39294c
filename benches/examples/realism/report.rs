//! Tables as Markdown and JSON.

use std::fmt::Write;
use std::path::Path;

use crate::figures::{Row, Table};

/// Beyond this a row is marked: a quarter more or less.
const APART: f64 = 1.25;

/// Marks between which a report's tables stand.
const MARKS: [&str; 2] = ["<!-- tables -->", "<!-- end of tables -->"];

fn ratio(row: &Row) -> Option<f64> {
    (row.real.abs() > 1e-9).then(|| row.sim / row.real)
}

/// Whether the sides are more than a quarter apart.
fn apart(row: &Row) -> bool {
    ratio(row).is_none_or(|r| !(1.0 / APART..=APART).contains(&r)) && row.sim != row.real
}

fn number(v: f64) -> String {
    match v.abs() {
        a if a >= 100.0 => format!("{v:.0}"),
        a if a >= 10.0 => format!("{v:.1}"),
        a if a >= 1.0 => format!("{v:.2}"),
        _ => format!("{v:.3}"),
    }
}

pub(crate) fn markdown(tables: &[Table]) -> String {
    let mut out = String::new();
    for table in tables {
        let rows = table.rows.iter();
        let inside = table.rows.iter().filter(|r| !apart(r)).count();
        // Writing to a string cannot fail.
        let _ = writeln!(
            out,
            "\n### {}\n\n{inside} of {} rows are within a quarter; the others are in bold.\n",
            table.title,
            rows.len()
        );
        let _ = writeln!(out, "| | real | simulated | ratio |\n|---|--:|--:|--:|");
        for row in rows {
            let unit = if row.unit.is_empty() { String::new() } else { format!(" ({})", row.unit) };
            let times = ratio(row).map_or("-".to_owned(), |r| format!("{r:.2}"));
            let times = if apart(row) { format!("**{times}**") } else { times };
            let _ = writeln!(
                out,
                "| {}{unit} | {} | {} | {times} |",
                row.what,
                number(row.real),
                number(row.sim)
            );
        }
    }
    out
}

pub(crate) fn json(tables: &[Table]) -> String {
    let tables: Vec<String> = tables
        .iter()
        .map(|t| {
            let rows: Vec<String> = t
                .rows
                .iter()
                .map(|r| {
                    format!(
                        "    {{\"what\": \"{}\", \"unit\": \"{}\", \"real\": {:.4}, \"simulated\": {:.4}}}",
                        r.what, r.unit, r.real, r.sim
                    )
                })
                .collect();
            format!("  \"{}\": [\n{}\n  ]", t.name, rows.join(",\n"))
        })
        .collect();
    format!("{{\n{}\n}}\n", tables.join(",\n"))
}

/// Puts tables between the marks of a file.
pub(crate) fn insert(path: &Path, tables: &str) -> Result<(), Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string(path).map_err(|e| format!("{}: {e}", path.display()))?;
    let (Some(start), Some(end)) = (text.find(MARKS[0]), text.find(MARKS[1])) else {
        return Err(format!("{}: no '{}' and '{}'", path.display(), MARKS[0], MARKS[1]).into());
    };
    let head = &text[..start + MARKS[0].len()];
    esm_io::write_file(path, format!("{head}\n{tables}\n{}", &text[end..]).as_bytes())?;
    Ok(())
}
