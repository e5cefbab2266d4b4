//! Matrices in CSV files: numbers without header, comma separated, `#` for comments.

use super::error::{FileError, shown};
use super::text;
use crate::matrix::{Matrix, SparseMatrix};
use std::path::Path;

/// The matrix in a CSV file.
pub(super) fn matrix(path: &Path) -> Result<SparseMatrix, FileError> {
    let text = text::read(path, text::CSV_SIZE_LIMIT)?;
    let name = path.display().to_string();
    let bad = |line: usize, message: String| FileError::Csv {
        path: name.clone(),
        line,
        message,
    };
    let mut reader = csv::ReaderBuilder::new()
        .has_headers(false)
        .flexible(true)
        .comment(Some(b'#'))
        .trim(csv::Trim::All)
        .from_reader(text.as_bytes());
    let (mut data, mut rows, mut width) = (Vec::new(), 0, 0);
    for record in reader.records() {
        let record = record.map_err(|e| {
            let line = e.position().map_or(0, |p| p.line() as usize);
            bad(line, e.to_string())
        })?;
        let line = record.position().map_or(0, |p| p.line() as usize);
        if rows == 0 {
            width = record.len();
        } else if record.len() != width {
            return Err(bad(
                line,
                format!("{} numbers, the first line has {width}", record.len()),
            ));
        }
        for (j, field) in record.iter().enumerate() {
            let value = field.parse::<f64>().map_err(|_| {
                let field = shown(field);
                bad(
                    line,
                    format!("column {}: \"{field}\" is not a number", j + 1),
                )
            })?;
            data.push(value);
        }
        rows += 1;
    }
    Ok(Matrix::new(rows, width, data)?.into())
}
