//! Printing results in the format in force.

use std::io::Write;

use bson::{Bson, Document};

use super::{Context, UsageError, formats, separated, table};
use crate::error::Result;
use crate::formats::shell;
use crate::output::Format;
use crate::settings::Origin;

impl Context<'_> {
    /// Returns the format in force: that of the settings, else a table on a terminal, else the first of `allowed`.
    ///
    /// # Errors
    /// Where `--format` names one that this command does not have.
    pub fn format(&self, allowed: &[Format]) -> Result<Format, UsageError> {
        let table = self.terminal && allowed.contains(&Format::Table);
        let default = if table { Format::Table } else { allowed[0] };
        let Some(format) = self.settings.format.value else { return Ok(default) };
        if allowed.contains(&format) {
            return Ok(format);
        }
        if !matches!(self.settings.format.origin, Origin::Flag(_)) {
            // A format of the environment or of rmem.toml is for the commands that have it.
            return Ok(default);
        }
        let names: Vec<_> = allowed.iter().map(|format| format.name()).collect();
        Err(UsageError::new(format!("this command has no format `{}`; it has {}", format.name(), names.join(", "))))
    }

    /// Prints documents as they come; returns how many.
    ///
    /// # Errors
    /// Where a document cannot be had or stdout fails.
    pub fn print_documents(&mut self, documents: impl Iterator<Item = Result<Document>>) -> Result<u64> {
        self.print_as(table::text, documents)
    }

    /// Prints rows that a command makes itself, as documents; in a table they are one.
    ///
    /// # Errors
    /// Where a row cannot be had or stdout fails.
    pub fn print_rows(&mut self, rows: impl Iterator<Item = Result<Document>>) -> Result<u64> {
        self.print_as(table::whole, rows)
    }

    fn print_as(&mut self, table: Table, documents: impl Iterator<Item = Result<Document>>) -> Result<u64> {
        let format = self.format(&formats::DOCUMENTS)?;
        let (columns, temporary) = (self.columns, self.temporary());
        let stdout = self.output.stdout();
        match format {
            Format::Table => return print_table(table, documents, columns, stdout),
            // The keys of all documents are in the first line.
            Format::Csv | Format::Tsv => {
                let delimiter = if format == Format::Csv { ',' } else { '\t' };
                return separated::write(documents, delimiter, &temporary, stdout);
            }
            _ => {}
        }
        write_values(documents.map(|document| Ok(document?.into())), format, stdout)
    }

    /// Prints values as they come, one a line or as one array; returns how many.
    ///
    /// # Errors
    /// Where a value cannot be had or stdout fails.
    pub fn print_values(&mut self, values: impl Iterator<Item = Result<Bson>>) -> Result<u64> {
        let format = self.format(&formats::VALUES)?;
        write_values(values, format, self.output.stdout())
    }

    /// Prints a single document as [`Context::print_documents`] does, but as JSON without an array around it.
    ///
    /// # Errors
    /// Where stdout fails.
    pub fn print_document(&mut self, document: Document) -> Result<()> {
        if self.format(&formats::DOCUMENTS)? == Format::Json {
            return Ok(self.output.line(&shell::pretty(&document.into()))?);
        }
        self.print_documents([Ok(document)].into_iter()).map(drop)
    }

    /// Prints the one document that is the result of a command.
    ///
    /// # Errors
    /// Where stdout fails.
    pub fn print_result(&mut self, result: Document) -> Result<()> {
        match self.format(&formats::RESULT)? {
            Format::Json => self.output.line(&shell::pretty(&result.into()))?,
            _ => self.output.line(&shell::relaxed(&result))?,
        }
        Ok(())
    }

    /// Prints lines for people, or a document that says the same.
    ///
    /// # Errors
    /// Where stdout fails.
    pub fn print_report(&mut self, lines: impl IntoIterator<Item = String>, report: Document) -> Result<()> {
        if self.format(&formats::TEXT)? == Format::Json {
            return Ok(self.output.line(&shell::pretty(&report.into()))?);
        }
        Ok(lines.into_iter().try_for_each(|line| self.output.line(&line))?)
    }

    /// Prints lines for people, or what they say as one array.
    ///
    /// # Errors
    /// Where stdout fails.
    pub fn print_lines(&mut self, lines: impl IntoIterator<Item = (String, Bson)>) -> Result<()> {
        if self.format(&formats::TEXT)? == Format::Json {
            let values = lines.into_iter().map(|(_, value)| value).collect();
            return Ok(self.output.line(&shell::pretty(&Bson::Array(values)))?);
        }
        Ok(lines.into_iter().try_for_each(|(line, _)| self.output.line(&line))?)
    }
}

/// The most documents in one table. More are printed in several, each with its own heading, so that
/// memory stays bounded.
const TABLE_ROWS: usize = 1_000;

/// How documents become the text of tables.
type Table = fn(&[Document], Option<usize>) -> String;

fn print_table(
    table: Table,
    documents: impl Iterator<Item = Result<Document>>,
    columns: Option<usize>,
    out: &mut dyn Write,
) -> Result<u64> {
    let (mut rows, mut count) = (Vec::new(), 0);
    let mut print = |rows: &mut Vec<Document>, count: u64| {
        let gap = if count as usize > rows.len() { "\n" } else { "" };
        write!(out, "{gap}{}", table(&std::mem::take(rows), columns))
    };
    for document in documents {
        rows.push(document?);
        count += 1;
        if rows.len() == TABLE_ROWS {
            print(&mut rows, count)?;
        }
    }
    if !rows.is_empty() {
        print(&mut rows, count)?;
    }
    Ok(count)
}

/// Writes values as they come, one a line or as one array; returns how many.
fn write_values(values: impl Iterator<Item = Result<Bson>>, format: Format, out: &mut dyn Write) -> Result<u64> {
    let mut count = 0;
    for value in values {
        if format == Format::Json && count > 0 {
            // What follows an error begins a line, too.
            writeln!(out, "{}", if value.is_ok() { "," } else { "" })?;
        }
        let value = value?;
        match format {
            Format::Json if count == 0 => write!(out, "[\n{}", shell::pretty(&value))?,
            Format::Json => write!(out, "{}", shell::pretty(&value))?,
            Format::Canonical => writeln!(out, "{}", shell::canonical_value(&value))?,
            _ => writeln!(out, "{}", shell::relaxed_value(&value))?,
        }
        count += 1;
    }
    if format == Format::Json {
        writeln!(out, "{}", if count == 0 { "[]" } else { "\n]" })?;
    }
    Ok(count)
}
