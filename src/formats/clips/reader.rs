//! Text to facts and templates, one at a time.

use std::collections::{BTreeSet, HashSet, VecDeque};

use super::command::{self, Content};
use super::defglobal;
use super::deftemplate::{self, local};
use super::expression::{self, evaluate};
use super::function::is_function;
use super::global::Globals;
use super::lexer::{Lexer, Token, TokenKind};
use super::template::Template;
use super::value::{Body, Fact, Filled, Value};
use crate::formats::{Diagnostic, Source, Span};

/// Constructs that are skipped.
const SKIPPED: [&str; 9] = [
    "defrule",
    "deffunction",
    "defglobal",
    "defmodule",
    "defclass",
    "definstances",
    "defmessage-handler",
    "defgeneric",
    "defmethod",
];

/// Something that a text holds.
#[derive(Debug, Clone, PartialEq)]
pub enum Item {
    /// A fact: alone, in `deffacts`, or in `assert`.
    Fact(Fact),
    /// `(deftemplate …)`
    Template(Template),
    /// What was skipped: `defrule`, say, and its name.
    Skipped {
        /// The construct, or the command.
        kind: String,
        /// Its name; empty where it has none.
        name: String,
    },
}

/// Whether a list with this head is not a fact.
#[must_use]
pub fn is_construct(name: &str) -> bool {
    SKIPPED.contains(&name) || matches!(name, "deffacts" | "deftemplate" | "assert")
}

/// Reads what a text holds, in order. After an error nothing more comes.
///
/// In `deffacts` and `assert` a list inside of a fact can be a slot or a call. It is a
/// slot where the template is known, and else unless a plain value comes before it or
/// its head is a function that no slot would be named after, like `create$` or `+`,
/// or one that is called without arguments, like `(now)`.
pub struct Reader<'a> {
    lexer: Lexer<'a>,
    templates: HashSet<String>,
    /// The functions that the text defines.
    functions: HashSet<&'a str>,
    /// The templates that are not known, with slots that have the names of functions.
    doubtful: BTreeSet<(String, String)>,
    globals: Globals,
    /// What one construct held besides what was handed out of it.
    ready: VecDeque<Item>,
    /// The `deffacts` or `assert` that is open.
    group: Option<Span>,
    /// Whether everything but templates is skipped.
    templates_only: bool,
    /// What the whole text consists of, once that was asked.
    content: Option<Content>,
    done: bool,
}

impl<'a> Reader<'a> {
    /// A reader of a text; the names are of templates of other texts.
    pub fn new(source: &'a Source, templates: impl IntoIterator<Item = String>) -> Self {
        Self {
            lexer: Lexer::new(source),
            templates: templates.into_iter().collect(),
            functions: HashSet::new(),
            doubtful: BTreeSet::new(),
            globals: Globals::default(),
            ready: VecDeque::new(),
            group: None,
            templates_only: false,
            content: None,
            done: false,
        }
    }

    /// The same reader, for a text whose facts may use global variables of other texts.
    #[must_use]
    pub fn with_globals(self, globals: Globals) -> Self {
        Self { globals, ..self }
    }

    /// Returns what was taken for slots in `deffacts` and `assert` and would be calls of functions in CLIPS, unless
    /// a template has such slots: names of templates that are not known, and of slots.
    #[must_use]
    pub fn doubtful(&self) -> &BTreeSet<(String, String)> {
        &self.doubtful
    }

    /// Returns the global variables that are known after what was read.
    #[must_use]
    pub fn into_globals(self) -> Globals {
        self.globals
    }

    /// A reader that passes over everything but templates and global variables, whatever it holds.
    pub fn of_templates(source: &'a Source) -> Self {
        Self { templates_only: true, ..Self::new(source, []) }
    }

