//! The grammar of values and documents, `grammars/shell.pest`.

use pest_derive::Parser;

#[derive(Parser)]
#[grammar = "grammars/shell.pest"]
pub(super) struct ShellParser;
