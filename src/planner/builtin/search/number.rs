//! Numbers beside the facts of a state: expressions, comparisons, and effects that change values (PDDL 2.1, Fox and
//! Long 2003; the numeric tasks of Hoffmann 2003, "The Metric-FF planning system").
//!
//! The values of numeric variables follow the facts of a state, each in two words. Whether a comparison holds is a
//! fact of the state as well, so that whatever looks at facts looks at comparisons.

/// The number of a fact: a value of a variable, numbered through all variables.
pub type Fact = u32;

/// How far two numbers may be apart and still be equal, as the validator has it.
pub(super) const TOLERANCE: f64 = 1e-6;

/// How a comparison compares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Comparator {
    /// `<`
    Less,
    /// `<=`
    AtMost,
    /// `=`
    Equal,
    /// `>=`
    AtLeast,
    /// `>`
    Greater,
}

impl Comparator {
    /// Whether two numbers compare so.
    #[must_use]
    pub fn compare(self, left: f64, right: f64) -> bool {
        match self {
            Self::Less => left < right - TOLERANCE,
            Self::AtMost => left <= right + TOLERANCE,
            Self::Equal => left >= right - TOLERANCE && left <= right + TOLERANCE,
            Self::AtLeast => left >= right - TOLERANCE,
            Self::Greater => left > right + TOLERANCE,
        }
    }

    /// Whether two numbers compare so; `None` where one of them has no value.
    #[must_use]
    pub fn outcome(self, left: f64, right: f64) -> Option<bool> {
        (!left.is_nan() && !right.is_nan()).then(|| self.compare(left, right))
    }
}

/// How an effect changes a value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Change {
    /// To the amount.
    Assign,
    /// By adding the amount.
    Increase,
    /// By subtracting the amount.
    Decrease,
    /// By multiplying with the amount.
    ScaleUp,
    /// By dividing by the amount.
    ScaleDown,
}

/// An arithmetic expression over numeric variables.
#[derive(Debug, Clone, PartialEq)]
pub enum Expression {
    /// A number.
    Number(f64),
    /// The value of a variable.
    Variable(u32),
    /// The sum of all.
    Sum(Vec<Self>),
    /// The product of both.
    Product(Box<Self>, Box<Self>),
    /// The first divided by the second.
    Quotient(Box<Self>, Box<Self>),
}

impl Expression {
    /// Returns the value, given those of the variables; not a number where one has none, or a divisor is zero.
    pub fn value(&self, values: &impl Fn(u32) -> f64) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Variable(variable) => values(*variable),
            Self::Sum(parts) => parts.iter().map(|part| part.value(values)).sum(),
            Self::Product(left, right) => left.value(values) * right.value(values),
            Self::Quotient(left, right) => divided(left.value(values), right.value(values)),
        }
    }

    /// Whether there may be no value, given which variables may have none.
    pub(super) fn may_lack(&self, lacks: &impl Fn(u32) -> bool) -> bool {
        match self {
            Self::Number(number) => number.is_nan(),
            Self::Variable(variable) => lacks(*variable),
            Self::Sum(parts) => parts.iter().any(|part| part.may_lack(lacks)),
            Self::Product(left, right) => left.may_lack(lacks) || right.may_lack(lacks),
            Self::Quotient(left, right) => left.may_lack(lacks) || may_be_zero(right) || right.may_lack(lacks),
        }
    }

    /// Adds the variables, where they are new.
    pub fn variables(&self, found: &mut Vec<u32>) {
        match self {
            Self::Number(_) => {}
            Self::Variable(variable) => {
                if !found.contains(variable) {
                    found.push(*variable);
                }
            }
            Self::Sum(parts) => parts.iter().for_each(|part| part.variables(found)),
            Self::Product(left, right) | Self::Quotient(left, right) => {
                left.variables(found);
                right.variables(found);
            }
        }
    }

    /// Returns the number that an expression without variables stands for.
    #[must_use]
    pub fn constant(&self) -> Option<f64> {
        let mut variables = Vec::new();
        self.variables(&mut variables);
        variables.is_empty().then(|| self.value(&|_| 0.0))
    }

    /// Whether the value is a sum of variables times constants, and a constant.
    #[must_use]
    pub fn is_linear(&self) -> bool {
        match self {
            Self::Number(_) | Self::Variable(_) => true,
            Self::Sum(parts) => parts.iter().all(Self::is_linear),
            Self::Product(left, right) => {
                left.constant().is_some() && right.is_linear() || right.constant().is_some() && left.is_linear()
            }
            Self::Quotient(left, right) => left.is_linear() && right.constant().is_some(),
        }
    }
}

