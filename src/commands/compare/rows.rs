//! The rows of a comparison, printed as they come where the format has lines.

use bson::{Bson, Document, doc};

use crate::commands::{Context, separated};
use crate::error::Result;
use crate::formats::shell;
use crate::output::Format;
use crate::planning::comparison::Measurement;

/// What is printed of a comparison.
pub(super) struct Rows {
    format: Format,
    /// Whether only scores are printed.
    is_scores: bool,
    /// How many runs are printed already.
    printed: usize,
}

impl Rows {
    pub(super) fn new(format: Format, is_scores: bool) -> Self {
        Self { format, is_scores, printed: 0 }
    }

    /// Prints the runs that are not printed yet. As long as planners still run on a task, a word that it has no plan waits,
    /// as a plan may refute it.
    pub(super) fn print(
        &mut self,
        measured: &[Measurement],
        is_settled: bool,
        context: &mut Context<'_>,
    ) -> Result<()> {
        if self.is_scores || !matches!(self.format, Format::Jsonl | Format::Csv | Format::Tsv) {
            return Ok(());
        }
        while let Some(row) = measured.get(self.printed).filter(|row| is_settled || !row.is_unsolvable()) {
            self.line(&row.listed(), context)?;
            self.printed += 1;
        }
        Ok(context.output.flush()?)
    }

    /// Prints a run; of values with separators, the keys above the first one.
    fn line(&self, row: &Document, context: &mut Context<'_>) -> Result<()> {
        let delimiter = match self.format {
            Format::Csv => ',',
            Format::Tsv => '\t',
            _ => return Ok(context.output.line(&shell::relaxed(row))?),
        };
        let mut text = Vec::new();
        separated::write(std::iter::once(Ok(row.clone())), delimiter, &context.temporary(), &mut text)?;
        let text = String::from_utf8_lossy(&text);
        let text = if self.printed == 0 { &text } else { text.split_once('\n').map_or("", |(_, row)| row) };
        Ok(context.output.line(text.trim_end_matches(['\r', '\n']))?)
    }

    /// Prints what comes after the last run: the scores, and the runs of formats that have no lines.
    pub(super) fn end(&self, measured: &[Measurement], scores: Vec<Document>, context: &mut Context<'_>) -> Result<()> {
        let runs = || measured.iter().map(Measurement::listed).collect::<Vec<_>>();
        let printed = match (self.format, self.is_scores) {
            (Format::Json, false) => {
                let whole = doc! { "runs": runs(), "scores": scores };
                return Ok(context.output.line(&shell::pretty(&Bson::Document(whole)))?);
            }
            (Format::Csv | Format::Tsv, false) => return Ok(()),
            (_, true) | (Format::Jsonl, false) => scores,
            (_, false) => [runs(), scores].concat(),
        };
        context.print_documents(printed.into_iter().map(Ok)).map(drop)
    }
}
