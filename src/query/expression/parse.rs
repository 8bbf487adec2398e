//! Parses expressions.

use bson::{Bson, Document};

use super::constants::gathered;
use super::form;
use super::mistake;
use super::operator::{Arguments, Named, Operator};
use super::register;
use super::scope::Scope;
use super::tree::{Expression, Source, constant};
use super::value::Value;
use crate::query::dollar::is_reference_key;
use crate::query::error::{QueryError, Result};
use crate::query::text::{SCORE, meta};

/// How deep expressions may be nested.
const MAX_DEPTH: usize = 200;

/// Operators whose value differs from call to call.
const VOLATILE: [&str; 2] = ["$rand", "$sampleRate"];

/// Operators that mongod does not fold, even if all arguments are constants.
const UNFOLDED: [&str; 13] = [
    "$firstN",
    "$lastN",
    "$maxN",
    "$minN",
    "$regexFind",
    "$regexFindAll",
    "$regexMatch",
    "$replaceAll",
    "$replaceOne",
    "$setField",
    "$sortArray",
    "$unsetField",
    "$zip",
];

/// Returns whether it is a constant other than an array.
fn is_no_array(operand: &Expression) -> bool {
    matches!(operand, Expression::Constant(value) if !matches!(value, Some(Bson::Array(_))))
}

/// Checks an argument of `$zip`, which has to be written as what it is.
fn check_zipped(name: &str, value: &Bson) -> Result<()> {
    match (name, value) {
        ("inputs", Bson::Array(_)) | ("defaults", Bson::Array(_)) | ("useLongestLength", Bson::Boolean(_)) => Ok(()),
        ("inputs", _) => Err(QueryError::invalid(34_461, "inputs must be an array of expressions")),
        ("defaults", _) => Err(QueryError::invalid(34_462, "defaults must be an array of expressions")),
        _ => Err(QueryError::invalid(34_463, "useLongestLength must be a bool")),
    }
}

/// Checks constant arguments that mongod checks while parsing.
fn check_constants(operator: &Named, arguments: &[Option<Expression>]) -> Result<()> {
    match (operator.name, arguments) {
        ("$zip", [Some(Expression::Constant(Some(Bson::Array(inputs)))), ..]) if inputs.is_empty() => {
            Err(QueryError::invalid(34_465, "$zip requires at least one input array"))
        }
        ("$zip", [_, longest, Some(_)])
            if !matches!(longest, Some(Expression::Constant(Some(Bson::Boolean(true))))) =>
        {
            Err(QueryError::invalid(34_466, "cannot specify defaults unless useLongestLength is true"))
        }
        // With a null input, these only check their other arguments.
        ("$sortArray" | "$regexFind" | "$regexFindAll" | "$regexMatch", [_, rest @ ..])
            if rest.iter().flatten().all(Expression::is_constant) =>
        {
            let rest = rest.iter().map(|argument| argument.as_ref().map(constant).transpose());
            let values = std::iter::once(Ok(Some(Some(Bson::Null)))).chain(rest).collect::<Result<_>>()?;
            operator.run(&Arguments { operator: operator.name, values }).map(drop)
        }
        _ => Ok(()),
    }
}

/// Reads expressions in a scope.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reader<'a> {
    pub(super) scope: &'a Scope,
    depth: usize,
    /// Whether constants are evaluated while parsing: then an invalid constant is an error even if its value is not
    /// needed.
    folds: bool,
}

impl<'a> Reader<'a> {
    pub(super) fn new(scope: &'a Scope) -> Self {
        Self { scope, depth: 0, folds: !scope.lazy }
    }

