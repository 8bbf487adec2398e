//! The syntax tree of domains and problems: what was written, where, and in whose spelling.
//!
//! Nothing is resolved here: whether a name is a constant, a function without
//! arguments or a mistake is [`crate::pddl`]'s business. Trees are equal when they
//! were written with the same words, wherever those stood.

use std::fmt;
use std::sync::Arc;

use crate::formats::Span;

/// Where a node stood in its text. All places are equal, so that trees compare by content.
#[derive(Clone, Copy, Default)]
pub struct Place(pub Span);

impl PartialEq for Place {
    fn eq(&self, _: &Self) -> bool {
        true
    }
}

impl fmt::Debug for Place {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}..{}", self.0.start, self.0.end)
    }
}

/// A word in its original spelling: a name, a variable with its `?`, a keyword with its `:`.
#[derive(Clone, PartialEq)]
pub struct Name {
    text: Arc<str>,
    place: Place,
}

impl Name {
    /// A name that stood at `span`.
    #[must_use]
    pub fn new(text: impl Into<Arc<str>>, span: Span) -> Self {
        Self { text: text.into(), place: Place(span) }
    }

    /// The original spelling.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.text
    }

    /// The spelling, shared.
    #[must_use]
    pub fn shared(&self) -> Arc<str> {
        self.text.clone()
    }

    /// Where it stood.
    #[must_use]
    pub fn span(&self) -> Span {
        self.place.0
    }

    /// The same word without regard to case, as PDDL compares.
    #[must_use]
    pub fn is(&self, other: &str) -> bool {
        self.text.eq_ignore_ascii_case(other)
    }
}

impl fmt::Display for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl fmt::Debug for Name {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        fmt::Debug::fmt(&self.text, f)
    }
}

/// `t` or `(either t u)`: one name, or the alternatives.
pub type Type = Arc<[Name]>;

/// A name or variable with the type that was written after it.
#[derive(Debug, Clone, PartialEq)]
pub struct Typed {
    /// The name, or the variable with its `?`.
    pub name: Name,
    /// What follows the dash; [`None`] where there is none.
    pub kind: Option<Type>,
}

/// `(NAME ?x - t …)`: a predicate, a function, or the head of a derived predicate.
#[derive(Debug, Clone, PartialEq)]
pub struct Signature {
    /// The name.
    pub name: Name,
    /// The parameters.
    pub parameters: Vec<Typed>,
}

/// A function and the type of its values; [`None`] means numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct Function {
    /// Name and parameters.
    pub signature: Signature,
    /// What follows the dash.
    pub kind: Option<Type>,
}

/// `(define (domain NAME) …)`. Sections that are absent are empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Domain {
    /// The domain's name.
    pub name: Name,
    /// `:requirements`, with their colons.
    pub requirements: Vec<Name>,
    /// `:types`.
    pub types: Vec<Typed>,
    /// `:constants`.
    pub constants: Vec<Typed>,
    /// `:predicates`.
    pub predicates: Vec<Signature>,
    /// `:functions`.
    pub functions: Vec<Function>,
    /// `:constraints`.
    pub constraints: Option<Condition>,
    /// Every `(:derived …)`.
    pub derived: Vec<Derived>,
    /// Every `(:action …)`.
    pub actions: Vec<Action>,
    /// Every `(:durative-action …)`.
    pub durative_actions: Vec<DurativeAction>,
}

/// `(:derived (NAME ?x …) CONDITION)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Derived {
    /// What is derived.
    pub head: Signature,
    /// When it holds.
    pub condition: Condition,
    /// The whole section.
    pub place: Place,
}

/// `(:action NAME :parameters (…) :precondition … :effect …)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Action {
    /// The action's name.
    pub name: Name,
    /// `:parameters`.
    pub parameters: Vec<Typed>,
    /// `:vars` of PDDL 1.2.
    pub locals: Vec<Typed>,
    /// `:precondition`.
    pub precondition: Option<Condition>,
    /// `:effect`.
    pub effect: Option<Effect>,
    /// The whole section.
    pub place: Place,
}

/// `(:durative-action NAME :parameters (…) :duration … :condition … :effect …)`.
#[derive(Debug, Clone, PartialEq)]
pub struct DurativeAction {
    /// The action's name.
    pub name: Name,
    /// `:parameters`.
    pub parameters: Vec<Typed>,
    /// `:duration`: comparisons of `?duration`, perhaps joined by `and`, perhaps `at start` or `at end`.
    pub duration: Option<Condition>,
    /// `:condition`.
    pub condition: Option<Condition>,
    /// `:effect`.
    pub effect: Option<Effect>,
    /// The whole section.
    pub place: Place,
}

/// A predicate or function applied to terms.
#[derive(Debug, Clone, PartialEq)]
pub struct Atom {
    /// The predicate or function.
    pub name: Name,
    /// The arguments.
    pub arguments: Vec<Term>,
    /// The list with its brackets.
    pub place: Place,
}

/// An argument.
#[derive(Debug, Clone, PartialEq)]
pub enum Term {
    /// `?x`
    Variable(Name),
    /// An object, a constant — or, in arithmetic, a function without arguments.
    Name(Name),
    /// `(f t …)`
    Call(Box<Atom>),
}

impl Term {
    /// Where it stood.
    #[must_use]
    pub fn span(&self) -> Span {
        match self {
            Self::Variable(name) | Self::Name(name) => name.span(),
            Self::Call(atom) => atom.place.0,
        }
    }
}

/// A condition and where it stood.
#[derive(Debug, Clone, PartialEq)]
pub struct Condition {
    /// What it says.
    pub kind: ConditionKind,
    /// The list with its brackets.
    pub place: Place,
}

