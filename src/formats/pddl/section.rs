//! Text → domain or problem, section by section.

use pest::iterators::Pair;

use super::Dialect;
use super::ast::{Action, Condition, Derived, Domain, DurativeAction, Effect, Metric, Place, Problem, Typed};
use super::grammar::{Rule, parse};
use super::outline::{Flaw, Outline, outline};
use super::syntax::{explain, keyword, of_section};
use super::walk::{Walk, Words, parts};
use crate::formats::{Diagnostic, Source, Span};

/// Reads a domain.
///
/// # Errors
/// The first place where the text is not a domain.
pub fn read_domain(source: &Source, dialect: Dialect) -> Result<Domain, Diagnostic> {
    let mut reader = Reader::new(source, Rule::domain_head);
    let outline = reader.outline(dialect)?;
    let mut domain = Domain {
        name: reader.walk(outline.whole.start, outline.head.end, Rule::domain_head, |walk, pair| {
            Some(walk.name(&parts(pair).next()?))
        })?,
        requirements: Vec::new(),
        types: Vec::new(),
        constants: Vec::new(),
        predicates: Vec::new(),
        functions: Vec::new(),
        constraints: None,
        derived: Vec::new(),
        actions: Vec::new(),
        durative_actions: Vec::new(),
    };
    for section in outline.sections {
        reader.domain_section(&mut domain, section)?;
    }
    Ok(domain)
}

/// Reads a problem.
///
/// # Errors
/// The first place where the text is not a problem.
pub fn read_problem(source: &Source, dialect: Dialect) -> Result<Problem, Diagnostic> {
    let mut reader = Reader::new(source, Rule::problem_head);
    let outline = reader.outline(dialect)?;
    let mut problem = Problem {
        name: reader.walk(outline.whole.start, outline.head.end, Rule::problem_head, |walk, pair| {
            Some(walk.name(&parts(pair).next()?))
        })?,
        domain: None,
        requirements: Vec::new(),
        objects: Vec::new(),
        init: Vec::new(),
        goal: None,
        constraints: None,
        metric: None,
        length: Vec::new(),
        place: Place(outline.whole),
    };
    for section in outline.sections {
        reader.problem_section(&mut problem, section)?;
    }
    Ok(problem)
}

/// A text on its way to a tree.
pub(super) struct Reader<'a> {
    pub(super) source: &'a Source,
    kind: Rule,
    pub(super) words: Words,
    /// How many arguments the last plain atom had.
    pub(super) arity: usize,
    /// The sections seen that may come only once.
    seen: Vec<(String, Span)>,
}

const DOMAIN_SECTIONS: [&str; 9] = [
    ":requirements",
    ":types",
    ":constants",
    ":predicates",
    ":functions",
    ":constraints",
    ":derived",
    ":action",
    ":durative-action",
];

const PROBLEM_SECTIONS: [&str; 8] =
    [":domain", ":requirements", ":objects", ":init", ":goal", ":constraints", ":metric", ":length"];

impl<'a> Reader<'a> {
    pub(super) fn new(source: &'a Source, kind: Rule) -> Self {
        Self { source, kind, words: Words::default(), arity: 0, seen: Vec::new() }
    }

    /// The outline; where a list is not closed, the section's own fault if it has one.
    fn outline(&mut self, dialect: Dialect) -> Result<Outline, Diagnostic> {
        outline(self.source, dialect).map_err(|flaw| match flaw {
            Flaw::Plain(diagnostic) => diagnostic,
            Flaw::Unclosed(diagnostic, section) => self.own_fault(section).unwrap_or(diagnostic),
        })
    }

    /// What is wrong with the unfinished section, other than that it is unfinished.
    fn own_fault(&mut self, section: Span) -> Option<Diagnostic> {
        let (keyword, _) = keyword(self.source, section)?;
        let rule = match keyword.as_str() {
            ":action" => Rule::action,
            ":durative-action" => Rule::durative_action,
            _ => return None,
        };
        let flaw = parse(self.source, section, rule).err()?;
        let last = self.source.slice(section).trim_end().len() + section.start;
        (flaw.span().start < last).then(|| explain(self.source, section, &flaw))
    }