    fn step(&mut self) -> Result<Option<Item>, Diagnostic> {
        loop {
            if let Some(item) = self.ready.pop_front() {
                return Ok(Some(item));
            }
            let token = self.lexer.next()?;
            match (token.kind, self.group) {
                (TokenKind::End, None) => return Ok(None),
                (TokenKind::Close, Some(_)) => self.group = None,
                (TokenKind::Open, Some(_)) => return self.fact(token.span).map(|fact| Some(Item::Fact(fact))),
                (TokenKind::Open, None) => {
                    if let Some(item) = self.list(token.span)? {
                        return Ok(Some(item));
                    }
                }
                (_, Some(open)) => return Err(self.unclosed(token, open, "a fact `(…)` or `)`")),
                (TokenKind::Symbol, None) if self.is_listing(token)? => self.pass_listing(token)?,
                (TokenKind::Close, None) => {
                    return Err(self.lexer.wrong(token, "a fact or a construct `(…)`").hint("no list is open here"));
                }
                _ => return Err(self.lexer.wrong(token, "a fact or a construct `(…)`")),
            }
        }
    }

    /// Whether a word is of a listing that CLIPS prints: `f-12` before a fact, the total below them, or the prompt.
    fn is_listing(&mut self, word: Token) -> Result<bool, Diagnostic> {
        let is_index = |text: &str| {
            let number = text.strip_prefix("f-").unwrap_or_default();
            !number.is_empty() && number.bytes().all(|byte| byte.is_ascii_digit())
        };
        let next = self.lexer.peek(0)?;
        Ok(match self.lexer.text(word) {
            "CLIPS>" => matches!(next.kind, TokenKind::Open | TokenKind::End),
            "For" => {
                let words = [next, self.lexer.peek(1)?, self.lexer.peek(2)?];
                words.map(|word| self.lexer.text(word)) == ["a", "total", "of"]
            }
            text => is_index(text) && next.kind == TokenKind::Open,
        })
    }

    /// Passes over what a listing has beside its facts: the command after a prompt, or the line with the total.
    fn pass_listing(&mut self, word: Token) -> Result<(), Diagnostic> {
        match self.lexer.text(word) {
            "CLIPS>" if self.lexer.peek(0)?.kind == TokenKind::Open => {
                let open = self.lexer.next()?.span;
                self.skip(open, "")?;
            }
            // `For a total of 12 facts.`
            "For" => {
                for _ in 0..5 {
                    self.lexer.next()?;
                }
            }
            _ => {}
        }
        Ok(())
    }

    /// A list at the top; nothing comes of the beginning of a group.
    fn list(&mut self, open: Span) -> Result<Option<Item>, Diagnostic> {
        let head = self.lexer.peek(0)?;
        let name = if head.kind == TokenKind::Symbol { self.lexer.text(head) } else { "" };
        match name {
            "defglobal" => {
                self.lexer.next()?;
                let names = defglobal::read(&mut self.lexer, open, &mut self.globals)?;
                let skipped = |name: &str| Item::Skipped { kind: "defglobal".to_owned(), name: name.to_owned() };
                self.ready.extend(names.into_iter().map(skipped));
                Ok(None)
            }
            _ if !self.templates.contains(local(name)) && command::meant(name).is_some() => {
                let meant = command::meant(name).unwrap_or_default();
                let error = self.lexer.wrong(head, "a fact or a construct");
                Err(error.hint(format!("did you mean `{meant}`?")))
            }
            _ if self.templates_only && name != "deftemplate" => self.skip(open, name).map(Some),
            "deftemplate" => {
                self.lexer.next()?;
                let template =
                    deftemplate::read(&mut self.lexer, &self.globals).map_err(|error| self.opened(error, open))?;
                self.templates.insert(template.name.clone());
                Ok(Some(Item::Template(template)))
            }
            "deffacts" => {
                self.lexer.next()?;
                let name = self.lexer.next()?;
                if name.kind != TokenKind::Symbol {
                    return Err(self.lexer.wrong(name, "the name of these facts"));
                }
                if self.lexer.peek(0)?.kind == TokenKind::Text {
                    self.lexer.next()?;
                }
                self.begin(open)
            }
            "assert" => {
                self.lexer.next()?;
                self.begin(open)
            }
            _ if SKIPPED.contains(&name) || self.is_command(name) => self.skip(open, name).map(Some),
            _ => self.fact(open).map(|fact| Some(Item::Fact(fact))),
        }
    }

