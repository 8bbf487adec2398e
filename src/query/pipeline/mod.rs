//! Aggregation pipelines: a sequence of stages, each evaluated lazily where it can be.
//!
//! A pipeline reads documents and gives documents. What it needs of other
//! collections it asks of a function ([`Sources`]); where it ends in `$out` or
//! `$merge`, [`Pipeline::output`] says what the store is to do with the results.

mod accumulator;
mod argument;
mod bucket;
mod collected;
mod densify;
mod description;
mod documents;
mod facet;
mod fill;
mod foreign;
mod granularity;
mod graph;
mod group;
mod groups;
mod lookup;
mod near;
mod output;
mod parse;
mod partition;
mod redact;
mod run;
mod script;
mod stage;
mod state;
mod unset;
mod unwind;
mod window;

use bson::{DateTime, Document, doc};

use super::error::{QueryError, Result};
use super::expression::{Scope, Variables};
use super::filter::Filter;
use super::geo::Near;
use super::limit::check_result;
use super::spill::Spill;
use super::text;
pub use description::Description;
use documents::interruptible;
pub use documents::{Documents, Origin, Sources};
pub use output::{Merge, Output, WhenMatched, WhenNotMatched};
pub use parse::is_empty_match;
use run::Run;
use stage::Stage;

/// A compiled pipeline.
#[derive(Debug)]
pub struct Pipeline {
    stages: Vec<Stage>,
    output: Option<Output>,
    variables: Variables,
    /// Whether documents carry their score.
    is_scored: bool,
}

impl Pipeline {
    /// Reads a pipeline.
    ///
    /// # Errors
    /// If MongoDB refuses it, or rmem does not support a stage.
    pub fn parse(stages: &[Document]) -> Result<Self> {
        Self::parse_with(stages, &Document::new())
    }

    /// [`Pipeline::parse`] with constants its expressions can use as `$$name`.
    ///
    /// # Errors
    /// As [`Pipeline::parse`].
    pub fn parse_with(stages: &[Document], constants: &Document) -> Result<Self> {
        let (scope, variables) = Scope::with_constants(constants)?;
        let mut pipeline = Self::parse_in(stages, &scope, 0)?;
        pipeline.variables = variables;
        pipeline.is_scored = stages.iter().any(text::asks_for_score);
        if pipeline.is_scored && pipeline.search().is_none() {
            return Err(text::no_score());
        }
        Ok(pipeline)
    }

    fn parse_in(stages: &[Document], scope: &Scope, depth: usize) -> Result<Self> {
        let (stages, output) = parse::stages(stages, scope, depth)?;
        if let Some(output) = output.as_ref().filter(|_| depth > 0) {
            let message = "$out and $merge are not allowed within another pipeline";
            return Err(QueryError::invalid(51_047, message).about(output.stage()));
        }
        Ok(Self { stages, output, variables: Variables::default(), is_scored: false })
    }

    /// Returns the filter of the first stage, where it is `$match`: an index may be used for it.
    #[must_use]
    pub fn first_match(&self) -> Option<&Filter> {
        match self.stages.first() {
            Some(Stage::Match(filter)) => Some(filter),
            _ => None,
        }
    }

    /// Returns the first filter that there is: empty ones before it do nothing.
    fn search(&self) -> Option<&Filter> {
        self.stages.iter().find_map(|stage| match stage {
            Stage::Match(filter) => filter.search().map(|_| filter),
            _ => None,
        })
    }

    /// Returns whether documents have to carry their score.
    #[must_use]
    pub fn is_scored(&self) -> bool {
        self.is_scored
    }

    /// Returns the filters that search, each with the collection that it is about where that is another one.
    #[must_use]
    pub fn searches(&self) -> Vec<(Option<&Origin>, &Filter)> {
        let own = self.search().map(|filter| (None, filter));
        let inner = self.stages.iter().filter_map(Stage::inner).flat_map(|(origin, pipeline)| {
            pipeline.searches().into_iter().map(move |(other, filter)| (other.or(origin), filter))
        });
        own.into_iter().chain(inner).collect()
    }

    /// Returns whether the pipeline brings its own documents (`$documents`) and reads no collection.
    #[must_use]
    pub fn brings_documents(&self) -> bool {
        matches!(self.stages.first(), Some(Stage::Documents(_)))
    }

    /// Returns the distance condition of `$geoNear`, if the pipeline begins with it.
    #[must_use]
    pub fn near(&self) -> Option<&Near> {
        self.stages.iter().find_map(|stage| match stage {
            Stage::GeoNear(stage) => Some(stage.near()),
            _ => None,
        })
    }

    /// Returns whether the output for a document depends on no other input document: then the
    /// pipeline may be run over some documents after the other.
    #[must_use]
    pub fn is_piecewise(&self) -> bool {
        self.stages.iter().all(Stage::is_piecewise)
    }

    /// Leaves out a filter in front, which the documents that come in have passed; that of a search stays.
    pub fn assume_first_match(&mut self) {
        if matches!(self.stages.first(), Some(Stage::Match(_))) && !self.is_scored {
            self.stages.remove(0);
        }
    }

    /// Returns what comes out where so many documents match the first filter, if all that follows it is a count of them.
    #[must_use]
    pub fn counted(&self, count: u64) -> Option<Vec<Document>> {
        let count = i64::try_from(count).ok()?;
        let counted = match self.stages.as_slice() {
            _ if self.output.is_some() || self.is_scored => None,
            [Stage::Count(name)] | [Stage::Match(_), Stage::Count(name)] => {
                Some(doc! { name.as_str(): accumulator::count(count) })
            }
            [Stage::Group(group)] | [Stage::Match(_), Stage::Group(group)] => group.counted(count),
            _ => None,
        };
        // Of no documents, nothing comes out.
        counted.map(|document| if count > 0 { vec![document] } else { Vec::new() })
    }

    /// Returns where results are written, if the last stage is `$out` or `$merge`.
    #[must_use]
    pub fn output(&self) -> Option<&Output> {
        self.output.as_ref()
    }

    /// Returns the documents that come out.
    pub fn run<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        now: DateTime,
        sources: &'a Sources<'a, E>,
    ) -> Documents<'a, E> {
        self.run_within(input, now, sources, Spill::default())
    }

    /// [`Pipeline::run`] with a limit of the memory that a sort or `$group` may hold.
    pub fn run_within<'a, E: From<QueryError> + 'a>(
        &'a self,
        input: Documents<'a, E>,
        now: DateTime,
        sources: &'a Sources<'a, E>,
        spill: Spill,
    ) -> Documents<'a, E> {
        let mut run = Run::new(now, self.variables.clone(), sources, spill);
        run.is_scored = self.is_scored;
        let results = self.run_with(input, run);
        Box::new(results.map(|result| {
            let result = result?;
            check_result(&result)?;
            Ok(result)
        }))
    }

    fn run_with<'a, E: From<QueryError> + 'a>(&'a self, input: Documents<'a, E>, run: Run<'a, E>) -> Documents<'a, E> {
        let mut documents = input;
        let mut stages = self.stages.iter().peekable();
        let mut is_first = true;
        while let Some(stage) = stages.next() {
            // What a collection gives is looked at where it is read.
            if !std::mem::replace(&mut is_first, false) {
                documents = interruptible(documents);
            }
            let limit = match (stage, stages.peek()) {
                (Stage::Sort(_), Some(Stage::Limit(limit))) => Some(*limit),
                _ => None,
            };
            documents = stage.run(documents, &run, limit);
        }
        documents
    }
}
