//! Syntax tree → text. What is written reads back as the same tree.

use std::fmt::{self, Display, Formatter, Write as _};

use super::ast::{
    Action, Assigner, Atom, Comparator, Condition, ConditionKind, Derived, Domain, DurativeAction, Effect, EffectKind,
    Expression, Function, Init, Metric, Modal, Moment, Name, Operator, Problem, Signature, Term, Type, Typed,
};

/// Things with white space between them.
struct Spaced<'a, T>(&'a [T]);

impl<T: Display> Display for Spaced<'_, T> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (index, item) in self.0.iter().enumerate() {
            if index > 0 {
                f.write_char(' ')?;
            }
            item.fmt(f)?;
        }
        Ok(())
    }
}

/// Names with their types, a type once for all neighbours that share it.
struct TypedList<'a>(&'a [Typed]);

impl Display for TypedList<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (index, typed) in self.0.iter().enumerate() {
            if index > 0 {
                f.write_char(' ')?;
            }
            typed.name.fmt(f)?;
            let next = self.0.get(index + 1).map(|next| &next.kind);
            match (&typed.kind, next) {
                // Without a type it would get the next one's.
                (None, Some(Some(_))) => f.write_str(" - object")?,
                (kind, next) if next != Some(kind) => write_kind(f, kind.as_ref())?,
                _ => {}
            }
        }
        Ok(())
    }
}

fn write_kind(f: &mut Formatter<'_>, kind: Option<&Type>) -> fmt::Result {
    match kind.map(AsRef::as_ref) {
        None => Ok(()),
        Some([only]) => write!(f, " - {only}"),
        Some(names) => write!(f, " - (either {})", Spaced(names)),
    }
}

fn write_section<T: Display>(f: &mut Formatter<'_>, keyword: &str, items: &[T]) -> fmt::Result {
    if items.is_empty() { Ok(()) } else { write!(f, "\n  ({keyword} {})", Spaced(items)) }
}

fn write_typed_section(f: &mut Formatter<'_>, keyword: &str, list: &[Typed]) -> fmt::Result {
    if list.is_empty() { Ok(()) } else { write!(f, "\n  ({keyword} {})", TypedList(list)) }
}

/// One element per line.
fn write_lines<T: Display>(f: &mut Formatter<'_>, keyword: &str, items: &[T]) -> fmt::Result {
    write!(f, "\n  ({keyword}")?;
    for item in items {
        f.write_str("\n    ")?;
        item.fmt(f)?;
    }
    f.write_char(')')
}

/// Functions, a type once for all neighbours that share it.
fn write_functions(f: &mut Formatter<'_>, functions: &[Function]) -> fmt::Result {
    f.write_str("\n  (:functions")?;
    for (index, function) in functions.iter().enumerate() {
        write!(f, "\n    {}", function.signature)?;
        match (&function.kind, functions.get(index + 1).map(|next| &next.kind)) {
            // Without a type it would get the next one's.
            (None, Some(Some(_))) => f.write_str(" - number")?,
            (kind, next) if next != Some(kind) => write_kind(f, kind.as_ref())?,
            _ => {}
        }
    }
    f.write_char(')')
}

fn write_field<T: Display>(f: &mut Formatter<'_>, keyword: &str, value: Option<&T>) -> fmt::Result {
    value.map_or(Ok(()), |value| write!(f, "\n    {keyword} {value}"))
}

impl Display for Domain {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "(define (domain {})", self.name)?;
        write_section(f, ":requirements", &self.requirements)?;
        write_typed_section(f, ":types", &self.types)?;
        write_typed_section(f, ":constants", &self.constants)?;
        if !self.predicates.is_empty() {
            write_lines(f, ":predicates", &self.predicates)?;
        }
        if !self.functions.is_empty() {
            write_functions(f, &self.functions)?;
        }
        if let Some(constraints) = &self.constraints {
            write!(f, "\n  (:constraints {constraints})")?;
        }
        write_each(f, &self.derived)?;
        write_each(f, &self.actions)?;
        write_each(f, &self.durative_actions)?;
        f.write_str(")\n")
    }
}