    /// Whether CLIPS would run a list with this head, and not take it for a fact.
    fn is_command(&mut self, name: &str) -> bool {
        if name.is_empty() || self.templates.contains(local(name)) {
            return false;
        }
        if command::is_unmistakable(name) {
            return true;
        }
        let text = self.lexer.source.text();
        match *self.content.get_or_insert_with(|| Content::of(text)) {
            Content::Facts => false,
            Content::Constructs => command::is_command(name),
            Content::Program => true,
        }
    }

    fn begin(&mut self, open: Span) -> Result<Option<Item>, Diagnostic> {
        self.group = Some(open);
        Ok(None)
    }

    /// Passes over a list whose head is the next word.
    fn skip(&mut self, open: Span, kind: &str) -> Result<Item, Diagnostic> {
        let first = self.lexer.peek(1)?;
        let is_named = SKIPPED.contains(&kind) || command::is_named(kind);
        let name = match first.kind {
            TokenKind::Open | TokenKind::Close => String::new(),
            _ if !is_named => String::new(),
            _ => self.lexer.text(first).to_owned(),
        };
        if matches!(kind, "deffunction" | "defgeneric" | "defmethod") && first.kind == TokenKind::Symbol {
            self.functions.insert(local(self.lexer.text(first)));
        }
        let mut depth = 1_usize;
        while depth > 0 {
            let token = self.lexer.next()?;
            match token.kind {
                TokenKind::Open => depth += 1,
                TokenKind::Close => depth -= 1,
                TokenKind::End => return Err(self.unclosed(token, open, "`)`")),
                _ => {}
            }
        }
        Ok(Item::Skipped { kind: kind.to_owned(), name })
    }

    /// A fact behind its `(`.
    fn fact(&mut self, open: Span) -> Result<Fact, Diagnostic> {
        let head = self.lexer.next()?;
        if head.kind != TokenKind::Symbol {
            let error = self.unclosed(head, open, "the name of a template");
            let is_instance = head.kind == TokenKind::Instance;
            return Err(if is_instance { error.hint("instances of classes cannot be imported") } else { error });
        }
        let name = self.lexer.text(head);
        let (body, end) = if self.has_slots(name)? {
            let (mut slots, end) = self.slots(name, open)?;
            for name in self.lexer.remark(end.end)? {
                slots.iter_mut().filter(|slot| slot.name == name).for_each(|slot| slot.multiple = true);
            }
            (Body::Slots(slots), end)
        } else {
            let (values, end, _) = self.values(open).map_err(|error| self.without_template(error, name))?;
            (Body::Ordered(values), end)
        };
        Ok(Fact { name: name.to_owned(), body, span: open.to(end) })
    }

    /// Whether what follows the name of a fact are slots.
    fn has_slots(&mut self, name: &str) -> Result<bool, Diagnostic> {
        let known = self.templates.contains(local(name));
        let next = self.lexer.peek(0)?;
        if next.kind != TokenKind::Open {
            return Ok(known && next.kind == TokenKind::Close);
        }
        if known || self.group.is_none() {
            return Ok(true);
        }
        let head = self.lexer.peek(1)?;
        let head = self.lexer.text(head);
        let is_empty = self.lexer.peek(2)?.kind == TokenKind::Close;
        Ok(!(expression::is_call(head) || is_empty && self.is_function(head)))
    }

    /// Whether a word is the name of a function, of CLIPS or of the text.
    fn is_function(&self, name: &str) -> bool {
        is_function(name) || self.functions.contains(name)
    }

    /// Says how a list becomes a slot, where it was taken for a call for want of a template.
    fn without_template(&self, error: Diagnostic, name: &str) -> Diagnostic {
        let is_call = self.lexer.source.slice(error.span()).starts_with('(');
        if self.group.is_none() || self.templates.contains(local(name)) || !is_call {
            return error;
        }
        error.hint(format!(
            "no deftemplate `{name}` is known, so this is a call of a function, as in CLIPS; \
             if it is a slot, name the file of the deftemplate: --deftemplates FILE"
        ))
    }

