//! What is seen, and how keys change it.

use std::time::Duration;

use bson::Document;

use crate::formats::{Source, shell};
use crate::memory::Memory;
use crate::memory::watch::{Trigger, Watch};
use crate::query::QueryError;
use crate::store::{Find, Namespace, Next, StoreError};

/// At most so many documents are read at once.
const PAGE: u64 = 1000;

/// A key that means something.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Key {
    /// A character.
    Char(char),
    /// One line up.
    Up,
    /// One line down.
    Down,
    /// Many lines up.
    PageUp,
    /// Many lines down.
    PageDown,
    /// To the first line.
    Home,
    /// To the last line.
    End,
    /// Into what is selected.
    Enter,
    /// Back.
    Back,
    /// The last character goes.
    Erase,
}

/// One of the things that are seen on top of each other.
pub(super) enum Screen<'a> {
    Collections { names: Vec<(Namespace, u64)>, selected: usize },
    Documents(Box<Documents<'a>>),
    Text { title: String, lines: Vec<String>, top: usize },
}

/// The documents of a collection.
pub(super) struct Documents<'a> {
    pub(super) namespace: Namespace,
    pub(super) filter: String,
    pub(super) sort: String,
    pub(super) rows: Vec<Document>,
    pub(super) total: u64,
    pub(super) selected: usize,
    watch: Option<Watch<'a>>,
}

/// What is being typed.
pub(super) struct Prompt {
    pub(super) title: &'static str,
    pub(super) text: String,
    is_sort: bool,
}

/// What is seen.
pub struct Browser<'a> {
    memory: &'a Memory,
    pub(super) screens: Vec<Screen<'a>>,
    pub(super) prompt: Option<Prompt>,
    /// What went wrong last, or is worth a line.
    pub(super) message: String,
    is_over: bool,
}

