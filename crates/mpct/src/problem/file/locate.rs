//! Where in the text a key stands. Only asked for once something is wrong.

use toml::de::{DeTable, DeValue};

/// Line and column, from 1, of a byte of the text.
pub(super) fn position(text: &str, offset: usize) -> (usize, usize) {
    let before = &text.as_bytes()[..offset.min(text.len())];
    let line = before.iter().filter(|&&b| b == b'\n').count() + 1;
    let start = before.iter().rposition(|&b| b == b'\n');
    (line, before.len() - start.map_or(0, |p| p + 1) + 1)
}

/// The line of a key such as `["simulation", "setpoint", "[2]", "state"]`; for a key that is missing, none.
pub(super) fn line_of(text: &str, key: &[&str]) -> Option<usize> {
    let root = DeTable::parse(text).ok()?;
    let (first, rest) = key.split_first()?;
    let (name, value) = root.get_ref().get_key_value(*first)?;
    let mut at = name.span().start;
    let mut value = value.get_ref();
    for part in rest {
        match value {
            DeValue::Table(table) => {
                let (name, next) = table.get_key_value(*part)?;
                at = name.span().start;
                value = next.get_ref();
            }
            DeValue::Array(list) => {
                let index = part.strip_prefix('[')?.strip_suffix(']')?;
                let next = list.get(index.parse::<usize>().ok()?)?;
                at = next.span().start;
                value = next.get_ref();
            }
            _ => return None,
        }
    }
    Some(position(text, at).0)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str =
        "name = 'x'\n[plant]\nA = [\n  [1, 2],\n  [3],\n]\n[[s.p]]\nk = 1\n[[s.p]]\nk = 2\n";

    #[test]
    fn keys_are_found() {
        for (key, line) in [
            (&["name"][..], 1),
            (&["plant", "A"], 3),
            (&["plant", "A", "[1]"], 5),
            (&["plant", "A", "[0]", "[1]"], 4),
            (&["s", "p", "[1]", "k"], 10),
        ] {
            assert_eq!(line_of(TEXT, key), Some(line), "{key:?}");
        }
        assert_eq!(line_of(TEXT, &["plant", "B"]), None);
        assert_eq!(line_of(TEXT, &["plant", "A", "[7]"]), None);
    }

    #[test]
    fn positions_count_from_one() {
        assert_eq!(position("ab\ncd", 0), (1, 1));
        assert_eq!(position("ab\ncd", 4), (2, 2));
        assert_eq!(position("ab", 9), (1, 3));
    }
}
