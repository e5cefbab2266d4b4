//! Walks a TOML table and keeps the path of keys for messages.

use super::error::{FileError, shown};
use crate::matrix::{Matrix, SparseMatrix};
use crate::problem::Weight;
use std::path::Path;
use toml::{Table, Value};

/// A table of the file with its path, and the keys it may have.
pub(super) struct Section<'a> {
    path: String,
    table: &'a Table,
    folder: &'a Path,
}

/// Most rows or columns of a sparse matrix: twice the carts of the largest case. A few bytes must not ask for a
/// terabyte.
const MAX_ORDER: f64 = 200_000.0;

type Found<T> = Result<Option<T>, FileError>;

fn kind(value: &Value) -> String {
    match value {
        Value::String(s) => format!("the text \"{}\"", shown(s)),
        Value::Integer(i) => format!("the number {i}"),
        Value::Float(f) => format!("the number {f}"),
        Value::Boolean(b) => format!("{b}"),
        Value::Datetime(_) => "a date".into(),
        Value::Array(a) => format!("a list of {}", a.len()),
        Value::Table(_) => "a table".into(),
    }
}

fn number(value: &Value) -> Option<f64> {
    match value {
        Value::Float(f) => Some(*f),
        Value::Integer(i) => Some(*i as f64),
        _ => None,
    }
}

impl<'a> Section<'a> {
    pub(super) fn root(table: &'a Table, folder: &'a Path) -> Self {
        Self {
            path: String::new(),
            table,
            folder,
        }
    }

    /// The key with its path.
    pub(super) fn key(&self, name: &str) -> String {
        if self.path.is_empty() {
            name.into()
        } else {
            format!("{}.{name}", self.path)
        }
    }

    fn wrong(&self, name: &str, expected: impl Into<String>, found: &Value) -> FileError {
        FileError::WrongType {
            key: self.key(name),
            expected: expected.into(),
            found: kind(found),
            line: None,
        }
    }

    /// Refuses keys that are not among `known`.
    pub(super) fn only(&self, known: &[&str]) -> Result<(), FileError> {
        match self.table.keys().find(|k| !known.contains(&k.as_str())) {
            None => Ok(()),
            Some(key) => {
                let typed = key.to_lowercase();
                // Two letters exchanged in a short key look less alike than they are.
                let likeness = |k: &str| {
                    let slip =
                        typed.len() > 1 && strsim::osa_distance(&typed, &k.to_lowercase()) == 1;
                    let alike = strsim::jaro_winkler(&typed, &k.to_lowercase());
                    if slip { alike.max(0.8) } else { alike }
                };
                let closest = known
                    .iter()
                    .filter(|k| key.len() <= 4 * k.len())
                    .map(|k| (likeness(k), k))
                    .max_by(|a, b| a.0.total_cmp(&b.0))
                    .filter(|c| c.0 > 0.7);
                Err(FileError::UnknownKey {
                    key: self.key(&shown(key)),
                    suggestion: closest.map(|c| self.key(c.1)),
                    known: known.join(", "),
                    line: None,
                })
            }
        }
    }

    fn missing(&self, name: &str, meaning: &str) -> FileError {
        FileError::MissingKey {
            key: self.key(name),
            meaning: meaning.into(),
        }
    }