    /// Returns the reader with other variables.
    pub(super) fn within<'b>(&self, scope: &'b Scope) -> Reader<'b> {
        Reader { scope, ..*self }
    }

    /// Returns whether constants are evaluated while parsing.
    pub(super) fn folds(&self) -> bool {
        self.folds
    }

    /// Returns the reader with constant folding turned off.
    pub(super) fn lazily(&self) -> Self {
        Self { folds: false, ..*self }
    }

    pub(super) fn read(&self, value: &Bson) -> Result<Expression> {
        if self.depth > MAX_DEPTH {
            return Err(QueryError::invalid(15, "the expression is nested too deeply"));
        }
        let deeper = Self { depth: self.depth + 1, ..*self };
        match value {
            Bson::String(text) if text.starts_with('$') => deeper.path(text),
            Bson::Array(items) => {
                let items: Vec<_> = items.iter().map(|item| deeper.read(item)).collect::<Result<_>>()?;
                let all_constant = items.iter().all(Expression::is_constant);
                deeper.folded(Expression::Array(items), all_constant)
            }
            Bson::Document(document) => match document.iter().next() {
                Some((name, argument)) if name.starts_with('$') => {
                    if document.len() > 1 {
                        let message = "an object representing an expression must have exactly one field";
                        return Err(QueryError::invalid(15_983, message));
                    }
                    deeper.operator(name, argument).map_err(|error| error.about(name))
                }
                _ => deeper.document(document),
            },
            value => Ok(Expression::Constant(Some(value.clone()))),
        }
    }

    fn document(&self, document: &Document) -> Result<Expression> {
        let mut fields = Vec::with_capacity(document.len());
        for (name, value) in document {
            if name.starts_with('$') || name.contains('.') || name.is_empty() {
                let message =
                    format!("the field name '{name}' in an expression may not be empty, or have '.' or a leading '$'");
                let is_path = name.contains('.') && !name.starts_with('$');
                return Err(QueryError::invalid(if is_path { 16_412 } else { 16_410 }, message).about(name));
            }
            fields.push((name.clone(), self.read(value)?));
        }
        let all_constant = fields.iter().all(|(_, field)| field.is_constant());
        self.folded(Expression::Document(fields), all_constant)
    }

    /// Returns the expression, or its value, where that is known before there is a document.
    fn folded(&self, expression: Expression, is_constant: bool) -> Result<Expression> {
        match is_constant && self.folds {
            true => Ok(Expression::Constant(constant(&expression)?)),
            false => Ok(expression),
        }
    }

    fn operator(&self, name: &str, argument: &Bson) -> Result<Expression> {
        if matches!(name, "$literal" | "$const") {
            return Ok(Expression::Constant(Some(argument.clone())));
        }
        if name == "$meta" {
            meta(argument)?;
            return Ok(Expression::Path(Source::Root, vec![SCORE.to_owned()]));
        }
        if let Some(form) = form::read(self, name, argument)? {
            return if self.folds { form.folded() } else { Ok(Expression::Form(Box::new(form))) };
        }
        if let Some(operator) = register::named(name) {
            return self.named(operator, argument);
        }
        let operator = register::positional(name).ok_or_else(|| register::unknown(name))?;
        let arguments = self.positional(operator, argument)?;
        let fold = arguments.iter().all(Expression::is_constant) && !VOLATILE.contains(&name);
        // mongod checks these constant arguments while parsing.
        match (name, arguments.as_slice()) {
            ("$setEquals", operands) if self.folds && operands.iter().any(is_no_array) => {
                return Err(QueryError::invalid(5_887_502, "all operands of $setEquals must be arrays"));
            }
            ("$setIsSubset", [_, Expression::Constant(set)])
                if self.folds && !fold && !matches!(set, Some(Bson::Array(_))) =>
            {
                return Err(QueryError::invalid(17_311, "the second operand of $setIsSubset must be an array"));
            }
            ("$indexOfArray", [Expression::Constant(Some(array)), ..])
                if self.folds && !fold && !matches!(array, Bson::Array(_) | Bson::Null | Bson::Undefined) =>
            {
                return Err(QueryError::invalid(50_809, "the first operand of $indexOfArray must be an array"));
            }
            _ => {}
        }
        let arguments = if fold || !self.folds { arguments } else { gathered(operator, arguments)? };
        self.folded(Expression::Call(operator, arguments), fold)
    }

    fn positional(&self, operator: &Operator, argument: &Bson) -> Result<Vec<Expression>> {
        self.arguments(operator.name, operator.arity, argument)
    }

    /// Returns the arguments of an operator: an array, or one that is none.
    pub(super) fn arguments(&self, name: &str, arity: (usize, usize), argument: &Bson) -> Result<Vec<Expression>> {
        let arguments: Vec<_> = match argument {
            Bson::Array(items) => items.iter().map(|item| self.read(item)).collect::<Result<_>>()?,
            Bson::Document(document) if arity == (0, 0) && document.is_empty() => Vec::new(),
            other => vec![self.read(other)?],
        };
        if arguments.len() < arity.0 || arguments.len() > arity.1 {
            return Err(mistake::count(name, arity, arguments.len()));
        }
        Ok(arguments)
    }

    fn named(&self, operator: &'static Named, argument: &Bson) -> Result<Expression> {
        let mut arguments: Vec<Option<Expression>> = operator.fields.iter().map(|_| None).collect();
        let is_expression = |fields: &Document| fields.keys().next().is_some_and(|name| name.starts_with('$'));
        let is_names = matches!(argument, Bson::Document(fields) if !operator.bare || !is_expression(fields));
        match argument {
            Bson::Document(fields) if is_names => {
                for (name, value) in fields {
                    let index = operator.fields.iter().position(|(known, _)| known == name);
                    let place = index.and_then(|index| arguments.get_mut(index));
                    let place = place.ok_or_else(|| mistake::unknown(operator.name, name))?;
                    if operator.name == "$zip" {
                        check_zipped(name, value)?;
                    }
                    *place = Some(match (name.as_str(), operator.name) {
                        // A pattern of a sort is no expression.
                        ("sortBy", _) => Expression::Constant(Some(value.clone())),
                        ("field", "$getField" | "$setField" | "$unsetField") => self.literal(operator.name, value)?,
                        _ => self.read(value)?,
                    });
                }
            }
            other if operator.name == "$getField" => {
                if let Some(place) = arguments.first_mut() {
                    *place = Some(self.literal(operator.name, other)?);
                }
            }
            other if operator.bare => {
                let mut read = self.arguments(operator.name, (1, 1), other)?;
                if let (Some(place), Some(only)) = (arguments.first_mut(), read.pop()) {
                    *place = Some(only);
                }
            }
            _ => return Err(mistake::shape(operator.name)),
        }
        if operator.name == "$getField"
            && !is_names
            && let Some(input @ None) = arguments.get_mut(1)
        {
            *input = Some(self.variable("CURRENT", Vec::new())?);
        }
        let fields = operator.fields.iter().zip(&arguments);
        let absent = fields.filter(|((_, required), value)| *required && value.is_none()).map(|((name, _), _)| *name);
        if let Some(error) = mistake::missing(operator.name, &absent.collect::<Vec<_>>()) {
            return Err(error);
        }
        if self.folds {
            check_constants(operator, &arguments)?;
        }
        let fold = arguments.iter().flatten().all(Expression::is_constant) && !UNFOLDED.contains(&operator.name);
        self.folded(Expression::Named(operator, arguments), fold)
    }

    /// Reads a constant string without evaluating it.
    fn literal(&self, operator: &str, value: &Bson) -> Result<Expression> {
        let (path, varying, no_string) = match operator {
            "$getField" => (5_654_600, 5_654_601, 5_654_602),
            _ => (4_161_108, 4_161_106, 4_161_107),
        };
        let code = match self.lazily().read(value)? {
            constant @ Expression::Constant(Some(Bson::String(_))) => return Ok(constant),
            Expression::Constant(_) => no_string,
            Expression::Path(..) => path,
            _ => varying,
        };
        Err(QueryError::invalid(code, format!("{operator} requires 'field' to be a constant string")))
    }

    /// `$path`, `$$variable.path`.
    fn path(&self, text: &str) -> Result<Expression> {
        if let Some(variable) = text.strip_prefix("$$") {
            let (name, path) = variable.split_once('.').map_or((variable, None), |(name, path)| (name, Some(path)));
            let path = path.map_or(Ok(Vec::new()), parts)?;
            return self.variable(name, path);
        }
        let path = text.strip_prefix('$').unwrap_or(text);
        if path.is_empty() {
            return Err(QueryError::invalid(16_872, "'$' by itself is not a path").about("$"));
        }
        let path = parts(path)?;
        match self.scope.find("CURRENT") {
            Some(slot) => Ok(Expression::Path(Source::Slot(slot), path)),
            None => Ok(Expression::Path(Source::Root, path)),
        }
    }

    fn variable(&self, name: &str, path: Vec<String>) -> Result<Expression> {
        if let Some(slot) = self.scope.find(name) {
            return Ok(Expression::Path(Source::Slot(slot), path));
        }
        match name {
            "ROOT" | "CURRENT" => Ok(Expression::Path(Source::Root, path)),
            "NOW" => Ok(Expression::Path(Source::Now, path)),
            "REMOVE" => Ok(Expression::Constant(None)),
            "KEEP" | "PRUNE" | "DESCEND" if self.scope.redacting => Ok(Expression::Constant(marker(name))),
            "CLUSTER_TIME" => Ok(Expression::Path(Source::ClusterTime, path)),
            _ => {
                let starts = name.chars().next().is_some_and(|c| c.is_ascii_alphabetic() || !c.is_ascii());
                let error = match starts {
                    true => QueryError::invalid(17_276, format!("use of undefined variable: {name}")),
                    false => QueryError::failed_to_parse(format!("not a valid name of a variable: {name}")),
                };
                Err(error.about(&format!("$${name}")))
            }
        }
    }
}

/// Returns the value of `$$KEEP`, `$$PRUNE` or `$$DESCEND`.
fn marker(name: &str) -> Value {
    Some(Bson::String(name.to_ascii_lowercase()))
}

/// Returns the parts of a path in an expression.
pub(super) fn parts(path: &str) -> Result<Vec<String>> {
    let parts: Vec<String> = path.split('.').map(str::to_owned).collect();
    if parts.len() > MAX_DEPTH {
        return Err(QueryError::invalid(5_729_101, "a path has more than 200 parts"));
    }
    for part in &parts {
        if path.is_empty() || path.ends_with('.') {
            return Err(QueryError::invalid(40_353, format!("the field path '{path}' ends with a dot")));
        }
        if part.is_empty() {
            return Err(QueryError::invalid(15_998, format!("the field path '{path}' has an empty part")));
        }
        // The keys of a DBRef are names of fields.
        if part.starts_with('$') && !is_reference_key(part) {
            return Err(QueryError::invalid(
                16_410,
                format!("the field path '{path}' has a part that starts with '$'"),
            )
            .about(part));
        }
        if part.contains('\0') {
            return Err(QueryError::invalid(16_411, "a field path may not contain a NUL"));
        }
    }
    Ok(parts)
}