fn write_each<T: Display>(f: &mut Formatter<'_>, sections: &[T]) -> fmt::Result {
    sections.iter().try_for_each(|section| write!(f, "\n  {section}"))
}

impl Display for Signature {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "({}", self.name)?;
        if !self.parameters.is_empty() {
            write!(f, " {}", TypedList(&self.parameters))?;
        }
        f.write_char(')')
    }
}

impl Display for Function {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.signature)?;
        write_kind(f, self.kind.as_ref())
    }
}

impl Display for Derived {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "(:derived {} {})", self.head, self.condition)
    }
}

impl Display for Action {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "(:action {}\n    :parameters ({})", self.name, TypedList(&self.parameters))?;
        if !self.locals.is_empty() {
            write!(f, "\n    :vars ({})", TypedList(&self.locals))?;
        }
        write_field(f, ":precondition", self.precondition.as_ref())?;
        write_field(f, ":effect", self.effect.as_ref())?;
        f.write_char(')')
    }
}

impl Display for DurativeAction {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "(:durative-action {}\n    :parameters ({})", self.name, TypedList(&self.parameters))?;
        write_field(f, ":duration", self.duration.as_ref())?;
        write_field(f, ":condition", self.condition.as_ref())?;
        write_field(f, ":effect", self.effect.as_ref())?;
        f.write_char(')')
    }
}

impl Display for Atom {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        // Initial states have millions of atoms, and each `write!` is a call through a table for each of its parts.
        f.write_char('(')?;
        self.name.fmt(f)?;
        for argument in &self.arguments {
            f.write_char(' ')?;
            argument.fmt(f)?;
        }
        f.write_char(')')
    }
}

impl Display for Term {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Variable(name) | Self::Name(name) => name.fmt(f),
            Self::Call(atom) => atom.fmt(f),
        }
    }
}

impl Display for Condition {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match &self.kind {
            ConditionKind::Atom(atom) => write!(f, "{atom}"),
            ConditionKind::Comparison(comparator, left, right) => write!(f, "({comparator} {left} {right})"),
            ConditionKind::Not(inner) => write!(f, "(not {inner})"),
            ConditionKind::And(parts) if parts.is_empty() => f.write_str("(and)"),
            ConditionKind::And(parts) => write!(f, "(and {})", Spaced(parts)),
            ConditionKind::Or(parts) if parts.is_empty() => f.write_str("(or)"),
            ConditionKind::Or(parts) => write!(f, "(or {})", Spaced(parts)),
            ConditionKind::Imply(left, right) => write!(f, "(imply {left} {right})"),
            ConditionKind::Forall(variables, inner) => write!(f, "(forall ({}) {inner})", TypedList(variables)),
            ConditionKind::Exists(variables, inner) => write!(f, "(exists ({}) {inner})", TypedList(variables)),
            ConditionKind::Timed(moment, inner) => write!(f, "({moment} {inner})"),
            ConditionKind::Preference(Some(name), inner) => write!(f, "(preference {name} {inner})"),
            ConditionKind::Preference(None, inner) => write!(f, "(preference {inner})"),
            ConditionKind::Modal(modal, numbers, parts) => {
                write!(f, "({modal}")?;
                numbers.iter().try_for_each(|number| write!(f, " {number}"))?;
                parts.iter().try_for_each(|part| write!(f, " {part}"))?;
                f.write_char(')')
            }
        }
    }
}

impl Display for Expression {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(number, _) => number.fmt(f),
            Self::Term(term) => term.fmt(f),
            Self::Elapsed(_) => f.write_str("#t"),
            Self::Operation(operator, operands, _) => write!(f, "({operator} {})", Spaced(operands)),
        }
    }
}

impl Display for Effect {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match &self.kind {
            EffectKind::Add(atom) => write!(f, "{atom}"),
            EffectKind::Delete(atom) => write!(f, "(not {atom})"),
            EffectKind::And(parts) if parts.is_empty() => f.write_str("(and)"),
            EffectKind::And(parts) => write!(f, "(and {})", Spaced(parts)),
            EffectKind::Forall(variables, inner) => write!(f, "(forall ({}) {inner})", TypedList(variables)),
            EffectKind::When(condition, inner) => write!(f, "(when {condition} {inner})"),
            EffectKind::Timed(moment, inner) => write!(f, "({moment} {inner})"),
            EffectKind::Assign(assigner, target, value) => write!(f, "({assigner} {target} {value})"),
        }
    }
}

