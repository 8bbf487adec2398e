//! Numbers beside the facts of a state: expressions, comparisons, and effects that change values (PDDL 2.1, Fox and
//! Long 2003; the numeric tasks of Hoffmann 2003, "The Metric-FF planning system").
//!
//! The values of numeric variables follow the facts of a state, each in two words. Whether a comparison holds is a
//! fact of the state as well, so that whatever looks at facts looks at comparisons.

/// The number of a fact: a value of a variable, numbered through all variables.
pub type Fact = u32;

/// How far two numbers may be apart and still be equal, as the validator has it.
const TOLERANCE: f64 = 1e-6;

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
            Self::Less => left < right,
            Self::AtMost => left <= right + TOLERANCE,
            Self::Equal => (left - right).abs() <= TOLERANCE,
            Self::AtLeast => left >= right - TOLERANCE,
            Self::Greater => left > right,
        }
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
    /// Returns the value, given those of the variables.
    pub fn value(&self, values: &impl Fn(u32) -> f64) -> f64 {
        match self {
            Self::Number(number) => *number,
            Self::Variable(variable) => values(*variable),
            Self::Sum(parts) => parts.iter().map(|part| part.value(values)).sum(),
            Self::Product(left, right) => left.value(values) * right.value(values),
            Self::Quotient(left, right) => left.value(values) / right.value(values),
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
}

impl Comparison {
    /// Whether it holds.
    pub fn holds(&self, values: &impl Fn(u32) -> f64) -> bool {
        self.comparator.compare(self.left.value(values), self.right.value(values))
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

impl NumericEffect {
    /// Returns the value afterwards.
    pub(super) fn apply(&self, value: f64, amount: f64) -> f64 {
        let changed = match self.change {
            Change::Assign => amount,
            Change::Increase => value + amount,
            Change::Decrease => value - amount,
            Change::ScaleUp => value * amount,
            Change::ScaleDown => value / amount,
        };
        // There is one zero.
        changed + 0.0
    }
}

/// Changes values by effects, all of whose conditions hold: what they read is what was before.
pub(super) fn advance<'e>(effects: impl Iterator<Item = &'e NumericEffect> + Clone, values: &mut [f64]) {
    let read = |variable: u32| values[variable as usize];
    let amounts: Vec<f64> = effects.clone().map(|effect| effect.amount.value(&read)).collect();
    for (effect, amount) in effects.zip(amounts) {
        let value = &mut values[effect.variable as usize];
        *value = effect.apply(*value, amount);
    }
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
