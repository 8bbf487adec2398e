//! Counts by family, and the table of them.

use std::collections::BTreeMap;

/// What came of a case.
pub(crate) enum Outcome {
    Agrees,
    /// The name of what is refused.
    Refused(String),
    Differs(String),
}

#[derive(Default, Clone)]
struct Counts {
    agreed: usize,
    refused: usize,
    differ: usize,
}

pub(crate) struct Report {
    families: BTreeMap<String, Counts>,
    refusals: BTreeMap<String, usize>,
    wanted: Option<String>,
    show: usize,
}

impl Report {
    pub(crate) fn from_environment() -> Self {
        let show = std::env::var("RMEM_CONFORMANCE_SHOW").ok().and_then(|text| text.parse().ok()).unwrap_or(0);
        Self {
            families: BTreeMap::new(),
            refusals: BTreeMap::new(),
            wanted: std::env::var("RMEM_CONFORMANCE_FAMILY").ok(),
            show,
        }
    }

    pub(crate) fn wants(&self, test: &str) -> bool {
        self.wanted.as_ref().is_none_or(|wanted| test.contains(wanted.as_str()))
    }

    pub(crate) fn add(&mut self, test: &str, outcome: Outcome) {
        let counts = self.families.entry(family(test)).or_default();
        match outcome {
            Outcome::Agrees => counts.agreed += 1,
            Outcome::Refused(name) => {
                counts.refused += 1;
                *self.refusals.entry(name).or_default() += 1;
            }
            Outcome::Differs(difference) => {
                counts.differ += 1;
                if self.show > 0 {
                    self.show -= 1;
                    say(&format!("{test}\n    {difference}\n"));
                }
            }
        }
    }

    pub(crate) fn agreement(&self) -> f64 {
        let total = self.total();
        let (agreed, differ) = (total.agreed as f64, total.differ as f64);
        if agreed + differ == 0.0 { 1.0 } else { agreed / (agreed + differ) }
    }

    fn total(&self) -> Counts {
        let mut total = Counts::default();
        for counts in self.families.values() {
            total.agreed += counts.agreed;
            total.refused += counts.refused;
            total.differ += counts.differ;
        }
        total
    }

    /// Prints the tables, in markdown.
    pub(crate) fn print(&self) {
        say("| operator family | cases | agree | differ | refused | agree of those not refused |");
        say("|---|--:|--:|--:|--:|--:|");
        for (family, counts) in &self.families {
            say(&line(family, counts));
        }
        say(&line("**all**", &self.total()));
        let mut refusals: Vec<_> = self.refusals.iter().collect();
        refusals.sort_by(|a, b| b.1.cmp(a.1));
        say("\n| refused by name | cases |\n|---|--:|");
        for (name, count) in refusals {
            say(&format!("| {} | {count} |", name.replace(['|', '\0'], "?")));
        }
    }
}

fn say(text: &str) {
    println!("{text}");
}

fn line(name: &str, counts: &Counts) -> String {
    let Counts { agreed, differ, refused } = *counts;
    let compared = agreed + differ;
    let percent = match compared {
        0 => "–".to_owned(),
        _ => format!("{:.1} %", agreed as f64 * 100.0 / compared as f64),
    };
    format!("| {name} | {} | {agreed} | {differ} | {refused} | {percent} |", compared + refused)
}

/// The folder of a test.
fn family(test: &str) -> String {
    let file = test.split("::").next().unwrap_or(test);
    let folder = file.rsplit_once('/').map_or(file, |(folder, _)| folder);
    folder.trim_start_matches("compatibility/tests/core/").to_owned()
}
