//! Progress on stderr: a bar on a terminal, a line now and then in a log, nothing with `--quiet`.

use super::output::{self, note};
use super::stop;
use crate::progress::Progress;
use crate::sys::locks::lock;
use indicatif::{ProgressBar, ProgressStyle};
use std::io::IsTerminal;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

/// The least time between two lines in a log.
const PAUSE: Duration = Duration::from_secs(5);

/// Shows progress where the user sees it.
pub enum Console<'a> {
    /// Says nothing.
    Quiet,
    /// Hands all on to a program that called a command, which listens to signals itself.
    Handed(&'a dyn Progress),
    /// Shows it of one of several scans, by its name.
    Scan(&'a Console<'a>, &'a str),
    /// A bar for the current stage.
    Bars(Mutex<Option<ProgressBar>>),
    /// Plain lines.
    Lines(Mutex<Stage>),
}

/// The state of a stage that is told in lines.
#[derive(Debug)]
pub struct Stage {
    name: String,
    total: u64,
    done: u64,
    last: Instant,
    last_tenth: u64,
}

impl Stage {
    fn new(name: &str, total: u64, now: Instant) -> Self {
        Stage {
            name: name.to_string(),
            total,
            done: 0,
            last: now,
            last_tenth: 0,
        }
    }

    /// Counts steps; returns the line to print if it is time for one.
    fn advance(&mut self, steps: u64, now: Instant) -> Option<String> {
        self.done = self.done.saturating_add(steps);
        if now.duration_since(self.last) < PAUSE {
            return None;
        }
        if self.total == 0 {
            self.last = now;
            return Some(format!("{}: {}", self.name, self.done));
        }
        let percent = (u128::from(self.done) * 100 / u128::from(self.total)).min(100) as u64;
        if percent / 10 == self.last_tenth {
            return None;
        }
        self.last_tenth = percent / 10;
        self.last = now;
        Some(format!("{}: {percent} %", self.name))
    }
}

impl Console<'_> {
    /// Chooses by what stderr is.
    pub fn new(quiet: bool) -> Self {
        if quiet {
            Console::Quiet
        } else if std::io::stderr().is_terminal() {
            Console::Bars(Mutex::new(None))
        } else {
            Console::Lines(Mutex::new(Stage::new("", 0, Instant::now())))
        }
    }

    /// Tells something that the user did not ask for; a bar stays below it.
    pub fn note(&self, line: &str) {
        match self {
            Console::Quiet | Console::Handed(_) => {}
            Console::Scan(console, _) => console.note(line),
            Console::Bars(bar) => match &*lock(bar) {
                Some(bar) => bar.suspend(|| note(line)),
                None => note(line),
            },
            Console::Lines(_) => note(line),
        }
    }
}

impl Console<'_> {
    /// Tells what the user has to know, also with `--quiet`.
    pub fn tell(&self, line: &str) {
        match self {
            Console::Quiet => note(line),
            Console::Handed(progress) => progress.warn(line),
            Console::Scan(console, name) => console.tell(&format!("{name}: {line}")),
            _ => self.note(line),
        }
    }

    /// From now on Ctrl-C asks the work to stop, for work that looks at [`Progress::interrupted`].
    pub fn listen(&self) {
        if !matches!(self, Console::Handed(_)) {
            stop::listen();
        }
    }
}

impl Drop for Console<'_> {
    fn drop(&mut self) {
        if let Console::Bars(bar) = self
            && let Some(bar) = lock(bar).take()
        {
            bar.finish_and_clear();
        }
    }
}

/// Between two turns of the spinner, which shows that the work goes on while a step takes long.
const TICK: Duration = Duration::from_millis(200);

