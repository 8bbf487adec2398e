//! A line of mongosh, taken apart.

/// The database of collections that are written as `db.NAME`, where no other is the default.
pub const DATABASE: &str = "robmem";

/// A line: a method of a collection with its arguments, and the methods that are called on what it gives.
pub(super) struct Line<'a> {
    pub(super) namespace: String,
    pub(super) method: &'a str,
    pub(super) arguments: Vec<&'a str>,
    pub(super) modifiers: Vec<Segment<'a>>,
}

/// A part of a line between dots: a name, with its arguments where it is called.
pub(super) struct Segment<'a> {
    pub(super) name: &'a str,
    pub(super) arguments: Option<Vec<&'a str>>,
}

impl<'a> Line<'a> {
    /// Takes a line apart; collections that are written as `db.NAME` are in `database`.
    pub(super) fn parse(line: &'a str, database: &str) -> Option<Self> {
        let segments = segments(statement(line))?;
        let mut segments = segments.into_iter().peekable();
        let is_db = segments.next_if(|segment| segment.name == "db" && segment.arguments.is_none()).is_some();
        let (home, mut database) = (database, is_db.then(|| database.to_owned()));
        let mut path: Vec<String> = Vec::new();
        // `db.orders.find` without brackets asks for all documents.
        let mut segments = segments.collect::<Vec<_>>();
        if let Some(last) = segments.last_mut().filter(|last| is_db && last.arguments.is_none() && is_bare(last.name)) {
            last.arguments = Some(Vec::new());
        }
        let mut segments = segments.into_iter();
        while let Some(Segment { name, arguments }) = segments.next() {
            match (name, arguments) {
                ("getSiblingDB" | "getDB", Some(arguments)) => database = Some(unquoted(arguments.first()?)),
                ("getCollection", Some(arguments)) => path.push(unquoted(arguments.first()?)),
                (name, None) => path.push(name.to_owned()),
                (method, Some(arguments)) => {
                    let namespace = namespace(database, &path, home)?;
                    return Some(Self { namespace, method, arguments, modifiers: segments.collect() });
                }
            }
        }
        None
    }
}

/// A line without `await` and semicolons.
fn statement(line: &str) -> &str {
    let line = line.trim().trim_end_matches(';');
    line.strip_prefix("await ").unwrap_or(line).trim()
}

/// The method that a line calls on a database, like `dropDatabase`.
pub(super) fn of_database(line: &str) -> Option<&str> {
    let mut segments = segments(statement(line))?.into_iter();
    segments.next().filter(|first| first.name == "db" && first.arguments.is_none())?;
    let mut methods = segments.skip_while(|segment| matches!(segment.name, "getSiblingDB" | "getDB"));
    methods.next().filter(|method| method.arguments.is_some()).map(|method| method.name)
}

/// Whether a method is one that is called without arguments, and hardly the name of a collection.
fn is_bare(name: &str) -> bool {
    ["find", "findOne", "count", "countDocuments", "estimatedDocumentCount", "getIndexes", "drop", "watch"]
        .contains(&name)
}

fn namespace(database: Option<String>, path: &[String], home: &str) -> Option<String> {
    let path = path.join(".");
    let name = match database {
        Some(database) => format!("{database}.{path}"),
        None if path.contains('.') => path,
        None => format!("{home}.{path}"),
    };
    let is_allowed = |c: char| c.is_alphanumeric() || matches!(c, '_' | '-');
    let is_part = |part: &str| !part.is_empty() && part.chars().all(is_allowed);
    (name.contains('.') && name.split('.').all(is_part)).then_some(name)
}

/// Takes a line apart at the dots outside of brackets and quotes.
fn segments(line: &str) -> Option<Vec<Segment<'_>>> {
    let parts = split(line, b'.')?.into_iter().map(|part| match part.split_once('[') {
        // `db["orders"]` is `db.orders`.
        Some((name, key)) if !name.contains('(') => {
            let key = key.trim().strip_suffix(']').map(str::trim).filter(|key| is_text(key))?;
            let key = key.trim_matches(['"', '\'', '`']);
            Some(vec![parsed(name)?, Segment { name: key, arguments: None }])
        }
        _ => Some(vec![parsed(part)?]),
    });
    Some(parts.collect::<Option<Vec<_>>>()?.into_iter().flatten().collect())
}

fn parsed(part: &str) -> Option<Segment<'_>> {
    let part = part.trim();
    let Some((name, rest)) = part.split_once('(') else {
        return is_name(part).then_some(Segment { name: part, arguments: None });
    };
    let inner = rest.strip_suffix(')').filter(|_| is_name(name.trim()))?;
    let arguments = split(inner, b',')?.into_iter().map(str::trim).filter(|text| !text.is_empty()).collect();
    Some(Segment { name: name.trim(), arguments: Some(arguments) })
}

fn is_name(text: &str) -> bool {
    !text.is_empty() && text.chars().all(|c| c.is_alphanumeric() || matches!(c, '_' | '-' | '$'))
}

/// Splits a text at a sign outside of brackets and quotes; none where these are not closed.
fn split(text: &str, sign: u8) -> Option<Vec<&str>> {
    let (mut parts, mut start, mut depth) = (Vec::new(), 0, 0_usize);
    let (mut quote, mut is_escaped) = (None, false);
    for (at, byte) in text.bytes().enumerate() {
        if let Some(mark) = quote {
            (is_escaped, quote) =
                if is_escaped { (false, quote) } else { (byte == b'\\', quote.filter(|_| byte != mark)) };
            continue;
        }
        match byte {
            b'"' | b'\'' | b'`' => quote = Some(byte),
            b'(' | b'[' | b'{' => depth += 1,
            b')' | b']' | b'}' => depth = depth.checked_sub(1)?,
            _ if byte == sign && depth == 0 => {
                parts.push(text.get(start..at)?);
                start = at + 1;
            }
            _ => {}
        }
    }
    parts.push(text.get(start..)?);
    (depth == 0 && quote.is_none()).then_some(parts)
}

pub(super) fn is_empty(text: &str) -> bool {
    text.chars().filter(|c| !c.is_whitespace()).collect::<String>() == "{}"
}

pub(super) fn is_text(text: &str) -> bool {
    text.starts_with(['"', '\'', '`'])
}

pub(super) fn unquoted(text: &str) -> String {
    text.trim().trim_matches(['"', '\'', '`']).to_owned()
}
