//! `rmem view [NS]`: a browser of the memory in the terminal.

use std::io::{self, IsTerminal as _, Write};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use clap::Args;
use ratatui::Terminal;
use ratatui::backend::CrosstermBackend;
use ratatui::crossterm::event::{self, Event, KeyCode, KeyEventKind, KeyModifiers};
use ratatui::crossterm::terminal::{
    Clear, ClearType, EnterAlternateScreen, LeaveAlternateScreen, disable_raw_mode, enable_raw_mode,
};
use ratatui::crossterm::{cursor, execute};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use signal_hook::consts::{SIGQUIT, SIGTSTP};

use super::{Context, UsageError};
use crate::error::Result;
use crate::exit::Exit;
use crate::interrupt::InterruptGuard;
use crate::store::Namespace;
use crate::views::browser::{Browser, Key, draw};

/// Browse documents, plans and computables in the terminal
#[derive(Debug, Args)]
#[command(after_help = "Example:\n  rmem view robmem.worldmodel\n\n\
Arrow keys (or j, k) move, Enter opens what is selected, Esc goes back, / asks for a query, s for a sort order,\n\
e explains how the query is answered, p shows the plan that is selected (or the plans), c the computables,\n\
r reads again, q quits, Ctrl-Z suspends. A collection that is open is read again as it changes. The first 1000 documents are shown.")]
pub struct ViewArgs {
    /// Begin with this collection (default: the list of collections)
    #[arg(value_name = "NS")]
    pub namespace: Option<Namespace>,
}

/// How long to wait for a key before the memory is asked for changes: what is shown is no older than this.
const POLL_INTERVAL: Duration = Duration::from_millis(100);
/// How long the browser may take to end once its terminal is gone.
const EXIT_TIMEOUT: Duration = Duration::from_secs(1);

pub(super) fn run(args: &ViewArgs, context: &mut Context<'_>) -> Result<Exit> {
    if !context.is_terminal() {
        return Err(UsageError::new("view needs a terminal; for other programs there is rmem query").into());
    }
    let memory = context.memory()?;
    let mut browser = Browser::new(&memory, args.namespace.clone())?;
    // A signal sets a flag, so that the terminal is put right before the end.
    let signals = Signals::new()?;
    end_with_terminal();
    let screen = Screen::enter(context.output.screen())?;
    browse(&mut browser, screen, &signals)
}

/// What other programs ask for by signals.
struct Signals {
    guard: InterruptGuard,
    quit: Arc<AtomicBool>,
    suspend: Arc<AtomicBool>,
}

impl Signals {
    fn new() -> io::Result<Self> {
        let signals = Self { guard: InterruptGuard::new(), quit: Arc::default(), suspend: Arc::default() };
        signal_hook::flag::register(SIGQUIT, Arc::clone(&signals.quit))?;
        signal_hook::flag::register(SIGTSTP, Arc::clone(&signals.suspend))?;
        Ok(signals)
    }

    fn is_end(&self) -> bool {
        self.guard.interrupted().load(Ordering::Relaxed) || self.quit.load(Ordering::Relaxed)
    }
}

fn browse(browser: &mut Browser<'_>, screen: Screen<'_>, signals: &Signals) -> Result<Exit> {
    let mut terminal = Terminal::new(CrosstermBackend::new(screen))?;
    terminal.draw(|frame| draw(browser, frame))?;
    while !browser.is_over() {
        if signals.is_end() {
            return Ok(Exit::Interrupted);
        }
        let mut is_changed = signals.suspend.swap(false, Ordering::Relaxed);
        if is_changed {
            suspend(&mut terminal)?;
        }
        is_changed |= browser.refresh()?;
        if is_hung_up(POLL_INTERVAL) {
            return Ok(Exit::Interrupted);
        }
        while event::poll(Duration::ZERO)? {
            is_changed = true;
            let height = terminal.size()?.height.saturating_sub(4);
            match event::read()? {
                Event::Key(key) if key.kind != KeyEventKind::Release => {
                    if key.modifiers.contains(KeyModifiers::CONTROL) {
                        match key.code {
                            KeyCode::Char('c' | '\\') => return Ok(Exit::Interrupted),
                            KeyCode::Char('z') => signals.suspend.store(true, Ordering::Relaxed),
                            _ => {}
                        }
                    } else if let Some(key) = meaning(key.code) {
                        browser.press(key, usize::from(height));
                    }
                }
                _ => {}
            }
        }
        if is_changed {
            terminal.draw(|frame| draw(browser, frame))?;
        }
    }
    Ok(Exit::Done)
}

