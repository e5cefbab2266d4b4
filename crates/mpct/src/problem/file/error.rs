//! What can be wrong with a problem file.

use crate::error::DesignError;
use thiserror::Error;

/// Longest piece of a file that is repeated in a message.
const SHOWN: usize = 60;

/// A piece of a file as it may stand in a message: short, and without characters that steer a terminal.
pub(super) fn shown(text: &str) -> String {
    let mut short: String = text
        .chars()
        .take(SHOWN)
        .map(|c| if c.is_control() { '\u{fffd}' } else { c })
        .collect();
    if text.chars().nth(SHOWN).is_some() {
        short.push('…');
    }
    short
}

fn at(line: &Option<usize>) -> String {
    line.map_or(String::new(), |line| format!("line {line}: "))
}

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
    #[error("{}unknown key `{key}`{}; known here: {known}", at(line), suggestion.as_ref().map_or(String::new(), |s| format!(", did you mean `{s}`?")))]
    UnknownKey {
        /// The key with its path.
        key: String,
        /// The known key that looks most like it.
        suggestion: Option<String>,
        /// All keys known in that table.
        known: String,
        /// The line where it stands, from 1, when the text is at hand.
        line: Option<usize>,
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
    #[error("{}`{key}`: expected {expected}, found {found}", at(line))]
    WrongType {
        /// The key with its path.
        key: String,
        /// What is needed.
        expected: String,
        /// What stands there.
        found: String,
        /// The line where it stands, from 1, when the text is at hand.
        line: Option<usize>,
    },
    /// Rows of a matrix differ in length.
    #[error(
        "{}`{key}`: row {row} has {found} entries, row 0 has {expected}",
        at(line)
    )]
    Ragged {
        /// The key with its path.
        key: String,
        /// The row, 0-based.
        row: usize,
        /// Entries of row 0.
        expected: usize,
        /// Entries of that row.
        found: usize,
        /// The line where it stands, from 1, when the text is at hand.
        line: Option<usize>,
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

impl FileError {
    /// Fills in the line, which `find` looks up from the parts of the key.
    pub(super) fn with_line(mut self, find: impl Fn(&[&str]) -> Option<usize>) -> Self {
        let (key, line, row) = match &mut self {
            Self::UnknownKey { key, line, .. } | Self::WrongType { key, line, .. } => {
                (key, line, None)
            }
            Self::Ragged { key, line, row, .. } => (key, line, Some(*row)),
            _ => return self,
        };
        let path = key.replace('[', ".[");
        let mut parts: Vec<&str> = path.split('.').collect();
        let row = row.map(|row| format!("[{row}]"));
        parts.extend(row.as_deref());
        *line = find(&parts);
        self
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_of_files_are_short_and_plain() {
        assert_eq!(shown("state_lowr"), "state_lowr");
        assert_eq!(shown("\u{1b}[31mred\n"), "\u{fffd}[31mred\u{fffd}");
        assert_eq!(shown(&"é".repeat(60)), "é".repeat(60));
        assert_eq!(shown(&"é".repeat(61)), "é".repeat(60) + "…");
    }
}