impl Display for Problem {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        BeforeInit(self).fmt(f)?;
        self.init.iter().try_for_each(|element| {
            f.write_str(ELEMENT)?;
            element.fmt(f)
        })?;
        AfterInit(self).fmt(f)
    }
}

/// What stands before each element of `:init`.
pub(super) const ELEMENT: &str = "\n    ";

/// A problem up to the first element of `:init`.
pub(super) struct BeforeInit<'a>(pub(super) &'a Problem);

impl Display for BeforeInit<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let problem = self.0;
        write!(f, "(define (problem {})", problem.name)?;
        if let Some(domain) = &problem.domain {
            write!(f, "\n  (:domain {domain})")?;
        }
        write_section(f, ":requirements", &problem.requirements)?;
        write_typed_section(f, ":objects", &problem.objects)?;
        f.write_str("\n  (:init")
    }
}

/// A problem from behind the last element of `:init` on.
pub(super) struct AfterInit<'a>(pub(super) &'a Problem);

impl Display for AfterInit<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let problem = self.0;
        f.write_char(')')?;
        if let Some(goal) = &problem.goal {
            write!(f, "\n  (:goal {goal})")?;
        }
        if let Some(constraints) = &problem.constraints {
            write!(f, "\n  (:constraints {constraints})")?;
        }
        if let Some(metric) = &problem.metric {
            write!(f, "\n  {metric}")?;
        }
        if !problem.length.is_empty() {
            f.write_str("\n  (:length")?;
            problem.length.iter().try_for_each(|(name, number)| write!(f, " ({name} {number})"))?;
            f.write_char(')')?;
        }
        f.write_str(")\n")
    }
}

impl Display for Init {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Atom(atom) => atom.fmt(f),
            Self::Not(atom) => write!(f, "(not {atom})"),
            Self::Value(target, value) => {
                f.write_str("(= ")?;
                target.fmt(f)?;
                f.write_char(' ')?;
                value.fmt(f)?;
                f.write_char(')')
            }
            Self::At(time, true, atom) => write!(f, "(at {time} {atom})"),
            Self::At(time, false, atom) => write!(f, "(at {time} (not {atom}))"),
        }
    }
}

impl Display for Metric {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let direction = if self.minimize { "minimize" } else { "maximize" };
        write!(f, "(:metric {direction} {})", self.expression)
    }
}

/// Words that stand for themselves, written and read by the same table.
macro_rules! words {
    ($($type:ident { $($variant:ident = $word:literal,)* })*) => {$(
        impl $type {
            /// How it is written.
            #[must_use]
            pub fn word(self) -> &'static str {
                match self { $(Self::$variant => $word,)* }
            }

            /// The one that is written so, without regard to case.
            #[must_use]
            pub fn from_word(word: &str) -> Option<Self> {
                $(if word.eq_ignore_ascii_case($word) { return Some(Self::$variant); })*
                None
            }
        }

        impl Display for $type {
            fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
                f.write_str(self.word())
            }
        }
    )*};
}

words! {
    Comparator { Equal = "=", Less = "<", AtMost = "<=", Greater = ">", AtLeast = ">=", }
    Operator { Add = "+", Subtract = "-", Multiply = "*", Divide = "/", }
    Moment { Start = "at start", End = "at end", All = "over all", }
    Assigner {
        Assign = "assign",
        Increase = "increase",
        Decrease = "decrease",
        ScaleUp = "scale-up",
        ScaleDown = "scale-down",
    }
    Modal {
        Always = "always",
        Sometime = "sometime",
        AtMostOnce = "at-most-once",
        SometimeAfter = "sometime-after",
        SometimeBefore = "sometime-before",
        Within = "within",
        HoldAfter = "hold-after",
        AlwaysWithin = "always-within",
        HoldDuring = "hold-during",
    }
}

/// A name for a place that no text has.
impl From<&str> for Name {
    fn from(text: &str) -> Self {
        Self::new(text, crate::formats::Span::default())
    }
}