    /// Parses a stretch of the text by `rule` and walks the result.
    pub(super) fn walk<T>(
        &mut self,
        start: usize,
        end: usize,
        rule: Rule,
        walker: impl FnOnce(&mut Walk<'_>, Pair<'_, Rule>) -> Option<T>,
    ) -> Result<T, Diagnostic> {
        let span = Span::new(start, end);
        let pair = parse(self.source, span, rule)?;
        let mut walk = Walk { source: self.source, base: start, words: &mut self.words, flaw: None };
        match walker(&mut walk, pair) {
            Some(node) => Ok(node),
            None => Err(walk.flaw.unwrap_or_else(|| Diagnostic::new(self.source, span, "this cannot be read"))),
        }
    }

    /// The same for a whole section, whose complaints say where they are.
    fn section<T>(
        &mut self,
        section: Span,
        rule: Rule,
        walker: impl FnOnce(&mut Walk<'_>, Pair<'_, Rule>) -> Option<T>,
    ) -> Result<T, Diagnostic> {
        self.walk(section.start, section.end, rule, walker).map_err(|flaw| explain(self.source, section, &flaw))
    }

    /// The section's keyword in lower case, if it may stand here.
    fn keyword(&mut self, section: Span) -> Result<String, Diagnostic> {
        let (known, kind): (&[&str], _) = match self.kind {
            Rule::domain_head => (&DOMAIN_SECTIONS, "domain"),
            _ => (&PROBLEM_SECTIONS, "problem"),
        };
        let Some((keyword, span)) = keyword(self.source, section) else {
            let message = format!("expected a section of a {kind}, found a list without a keyword");
            return Err(Diagnostic::new(self.source, section, message).hint(format!("there are {}", known.join(", "))));
        };
        if !known.contains(&keyword.as_str()) {
            let message = format!("expected a section of a {kind}, found `{keyword}`");
            let diagnostic = Diagnostic::new(self.source, span, message);
            return Err(match of_section(&keyword) {
                Some(_) if kind == "domain" => diagnostic.hint("this section belongs in a problem"),
                Some(_) => diagnostic.hint("this section belongs in a domain"),
                None => diagnostic.hint(format!("there are {}", known.join(", "))),
            });
        }
        if !matches!(keyword.as_str(), ":action" | ":durative-action" | ":derived") {
            if let Some((_, first)) = self.seen.iter().find(|(seen, _)| *seen == keyword) {
                let (line, column) = self.source.position(first.start);
                return Err(Diagnostic::new(self.source, span, format!("`{keyword}` is there twice"))
                    .hint(format!("the first one is at {line}:{column}")));
            }
            self.seen.push((keyword.clone(), span));
        }
        Ok(keyword)
    }

    fn domain_section(&mut self, domain: &mut Domain, section: Span) -> Result<(), Diagnostic> {
        match self.keyword(section)?.as_str() {
            ":requirements" => domain.requirements = self.requirements(section)?,
            ":types" => domain.types = self.names(section)?,
            ":constants" => domain.constants = self.names(section)?,
            ":predicates" => {
                domain.predicates = self.section(section, Rule::predicates, |walk, pair| {
                    parts(pair).map(|part| walk.signature(part)).collect()
                })?;
            }
            ":functions" => {
                domain.functions = self.section(section, Rule::functions, |walk, pair| walk.functions(pair))?
            }
            ":constraints" => domain.constraints = Some(self.condition(section, Rule::constraints)?),
            ":derived" => domain.derived.push(self.section(section, Rule::derived, derived)?),
            ":action" => domain.actions.push(self.section(section, Rule::action, action)?),
            _ => domain.durative_actions.push(self.section(section, Rule::durative_action, durative_action)?),
        }
        Ok(())
    }

