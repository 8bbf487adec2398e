//! Documents in columns: tables for people, CSV and TSV for programs.

use bson::{Bson, Document};
use unicode_width::UnicodeWidthStr as _;

use crate::calendar::day_and_time;
use crate::formats::visible::cut;
use crate::formats::{shell, visible};

/// The key whose value tells kinds of documents apart.
const RELATION: &str = "relation";
/// Blanks between two columns.
const GAP: usize = 2;
/// The least width of a column that is cut.
const LEAST: usize = 6;

/// Returns tables, one for each kind of documents: of the same `relation`, or with the same keys.
/// No line is wider than `columns`.
pub(super) fn text(rows: &[Document], columns: Option<usize>) -> String {
    let kinds = kinds(rows);
    let is_titled = kinds.len() > 1;
    let tables = kinds.iter().map(|(title, rows)| {
        let title = if is_titled { format!("{title} ({})\n", rows.len()) } else { String::new() };
        title + &aligned(&keys(rows), rows, columns)
    });
    tables.collect::<Vec<_>>().join("\n")
}

/// Returns one table of rows that describe things of one sort, some with more columns than others.
/// No line is wider than `columns`.
pub(super) fn whole(rows: &[Document], columns: Option<usize>) -> String {
    let longest = rows.iter().max_by_key(|row| row.len());
    let all: Vec<&Document> = longest.into_iter().chain(rows).collect();
    aligned(&keys(&all), &all[all.len() - rows.len()..], columns)
}

/// Documents of one kind, and what the kind is called.
type Kind<'a> = (String, Vec<&'a Document>);

fn kinds(rows: &[Document]) -> Vec<Kind<'_>> {
    let mut kinds: Vec<Kind<'_>> = Vec::new();
    for row in rows {
        let title = match row.get(RELATION) {
            Some(Bson::String(relation)) => relation.clone(),
            _ => keys(&[row]).join(", "),
        };
        match kinds.iter_mut().find(|(other, _)| *other == title) {
            Some((_, rows)) => rows.push(row),
            None => kinds.push((title, vec![row])),
        }
    }
    kinds
}

/// The keys of documents, in order of first appearance.
fn keys<'a>(rows: &[&'a Document]) -> Vec<&'a str> {
    let mut keys: Vec<&str> = Vec::new();
    for key in rows.iter().flat_map(|row| row.keys()) {
        if !keys.contains(&key.as_str()) {
            keys.push(key);
        }
    }
    keys
}

/// Lines of cells below a line of keys.
fn aligned(keys: &[&str], rows: &[&Document], columns: Option<usize>) -> String {
    let mut lines: Vec<Vec<String>> = vec![keys.iter().map(|key| visible::line(key).into_owned()).collect()];
    let cell = |row: &Document, key: &str| row.get(key).map(cell).unwrap_or_default();
    lines.extend(rows.iter().map(|row| keys.iter().map(|key| cell(row, key)).collect()));
    let widest = |column: usize| lines.iter().map(|line| line[column].width()).max().unwrap_or_default();
    let mut widths: Vec<usize> = (0..keys.len()).map(widest).collect();
    if let Some(columns) = columns {
        fit(&mut widths, columns.saturating_sub(GAP * keys.len().saturating_sub(1)));
    }
    let mut text = String::new();
    for line in &lines {
        let cells = line.iter().zip(&widths).map(|(cell, width)| padded(&cut(cell, *width), *width));
        text.push_str(cells.collect::<Vec<_>>().join(&" ".repeat(GAP)).trim_end());
        text.push('\n');
    }
    text
}

/// Makes the widest columns narrower until all of them fit.
fn fit(widths: &mut [usize], available: usize) {
    while widths.iter().sum::<usize>() > available {
        let Some(widest) = widths.iter_mut().max().filter(|widest| **widest > LEAST) else { return };
        *widest -= 1;
    }
}

fn padded(text: &str, width: usize) -> String {
    format!("{text}{}", " ".repeat(width.saturating_sub(text.width())))
}

/// A value for people: texts bare, dates and ids as people write them, control characters visible.
fn cell(value: &Bson) -> String {
    match value {
        Bson::String(text) => visible::line(text).into_owned(),
        other => nested(other),
    }
}

/// A value inside another one: texts are quoted.
fn nested(value: &Bson) -> String {
    match value {
        Bson::ObjectId(id) => id.to_hex(),
        Bson::DateTime(date) => day_and_time(date.timestamp_millis()),
        Bson::Decimal128(number) => number.to_string(),
        Bson::Array(elements) => format!("[{}]", elements.iter().map(nested).collect::<Vec<_>>().join(", ")),
        Bson::Document(document) => {
            let fields: Vec<String> = document
                .iter()
                .map(|(key, value)| format!("{}: {}", visible::line(key).into_owned(), nested(value)))
                .collect();
            format!("{{{}}}", fields.join(", "))
        }
        other => visible::line(&shell::relaxed_value(other)).into_owned(),
    }
}

#[cfg(test)]
mod tests {
    use bson::doc;

    use super::*;

    #[test]
    fn documents_of_different_kinds_are_in_tables_of_their_own() {
        let rows = [
            doc! { "relation": "on", "top": "A" },
            doc! { "relation": "clear", "object": "B" },
            doc! { "relation": "on", "top": "C", "bottom": "D" },
        ];
        let expected = "on (2)\nrelation  top  bottom\non        A\non        C    D\n\nclear (1)\nrelation  object\nclear     B\n";
        assert_eq!(text(&rows, None), expected);
    }

    #[test]
    fn rows_of_one_sort_are_one_table_with_the_columns_of_the_longest_row() {
        let rows = [doc! { "field": "a", "share": 1 }, doc! { "field": "b", "least": 2, "share": 3 }];
        assert_eq!(whole(&rows, None), "field  least  share\na             1\nb      2      3\n");
    }

    #[test]
    fn a_table_is_no_wider_than_the_terminal() {
        let rows = [doc! { "_id": 1, "text": "a long text that says much, 日本語", "n": [1, 2, 3] }];
        for columns in [80, 40, 30, 24] {
            let table = text(&rows, Some(columns));
            assert!(table.lines().all(|line| line.width() <= columns), "{table}");
            assert_eq!(table.contains('…'), columns < 48, "{table}");
        }
    }

    #[test]
    fn dates_and_ids_are_shown_as_people_write_them() {
        let id = bson::oid::ObjectId::parse_str("65f000000000000000000001").unwrap();
        let date = bson::DateTime::from_millis(1_700_000_000_000);
        let table = text(&[doc! { "_id": id, "at": date, "in": { "at": [date, "x"] } }], None);
        assert_eq!(
            table.lines().nth(1),
            Some("65f000000000000000000001  2023-11-14 22:13:20  {at: [2023-11-14 22:13:20, \"x\"]}")
        );
    }
}
