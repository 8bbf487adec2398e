//! Plans as text for planners' tools, programs and people: one file per format.

mod clips;
mod dot;
mod ff;
mod page;
mod shell;
mod svg;
mod text;

pub use clips::{FactLayout, PrintError};
pub use page::PrintedPlan;

/// How a plan is printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Format {
    /// As the planning competitions write it: `(unstack b a)`, `; cost = 2 (unit cost)`.
    #[default]
    Text,
    /// The document, as one line of JSON.
    Document,
    /// Facts `plan` and `plan-action`.
    Clips,
    /// As FF writes it: `step    0: unstack b a`.
    Ff,
    /// A line a step: its number, how it stands, the action and its arguments, as words of a shell.
    Shell,
    /// A graph for Graphviz.
    Dot,
    /// A drawing for browsers: boxes in order, or bars over time.
    Svg,
}

impl PrintedPlan<'_> {
    /// What the lanes of its drawing can be: the values of a parameter of the steps, or their actions.
    #[must_use]
    pub fn possible_lanes(&self) -> Vec<&str> {
        svg::lanes(self)
    }

    /// Prints the plan as facts for these deftemplates.
    ///
    /// # Errors
    ///
    /// A value that CLIPS cannot read.
    pub fn facts(&self, layout: FactLayout<'_>) -> Result<String, PrintError> {
        clips::facts(self, layout)
    }

    /// Prints the plan; the text ends with a line break.
    ///
    /// # Errors
    ///
    /// A value that the format cannot spell.
    pub fn print(&self, format: Format) -> Result<String, PrintError> {
        match format {
            Format::Text => Ok(text::text(self)),
            // Documents become JSON without fail: their keys are strings.
            Format::Document => Ok(serde_json::to_string(self.document).unwrap_or_default() + "\n"),
            Format::Clips => self.facts(FactLayout::Own),
            Format::Ff => Ok(ff::ff(self.plan)),
            Format::Shell => shell::lines(self),
            Format::Dot => Ok(dot::graph(self)),
            Format::Svg => Ok(svg::draw(self)),
        }
    }
}
