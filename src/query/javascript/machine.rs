//! The machine of a thread: a QuickJS runtime with the programs that it has compiled.

use std::borrow::Cow;
use std::cell::{Cell, RefCell};
use std::collections::HashMap;
use std::rc::Rc;
use std::time::{Duration, Instant};

use bson::Bson;
use rquickjs::context::EvalOptions;
use rquickjs::function::Args;
use rquickjs::{Context, Ctx, Error, Function, Object, Persistent, Runtime, Value};

use super::convert::{Fault, Types, from_value, to_document, to_value};
use super::predicate::predicate;
use super::script::{Code, Script};
use crate::query::error::{QueryError, Result};
use crate::query::interruption;
use crate::query::view::{Fields, View};

/// How long one call may take.
const TIME_LIMIT: Duration = Duration::from_secs(5);
/// The memory of a machine, in bytes.
const MEMORY_LIMIT: usize = 128 << 20;
/// The stack of a machine, in bytes.
const STACK_LIMIT: usize = 256 << 10;
/// The most programs that a machine keeps.
const MOST_PROGRAMS: usize = 64;

/// MongoDB's code JSInterpreterFailure.
const FAILED: i32 = 139;
/// MongoDB's code for a thrown value that is no error.
const THREW: i32 = 8;

const PRELUDE: &str = include_str!("prelude.js");

thread_local! {
    static MACHINE: RefCell<Option<Machine>> = const { RefCell::new(None) };
}

struct Machine {
    // Before the runtime, which what they hold belongs to.
    programs: HashMap<u64, Compiled>,
    runtime: Runtime,
    deadline: Rc<Cell<Option<Instant>>>,
}

/// A program in a context of its own.
struct Compiled {
    function: Persistent<Function<'static>>,
    types: Persistent<Object<'static>>,
    context: Context,
}

/// Whether a text is a program: a text is read as a whole before the first of it is run, which ends it.
fn parses(ctx: &Ctx<'_>, code: &str) -> bool {
    let mut options = EvalOptions::default();
    options.strict = false;
    let ended: rquickjs::Result<Value<'_>> = ctx.eval_with_options(format!("throw 0;{{{code}\n}}"), options);
    ended.is_err_and(|error| error.is_exception() && ctx.catch().is_number())
}

impl Machine {
    fn new() -> rquickjs::Result<Self> {
        let runtime = Runtime::new()?;
        runtime.set_memory_limit(MEMORY_LIMIT);
        runtime.set_max_stack_size(STACK_LIMIT);
        let deadline = Rc::new(Cell::new(None));
        let watched = Rc::clone(&deadline);
        let is_over = move || {
            watched.get().is_some_and(|deadline: Instant| Instant::now() >= deadline) || interruption::check().is_err()
        };
        runtime.set_interrupt_handler(Some(Box::new(is_over)));
        Ok(Self { programs: HashMap::new(), runtime, deadline })
    }

    fn compile(&mut self, script: &Script) -> Result<()> {
        if self.programs.contains_key(&script.id) {
            return Ok(());
        }
        if self.programs.len() >= MOST_PROGRAMS {
            self.programs.clear();
        }
        let context = Context::full(&self.runtime).map_err(|error| failure(error.to_string()))?;
        let (function, types) = context.with(|ctx| {
            let types: Object<'_> = ctx.eval(PRELUDE).map_err(|error| self.explain(&ctx, &error))?;
            for (name, value) in &script.scope {
                let value = to_value(&ctx, &Types(&types), View::from(value), 0);
                let set = value.and_then(|value| ctx.globals().set(name.as_str(), value));
                set.map_err(|error| self.explain(&ctx, &error))?;
            }
            let mut options = EvalOptions::default();
            // MongoDB's functions are not strict: they may make global variables.
            options.strict = false;
            let source = match &script.code {
                Code::Function(source) => Cow::Borrowed(source.as_str()),
                Code::Predicate(text) => Cow::Owned(predicate(text, &|code| parses(&ctx, code))),
            };
            let value: Value<'_> =
                ctx.eval_with_options(&*source, options).map_err(|error| self.explain(&ctx, &error))?;
            let function = value.into_function().ok_or_else(|| failure("the code is not a function".to_owned()))?;
            Ok::<_, QueryError>((Persistent::save(&ctx, function), Persistent::save(&ctx, types)))
        })?;
        self.programs.insert(script.id, Compiled { function, types, context });
        Ok(())
    }