/// What a bar shows in so many columns. The bar takes what is left of them.
fn template(total: u64, columns: usize) -> &'static str {
    const WIDE: usize = 64;
    match (total, columns >= WIDE) {
        (0, true) => "{spinner} {msg:<12} {pos} [{elapsed}, {per_sec}]",
        (0, false) => "{spinner} {msg:<9!} {pos} {elapsed}",
        (_, true) => "{spinner} {msg:<12} [{wide_bar}] {percent:>3} % [{elapsed}, {eta} left]",
        (_, false) => "{spinner} {msg:<9!} [{wide_bar}] {percent:>3} % {eta}",
    }
}

fn new_bar(stage: &str, total: u64) -> ProgressBar {
    let bar = match total {
        0 => ProgressBar::new_spinner(),
        total => ProgressBar::new(total),
    };
    let columns = output::columns_of(std::io::stderr());
    if let Ok(style) = ProgressStyle::with_template(template(total, columns)) {
        bar.set_style(style.progress_chars("=> "));
    }
    bar.set_message(stage.to_string());
    bar.enable_steady_tick(TICK);
    bar
}

impl Progress for Console<'_> {
    fn begin(&self, stage: &str, total: u64) {
        match self {
            Console::Quiet => {}
            Console::Handed(progress) => progress.begin(stage, total),
            Console::Scan(console, _) => console.begin(stage, total),
            Console::Bars(bar) => {
                if let Some(old) = lock(bar).replace(new_bar(stage, total)) {
                    old.finish_and_clear();
                }
            }
            Console::Lines(lines) => *lock(lines) = Stage::new(stage, total, Instant::now()),
        }
    }

    fn advance(&self, steps: u64) {
        match self {
            Console::Quiet => {}
            Console::Handed(progress) => progress.advance(steps),
            Console::Scan(console, _) => console.advance(steps),
            Console::Bars(bar) => {
                if let Some(bar) = &*lock(bar) {
                    bar.inc(steps);
                }
            }
            Console::Lines(lines) => {
                let line = lock(lines).advance(steps, Instant::now());
                if let Some(line) = line {
                    note(&line);
                }
            }
        }
    }

    fn interrupted(&self) -> bool {
        static TOLD: AtomicBool = AtomicBool::new(false);
        if let Console::Handed(progress) = self {
            return progress.interrupted();
        }
        if let Console::Scan(console, _) = self {
            return console.interrupted();
        }
        let asked = stop::is_asked();
        if asked && !TOLD.swap(true, Ordering::Relaxed) {
            self.note("stopping at the next safe place; a second Ctrl-C ends at once");
        }
        asked
    }

    /// Also with `--quiet`: what may make numbers wrong is something that goes wrong.
    fn warn(&self, message: &str) {
        match self {
            Console::Handed(progress) => progress.warn(message),
            Console::Scan(console, name) => console.warn(&format!("{name}: {message}")),
            _ => self.tell(&format!("warning: {message}")),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bars_are_shorter_in_narrow_terminals() {
        for total in [0, 9] {
            let all = [40, 80].map(|columns| template(total, columns));
            assert!(all[0].len() < all[1].len());
            for text in all {
                assert!(ProgressStyle::with_template(text).is_ok(), "{text}");
            }
        }
    }

    #[test]
    fn a_log_has_a_line_now_and_then() {
        let start = Instant::now();
        let mut stage = Stage::new("mesh", 1000, start);
        let lines: Vec<String> = (0..1000)
            .filter_map(|i| stage.advance(1, start + Duration::from_millis(100 * i)))
            .collect();
        // 100 seconds: a line per tenth, which is more than 5 seconds apart
        assert_eq!(lines.len(), 10);
        assert_eq!(lines[9], "mesh: 100 %");
        let mut slow = Stage::new("mesh", 10, start);
        assert_eq!(slow.advance(1, start + Duration::from_secs(1)), None);
        let line = slow.advance(1, start + Duration::from_secs(9));
        assert_eq!(line.as_deref(), Some("mesh: 20 %"));
        assert_eq!(
            slow.advance(u64::MAX, start + Duration::from_secs(10)),
            None
        );
    }
}