impl<'a> Browser<'a> {
    /// Begins with the collections, or with the documents of one.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn new(memory: &'a Memory, namespace: Option<Namespace>) -> Result<Self, StoreError> {
        let mut browser = Self { memory, screens: Vec::new(), prompt: None, message: String::new(), is_over: false };
        let names = browser.collections()?;
        browser.screens.push(Screen::Collections { names, selected: 0 });
        if let Some(namespace) = namespace {
            browser.open(namespace, String::new())?;
        }
        Ok(browser)
    }

    /// Whether the user has had enough.
    #[must_use]
    pub fn is_over(&self) -> bool {
        self.is_over
    }

    /// Handles a key. Errors are shown in the last line.
    pub fn press(&mut self, key: Key, height: usize) {
        self.message.clear();
        let done = if self.prompt.is_some() { self.type_in(key) } else { self.command(key, height) };
        if let Err(error) = done {
            self.message = error.to_string();
        }
    }

    /// Reads again what has changed; says whether anything did.
    ///
    /// # Errors
    /// Where the store fails.
    pub fn refresh(&mut self) -> Result<bool, StoreError> {
        let memory = self.memory;
        let Some(Screen::Documents(documents)) = self.screens.last_mut() else { return Ok(false) };
        let mut is_changed = false;
        if let Some(watch) = &mut documents.watch {
            while let Next::Change(_) = watch.next(Duration::ZERO)? {
                is_changed = true;
            }
            watch.done()?;
        }
        if is_changed {
            documents.read(memory)?;
        }
        Ok(is_changed)
    }

    fn command(&mut self, key: Key, height: usize) -> Result<(), StoreError> {
        match key {
            Key::Char('q') => self.is_over = true,
            Key::Back | Key::Erase if self.screens.len() > 1 => drop(self.screens.pop()),
            Key::Back | Key::Erase => {}
            Key::Enter => self.enter()?,
            Key::Char('/') => self.ask(false),
            Key::Char('s') => self.ask(true),
            Key::Char('e') => self.explain()?,
            Key::Char('p') => self.plan()?,
            Key::Char('c') => self.computables()?,
            Key::Char('r') => self.reread()?,
            Key::Up | Key::Char('k') => self.go(-1),
            Key::Down | Key::Char('j') => self.go(1),
            Key::PageUp => self.go(-(height.max(1) as isize)),
            Key::PageDown => self.go(height.max(1) as isize),
            Key::Home => self.go(isize::MIN / 2),
            Key::End => self.go(isize::MAX / 2),
            Key::Char(_) => {}
        }
        Ok(())
    }

    /// Moves the selection, or the text.
    fn go(&mut self, by: isize) {
        let (place, count) = match self.screens.last_mut() {
            Some(Screen::Collections { names, selected }) => (selected, names.len()),
            Some(Screen::Documents(documents)) => (&mut documents.selected, documents.rows.len()),
            Some(Screen::Text { lines, top, .. }) => (top, lines.len()),
            None => return,
        };
        *place = place.saturating_add_signed(by).min(count.saturating_sub(1));
    }

    fn enter(&mut self) -> Result<(), StoreError> {
        let next = match self.screens.last() {
            Some(Screen::Collections { names, selected }) => {
                let Some((namespace, _)) = names.get(*selected) else { return Ok(()) };
                return self.open(namespace.clone(), String::new());
            }
            Some(Screen::Documents(documents)) => documents.rows.get(documents.selected).map(|document| {
                let text = shell::pretty(&document.clone().into());
                (documents.namespace.to_string(), text)
            }),
            _ => None,
        };
        if let Some((title, text)) = next {
            self.show(title, &text);
        }
        Ok(())
    }

    fn show(&mut self, title: String, text: &str) {
        let lines = text.lines().map(str::to_owned).collect();
        self.screens.push(Screen::Text { title, lines, top: 0 });
    }

    fn open(&mut self, namespace: Namespace, filter: String) -> Result<(), StoreError> {
        let trigger = Trigger {
            namespace: namespace.clone(),
            filter: Document::new(),
            name: None,
            computed: false,
            metadata: false,
        };
        // A store without change streams is browsed all the same; `r` reads again.
        let watch = self.memory.watch(trigger).ok();
        let mut documents =
            Documents { namespace, filter, sort: String::new(), rows: Vec::new(), total: 0, selected: 0, watch };
        documents.read(self.memory)?;
        self.screens.push(Screen::Documents(Box::new(documents)));
        Ok(())
    }

    /// The collections that can be reached; where a store cannot, the last line says why.
    fn collections(&mut self) -> Result<Vec<(Namespace, u64)>, StoreError> {
        let (names, all) = self.memory.reachable_collections();
        if let Err(error) = all {
            if names.is_empty() {
                return Err(error);
            }
            self.message = error.to_string();
        }
        let names = names.into_iter();
        names.map(|name| self.memory.count(&name, &Document::new()).map(|count| (name, count))).collect()
    }

    fn reread(&mut self) -> Result<(), StoreError> {
        let fresh = self.collections()?;
        let memory = self.memory;
        match self.screens.last_mut() {
            Some(Screen::Documents(documents)) => documents.read(memory),
            Some(Screen::Collections { names, selected }) => {
                *selected = (*selected).min(fresh.len().saturating_sub(1));
                *names = fresh;
                Ok(())
            }
            _ => Ok(()),
        }
    }

    /// Asks for a query, or for an order.
    fn ask(&mut self, is_sort: bool) {
        let Some(Screen::Documents(documents)) = self.screens.last() else {
            "open a collection first: Enter".clone_into(&mut self.message);
            return;
        };
        let (title, text) = if is_sort {
            ("sort, like {name: 1}", &documents.sort)
        } else {
            ("query, like {type: 'cup'}", &documents.filter)
        };
        self.prompt = Some(Prompt { title, text: text.clone(), is_sort });
    }

    fn type_in(&mut self, key: Key) -> Result<(), StoreError> {
        let Some(prompt) = &mut self.prompt else { return Ok(()) };
        match key {
            Key::Char(c) => prompt.text.push(c),
            Key::Erase => drop(prompt.text.pop()),
            Key::Back => self.prompt = None,
            Key::Enter => return self.answer(),
            _ => {}
        }
        Ok(())
    }

    /// Takes what was typed; what is not a query stays to be corrected.
    fn answer(&mut self) -> Result<(), StoreError> {
        let (Some(prompt), Some(Screen::Documents(documents))) = (&self.prompt, self.screens.last_mut()) else {
            return Ok(());
        };
        let text = prompt.text.trim().to_owned();
        let place = if prompt.is_sort { &mut documents.sort } else { &mut documents.filter };
        let before = std::mem::replace(place, text);
        match documents.read(self.memory) {
            Ok(()) => {
                documents.selected = 0;
                self.prompt = None;
                Ok(())
            }
            Err(error) => {
                let place = if prompt.is_sort { &mut documents.sort } else { &mut documents.filter };
                *place = before;
                Err(error)
            }
        }
    }

    /// Says how the query is answered.
    fn explain(&mut self) -> Result<(), StoreError> {
        let Some(Screen::Documents(documents)) = self.screens.last() else { return Ok(()) };
        let find = documents.find()?;
        let explained = self.memory.explain(&documents.namespace, &find)?;
        let title = format!("explain {} {}", documents.namespace, documents.filter);
        self.show(title, &shell::pretty(&explained.into()));
        Ok(())
    }

    /// Shows the plan that is selected; elsewhere, the plans.
    fn plan(&mut self) -> Result<(), StoreError> {
        let selected = match self.screens.last() {
            Some(Screen::Documents(documents)) => documents.rows.get(documents.selected),
            _ => None,
        };
        let Some(document) = selected.filter(|document| document.contains_key("plan")) else {
            let plans = Namespace { database: "robmem".to_owned(), collection: "plans".to_owned() };
            return self.open(plans, String::new());
        };
        let id = document.get("_id").map(shell::relaxed_value).unwrap_or_default();
        let text = steps(document);
        self.show(format!("plan {id}"), &text);
        Ok(())
    }

    fn computables(&mut self) -> Result<(), StoreError> {
        let (computables, wrong) = self.memory.computables()?;
        let listed = computables.iter().map(|computable| {
            let definition = &computable.definition;
            let (name, namespace) = (&definition.name, &definition.namespace);
            format!(
                "{name}\n  of   {namespace}\n  for  {}\n  by   {}\n",
                shell::relaxed(&definition.spec),
                computable.describe()
            )
        });
        let text: String = listed.chain(wrong.iter().map(|wrong| format!("{wrong}\n"))).collect();
        let text = if text.is_empty() { "there are no computables".to_owned() } else { text };
        self.show("computables".to_owned(), &text);
        Ok(())
    }
}

