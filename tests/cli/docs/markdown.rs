//! The parts of a Markdown page that a test can hold it to.

/// A fenced block of code.
pub(super) struct Block {
    /// The line of its fence, from 1.
    pub(super) line: usize,
    /// The first word after the fence: `console`, `toml`, …
    pub(super) language: String,
    /// What follows it: `NAME=VALUE` words, a value in quotes where it has blanks.
    attributes: Vec<(String, String)>,
    /// The text inside.
    pub(super) text: String,
    /// The paragraph in front of the block.
    pub(super) before: String,
}

impl Block {
    /// The value of an attribute.
    pub(super) fn attribute(&self, name: &str) -> Option<&str> {
        self.attributes.iter().find(|(known, _)| known == name).map(|(_, value)| value.as_str())
    }
}

/// The fenced blocks of a page, in order.
pub(super) fn blocks(page: &str) -> Vec<Block> {
    let mut blocks = Vec::new();
    let mut paragraph = String::new();
    let mut lines = page.lines().enumerate();
    while let Some((number, line)) = lines.next() {
        if let Some(info) = line.strip_prefix("```") {
            let inside = lines.by_ref().map(|(_, line)| line).take_while(|line| *line != "```");
            let text = inside.flat_map(|line| [line, "\n"]).collect();
            let (language, rest) = info.split_once(' ').unwrap_or((info, ""));
            let before = std::mem::take(&mut paragraph);
            let attributes = attributes(rest);
            blocks.push(Block { line: number + 1, language: language.to_owned(), attributes, text, before });
        } else if line.trim().is_empty() {
            // A blank line after a paragraph belongs to it, so that a block may follow.
            paragraph.push('\n');
        } else {
            if paragraph.ends_with("\n\n") || paragraph == "\n" {
                paragraph.clear();
            }
            paragraph.push_str(line);
            paragraph.push('\n');
        }
    }
    blocks
}

fn attributes(mut text: &str) -> Vec<(String, String)> {
    let mut attributes = Vec::new();
    while let Some((name, rest)) = text.trim_start().split_once('=') {
        let (value, after) = match rest.strip_prefix('"') {
            Some(quoted) => quoted.split_once('"').unwrap_or((quoted, "")),
            None => rest.split_once(' ').unwrap_or((rest, "")),
        };
        attributes.push((name.to_owned(), value.to_owned()));
        text = after;
    }
    attributes
}

/// The page without its fenced blocks.
pub(super) fn prose(page: &str) -> String {
    let mut fenced = false;
    let mut outside = |line: &&str| {
        let fence = line.starts_with("```");
        fenced ^= fence;
        !fenced && !fence
    };
    page.lines().filter(|line| outside(line)).flat_map(|line| [line, "\n"]).collect()
}

/// The texts between single backticks.
pub(super) fn code_spans(prose: &str) -> impl Iterator<Item = &str> {
    prose.split('`').skip(1).step_by(2)
}

/// Targets of links, `[text](target)`.
pub(super) fn links(prose: &str) -> impl Iterator<Item = &str> {
    prose.split("](").skip(1).filter_map(|rest| rest.split_once(')').map(|(target, _)| target))
}

/// The anchors of a page's headings, as GitHub makes them.
pub(super) fn anchors(page: &str) -> Vec<String> {
    let prose = prose(page);
    let headings = prose.lines().filter(|line| line.starts_with('#')).map(|line| line.trim_start_matches('#').trim());
    let anchor = |heading: &str| {
        let kept = heading.to_lowercase().replace(' ', "-");
        kept.chars().filter(|c| c.is_alphanumeric() || matches!(c, '-' | '_')).collect()
    };
    headings.map(anchor).collect()
}
