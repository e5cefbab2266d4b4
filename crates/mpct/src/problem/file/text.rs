//! Reads text from files of unknown origin: what is not text, or too long, is refused before it costs memory.

use super::error::FileError;
use std::io::Read;
use std::path::Path;

/// Largest problem file that is read, in bytes. A parsed file can take seventy-five times its size in memory, and
/// 100 000 carts in sparse form take half of this; a larger dense matrix belongs in a CSV file.
pub const SIZE_LIMIT: u64 = 64 << 20;

/// Largest CSV file that is read, in bytes: a dense matrix of order 3 600 with all digits.
pub const CSV_SIZE_LIMIT: u64 = 256 << 20;

/// Bytes looked at before anything else: garbage shows at once.
const FIRST_LOOK: u64 = 64 << 10;

/// The text of a file of at most `limit` bytes.
pub(super) fn read(path: &Path, limit: u64) -> Result<String, FileError> {
    let name = path.display().to_string();
    let unreadable = |e: std::io::Error| FileError::Unreadable {
        path: name.clone(),
        reason: e.to_string(),
    };
    let not_text = |offset| FileError::NotText {
        path: name.clone(),
        offset,
    };
    let too_large = |bytes| FileError::TooLarge {
        path: name.clone(),
        bytes,
        limit,
    };
    let mut file = std::fs::File::open(path).map_err(unreadable)?;
    let size = file.metadata().map_err(unreadable)?.len();
    let mut content = Vec::new();
    Read::by_ref(&mut file)
        .take(FIRST_LOOK)
        .read_to_end(&mut content)
        .map_err(unreadable)?;
    if let Some(offset) = content.iter().position(|&b| b == 0) {
        return Err(not_text(offset));
    }
    if let Err(e) = std::str::from_utf8(&content) {
        // A character may be cut at the end of the first look.
        if e.error_len().is_some() || (content.len() as u64) < FIRST_LOOK {
            return Err(not_text(e.valid_up_to()));
        }
    }
    if size > limit {
        return Err(too_large(size));
    }
    // A pipe does not say how long it is: one byte more than allowed shows that it is too long.
    file.take((limit + 1).saturating_sub(content.len() as u64))
        .read_to_end(&mut content)
        .map_err(unreadable)?;
    let read = content.len() as u64;
    if read > limit {
        return Err(too_large(read));
    }
    String::from_utf8(content).map_err(|e| not_text(e.utf8_error().valid_up_to()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn refused(content: &[u8], limit: u64) -> FileError {
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), content).unwrap();
        read(file.path(), limit).unwrap_err()
    }

    #[test]
    fn what_is_not_text_is_refused_with_its_offset() {
        for (content, at) in [(&b"ab\0c"[..], 2), (b"abc\xff\xff", 3), (b"ab\xc3", 2)] {
            let error = refused(content, 100);
            assert!(matches!(error, FileError::NotText { offset, .. } if offset == at));
        }
    }

    #[test]
    fn garbage_after_the_first_look_is_refused_too() {
        let mut content = vec![b'#'; FIRST_LOOK as usize];
        content.push(0xff);
        let error = refused(&content, 1 << 20);
        assert!(matches!(error, FileError::NotText { offset, .. } if offset == 65536));
    }

    #[test]
    fn a_character_across_the_end_of_the_first_look_is_text() {
        let mut content = vec![b'#'; FIRST_LOOK as usize - 1];
        content.extend("é".as_bytes());
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), &content).unwrap();
        assert_eq!(read(file.path(), 1 << 20).unwrap().len(), content.len());
    }

    #[test]
    fn the_limit_is_the_largest_size_that_is_read() {
        let error = refused(b"12345", 4);
        assert!(matches!(
            error,
            FileError::TooLarge {
                bytes: 5,
                limit: 4,
                ..
            }
        ));
        let file = tempfile::NamedTempFile::new().unwrap();
        std::fs::write(file.path(), b"12345").unwrap();
        assert_eq!(read(file.path(), 5).unwrap(), "12345");
    }

    #[test]
    fn files_that_are_not_there_are_unreadable() {
        let error = read(Path::new("no/such/file.toml"), 10).unwrap_err();
        assert!(matches!(error, FileError::Unreadable { .. }));
        assert!(error.to_string().contains("no/such/file.toml"));
    }
}
