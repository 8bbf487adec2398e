//! `[[scene.object]]` in `rmem.toml`.

use std::ops::Range;

use serde::Deserialize;
use toml::Spanned;

use super::quoted::Quoted;
use crate::formats::scene::{Shape, document};
use crate::formats::shell;
use crate::query::Filter;
use crate::scene::ObjectKind;
use crate::scene::kind::NAME;
use crate::store::NamespaceError;

/// What is wrong, and where.
type Complaint = (Range<usize>, String);

/// `[scene]` as it is written.
#[derive(Debug, Clone, Default, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct Table {
    #[serde(default, rename = "object")]
    objects: Vec<ObjectTable>,
}

/// A kind of objects as it is written.
#[derive(Debug, Clone, Deserialize)]
#[serde(deny_unknown_fields)]
struct ObjectTable {
    name: Spanned<String>,
    collection: Spanned<String>,
    query: Option<Spanned<String>>,
    name_key: Option<Spanned<String>>,
    model: Option<String>,
    geometry: Option<Spanned<String>>,
}

impl Table {
    /// The kinds of objects; what is wrong in a text that a string of the `file` has is shown there.
    pub(super) fn kinds(&self, file: &str) -> Result<Vec<ObjectKind>, Complaint> {
        let mut kinds: Vec<ObjectKind> = Vec::with_capacity(self.objects.len());
        for table in &self.objects {
            let kind = table.kind(file)?;
            if kinds.iter().any(|other| other.name == kind.name) {
                let message = format!("there are two kinds of objects `{}`; name one otherwise", kind.name);
                return Err((table.name.span(), message));
            }
            kinds.push(kind);
        }
        Ok(kinds)
    }
}

impl ObjectTable {
    fn kind(&self, file: &str) -> Result<ObjectKind, Complaint> {
        let name_key = self.name_key.as_ref().map_or(NAME, |key| key.get_ref());
        if name_key.is_empty() || name_key.contains('.') {
            let span = self.name_key.as_ref().map(Spanned::span).unwrap_or_default();
            return Err((span, format!("`{name_key}` is not a key of a document; expected one like `name`")));
        }
        Ok(ObjectKind {
            name: self.name.get_ref().clone(),
            namespace: self
                .collection
                .get_ref()
                .parse()
                .map_err(|error: NamespaceError| (self.collection.span(), error.to_string()))?,
            query: self.query(file)?,
            name_key: name_key.to_owned(),
            model: self.model.clone(),
            geometry: self.geometry(file)?,
        })
    }

    fn query(&self, file: &str) -> Result<bson::Document, Complaint> {
        let Some(string) = &self.query else { return Ok(bson::Document::new()) };
        let text = Quoted { string, file };
        let query = shell::parse_document(&text.source()).map_err(|error| text.syntax("expected a query", &error))?;
        Filter::parse(&query).map_err(|error| text.refused("expected a query", &error))?;
        Ok(query)
    }

    fn geometry(&self, file: &str) -> Result<Vec<Shape>, Complaint> {
        let Some(string) = &self.geometry else { return Ok(Vec::new()) };
        let text = Quoted { string, file };
        let value = shell::parse_value(&text.source()).map_err(|error| text.syntax("expected a geometry", &error))?;
        document::shapes(&value).map_err(|wrong| (string.span(), wrong))
    }
}
