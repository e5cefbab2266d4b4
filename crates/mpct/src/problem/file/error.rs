//! What can be wrong with a problem file.

use crate::error::DesignError;
use thiserror::Error;

/// Why a problem file was refused. Keys are written with their path, `constraints.state_lower`.
#[derive(Clone, Debug, PartialEq, Error)]
#[non_exhaustive]
pub enum FileError {
    /// The file, or a file it names, cannot be read.
    #[error("cannot read {path}: {reason}")]
    Unreadable {
        /// The file.
        path: String,
        /// What the system says.
        reason: String,
    },
    /// The file is larger than any problem file should be.
    #[error("{path} has {bytes} bytes; problem files up to {limit} bytes are read")]
    TooLarge {
        /// The file.
        path: String,
        /// Its size.
        bytes: u64,
        /// The limit.
        limit: u64,
    },
    /// The file is not text.
    #[error("{path} is not a text file: byte {offset} is not UTF-8 text")]
    NotText {
        /// The file.
        path: String,
        /// Offset of the first byte that is not text.
        offset: usize,
    },
    /// The text is not TOML.
    #[error("line {line}, column {column}: {message}")]
    Syntax {
        /// Line, from 1.
        line: usize,
        /// Column, from 1.
        column: usize,
        /// What the parser says.
        message: String,
    },
    /// A key that means nothing.
    #[error("unknown key `{key}`{}; known here: {known}", suggestion.as_ref().map_or(String::new(), |s| format!(", did you mean `{s}`?")))]
    UnknownKey {
        /// The key with its path.
        key: String,
        /// The known key that looks most like it.
        suggestion: Option<String>,
        /// All keys known in that table.
        known: String,
    },
    /// A key that is needed.
    #[error("missing key `{key}`: {meaning}")]
    MissingKey {
        /// The key with its path.
        key: String,
        /// What it states.
        meaning: String,
    },
    /// A value of the wrong kind.
    #[error("`{key}`: expected {expected}, found {found}")]
    WrongType {
        /// The key with its path.
        key: String,
        /// What is needed.
        expected: String,
        /// What stands there.
        found: String,
    },
    /// Rows of a matrix differ in length.
    #[error("`{key}`: row {row} has {found} entries, row 0 has {expected}")]
    Ragged {
        /// The key with its path.
        key: String,
        /// The row, 0-based.
        row: usize,
        /// Entries of row 0.
        expected: usize,
        /// Entries of that row.
        found: usize,
    },
    /// A CSV file named in the problem file has something else than numbers.
    #[error("{path}, line {line}: {message}")]
    Csv {
        /// The CSV file.
        path: String,
        /// Line, from 1.
        line: usize,
        /// What is wrong.
        message: String,
    },
    /// The file is well formed, but what it states is not a problem.
    #[error(transparent)]
    Problem(#[from] DesignError),
}