fn divided(value: f64, divisor: f64) -> f64 {
    if divisor == 0.0 { f64::NAN } else { value / divisor }
}

fn may_be_zero(expression: &Expression) -> bool {
    expression.constant().is_none_or(|number| number == 0.0)
}

/// A comparison of two expressions, and the facts that say whether it holds.
#[derive(Debug, Clone, PartialEq)]
pub struct Comparison {
    /// How it compares.
    pub comparator: Comparator,
    /// The left expression.
    pub left: Expression,
    /// The right expression.
    pub right: Expression,
    /// That it holds; the next fact says that it does not.
    pub fact: Fact,
    /// Whether a third fact says that it cannot be computed: then neither it nor its negation holds.
    pub is_partial: bool,
}

impl Comparison {
    /// Whether it holds; `None` where it cannot be computed.
    pub fn holds(&self, values: &impl Fn(u32) -> f64) -> Option<bool> {
        self.comparator.outcome(self.left.value(values), self.right.value(values))
    }

    /// Returns the fact that says whether it holds.
    pub(super) fn truth(&self, values: &impl Fn(u32) -> f64) -> Fact {
        match self.holds(values) {
            Some(true) => self.fact,
            None if self.is_partial => self.fact + 2,
            Some(false) | None => self.fact + 1,
        }
    }

    /// Returns the variables that it compares.
    #[must_use]
    pub fn variables(&self) -> Vec<u32> {
        let mut found = Vec::new();
        self.left.variables(&mut found);
        self.right.variables(&mut found);
        found
    }

    /// How much the difference must change until the comparison holds, or does not hold.
    pub(super) fn gap(&self, truth: bool, values: &impl Fn(u32) -> f64) -> f64 {
        let difference = self.right.value(values) - self.left.value(values);
        match (self.comparator, truth) {
            (Comparator::AtLeast | Comparator::Greater, true) | (Comparator::Less | Comparator::AtMost, false) => {
                difference
            }
            (Comparator::AtLeast | Comparator::Greater, false) | (Comparator::Less | Comparator::AtMost, true) => {
                -difference
            }
            (Comparator::Equal, true) => difference.abs(),
            (Comparator::Equal, false) => -difference.abs(),
        }
    }

    /// Whether a difference of nothing is not enough.
    pub(super) fn is_strict(&self, truth: bool) -> bool {
        match self.comparator {
            Comparator::Less | Comparator::Greater => truth,
            Comparator::AtMost | Comparator::AtLeast | Comparator::Equal => !truth,
        }
    }
}

/// A change of a value under a condition.
#[derive(Debug, Clone, PartialEq)]
pub struct NumericEffect {
    /// What must hold before; usually nothing but the operator's own condition.
    pub condition: Vec<Fact>,
    /// What changes.
    pub variable: u32,
    /// In which way.
    pub change: Change,
    /// By how much, before the operator.
    pub amount: Expression,
}

/// What happens to a value at once. Changes of one kind add up; others of one value exclude each other.
#[derive(Debug, Clone, Copy)]
enum Update {
    Assign(f64),
    Shift(f64),
    Scale(f64),
}

impl Update {
    /// `None` where there is no amount.
    fn new(change: Change, amount: f64) -> Option<Self> {
        let update = match change {
            Change::Assign => Self::Assign(amount),
            Change::Increase => Self::Shift(amount),
            Change::Decrease => Self::Shift(-amount),
            Change::ScaleUp => Self::Scale(amount),
            Change::ScaleDown if amount == 0.0 => return None,
            Change::ScaleDown => Self::Scale(1.0 / amount),
        };
        (!amount.is_nan()).then_some(update)
    }

