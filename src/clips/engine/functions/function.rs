//! A function that programs can call.

use super::arguments::Arguments;
use super::failure::Failure;
use crate::clips::engine::native::{Environment, Value};
use crate::clips::engine::state::State;

/// A function: all its names, its least and greatest number of arguments, and what it does.
pub(super) struct Function {
    pub(super) names: &'static [&'static str],
    pub(super) least: u16,
    pub(super) most: Option<u16>,
    pub(super) body: Body,
}

pub(super) type Body = for<'s> fn(&'s State<'_>, &'s Environment, Arguments<'s>) -> Result<Value, Failure>;

pub(super) const fn function(names: &'static [&'static str], least: u16, most: u16, body: Body) -> Function {
    Function { names, least, most: Some(most), body }
}

pub(super) const fn open(names: &'static [&'static str], least: u16, body: Body) -> Function {
    Function { names, least, most: None, body }
}
