//! Values separated by commas or tabs, below a line of keys.
//!
//! The keys of all documents are in the first line, so that nothing can be written before the last document is
//! known. Documents are kept in memory while they are few, else in a temporary file without a name.

use std::collections::HashSet;
use std::io::{self, BufReader, Read, Seek as _, Write};
use std::path::Path;

use bson::{Bson, Document, RawDocumentBuf};
use tempfile::{SpooledTempFile, spooled_tempfile_in};

use crate::error::{Context as _, Result};
use crate::formats::shell;

/// How many bytes of documents are kept in memory.
const IN_MEMORY: usize = 16 << 20;

/// Writes the values of documents, a document a line; returns how many there are. `folder` is for a temporary file.
///
/// Line breaks, delimiters and quotes in values are quoted as RFC 4180 has it.
///
/// # Errors
/// Where a document cannot be had, the temporary file cannot be used, or `out` fails.
pub(super) fn write(
    documents: impl Iterator<Item = Result<Document>>,
    delimiter: char,
    folder: &Path,
    out: &mut dyn Write,
) -> Result<u64> {
    let mut kept = spooled_tempfile_in(IN_MEMORY, folder);
    let (keys, count) = keep(documents, &mut kept, folder)?;
    if count == 0 {
        return Ok(0);
    }
    line(keys.iter().cloned(), delimiter, out)?;
    kept.rewind()?;
    let mut kept = BufReader::new(kept);
    for _ in 0..count {
        let document = next(&mut kept)?;
        let values = keys.iter().map(|key| document.get(key).map(field).unwrap_or_default());
        line(values, delimiter, out)?;
    }
    Ok(count)
}

/// Keeps documents; returns their keys, in order of first appearance, and how many there are.
fn keep(
    documents: impl Iterator<Item = Result<Document>>,
    kept: &mut SpooledTempFile,
    folder: &Path,
) -> Result<(Vec<String>, u64)> {
    let (mut keys, mut seen, mut count) = (Vec::new(), HashSet::new(), 0);
    for document in documents {
        let document = document?;
        for key in document.keys().filter(|key| !seen.contains(*key)).cloned().collect::<Vec<_>>() {
            seen.insert(key.clone());
            keys.push(key);
        }
        let bytes = RawDocumentBuf::try_from(&document)?;
        kept.write_all(bytes.as_bytes())
            .with_context(|| format!("cannot keep the documents in {}; set TMPDIR", folder.display()))?;
        count += 1;
    }
    Ok((keys, count))
}

/// Reads a document that was kept.
fn next(kept: &mut impl Read) -> Result<Document> {
    let mut bytes = vec![0; 4];
    kept.read_exact(&mut bytes)?;
    let length = bytes.iter().rev().fold(0, |length, byte| length << 8 | usize::from(*byte));
    bytes.resize(length, 0);
    kept.read_exact(bytes.get_mut(4..).unwrap_or_default())?;
    Ok(Document::try_from(&*RawDocumentBuf::from_bytes(bytes)?)?)
}

fn line(fields: impl Iterator<Item = String>, delimiter: char, out: &mut dyn Write) -> io::Result<()> {
    for (nth, field) in fields.enumerate() {
        if nth > 0 {
            write!(out, "{delimiter}")?;
        }
        out.write_all(quoted(field, delimiter).as_bytes())?;
    }
    writeln!(out)
}

/// By hand: the crate `csv` is a hundred times this line, and builds serde with other features.
fn quoted(field: String, delimiter: char) -> String {
    let is_plain = !field.contains([delimiter, '"', '\n', '\r']);
    if is_plain { field } else { format!("\"{}\"", field.replace('"', "\"\"")) }
}

/// A value for another program: texts and dates bare, the rest as JSON.
fn field(value: &Bson) -> String {
    match value {
        Bson::String(text) => text.clone(),
        Bson::Null => String::new(),
        Bson::ObjectId(id) => id.to_hex(),
        Bson::DateTime(date) => date.try_to_rfc3339_string().unwrap_or_else(|_| date.timestamp_millis().to_string()),
        Bson::Decimal128(number) => number.to_string(),
        other => shell::relaxed_value(other),
    }
}

#[cfg(test)]
mod tests {
    use bson::doc;

    use super::*;

    fn written(rows: impl Iterator<Item = Document>) -> String {
        let mut out = Vec::new();
        write(rows.map(Ok), ',', &std::env::temp_dir(), &mut out).unwrap();
        String::from_utf8(out).unwrap()
    }

    #[test]
    fn separated_values_are_quoted_where_they_have_to_be() {
        let rows = [doc! { "a": "x,\"y\"\nz", "b": 1.5 }, doc! { "c": bson::Bson::Null, "b": [1] }];
        assert_eq!(written(rows.into_iter()), "a,b,c\n\"x,\"\"y\"\"\nz\",1.5,\n,[1],\n");
        assert_eq!(written(std::iter::empty()), "");
    }

    #[test]
    fn documents_that_do_not_fit_in_memory_are_written_all_the_same() {
        let long = "x".repeat(100_000);
        let count = IN_MEMORY / long.len() * 2;
        let text = written((0..count).map(|n| doc! { "n": n as i64, (format!("k{}", n % 3)): &long }));
        assert_eq!(text.lines().next(), Some("n,k0,k1,k2"));
        assert_eq!(
            text.lines().last(),
            Some(
                format!("{},{}{long}{}", count - 1, ",".repeat((count - 1) % 3), ",".repeat(2 - (count - 1) % 3))
                    .as_str()
            )
        );
        assert_eq!(text.lines().count(), count + 1);
    }
}
