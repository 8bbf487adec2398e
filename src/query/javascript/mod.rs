//! JavaScript: `$where`, `$function`, `$accumulator` and map-reduce, in an embedded QuickJS.
//!
//! A [`Program`] is a function as text. Each thread has a machine that compiles it when it is first called. Programs
//! see BSON's types and MongoDB's helpers, but no files, network or other programs. They run under limits of time,
//! memory and stack; after an error the machine is thrown away, because what it holds cannot be trusted.

#[cfg(feature = "javascript")]
mod convert;
#[cfg(feature = "javascript")]
mod machine;
mod map_reduce;
#[cfg(feature = "javascript")]
mod predicate;
mod script;
mod source;

use bson::{Bson, Document};

use super::error::{QueryError, Result};
use super::view::Fields;
pub use map_reduce::{MapReduce, Merging};
use script::{Code, Script};

/// A function, to be called with documents or values.
#[derive(Debug)]
pub(super) struct Program(Script);

impl Program {
    fn new(operator: &str, code: Code, scope: Document) -> Result<Self> {
        if !cfg!(feature = "javascript") {
            return Err(QueryError::unsupported(operator));
        }
        Ok(Self(Script::new(code, scope)))
    }

    /// Reads the argument of `$where`: a function, its body, or an expression, as a string or code.
    ///
    /// # Errors
    /// If it is something else, or empty.
    pub(super) fn predicate(value: &Bson) -> Result<Self> {
        let text = match value {
            Bson::String(text) | Bson::JavaScriptCode(text) => text,
            Bson::JavaScriptCodeWithScope(_) => {
                return Err(QueryError::invalid(4_649_201, "$where no longer supports code with a scope"));
            }
            _ => return Err(QueryError::bad_value("$where got bad type: it needs a string or code")),
        };
        if text.trim().is_empty() {
            return Err(QueryError::bad_value("$where needs code"));
        }
        let fields = source::used_fields(text);
        let mut program = Self::new("$where", Code::Predicate(text.clone()), Document::new())?;
        program.0.fields = fields;
        Ok(program)
    }

    /// Reads a function, as a string or code.
    ///
    /// # Errors
    /// If it is something else.
    pub(super) fn function(operator: &str, name: &str, value: &Bson) -> Result<Self> {
        match value {
            Bson::String(text) | Bson::JavaScriptCode(text) => {
                Self::new(operator, Code::Function(source::function(text)), Document::new())
            }
            _ => Err(QueryError::invalid(4_660_700, format!("the '{name}' of {operator} must be a string or code"))),
        }
    }

    /// Returns whether the predicate holds for a document.
    ///
    /// # Errors
    /// If it throws, or exceeds its limits.
    pub(super) fn holds(&self, document: Fields<'_>) -> Result<bool> {
        #[cfg(feature = "javascript")]
        return machine::holds(&self.0, document);
        #[cfg(not(feature = "javascript"))]
        return Err(QueryError::unsupported("$where")).inspect_err(|_| drop(document.to_document()));
    }

    /// Returns what the function gives for arguments; missing ones are undefined.
    ///
    /// # Errors
    /// If it throws, or exceeds its limits.
    pub(super) fn call(&self, arguments: &[Option<Bson>]) -> Result<Option<Bson>> {
        #[cfg(feature = "javascript")]
        return machine::call(&self.0, arguments);
        #[cfg(not(feature = "javascript"))]
        {
            let _ = (arguments, &self.0);
            Err(QueryError::unsupported("$function"))
        }
    }
}

impl Drop for Program {
    fn drop(&mut self) {
        #[cfg(feature = "javascript")]
        machine::forget(self.0.id);
    }
}

#[cfg(all(test, feature = "javascript"))]
mod tests {
    use super::*;
    use bson::{RawDocumentBuf, doc};

    fn holds(code: &str, document: &Document) -> Result<bool> {
        let raw = RawDocumentBuf::try_from(document).unwrap();
        Program::predicate(&code.into())?.holds((&*raw).into())
    }

    fn called(code: &str, arguments: &[Bson]) -> Result<Option<Bson>> {
        let arguments: Vec<_> = arguments.iter().cloned().map(Some).collect();
        Program::function("$function", "body", &code.into())?.call(&arguments)
    }

    #[test]
    fn a_predicate_is_an_expression_statements_or_a_function() {
        let document = doc! { "a": 3, "b": { "c": [1, 2] } };
        for code in [
            "this.a == 3",
            "obj.a === 3",
            "return this.a > 2",
            "var x = this.a; return x == 3;",
            "function() { return this.b.c[1] == 2 }",
            "() => obj.a == 3",
            "this['a'] == 3",
            "Object.keys(this).length == 2",
            "this.missing === undefined;",
            "tojson(this) != '{}'",
        ] {
            assert_eq!(holds(code, &document), Ok(true), "{code}");
        }
        for code in ["this.a == 4", "0", "''", "null", "NaN", "this.missing", "var x = 1; return x > 1"] {
            assert_eq!(holds(code, &document), Ok(false), "{code}");
        }
    }

