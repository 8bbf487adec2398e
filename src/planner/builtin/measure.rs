//! Metrics that are weighted sums of numbers and of time, as costs of actions.

use std::collections::{BTreeMap, HashMap, HashSet};

use ferroplan::types::{AssignOp, Domain, Effect, Expr, MetricDir, Problem, Term};

/// The function whose value grows by the costs; no name in PDDL has a blank.
pub(super) const COST: &str = " COST";

/// How long plans take.
const TOTAL_TIME: &str = "TOTAL-TIME";

/// The function whose value is zero at first.
const TOTAL_COST: &str = "TOTAL-COST";

/// The most values that weights may have.
const MOST_WEIGHTS: usize = 100_000;

/// The value of a function for some objects.
type Value = (String, Vec<String>);

/// What actions cost by the metric of a problem, of which less is better.
pub(super) struct Measure {
    /// What a unit of time costs.
    pub(super) rate: f64,
    /// What the actions cost, by their names.
    costs: HashMap<String, Expr>,
    /// How much the values count of those functions that have objects.
    weights: Vec<(Value, f64)>,
}

/// A weighted sum.
#[derive(Default)]
struct Sum {
    constant: f64,
    rate: f64,
    weights: HashMap<Value, f64>,
}

impl Measure {
    /// The costs of a task; `None` where the metric is not a weighted sum, or actions change it otherwise than by adding to
    /// what it counts.
    pub(super) fn new(domain: &Domain, problem: &Problem) -> Option<Self> {
        let (direction, expression) = problem.metric.as_ref()?;
        let mut changed = HashSet::new();
        effects(domain).for_each(|(_, effect)| changes(effect, &mut changed));
        let mut sum = Sum::of(expression, problem, &changed)?;
        if *direction == MetricDir::Maximize {
            sum.scale(-1.0);
        }
        if sum.rate < 0.0 || sum.rate == 0.0 && sum.weights.is_empty() {
            return None;
        }
        let mut measure = Self { rate: sum.rate, costs: HashMap::new(), weights: Vec::new() };
        for (action, effect) in effects(domain) {
            let mut parts = Vec::new();
            costs(effect, &sum, &mut parts)?;
            for part in parts {
                let known = measure.costs.remove(action);
                let cost = known.map_or(part.clone(), |known| Expr::Add(Box::new(known), Box::new(part)));
                measure.costs.insert(action.to_owned(), cost);
            }
        }
        measure.weigh(domain, problem, &sum)?;
        Some(measure)
    }

    /// Gives each value of a function that has objects its weight, which most of them do not have.
    fn weigh(&mut self, domain: &Domain, problem: &Problem, sum: &Sum) -> Option<()> {
        let arities: BTreeMap<&str, usize> =
            sum.weights.keys().map(|(name, objects)| (name.as_str(), objects.len())).collect();
        let objects: Vec<&String> = domain.constants.iter().chain(&problem.objects).map(|(name, _)| name).collect();
        for (name, arity) in arities.into_iter().filter(|(_, arity)| *arity > 0) {
            let count = objects.len().checked_pow(u32::try_from(arity).ok()?)?;
            if count > MOST_WEIGHTS {
                return None;
            }
            let mut tuples: Vec<Vec<String>> = vec![Vec::new()];
            for _ in 0..arity {
                let longer = |tuple: &Vec<String>| {
                    objects.iter().map(|object| [tuple.as_slice(), &[(*object).clone()]].concat()).collect::<Vec<_>>()
                };
                tuples = tuples.iter().flat_map(longer).collect();
            }
            self.weights.extend(tuples.into_iter().map(|objects| {
                let value = (name.to_owned(), objects);
                let weight = sum.weights.get(&value).copied().unwrap_or(0.0);
                ((weight_of(name), value.1), weight)
            }));
        }
        Some(())
    }

    /// Lets the actions of a task cost what they do, whether their durations are still there or not.
    pub(super) fn apply(&self, domain: &mut Domain, problem: &mut Problem) {
        for action in &mut domain.actions {
            let Some(cost) = self.costs.get(&action.name) else { continue };
            let effect = std::mem::replace(&mut action.effect, Effect::And(Vec::new()));
            let cost = Effect::Num(AssignOp::Increase, COST.to_owned(), Vec::new(), cost.clone());
            action.effect = Effect::And(vec![effect, cost]);
        }
        problem.init_fluents.push(((COST.to_owned(), Vec::new()), 0.0));
        problem.init_fluents.extend(self.weights.iter().cloned());
        problem.metric = Some((MetricDir::Minimize, Expr::Fluent(COST.to_owned(), Vec::new())));
    }
}