    /// Runs `work` with the function and the types of a program.
    fn run<T>(
        &mut self,
        script: &Script,
        work: impl for<'js> FnOnce(&Ctx<'js>, &Function<'js>, &Types<'_, 'js>) -> std::result::Result<T, Fault>,
    ) -> Result<T> {
        interruption::check()?;
        self.deadline.set(Some(Instant::now() + TIME_LIMIT));
        self.compile(script)?;
        let Some(compiled) = self.programs.get(&script.id) else { return Err(failure("no program".to_owned())) };
        compiled.context.with(|ctx| {
            let restored = compiled.function.clone().restore(&ctx).and_then(|function| {
                let types = compiled.types.clone().restore(&ctx)?;
                Ok((function, types))
            });
            let (function, types) = restored.map_err(|error| self.explain(&ctx, &error))?;
            work(&ctx, &function, &Types(&types)).map_err(|fault| match fault {
                Fault::Engine(error) => self.explain(&ctx, &error),
                Fault::Value(error) => error,
            })
        })
    }

    /// Says what ended a program.
    fn explain(&self, ctx: &Ctx<'_>, error: &Error) -> QueryError {
        if let Err(interruption) = interruption::check() {
            return interruption;
        }
        if self.deadline.get().is_some_and(|deadline| Instant::now() >= deadline) {
            return failure(format!("it ran longer than {} s", TIME_LIMIT.as_secs()));
        }
        if !error.is_exception() {
            return failure(error.to_string());
        }
        let thrown = ctx.catch();
        if thrown.is_null() {
            return failure(format!("it needs more than {} MB of memory", MEMORY_LIMIT >> 20));
        }
        match thrown.as_exception() {
            Some(exception) => {
                let name: String = exception.get("name").unwrap_or_else(|_| "Error".to_owned());
                let message = exception.message().unwrap_or_default();
                failure(format!("{name}: {message}"))
            }
            None => {
                let shown = thrown.get::<rquickjs::Coerced<String>>().map(|text| text.0).unwrap_or_default();
                QueryError::invalid(THREW, format!("uncaught exception: {shown}"))
            }
        }
    }
}

fn failure(message: String) -> QueryError {
    QueryError::invalid(FAILED, format!("JavaScript failed: {message}"))
}

/// Runs `work` on the machine of this thread, which does not survive an error.
fn with_machine<T>(work: impl FnOnce(&mut Machine) -> Result<T>) -> Result<T> {
    MACHINE.with_borrow_mut(|slot| {
        let machine = match slot {
            Some(machine) => machine,
            None => slot.insert(Machine::new().map_err(|error| failure(error.to_string()))?),
        };
        let result = work(machine);
        if result.is_err() {
            *slot = None;
        }
        result
    })
}

/// Drops what the machine of this thread holds of a program.
pub(super) fn forget(id: u64) {
    let _ = MACHINE.try_with(|slot| {
        if let Ok(mut slot) = slot.try_borrow_mut()
            && let Some(machine) = slot.as_mut()
        {
            machine.programs.remove(&id);
        }
    });
}

/// Returns whether a predicate holds for a document, which it sees as `this` and `obj`.
pub(super) fn holds(script: &Script, document: Fields<'_>) -> Result<bool> {
    with_machine(|machine| {
        machine.run(script, |ctx, function, types| {
            let object = to_document(ctx, types, document, script.fields.as_deref())?;
            ctx.globals().set("obj", object.clone())?;
            let mut arguments = Args::new(ctx.clone(), 0);
            arguments.this(object)?;
            let value: Value<'_> = function.call_arg(arguments)?;
            Ok(value.get::<rquickjs::Coerced<bool>>()?.0)
        })
    })
}

/// Returns what a function gives for arguments.
pub(super) fn call(script: &Script, arguments: &[Option<Bson>]) -> Result<Option<Bson>> {
    with_machine(|machine| {
        machine.run(script, |ctx, function, types| {
            let mut args = Args::new(ctx.clone(), arguments.len());
            for argument in arguments {
                args.push_arg(match argument {
                    Some(argument) => to_value(ctx, types, View::from(argument), 0)?,
                    None => Value::new_undefined(ctx.clone()),
                })?;
            }
            let value: Value<'_> = function.call_arg(args)?;
            Ok(Some(from_value(types, value, 0)?))
        })
    })
}