    #[test]
    fn the_value_of_statements_without_a_return_is_that_of_the_last_one_where_it_is_an_expression() {
        let document = doc! { "n": 3 };
        for code in [
            "var x = this.n; x > 2",
            "var x = this.n; x > 2;",
            "x = this.n;\nx > 1",
            "x = this.n // ; two\nx > 1",
            "x = 1\n+ this.n",
            "let z = this.n; z > 2",
            "const c = this.n > 1; c",
            "\"return\"; this.n > 2",
            "\"use strict\"; this.n > 1",
            "1; 2",
            "new Date() > 0; this.n == 3 /* ; */",
            "var f = function() { return true }; f()",
            "function g() { return false } true",
            "if (this.n > 9) { a = 1 } this.n == 3",
            "var s = '; '; s.length == 2 && this.n == 3;;",
            "var r = /;}/; r.test(';}')",
            "var t = `; ${this.n}\n; `; t.length > 4",
            "/* c */ function() { return this.n > 2 }",
            "// c\nfunction() { return this.n > 2 }",
            "function h() { return this.n == 3 }",
        ] {
            assert_eq!(holds(code, &document), Ok(true), "{code}");
        }
        for code in [
            "while (false) {}",
            "if (this.n > 2) { true }",
            "{ this.n > 1 }",
            "{a: this.n}",
            "try { this.x.y } catch (e) { true }",
            "switch (this.n) { case 3: true }",
            "label: this.n > 2",
            "do { this.n > 2 } while (false)",
            "var q",
            "for (var i = 0; i < 3; i++) { i == this.n }",
            "true; false",
            "true\nfalse",
            "x = -5\n+ this.n\n> 0",
        ] {
            assert_eq!(holds(code, &document), Ok(false), "{code}");
        }
        assert_eq!(holds("throw 1", &document).unwrap_err().code, 8);
        assert_eq!(holds("this.n >", &document).unwrap_err().code, 139);
        assert_eq!(holds("a } { b", &document).unwrap_err().code, 139);
    }

    #[test]
    fn types_go_in_and_come_out() {
        let identity = |value: Bson| called("function(x) { return x; }", &[value]).unwrap();
        let id = bson::oid::ObjectId::from_bytes([7; 12]);
        for value in [
            Bson::Double(1.5),
            Bson::Int64(i64::MAX),
            Bson::from("ü😀"),
            Bson::from(doc! { "a": [1.0, { "b": true }], "n": Bson::Null }),
            Bson::ObjectId(id),
            Bson::DateTime(bson::DateTime::from_millis(-5)),
            Bson::Timestamp(bson::Timestamp { time: 4, increment: 5 }),
            Bson::Decimal128("0.10".parse().unwrap()),
            Bson::Binary(bson::Binary { subtype: bson::spec::BinarySubtype::Generic, bytes: vec![1, 0, 255] }),
            Bson::RegularExpression(bson::Regex {
                pattern: "^a".try_into().unwrap(),
                options: "i".try_into().unwrap(),
            }),
            Bson::MinKey,
            Bson::MaxKey,
        ] {
            assert_eq!(identity(value.clone()), Some(value));
        }
        assert_eq!(identity(3.into()), Some(Bson::Double(3.0)));
        assert_eq!(called("function() { return NumberInt(3) }", &[]).unwrap(), Some(Bson::Int32(3)));
        assert_eq!(
            called("function(x) { return x == 5 && x !== 5 && x + 1 === 6 }", &[5i64.into()]).unwrap(),
            Some(true.into())
        );
        assert_eq!(called("function() {}", &[]).unwrap(), Some(Bson::Undefined));
    }

    #[test]
    fn types_are_called_by_their_names() {
        let text = |value: Bson| called("function(x) { return x + 1 }", &[value]).unwrap();
        assert_eq!(text(Bson::MaxKey), Some("[object MaxKey]1".into()));
        assert_eq!(text(Bson::MinKey), Some("[object MinKey]1".into()));
        let class = "function(x) { return Object.prototype.toString.call(x) }";
        assert_eq!(called(class, &[5i64.into()]).unwrap(), Some("[object NumberLong]".into()));
    }

    #[test]
    fn what_throws_loops_recurses_or_takes_memory_is_an_error_and_the_next_call_works() {
        for code in [
            "throw new Error('no')",
            "throw 5",
            "nothing.at.all",
            "this.a ===",
            "for (;;) {}",
            "function f() { return f() } return f()",
            "var x = []; for (;;) x.push(new Array(1000).fill(1));",
            "var s = 'x'; for (;;) s += s;",
            "/(a+)+$/.test('a'.repeat(40) + 'b')",
        ] {
            assert!(holds(code, &doc! { "a": 1 }).is_err(), "{code}");
            assert_eq!(holds("this.a == 1", &doc! { "a": 1 }), Ok(true), "after {code}");
        }
        assert_eq!(holds("throw new Error('no')", &doc! {}).unwrap_err().code, 139);
    }

    #[test]
    fn programs_do_not_see_the_globals_of_others() {
        assert_eq!(holds("leaked = 1; return true", &doc! {}), Ok(true));
        assert_eq!(holds("typeof leaked == 'undefined'", &doc! {}), Ok(true));
        assert_eq!(holds("typeof db == 'undefined' && typeof require == 'undefined'", &doc! {}), Ok(true));
    }

    #[test]
    fn a_deep_or_circular_result_is_an_error() {
        assert!(called("function() { var x = {}; x.x = x; return x }", &[]).is_err());
        assert!(called("function() { var x = {}; for (var i = 0; i < 5000; i++) x = {x: x}; return x }", &[]).is_err());
    }
}