impl Sum {
    /// The sum that an expression is; values of functions that do not change are numbers.
    fn of(expression: &Expr, problem: &Problem, changed: &HashSet<&str>) -> Option<Self> {
        let of = |expression: &Expr| Self::of(expression, problem, changed);
        Some(match expression {
            Expr::Num(number) => Self::number(*number),
            Expr::Fluent(name, terms) if name == TOTAL_TIME && terms.is_empty() => {
                Self { rate: 1.0, ..Self::default() }
            }
            Expr::Fluent(name, terms) => {
                let objects = terms.iter().map(|term| match term {
                    Term::Const(name) => Some(name.clone()),
                    Term::Var(_) => None,
                });
                let value = (name.clone(), objects.collect::<Option<Vec<_>>>()?);
                let known = problem.init_fluents.iter().find(|(known, _)| *known == value).map(|(_, number)| *number);
                let known = known.or((name == TOTAL_COST).then_some(0.0))?;
                match changed.contains(name.as_str()) {
                    true => Self { weights: HashMap::from([(value, 1.0)]), ..Self::default() },
                    false => Self::number(known),
                }
            }
            Expr::Add(left, right) => of(left)?.plus(of(right)?),
            Expr::Sub(left, right) => {
                let mut right = of(right)?;
                right.scale(-1.0);
                of(left)?.plus(right)
            }
            Expr::Neg(inner) => {
                let mut inner = of(inner)?;
                inner.scale(-1.0);
                inner
            }
            Expr::Mul(left, right) => {
                let (left, right) = (of(left)?, of(right)?);
                let (factor, mut sum) = if left.is_number() { (left, right) } else { (right, left) };
                sum.scale(Some(factor).filter(Self::is_number)?.constant);
                sum
            }
            Expr::Div(left, right) => {
                let (mut sum, divisor) = (of(left)?, of(right)?);
                let divisor = Some(divisor.constant).filter(|number| divisor.is_number() && *number != 0.0)?;
                sum.scale(1.0 / divisor);
                sum
            }
        })
    }

    fn number(constant: f64) -> Self {
        Self { constant, ..Self::default() }
    }

    fn is_number(&self) -> bool {
        self.rate == 0.0 && self.weights.is_empty()
    }

    fn plus(mut self, other: Self) -> Self {
        self.constant += other.constant;
        self.rate += other.rate;
        for (value, weight) in other.weights {
            *self.weights.entry(value).or_insert(0.0) += weight;
        }
        self
    }

    fn scale(&mut self, factor: f64) {
        self.constant *= factor;
        self.rate *= factor;
        self.weights.values_mut().for_each(|weight| *weight *= factor);
    }

    fn is_about(&self, function: &str) -> bool {
        self.weights.keys().any(|(name, _)| name == function)
    }
}

/// The effects of all actions, with the actions' names.
fn effects(domain: &Domain) -> impl Iterator<Item = (&str, &Effect)> {
    let durative = domain.durative_actions.iter();
    let durative = durative.flat_map(|action| action.effects.iter().map(|(_, effect)| (action.name.as_str(), effect)));
    durative.chain(domain.actions.iter().map(|action| (action.name.as_str(), &action.effect)))
}

/// Adds the functions that an effect changes.
fn changes<'a>(effect: &'a Effect, found: &mut HashSet<&'a str>) {
    match effect {
        Effect::Num(_, name, ..) => drop(found.insert(name)),
        Effect::And(parts) => parts.iter().for_each(|part| changes(part, found)),
        Effect::When(_, inner) | Effect::Forall(_, inner) => changes(inner, found),
        Effect::Add(..) | Effect::Del(..) => {}
    }
}

/// Adds what an effect adds to a sum; `None` where it does so under a condition, for several objects, or in another way.
fn costs(effect: &Effect, sum: &Sum, found: &mut Vec<Expr>) -> Option<()> {
    match effect {
        Effect::Num(operation, name, terms, amount) if sum.is_about(name) => {
            let sign = match operation {
                AssignOp::Increase => 1.0,
                AssignOp::Decrease => -1.0,
                _ => return None,
            };
            let weight = match sum.weights.get(&(name.clone(), Vec::new())) {
                Some(weight) => Expr::Num(*weight),
                None => Expr::Fluent(weight_of(name), terms.clone()),
            };
            let times = |left: Expr, right: Expr| Expr::Mul(Box::new(left), Box::new(right));
            found.push(times(times(Expr::Num(sign), weight), amount.clone()));
        }
        Effect::And(parts) => parts.iter().try_for_each(|part| costs(part, sum, found))?,
        Effect::When(_, inner) | Effect::Forall(_, inner) => {
            let mut changed = HashSet::new();
            changes(inner, &mut changed);
            return (!changed.iter().any(|name| sum.is_about(name))).then_some(());
        }
        Effect::Num(..) | Effect::Add(..) | Effect::Del(..) => {}
    }
    Some(())
}

/// The function that says how much the values of another one count.
fn weight_of(function: &str) -> String {
    format!(" WEIGHT {function}")
}