    fn joined(self, other: Self) -> Option<Self> {
        match (self, other) {
            (Self::Shift(one), Self::Shift(other)) => Some(Self::Shift(one + other)),
            (Self::Scale(one), Self::Scale(other)) => Some(Self::Scale(one * other)),
            (Self::Assign(one), Self::Assign(other)) if one == other => Some(self),
            _ => None,
        }
    }

    fn applied(self, value: f64) -> f64 {
        match self {
            Self::Assign(amount) => amount,
            Self::Shift(amount) => value + amount,
            Self::Scale(amount) => value * amount,
        }
    }
}

/// The values that effects lead to, all of whose conditions hold: what they read is what was before. `None` where one
/// cannot be computed, or a value would change in two ways at once: then the operator is not applicable.
pub(super) fn changes<'e>(
    effects: impl Iterator<Item = &'e NumericEffect>,
    values: &impl Fn(u32) -> f64,
) -> Option<Vec<(u32, f64)>> {
    let mut updates: Vec<(u32, Update)> = Vec::new();
    for effect in effects {
        let update = Update::new(effect.change, effect.amount.value(values))?;
        match updates.iter_mut().find(|(variable, _)| *variable == effect.variable) {
            Some((_, known)) => *known = known.joined(update)?,
            None => updates.push((effect.variable, update)),
        }
    }
    let changed = updates.into_iter().map(|(variable, update)| {
        let value = update.applied(values(variable));
        // There is one zero.
        value.is_finite().then_some((variable, value + 0.0))
    });
    changed.collect()
}

/// Changes values by effects, all of whose conditions hold; what cannot be computed is not a number then.
pub(super) fn advance<'e>(effects: impl Iterator<Item = &'e NumericEffect> + Clone, values: &mut [f64]) {
    match changes(effects.clone(), &|variable| values[variable as usize]) {
        Some(changed) => changed.into_iter().for_each(|(variable, value)| values[variable as usize] = value),
        None => effects.for_each(|effect| values[effect.variable as usize] = f64::NAN),
    }
}

/// Which of the changes of an operator may be impossible, given which variables may have no value.
pub(super) fn fallible(changes: &[(u32, Change, &Expression)], lacks: &impl Fn(u32) -> bool) -> Vec<bool> {
    let kind = |change: Change| match change {
        Change::Assign => 0,
        Change::Increase | Change::Decrease => 1,
        Change::ScaleUp | Change::ScaleDown => 2,
    };
    let may_fail = |(place, (variable, change, amount)): (usize, &(u32, Change, &Expression))| {
        let excludes = |(other, (same, how, by)): (usize, &(u32, Change, &Expression))| {
            let is_one = kind(*change) == kind(*how) && (*change != Change::Assign || amount == by);
            place != other && variable == same && !is_one
        };
        amount.may_lack(lacks)
            || *change == Change::ScaleDown && may_be_zero(amount)
            || *change != Change::Assign && lacks(*variable)
            || changes.iter().enumerate().any(excludes)
    };
    changes.iter().enumerate().map(may_fail).collect()
}

/// The numeric part of a task.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Numbers {
    /// How many variables there are.
    pub count: usize,
    /// What conditions compare.
    pub comparisons: Vec<Comparison>,
    /// The comparisons in which each variable is.
    pub uses: Vec<Vec<u32>>,
    /// The facts that say that a comparison cannot be computed, in order.
    pub undefined: Vec<Fact>,
    /// What the variables are called, as PDDL.
    pub names: Vec<String>,
}

/// Returns the value of a numeric variable in a state of so many facts.
pub(super) fn value(facts: usize, state: &[Fact], variable: u32) -> f64 {
    let place = facts + variable as usize * 2;
    f64::from_bits(u64::from(state[place]) << 32 | u64::from(state[place + 1]))
}

/// The words of a value in a state.
pub(super) fn words(value: f64) -> [Fact; 2] {
    let bits = (value + 0.0).to_bits();
    [(bits >> 32) as Fact, bits as Fact]
}