/// What a condition says.
#[derive(Debug, Clone, PartialEq)]
pub enum ConditionKind {
    /// `(p t …)`
    Atom(Atom),
    /// `(= a b)`, also of objects, and `(<= a b)` and the like.
    Comparison(Comparator, Box<Expression>, Box<Expression>),
    /// `(not c)`
    Not(Box<Condition>),
    /// `(and c …)`; an empty `()` too.
    And(Vec<Condition>),
    /// `(or c …)`
    Or(Vec<Condition>),
    /// `(imply a b)`
    Imply(Box<Condition>, Box<Condition>),
    /// `(forall (?x - t …) c)`
    Forall(Vec<Typed>, Box<Condition>),
    /// `(exists (?x - t …) c)`
    Exists(Vec<Typed>, Box<Condition>),
    /// `(at start c)`, `(at end c)`, `(over all c)`
    Timed(Moment, Box<Condition>),
    /// `(preference NAME c)`
    Preference(Option<Name>, Box<Condition>),
    /// `(sometime-after a b)` and the like: the operator, its numbers, its conditions.
    Modal(Modal, Vec<f64>, Vec<Condition>),
}

/// How two values are compared.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Comparator {
    /// `=`
    Equal,
    /// `<`
    Less,
    /// `<=`
    AtMost,
    /// `>`
    Greater,
    /// `>=`
    AtLeast,
}

/// When during a durative action.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Moment {
    /// `at start`
    Start,
    /// `at end`
    End,
    /// `over all`
    All,
}

/// The trajectory operators of PDDL 3.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Modal {
    /// `(always c)`
    Always,
    /// `(sometime c)`
    Sometime,
    /// `(at-most-once c)`
    AtMostOnce,
    /// `(sometime-after a b)`
    SometimeAfter,
    /// `(sometime-before a b)`
    SometimeBefore,
    /// `(within t c)`
    Within,
    /// `(hold-after t c)`
    HoldAfter,
    /// `(always-within t a b)`
    AlwaysWithin,
    /// `(hold-during t u c)`
    HoldDuring,
}

/// A number, or an object where objects are compared or assigned.
#[derive(Debug, Clone, PartialEq)]
pub enum Expression {
    /// `3.5`
    Number(f64, Place),
    /// A variable (also `?duration`), an object, a function; `total-time`, `(is-violated p)`, `undefined`.
    Term(Term),
    /// `#t`
    Elapsed(Place),
    /// `(+ a b …)`, `(- a)`
    Operation(Operator, Vec<Expression>, Place),
}

impl Expression {
    /// Where it stood.
    #[must_use]
    pub fn span(&self) -> Span {
        match self {
            Self::Number(_, place) | Self::Elapsed(place) | Self::Operation(_, _, place) => place.0,
            Self::Term(term) => term.span(),
        }
    }
}

/// The four arithmetical operators.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Operator {
    /// `+`
    Add,
    /// `-`
    Subtract,
    /// `*`
    Multiply,
    /// `/`
    Divide,
}

/// An effect and where it stood.
#[derive(Debug, Clone, PartialEq)]
pub struct Effect {
    /// What it does.
    pub kind: EffectKind,
    /// The list with its brackets.
    pub place: Place,
}

/// What an effect does.
#[derive(Debug, Clone, PartialEq)]
pub enum EffectKind {
    /// `(p t …)`
    Add(Atom),
    /// `(not (p t …))`
    Delete(Atom),
    /// `(and e …)`; an empty `()` too.
    And(Vec<Effect>),
    /// `(forall (?x - t …) e)`
    Forall(Vec<Typed>, Box<Effect>),
    /// `(when c e)`
    When(Box<Condition>, Box<Effect>),
    /// `(at start e)`, `(at end e)`
    Timed(Moment, Box<Effect>),
    /// `(increase (f t …) v)` and the like.
    Assign(Assigner, Term, Box<Expression>),
}

/// How a function's value changes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Assigner {
    /// `assign`
    Assign,
    /// `increase`
    Increase,
    /// `decrease`
    Decrease,
    /// `scale-up`
    ScaleUp,
    /// `scale-down`
    ScaleDown,
}

/// `(define (problem NAME) …)`. Sections that are absent are empty.
#[derive(Debug, Clone, PartialEq)]
pub struct Problem {
    /// The problem's name.
    pub name: Name,
    /// `(:domain NAME)`.
    pub domain: Option<Name>,
    /// `:requirements`, with their colons.
    pub requirements: Vec<Name>,
    /// `:objects`.
    pub objects: Vec<Typed>,
    /// `:init`.
    pub init: Vec<Init>,
    /// `:goal`.
    pub goal: Option<Condition>,
    /// `:constraints`.
    pub constraints: Option<Condition>,
    /// `:metric`.
    pub metric: Option<Metric>,
    /// `:length`: `:serial` and `:parallel` with their numbers.
    pub length: Vec<(Name, f64)>,
    /// The whole text from `(define` to its end.
    pub place: Place,
}

/// One element of `:init`.
#[derive(Debug, Clone, PartialEq)]
pub enum Init {
    /// `(p o …)`
    Atom(Atom),
    /// `(not (p o …))`
    Not(Atom),
    /// `(= (f o …) v)`
    Value(Term, Expression),
    /// `(at TIME (p o …))`; false where it reads `(at TIME (not (p o …)))`.
    At(f64, bool, Atom),
}

/// `(:metric minimize EXPRESSION)`.
#[derive(Debug, Clone, PartialEq)]
pub struct Metric {
    /// Whether less is better.
    pub minimize: bool,
    /// What is counted.
    pub expression: Expression,
    /// The whole section.
    pub place: Place,
}
