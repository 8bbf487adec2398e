//! The browser on a terminal.

use bson::Document;
use ratatui::Frame;
use ratatui::layout::{Constraint, Layout, Margin, Rect};
use ratatui::style::{Modifier, Style};
use ratatui::text::Line;
use ratatui::widgets::{Block, Cell, List, ListItem, ListState, Paragraph, Row, Table, TableState};

use super::state::{Browser, Documents, Screen};
use crate::formats::visible::cut;
use crate::views::field::text;

/// The most columns of documents.
const COLUMNS: usize = 6;

/// Draws what is seen.
pub fn draw(browser: &Browser<'_>, frame: &mut Frame<'_>) {
    let [main, last] = Layout::vertical([Constraint::Min(1), Constraint::Length(1)]).areas(frame.area());
    match browser.screens.last() {
        Some(Screen::Collections { names, selected }) => {
            let lines =
                names.iter().map(|(name, count)| ListItem::new(format!("{:<40} {count:>10}", name.to_string())));
            let list =
                List::new(lines).block(Block::bordered().title(" collections ")).highlight_style(selected_style());
            frame.render_stateful_widget(list, main, &mut ListState::default().with_selected(Some(*selected)));
        }
        Some(Screen::Documents(documents)) => table(documents, frame, main),
        Some(Screen::Text { title, lines, top }) => {
            let shown: Vec<Line<'_>> = lines.iter().skip(*top).map(|line| Line::raw(line.as_str())).collect();
            frame.render_widget(Paragraph::new(shown).block(Block::bordered().title(format!(" {title} "))), main);
        }
        None => {}
    }
    frame.render_widget(Paragraph::new(last_line(browser, last.width)), last);
}

fn selected_style() -> Style {
    Style::new().add_modifier(Modifier::REVERSED)
}

fn table(documents: &Documents<'_>, frame: &mut Frame<'_>, area: Rect) {
    let columns = columns(&documents.rows);
    let widths: Vec<Constraint> = columns.iter().map(|key| Constraint::Fill(weight(key, &documents.rows))).collect();
    // As the table lays them out, within its border and with a blank between them.
    let places = Layout::horizontal(widths.clone()).spacing(1).split(area.inner(Margin::new(1, 1)));
    let cell = |document: &Document, key: &str, place: &Rect| {
        Cell::new(document.get(key).map(|value| cut(&visible(value), place.width.into())).unwrap_or_default())
    };
    let row = |document| Row::new(columns.iter().zip(&*places).map(|(key, place)| cell(document, key, place)));
    let rows = documents.rows.iter().map(row);
    let noun = if documents.total == 1 { "document" } else { "documents" };
    let mut title = format!(" {}: {} {noun}", documents.namespace, documents.total);
    for (word, given) in [("", &documents.filter), ("sorted by ", &documents.sort)] {
        if !given.is_empty() {
            title.push_str(&format!(", {word}{given}"));
        }
    }
    let table = Table::new(rows, widths)
        .header(Row::new(columns.iter().map(|key| Cell::new(*key))).style(Style::new().add_modifier(Modifier::BOLD)))
        .row_highlight_style(selected_style())
        .block(Block::bordered().title(title + " "));
    frame.render_stateful_widget(table, area, &mut TableState::default().with_selected(Some(documents.selected)));
}

/// The keys that the most of the first documents have.
fn columns(rows: &[Document]) -> Vec<&str> {
    let mut counts: Vec<(&str, usize)> = Vec::new();
    for key in rows.iter().take(100).flat_map(Document::keys) {
        match counts.iter_mut().find(|(other, _)| other == key) {
            Some((_, count)) => *count += 1,
            None => counts.push((key, 1)),
        }
    }
    counts.sort_by_key(|(_, count)| std::cmp::Reverse(*count));
    counts.into_iter().take(COLUMNS).map(|(key, _)| key).collect()
}

/// How wide a column is wanted, between 4 and 40.
fn weight(key: &str, rows: &[Document]) -> u16 {
    let widths = rows.iter().take(100).filter_map(|row| row.get(key)).map(|value| visible(value).chars().count());
    let widest = widths.max().unwrap_or_default().max(key.chars().count()).clamp(4, 40);
    u16::try_from(widest).unwrap_or(40)
}

/// A value without what a terminal would obey.
fn visible(value: &bson::Bson) -> String {
    text(value).chars().map(|c| if c.is_control() { '·' } else { c }).collect()
}

/// The help on keys in the last line, longest first: the first that fits is shown.
const KEYS: [&str; 4] = [
    "arrows move  Enter opens  Esc back  / query  s sort  e explain  p plan  c computables  r again  q quit",
    "Enter opens  Esc back  / query  s sort  e explain  p plan  c computables  q quit",
    "Esc back  / query  s sort  e explain  q quit",
    "q quit",
];

fn last_line(browser: &Browser<'_>, width: u16) -> String {
    match &browser.prompt {
        Some(prompt) if browser.message.is_empty() => format!("{}: {}", prompt.title, prompt.text),
        Some(prompt) => format!("{} — {}", prompt.text, browser.message),
        None if !browser.message.is_empty() => browser.message.clone(),
        None => {
            let fitting = KEYS.iter().find(|keys| keys.len() <= usize::from(width));
            (*fitting.unwrap_or(&KEYS[KEYS.len() - 1])).to_owned()
        }
    }
}