    /// Notes a slot of a template that is not known which CLIPS would take for a call.
    ///
    /// # Errors
    /// Where it is one without arguments: no slot looks like that.
    fn doubt(&mut self, template: &str, slot: &Filled) -> Result<(), Diagnostic> {
        if self.group.is_none() || self.templates.contains(local(template)) || !self.is_function(&slot.name) {
            return Ok(());
        }
        if slot.values.is_empty() && !slot.computed {
            let message = format!("`{}` is a function, which rmem does not evaluate here", slot.name);
            let error = Diagnostic::new(self.lexer.source, slot.span, message);
            return Err(self.without_template(error, template));
        }
        self.doubtful.insert((local(template).to_owned(), slot.name.clone()));
        Ok(())
    }

    /// Slots of a fact of this template up to its `)`.
    fn slots(&mut self, template: &str, fact: Span) -> Result<(Vec<Filled>, Span), Diagnostic> {
        let mut slots: Vec<Filled> = Vec::new();
        loop {
            let token = self.lexer.next()?;
            match token.kind {
                TokenKind::Close => return Ok((slots, token.span)),
                TokenKind::Open => {}
                _ => return Err(self.unclosed(token, fact, "a slot `(name value)` or `)`")),
            }
            let head = self.lexer.next()?;
            if head.kind != TokenKind::Symbol {
                return Err(self.unclosed(head, token.span, "the name of a slot"));
            }
            let name = self.lexer.text(head);
            let (values, end, computed) = self.values(token.span)?;
            let span = token.span.to(end);
            if slots.iter().any(|slot| slot.name == name) {
                return Err(Diagnostic::new(self.lexer.source, span, format!("the slot `{name}` is given twice")));
            }
            let slot = Filled { name: name.to_owned(), values, multiple: false, computed, span };
            self.doubt(template, &slot)?;
            slots.push(slot);
        }
    }

    /// Values up to the `)` of their list, and whether some of them were computed.
    fn values(&mut self, open: Span) -> Result<(Vec<Value>, Span, bool), Diagnostic> {
        let (mut values, mut computed) = (Vec::new(), false);
        loop {
            let token = self.lexer.peek(0)?;
            match token.kind {
                TokenKind::Close => {
                    self.lexer.next()?;
                    return Ok((values, token.span, computed));
                }
                TokenKind::End => return Err(self.unclosed(token, open, "a value or `)`")),
                TokenKind::Open => {
                    computed = true;
                    values.extend(evaluate(&mut self.lexer, &self.globals)??);
                }
                // `=(+ 1 2)` is another spelling of the call.
                TokenKind::Symbol if self.lexer.text(token) == "=" && self.lexer.peek(1)?.kind == TokenKind::Open => {
                    self.lexer.next()?;
                }
                _ => {
                    self.lexer.next()?;
                    computed |= token.kind == TokenKind::Variable;
                    match self.group {
                        Some(_) => values.extend(self.globals.values(&self.lexer, token)?),
                        None => values.push(self.lexer.value(token)?),
                    }
                }
            }
        }
    }

    /// Complains about a word in a list; at the end of the text, says which list is not closed.
    fn unclosed(&self, token: Token, open: Span, expected: &str) -> Diagnostic {
        let error = self.lexer.wrong(token, expected);
        if token.kind == TokenKind::End { self.opened(error, open) } else { error }
    }

    fn opened(&self, error: Diagnostic, open: Span) -> Diagnostic {
        if error.span().start < self.lexer.source.text().len() || !error.hints().is_empty() {
            return error;
        }
        let (line, column) = self.lexer.source.position(open.start);
        error.hint(format!("the list opened at {line}:{column} is not closed"))
    }
}

impl Iterator for Reader<'_> {
    type Item = Result<Item, Diagnostic>;

    fn next(&mut self) -> Option<Self::Item> {
        if self.done {
            return None;
        }
        let item = self.step().transpose();
        self.done = !matches!(item, Some(Ok(_)));
        item
    }
}