/// Stops the program until it is told to continue; meanwhile the terminal is as it was.
fn suspend(terminal: &mut Terminal<CrosstermBackend<Screen<'_>>>) -> Result<()> {
    execute!(terminal.backend_mut(), LeaveAlternateScreen, cursor::Show)?;
    disable_raw_mode()?;
    signal_hook::low_level::emulate_default_handler(SIGTSTP)?;
    enable_raw_mode()?;
    execute!(terminal.backend_mut(), EnterAlternateScreen, cursor::Hide, Clear(ClearType::All))?;
    // Both of what was drawn and what is to be drawn are forgotten, so that all is drawn again.
    terminal.swap_buffers();
    terminal.swap_buffers();
    Ok(())
}

/// Ends the program soon after its terminal is gone, whatever it does then: where the terminal goes between a look at
/// it and crossterm's reading, crossterm reads for ever. Nothing is written that could be cut off.
fn end_with_terminal() {
    std::thread::spawn(|| {
        let stdout = io::stdout();
        loop {
            let mut end = [PollFd::new(&stdout, PollFlags::empty())];
            match poll(&mut end, None) {
                Ok(_) if end[0].revents().is_empty() => {}
                Err(rustix::io::Errno::INTR) => {}
                Ok(_) => break,
                Err(_) => return,
            }
        }
        std::thread::sleep(EXIT_TIMEOUT);
        #[expect(clippy::exit, reason = "the other thread cannot be reached")]
        std::process::exit(Exit::Interrupted.code().into());
    });
}

/// Waits for a key, for at most `limit`; returns whether the terminal is gone, at whose end crossterm would read for ever.
fn is_hung_up(limit: Duration) -> bool {
    let (stdin, stdout) = (io::stdin(), io::stdout());
    let mut ends = vec![PollFd::new(&stdout, PollFlags::empty())];
    // Else keys come from /dev/tty.
    if stdin.is_terminal() {
        ends.push(PollFd::new(&stdin, PollFlags::IN));
    }
    // A signal ends the wait early.
    let _ = poll(&mut ends, Timespec::try_from(limit).ok().as_ref());
    ends.iter().any(|end| end.revents().intersects(PollFlags::HUP | PollFlags::ERR))
}

fn meaning(code: KeyCode) -> Option<Key> {
    Some(match code {
        KeyCode::Char(c) => Key::Char(c),
        KeyCode::Up => Key::Up,
        KeyCode::Down => Key::Down,
        KeyCode::PageUp => Key::PageUp,
        KeyCode::PageDown => Key::PageDown,
        KeyCode::Home => Key::Home,
        KeyCode::End => Key::End,
        KeyCode::Enter | KeyCode::Right => Key::Enter,
        KeyCode::Esc | KeyCode::Left => Key::Back,
        KeyCode::Backspace => Key::Erase,
        _ => return None,
    })
}

/// The terminal's other screen; when it is dropped, the terminal is as it was.
struct Screen<'a>(&'a mut dyn Write);

impl<'a> Screen<'a> {
    fn enter(out: &'a mut dyn Write) -> io::Result<Self> {
        enable_raw_mode()?;
        let mut screen = Self(out);
        execute!(screen, EnterAlternateScreen, cursor::Hide)?;
        Ok(screen)
    }
}

impl Write for Screen<'_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        unless_gone(self.0.write(bytes), bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        unless_gone(self.0.flush(), ())
    }
}

/// What is written to a terminal that is gone is lost, and no error: ratatui would report it on stderr, which is the
/// same terminal, and panic there. That it is gone is seen where keys are waited for.
fn unless_gone<T>(written: io::Result<T>, all: T) -> io::Result<T> {
    match written {
        Err(_) if is_hung_up(Duration::ZERO) => Ok(all),
        written => written,
    }
}

impl Drop for Screen<'_> {
    fn drop(&mut self) {
        // Where the terminal is gone, there is nothing to put right.
        let _ = execute!(self, LeaveAlternateScreen, cursor::Show);
        let _ = disable_raw_mode();
    }
}
