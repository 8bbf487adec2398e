//! `--layout`: how a plan document is laid out.

use clap::ValueEnum;

use crate::plan;

/// The layout of a plan document.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, ValueEnum)]
pub enum Layout {
    /// One numbered key a step.
    #[default]
    Numbered,
    /// An array of actions, as Fawkes stores them.
    Fawkes,
}

impl From<Layout> for plan::Layout {
    fn from(layout: Layout) -> Self {
        match layout {
            Layout::Numbered => Self::Numbered,
            Layout::Fawkes => Self::Fawkes,
        }
    }
}