    pub(super) fn section(&self, name: &str) -> Found<Section<'a>> {
        match self.table.get(name) {
            None => Ok(None),
            Some(Value::Table(table)) => Ok(Some(Section {
                path: self.key(name),
                table,
                folder: self.folder,
            })),
            Some(other) => Err(self.wrong(name, format!("a table, [{}]", self.key(name)), other)),
        }
    }

    pub(super) fn need_section(&self, name: &str, meaning: &str) -> Result<Section<'a>, FileError> {
        self.section(name)?
            .ok_or_else(|| self.missing(name, meaning))
    }

    /// An array of tables, `[[name]]`.
    pub(super) fn sections(&self, name: &str) -> Result<Vec<Section<'a>>, FileError> {
        let expected = || format!("tables, each headed [[{}]]", self.key(name));
        match self.table.get(name) {
            None => Ok(Vec::new()),
            Some(Value::Array(list)) => list
                .iter()
                .enumerate()
                .map(|(i, value)| match value {
                    Value::Table(table) => Ok(Section {
                        path: format!("{}[{i}]", self.key(name)),
                        table,
                        folder: self.folder,
                    }),
                    other => Err(self.wrong(name, expected(), other)),
                })
                .collect(),
            Some(other) => Err(self.wrong(name, expected(), other)),
        }
    }

    pub(super) fn text(&self, name: &str) -> Found<String> {
        match self.table.get(name) {
            None => Ok(None),
            Some(Value::String(s)) => Ok(Some(s.clone())),
            Some(other) => Err(self.wrong(name, "a text in quotes", other)),
        }
    }

    pub(super) fn texts(&self, name: &str) -> Found<Vec<String>> {
        match self.table.get(name) {
            None => Ok(None),
            Some(Value::Array(list)) => list
                .iter()
                .enumerate()
                .map(|(i, v)| match v {
                    Value::String(s) => Ok(s.clone()),
                    other => Err(self.wrong(&format!("{name}[{i}]"), "a text in quotes", other)),
                })
                .collect::<Result<_, _>>()
                .map(Some),
            Some(other) => Err(self.wrong(name, "a list of texts in quotes", other)),
        }
    }

    /// A text that is one of the given.
    pub(super) fn choice<T: Copy>(&self, name: &str, choices: &[(&str, T)]) -> Found<T> {
        let Some(text) = self.text(name)? else {
            return Ok(None);
        };
        match choices.iter().find(|c| c.0 == text) {
            Some(choice) => Ok(Some(choice.1)),
            None => Err(FileError::WrongType {
                key: self.key(name),
                expected: choices
                    .iter()
                    .map(|c| format!("\"{}\"", c.0))
                    .collect::<Vec<_>>()
                    .join(" or "),
                found: format!("\"{}\"", shown(&text)),
                line: None,
            }),
        }
    }

    pub(super) fn flag(&self, name: &str) -> Found<bool> {
        match self.table.get(name) {
            None => Ok(None),
            Some(Value::Boolean(b)) => Ok(Some(*b)),
            Some(other) => Err(self.wrong(name, "true or false", other)),
        }
    }

    pub(super) fn number(&self, name: &str) -> Found<f64> {
        match self.table.get(name) {
            None => Ok(None),
            Some(value) => number(value)
                .map(Some)
                .ok_or_else(|| self.wrong(name, "a number", value)),
        }
    }

    pub(super) fn whole(&self, name: &str) -> Found<usize> {
        match self.table.get(name) {
            None => Ok(None),
            Some(Value::Integer(i)) => usize::try_from(*i)
                .map(Some)
                .map_err(|_| self.wrong(name, "a whole number >= 0", &Value::Integer(*i))),
            Some(other) => Err(self.wrong(name, "a whole number >= 0", other)),
        }
    }

    /// A seed of 64 bits. TOML integers end at 2^63 - 1, so that larger ones stand in quotes.
    pub(super) fn seed(&self, name: &str) -> Found<u64> {
        match self.table.get(name) {
            Some(Value::String(digits)) => match digits.parse() {
                Ok(seed) => Ok(Some(seed)),
                Err(_) => Err(self.wrong(
                    name,
                    "a whole number from 0 to 2^64 - 1",
                    &Value::String(digits.clone()),
                )),
            },
            _ => Ok(self.whole(name)?.map(|seed| seed as u64)),
        }
    }

    pub(super) fn need_whole(&self, name: &str, meaning: &str) -> Result<usize, FileError> {
        self.whole(name)?.ok_or_else(|| self.missing(name, meaning))
    }

    pub(super) fn vector(&self, name: &str) -> Found<Vec<f64>> {
        match self.table.get(name) {
            None => Ok(None),
            Some(Value::Array(list)) => list
                .iter()
                .enumerate()
                .map(|(i, v)| {
                    number(v).ok_or_else(|| self.wrong(&format!("{name}[{i}]"), "a number", v))
                })
                .collect::<Result<_, _>>()
                .map(Some),
            Some(other) => Err(self.wrong(name, "a list of numbers", other)),
        }
    }

    pub(super) fn need_vector(&self, name: &str, meaning: &str) -> Result<Vec<f64>, FileError> {
        self.vector(name)?
            .ok_or_else(|| self.missing(name, meaning))
    }

    pub(super) fn matrix(&self, name: &str) -> Found<SparseMatrix> {
        match self.table.get(name) {
            None => Ok(None),
            Some(Value::Array(rows)) => self.nested(name, rows).map(Some),
            Some(Value::Table(table)) => Section {
                path: self.key(name),
                table,
                folder: self.folder,
            }
            .matrix_table()
            .map(Some),
            Some(other) => Err(self.wrong(
                name,
                "a matrix: rows [[…], […]], { csv = \"file\" } or { shape = [n, m], entries = [[i, j, v], …] }",
                other,
            )),
        }
    }

    pub(super) fn need_matrix(&self, name: &str, meaning: &str) -> Result<SparseMatrix, FileError> {
        self.matrix(name)?
            .ok_or_else(|| self.missing(name, meaning))
    }

    /// `[[1, 2], [3, 4]]`.
    fn nested(&self, name: &str, rows: &[Value]) -> Result<SparseMatrix, FileError> {
        let mut data = Vec::new();
        let mut width = 0;
        for (i, row) in rows.iter().enumerate() {
            let Value::Array(row) = row else {
                return Err(self.wrong(&format!("{name}[{i}]"), "a row: a list of numbers", row));
            };
            if i == 0 {
                width = row.len();
            } else if row.len() != width {
                return Err(FileError::Ragged {
                    key: self.key(name),
                    row: i,
                    expected: width,
                    found: row.len(),
                    line: None,
                });
            }
            for (j, v) in row.iter().enumerate() {
                data.push(
                    number(v)
                        .ok_or_else(|| self.wrong(&format!("{name}[{i}][{j}]"), "a number", v))?,
                );
            }
        }
        Ok(Matrix::new(rows.len(), width, data)?.into())
    }

    /// `{ csv = … }` or `{ shape = …, entries = … }`.
    fn matrix_table(&self) -> Result<SparseMatrix, FileError> {
        self.only(&["csv", "shape", "entries"])?;
        if let Some(file) = self.text("csv")? {
            if let Some(other) = ["shape", "entries"]
                .iter()
                .find(|k| self.table.contains_key(**k))
            {
                return Err(FileError::WrongType {
                    key: self.key(other),
                    expected: "either csv or shape and entries".into(),
                    found: "both".into(),
                    line: None,
                });
            }
            return super::csv::matrix(&self.folder.join(file));
        }
        let shape = self.need_vector(
            "shape",
            "[rows, columns] of a sparse matrix, or csv = \"file\"",
        )?;
        let whole = |v: f64| v >= 0.0 && v.fract() == 0.0 && v <= MAX_ORDER;
        let [rows, columns] = shape[..] else {
            return Err(FileError::WrongType {
                key: self.key("shape"),
                expected: "[rows, columns]".into(),
                found: format!("{} numbers", shape.len()),
                line: None,
            });
        };
        if !(whole(rows) && whole(columns)) {
            return Err(FileError::WrongType {
                key: self.key("shape"),
                expected: format!("two whole numbers up to {MAX_ORDER}"),
                found: format!("[{rows}, {columns}]"),
                line: None,
            });
        }
        let list = match self.table.get("entries") {
            Some(Value::Array(list)) => list,
            Some(other) => {
                return Err(self.wrong("entries", "a list of [row, column, value]", other));
            }
            None => return Err(self.missing("entries", "a list of [row, column, value], 0-based")),
        };
        let mut entries = Vec::with_capacity(list.len());
        for (k, entry) in list.iter().enumerate() {
            let numbers: Vec<f64> = match entry {
                Value::Array(e) => e.iter().filter_map(number).collect(),
                _ => Vec::new(),
            };
            match numbers[..] {
                [i, j, v] if whole(i) && whole(j) => entries.push((i as usize, j as usize, v)),
                _ => {
                    return Err(self.wrong(
                        &format!("entries[{k}]"),
                        "[row, column, value] with whole row and column",
                        entry,
                    ));
                }
            }
        }
        let (rows, columns) = (rows as usize, columns as usize);
        SparseMatrix::from_triplets(rows, columns, &entries).map_err(|error| FileError::WrongType {
            key: self.key("entries"),
            expected: format!("entries inside {rows} x {columns}"),
            found: error.to_string(),
            line: None,
        })
    }

    /// A scalar, a diagonal or a matrix.
    pub(super) fn weight(&self, name: &str) -> Found<Weight> {
        match self.table.get(name) {
            None => Ok(None),
            Some(Value::Array(list))
                if !list.is_empty() && list.iter().all(|v| number(v).is_some()) =>
            {
                Ok(self.vector(name)?.map(Weight::Diagonal))
            }
            Some(Value::Array(_) | Value::Table(_)) => Ok(self.matrix(name)?.map(Weight::Matrix)),
            Some(value) => number(value)
                .map(|w| Some(Weight::Scalar(w)))
                .ok_or_else(|| self.wrong(name, "a number, a list (diagonal) or a matrix", value)),
        }
    }

    pub(super) fn need_weight(&self, name: &str, meaning: &str) -> Result<Weight, FileError> {
        self.weight(name)?
            .ok_or_else(|| self.missing(name, meaning))
    }
}
