//! The parsed file, with the place of every key; sections are taken out of it one after another.

use std::collections::BTreeMap;
use std::ops::Range;

use serde::Serialize;
use serde::de::{DeserializeOwned, IntoDeserializer};
use serde_json::Value;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::mistake::{Mistake, line_and_column, unknown_key};

/// Where a value stands: line and column, from 1.
pub type Place = (usize, usize);

/// A group of options that the file may hold.
pub trait Section: Default + Serialize + DeserializeOwned {}
impl<T: Default + Serialize + DeserializeOwned> Section for T {}

/// A table of the file whose keys have not all been taken.
#[derive(Debug, Clone)]
pub struct Table<'a> {
    file: &'a str,
    text: &'a str,
    /// Its path in the file, such as `camera.1`; empty for the whole file.
    path: String,
    left: DeTable<'a>,
    span: Range<usize>,
    known: Vec<String>,
}

impl<'a> Table<'a> {
    /// Parses a file's text.
    ///
    /// # Errors
    /// Where it is no TOML.
    pub fn parse(file: &'a str, text: &'a str) -> Result<Self, Mistake> {
        let parsed = DeTable::parse(text).map_err(|e| Mistake::refused(file, text, &e))?;
        Ok(Self {
            file,
            text,
            path: String::new(),
            span: parsed.span(),
            left: parsed.into_inner(),
            known: Vec::new(),
        })
    }

    /// Takes the keys of `T` out of this table; those that are not there have its default.
    ///
    /// # Errors
    /// Wrong types and unknown keys of nested tables.
    pub fn take<T: Section>(&mut self) -> Result<T, Mistake> {
        let keys = keys_of(&T::default());
        let is_ours = |key: &str| keys.iter().any(|k| k == key);
        let (ours, left): (DeTable<'a>, DeTable<'a>) = std::mem::take(&mut self.left)
            .into_iter()
            .partition(|(key, _)| is_ours(key.get_ref()));
        self.left = left;
        self.known.extend(keys);
        let table = Spanned::new(self.span.clone(), ours);
        T::deserialize(table.into_deserializer())
            .map_err(|e| Mistake::refused(self.file, self.text, &e))
    }

    /// Takes a table below this one; an empty one where there is none.
    ///
    /// # Errors
    /// If the key holds something else.
    pub fn take_table(&mut self, key: &str) -> Result<Self, Mistake> {
        match self.take_value(key) {
            None => Ok(self.below(key, DeTable::new(), self.span.clone())),
            Some(value) => self.as_table(key, value, "a table"),
        }
    }

    /// Takes the tables `[[key]]`; a single `[key]` is one of them.
    ///
    /// # Errors
    /// If the key holds something else.
    pub fn take_tables(&mut self, key: &str) -> Result<Vec<Self>, Mistake> {
        const EXPECTED: &str = "tables, each below a line of its name in double brackets";
        let Some(value) = self.take_value(key) else {
            return Ok(Vec::new());
        };
        let span = value.span();
        match value.into_inner() {
            DeValue::Array(all) => all
                .into_iter()
                .enumerate()
                .map(|(i, one)| self.as_table(&format!("{key}.{i}"), one, EXPECTED))
                .collect(),
            one => Ok(vec![self.as_table(
                &format!("{key}.0"),
                Spanned::new(span, one),
                EXPECTED,
            )?]),
        }
    }

    /// Refuses what nobody has taken.
    ///
    /// # Errors
    /// The first unknown key, with the known one that is most alike.
    pub fn finish(self) -> Result<(), Mistake> {
        let unknown = self.left.keys().min_by_key(|key| key.span().start);
        match unknown {
            None => Ok(()),
            Some(key) => {
                Err(self.mistake_at(Some(key.span()), unknown_key(key.get_ref(), &self.known)))
            }
        }
    }

    /// Where the keys of this table and of those below it stand, by their dotted path within it.
    pub fn places(&self) -> BTreeMap<String, Place> {
        let mut places = BTreeMap::new();
        self.collect("", &self.left, &mut places);
        places
    }

    /// The whole numbers of this table: the key of each, where it stands, and its decimal digits.
    pub fn integers(&self) -> Vec<(String, Place, String)> {
        let mut all = Vec::new();
        for (key, value) in &self.left {
            if let DeValue::Integer(number) = value.get_ref() {
                let place = line_and_column(self.text, value.span().start);
                let digits = i128::from_str_radix(number.as_str(), number.radix());
                let text = digits.map_or_else(|_| number.to_string(), |n| n.to_string());
                all.push((key.get_ref().to_string(), place, text));
            }
        }
        all
    }

    /// Where this table begins.
    pub fn head(&self) -> Place {
        line_and_column(self.text, self.span.start)
    }

    /// A mistake at a place in this table; at its head where there is none.
    pub fn mistake(&self, place: Option<Place>, what: impl Into<String>) -> Mistake {
        Mistake {
            file: self.file.to_owned(),
            place: place.or_else(|| Some(self.head())),
            what: what.into(),
        }
    }

    fn mistake_at(&self, span: Option<Range<usize>>, what: impl Into<String>) -> Mistake {
        Mistake::at(self.file, self.text, span, what)
    }

    fn take_value(&mut self, key: &str) -> Option<Spanned<DeValue<'a>>> {
        self.known.push(key.to_owned());
        self.left.remove(key)
    }

    fn as_table(
        &self,
        key: &str,
        value: Spanned<DeValue<'a>>,
        expected: &str,
    ) -> Result<Self, Mistake> {
        let span = value.span();
        match value.into_inner() {
            DeValue::Table(table) => Ok(self.below(key, table, span)),
            other => {
                let found = match other.type_str() {
                    of @ ("integer" | "array") => format!("an {of}"),
                    of => format!("a {of}"),
                };
                let what = format!("{key}: expected {expected}, found {found}");
                Err(self.mistake_at(Some(span), what))
            }
        }
    }

    fn below(&self, key: &str, left: DeTable<'a>, span: Range<usize>) -> Self {
        let dot = if self.path.is_empty() { "" } else { "." };
        Self {
            file: self.file,
            text: self.text,
            path: format!("{}{dot}{key}", self.path),
            left,
            span,
            known: Vec::new(),
        }
    }

    fn collect(&self, path: &str, table: &DeTable<'a>, places: &mut BTreeMap<String, Place>) {
        for (key, value) in table {
            let path = match path {
                "" => key.get_ref().to_string(),
                path => format!("{path}.{}", key.get_ref()),
            };
            if let DeValue::Table(table) = value.get_ref() {
                self.collect(&path, table, places);
            }
            places.insert(path, line_and_column(self.text, key.span().start));
        }
    }
}

/// The keys of a section.
pub fn keys_of<T: Serialize>(section: &T) -> Vec<String> {
    match serde_json::to_value(section) {
        Ok(Value::Object(fields)) => fields.into_iter().map(|(key, _)| key).collect(),
        _ => Vec::new(),
    }
}