    fn problem_section(&mut self, problem: &mut Problem, section: Span) -> Result<(), Diagnostic> {
        match self.keyword(section)?.as_str() {
            ":domain" => {
                let name =
                    self.section(section, Rule::problem_domain, |walk, pair| Some(walk.name(&parts(pair).next()?)))?;
                problem.domain = Some(name);
            }
            ":requirements" => problem.requirements = self.requirements(section)?,
            ":objects" => problem.objects = self.names(section)?,
            ":init" => problem.init = self.init(section)?,
            ":goal" => problem.goal = Some(self.goal(section)?),
            ":constraints" => problem.constraints = Some(self.condition(section, Rule::constraints)?),
            ":metric" => problem.metric = Some(self.section(section, Rule::metric, metric)?),
            _ => {
                problem.length = self.section(section, Rule::length, |walk, pair| {
                    parts(pair)
                        .map(|bound| {
                            let mut parts = parts(bound);
                            Some((walk.name(&parts.next()?), walk.number(&parts.next()?)?))
                        })
                        .collect()
                })?;
            }
        }
        Ok(())
    }

    fn requirements(&mut self, section: Span) -> Result<Vec<super::ast::Name>, Diagnostic> {
        self.section(section, Rule::requirements, |walk, pair| Some(parts(pair).map(|part| walk.name(&part)).collect()))
    }

    fn names(&mut self, section: Span) -> Result<Vec<Typed>, Diagnostic> {
        self.section(section, Rule::name_list, |walk, pair| walk.typed(parts(pair).next()?))
    }

    pub(super) fn condition(&mut self, section: Span, rule: Rule) -> Result<Condition, Diagnostic> {
        self.section(section, rule, |walk, pair| walk.condition(parts(pair).next()?))
    }
}

fn derived(walk: &mut Walk<'_>, pair: Pair<'_, Rule>) -> Option<Derived> {
    let place = walk.place(&pair);
    let mut parts = parts(pair);
    Some(Derived { head: walk.signature(parts.next()?)?, condition: walk.condition(parts.next()?)?, place })
}

fn metric(walk: &mut Walk<'_>, pair: Pair<'_, Rule>) -> Option<Metric> {
    let place = walk.place(&pair);
    let mut parts = parts(pair);
    let minimize = parts.next()?.as_str().eq_ignore_ascii_case("minimize");
    Some(Metric { minimize, expression: walk.expression(parts.next()?)?, place })
}

/// The fields of an action of either kind; each may be there only once.
#[derive(Default)]
struct Fields {
    parameters: Option<Vec<Typed>>,
    locals: Option<Vec<Typed>>,
    duration: Option<Condition>,
    condition: Option<Condition>,
    effect: Option<Effect>,
}

fn fields<'p>(walk: &mut Walk<'_>, pairs: impl Iterator<Item = Pair<'p, Rule>>) -> Option<Fields> {
    let mut fields = Fields::default();
    for field in pairs {
        let (rule, span) = (field.as_rule(), walk.span(&field));
        let value = parts(field).next()?;
        let is_again = match rule {
            Rule::parameters => fields.parameters.replace(walk.typed(value)?).is_some(),
            Rule::locals => fields.locals.replace(walk.typed(value)?).is_some(),
            Rule::duration => fields.duration.replace(walk.condition(value)?).is_some(),
            Rule::precondition | Rule::durative_condition => fields.condition.replace(walk.condition(value)?).is_some(),
            _ => fields.effect.replace(walk.effect(value)?).is_some(),
        };
        if is_again {
            return walk.fail(span, "this is there twice");
        }
    }
    Some(fields)
}

fn action(walk: &mut Walk<'_>, pair: Pair<'_, Rule>) -> Option<Action> {
    let place = walk.place(&pair);
    let mut pairs = parts(pair);
    let name = walk.name(&pairs.next()?);
    let Fields { parameters, locals, condition, effect, .. } = fields(walk, pairs)?;
    let (parameters, locals) = (parameters.unwrap_or_default(), locals.unwrap_or_default());
    Some(Action { name, parameters, locals, precondition: condition, effect, place })
}

fn durative_action(walk: &mut Walk<'_>, pair: Pair<'_, Rule>) -> Option<DurativeAction> {
    let place = walk.place(&pair);
    let mut pairs = parts(pair);
    let name = walk.name(&pairs.next()?);
    let Fields { parameters, duration, condition, effect, .. } = fields(walk, pairs)?;
    Some(DurativeAction { name, parameters: parameters.unwrap_or_default(), duration, condition, effect, place })
}