impl Documents<'_> {
    fn find(&self) -> Result<Find, StoreError> {
        let parse = |name: &'static str, text: &str| {
            let text = if text.is_empty() { "{}" } else { text };
            shell::parse_document(&Source::new(name, text)).map_err(|error| {
                let (_, column) = error.position();
                StoreError::from(QueryError::bad_value(format!("{} (column {column})", error.message())))
            })
        };
        let (filter, sort) = (parse("query", &self.filter)?, parse("sort", &self.sort)?);
        Ok(Find { filter, sort, limit: PAGE, ..Find::default() })
    }

    fn read(&mut self, memory: &Memory) -> Result<(), StoreError> {
        let find = self.find()?;
        let decoded =
            |raw: bson::RawDocumentBuf| Document::try_from(&*raw).map_err(|error| QueryError::from(error).into());
        let rows: Result<Vec<Document>, StoreError> =
            memory.find(&self.namespace, &find)?.map(|raw| raw.and_then(decoded)).collect();
        self.total = memory.count(&self.namespace, &find.filter)?;
        self.rows = rows?;
        self.selected = self.selected.min(self.rows.len().saturating_sub(1));
        Ok(())
    }
}

/// The steps of a plan's document, with what is known of each.
fn steps(document: &Document) -> String {
    let mut text = format!("plan: {}\n\n", document.get("plan").map(shell::relaxed_value).unwrap_or_default());
    for number in 1.. {
        let Ok(step) = document.get_document(number.to_string()) else { break };
        let words = step.iter().filter(|(key, _)| !key.starts_with('_')).map(|(_, value)| match value.as_str() {
            Some(word) => word.to_owned(),
            None => shell::relaxed_value(value),
        });
        let status = step.get_str("_status").unwrap_or("open");
        text.push_str(&format!("{number:4}  {status:8}  {}\n", words.collect::<Vec<_>>().join(" ")));
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::store::{Embedded, StoreUri};
    use bson::doc;
    use ratatui::Terminal;
    use ratatui::backend::TestBackend;

    fn memory() -> Memory {
        filled(Embedded::in_memory().unwrap())
    }

    fn filled(store: Embedded) -> Memory {
        let memory = Memory::new(Box::new(store), None, Vec::new());
        let cups = Namespace::parse("robmem.cups").unwrap();
        let cup = |n: i32| doc! { "_id": n, "name": format!("cup {n}"), "n": n };
        memory.insert(&cups, (0..30).map(cup).collect()).unwrap();
        let plans = Namespace::parse("robmem.plans").unwrap();
        let plan = doc! { "_id": 1, "plan": "success", "1": { "action": "pick-up", "x": "A", "_status": "done" } };
        memory.insert(&plans, vec![plan]).unwrap();
        memory
    }

    fn screen(browser: &Browser<'_>) -> String {
        let mut terminal = Terminal::new(TestBackend::new(70, 12)).unwrap();
        terminal.draw(|frame| super::super::draw(browser, frame)).unwrap();
        terminal.backend().to_string()
    }

    fn press(browser: &mut Browser<'_>, keys: &str) {
        for key in keys.chars() {
            let key = match key {
                '\n' => Key::Enter,
                '\u{1b}' => Key::Back,
                '\u{8}' => Key::Erase,
                key => Key::Char(key),
            };
            browser.press(key, 8);
        }
    }

    #[test]
    fn keys_lead_from_collections_to_documents_and_back() {
        let memory = memory();
        let mut browser = Browser::new(&memory, None).unwrap();
        assert!(screen(&browser).contains("robmem.cups") && screen(&browser).contains("30"), "{}", screen(&browser));
        press(&mut browser, "\n");
        assert!(screen(&browser).contains("cup 0"), "{}", screen(&browser));
        press(&mut browser, "/{n: {$gt: 27}}\ns{n: -1}\n");
        let shown = screen(&browser);
        assert!(shown.contains("cup 29") && shown.contains("cup 28") && !shown.contains("cup 27"), "{shown}");
        press(&mut browser, "\n");
        assert!(screen(&browser).contains("\"name\": \"cup 29\""), "{}", screen(&browser));
        press(&mut browser, "\u{1b}e");
        assert!(screen(&browser).contains("documents_examined"), "{}", screen(&browser));
        press(&mut browser, "\u{1b}\u{1b}\u{1b}q");
        assert!(browser.is_over());
    }

    #[test]
    fn what_can_be_reached_is_shown_beside_a_store_that_cannot() {
        let folder = tempfile::tempdir().unwrap();
        let uri = |path: &str| StoreUri::parse(&format!("file:{}/{path}", folder.path().display())).unwrap();
        let memory = Memory::at(uri("own"), uri("none/team"), vec!["team".to_owned()]);
        memory.insert(&Namespace::parse("robmem.cups").unwrap(), vec![doc! { "_id": 1 }]).unwrap();
        let mut browser = Browser::new(&memory, None).unwrap();
        assert!(screen(&browser).contains("robmem.cups"), "{}", screen(&browser));
        assert!(browser.message.contains("none/team"), "{}", browser.message);
        press(&mut browser, "\n");
        assert_eq!(browser.message, "");
    }

    #[test]
    fn a_wrong_query_stays_to_be_corrected() {
        let memory = memory();
        let mut browser = Browser::new(&memory, Some(Namespace::parse("robmem.cups").unwrap())).unwrap();
        press(&mut browser, "/{n: {$is: 1}}\n");
        let shown = screen(&browser);
        assert!(shown.contains("unknown") && shown.contains("{n: {$is: 1}}"), "{shown}");
        press(&mut browser, "\u{1b}");
        assert!(screen(&browser).contains("30 documents"), "{}", screen(&browser));
    }

    #[test]
    fn plans_are_shown_step_by_step_and_changes_are_seen() {
        let folder = tempfile::tempdir().unwrap();
        let memory = filled(Embedded::open(folder.path().join("m.rmem")).unwrap());
        let mut browser = Browser::new(&memory, None).unwrap();
        press(&mut browser, "pp");
        assert!(screen(&browser).contains("done      pick-up A"), "{}", screen(&browser));
        press(&mut browser, "\u{1b}");
        assert!(!browser.refresh().unwrap());
        let plans = Namespace::parse("robmem.plans").unwrap();
        memory.insert(&plans, vec![doc! { "_id": 2, "plan": "fail" }]).unwrap();
        assert!(browser.refresh().unwrap());
        assert!(screen(&browser).contains("2 documents"), "{}", screen(&browser));
    }
}
